"""Messages about a failed set-up: one sentence with the reason and a remedy."""

import errno
import re
import shutil
import subprocess
import sys
from pathlib import Path


class SetupError(Exception):
    """The set-up failed; the message is one sentence with a remedy."""


def check_platform(system: str, machine: str, libc: str, bits: int) -> None:
    """Raise an error if the ROS wheels do not support this machine.

    Args:
        system: Operating system, as returned by platform.system().
        machine: Processor architecture, as returned by platform.machine().
        libc: C library and version, such as 'glibc 2.36'.
        bits: Pointer size of this Python [bit].

    Raises:
        SetupError: The machine is not supported; the message states why.
    """
    remedy = "install and source ROS 2 Jazzy itself, or use a Debian or Ubuntu x86-64 machine"
    if system != "Linux":
        raise SetupError(f"ROS 2 for {system} cannot be set up here: {remedy}.")
    if machine not in ("x86_64", "AMD64"):
        raise SetupError(
            f"this processor is {machine} and the ROS 2 wheels are for x86-64: {remedy}."
        )
    if bits != 64:
        raise SetupError("this Python is a 32-bit one: start with a 64-bit Python 3.10 to 3.14.")
    version = re.match(r"glibc (\d+)\.(\d+)", libc)
    if not version or (int(version.group(1)), int(version.group(2))) < (2, 28):
        raise SetupError(
            "the ROS 2 wheels need glibc 2.28 or later and this system has {}: {}.".format(
                libc or "another C library", remedy
            )
        )


def check_venv_module(python: str) -> None:
    """Raise an error if a Python lacks the module venv, which is a separate package in Debian."""
    probe = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    if subprocess.call(
        [python, "-I", "-c", probe], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ):
        version = "{}.{}".format(*sys.version_info)
        named = re.search(r"3\.\d+$", python)
        raise SetupError(
            f"{python} lacks the venv module: install it (Debian, Ubuntu: "
            f"'sudo apt install python{named.group() if named else version}-venv') and start again."
        )


def check_space(folder: Path, needed: float) -> None:
    """Raise an error if the disk has less than `needed` [B] free."""
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise SetupError(
            f"set-up needs {needed / 1e9:.1f} GB of disk space and {folder} has "
            f"{free / 1e9:.1f} GB left: make room and start again."
        )


def explain_install(output: str, log: Path, step: str = "installing the packages") -> str:
    """Return a sentence that explains a failed installation.

    Args:
        output: Output of pip.
        log: Log file, which the sentence names.
        step: Name of the failed step, used if the output does not contain the reason.
    """
    network = (
        r"name resolution|new connection|Connection (?:refused|reset)|connection broken|"
        r"Max retries exceeded|timed out|Network is unreachable|ProxyError|RemoteDisconnected|"
        r"SSLError|CERTIFICATE_VERIFY|HTTP error|IncompleteRead|"
        r"setuptools==\S+ \(from versions: none\)"  # every reachable index has setuptools
    )
    if re.search(r"No space left on device", output):
        return f"the disk is full: make room and start again (details in {log})."
    if re.search(r"DO NOT MATCH THE HASHES", output):
        return (
            "a downloaded package is not the locked one: run 'python3 -m pip cache purge', check "
            f"the package index you use and start again (details in {log})."
        )
    if re.search(network, output):
        return (
            "no connection to the package index, which the first start needs: check the network "
            f"and start again, what has been downloaded is kept (details in {log})."
        )
    missing = re.search(r"No matching distribution found for (\S+)", output)
    if missing:
        return (
            f"there is no wheel of {missing.group(1)} for Python {sys.version_info[0]}."
            f"{sys.version_info[1]} on this machine: use another Python from "
            f"3.10 to 3.14 or a Debian or Ubuntu x86-64 machine (details in {log})."
        )
    return f"{step} failed: see {log} for the cause."


def explain_file_error(error: OSError, root: Path) -> str:
    """Return a sentence that explains why a file cannot be written or read."""
    place = error.filename or root
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "the disk is full: make room and start again."
    if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
        return f"{place} is not writable: copy this folder to a place where you may write."
    return f"{place}: {error.strerror or error}; correct that and start again."
