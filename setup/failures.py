"""Messages about a failed set-up: one sentence with the reason and a remedy."""

import errno
import re
import sys
from pathlib import Path

_REASONS = (  # a pattern in the output of uv, pip or venv, and what it means; the first one counts
    (r"No space left on device", "the disk is full: make room and start again"),
    (
        r"ensurepip is not available|No module named '?(?:venv|ensurepip)",
        "this Python has neither pip nor the module venv: install it (Debian, Ubuntu: "
        "'sudo apt install python{python}-venv') and start again",
    ),
    (
        r"Hash mismatch|DO NOT MATCH THE HASHES",
        "a downloaded package is not the locked one: delete .cache/uv and the caches of uv and "
        "pip, check the package index you use and start again",
    ),
    (
        r"Failed to initialize cache at `(.*)`",
        "the cache {0} cannot be written: set UV_CACHE_DIR to a folder where you may write",
    ),
    (
        r"invalid peer certificate|CERTIFICATE_VERIFY|SSLError",
        "the certificate of the package index is not trusted: set PIP_CERT to the file with the "
        "certificates of your network and start again",
    ),
    (
        r"ProxyError|tunnel error",
        "the proxy does not connect to the package index: correct HTTPS_PROXY, or 'proxy' in the "
        "settings of pip, and start again",
    ),
    (
        r"name resolution|new connection|Connection (?:refused|reset|broken)|Max retries exceeded|"
        r"timed out|Network is unreachable|HTTP error|IncompleteRead|error sending request|"
        r"Failed to (?:fetch|download)|\(from versions: none\)|not found in the package registry",
        "no connection to the package index, which the first start needs: check the network and "
        "start again, what has been downloaded is kept",
    ),
    (
        r"(?:Because(?: there is no version of)?|distribution found for) (\S+==\S+)",
        "there is no wheel of {0} for Python {python} on this machine: use another Python from "
        "3.10 to 3.14 or a Debian or Ubuntu x86-64 machine, or install and source ROS 2 Jazzy",
    ),
)


class SetupError(Exception):
    """The set-up failed; the message is one sentence with a remedy."""


def explain_install(output: str, log: Path, step: str) -> str:
    """Return a sentence that explains a failed installation.

    Args:
        output: Output of uv or pip.
        log: Log file, which the sentence names.
        step: Name of the failed step, used if the output does not contain the reason.
    """
    for pattern, sentence in _REASONS:
        found = re.search(pattern, " ".join(output.split()))  # uv wraps its lines
        if found:
            reason = sentence.format(*found.groups(), python="{}.{}".format(*sys.version_info))
            return f"{reason} (details in {log})."
    return f"{step} failed: see {log} for the cause."


def explain_file_error(error: OSError, root: Path) -> str:
    """Return a sentence that explains why a file cannot be written or read."""
    place = error.filename or root
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "the disk is full: make room and start again."
    if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
        return f"{place} is not writable: copy this folder to a place where you may write."
    return f"{place}: {error.strerror or error}; correct that and start again."
