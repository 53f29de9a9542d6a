"""Finds a usable Python.

Any Python 3 must parse this file and `omni`, so that an old Python prints a message instead of a
syntax error. These two files therefore use no f-strings, no annotated variables and no new modules.
"""

# ruff: noqa: UP032

import shutil
import subprocess
import sys

SUPPORTED = tuple((3, minor) for minor in (12, 13, 11, 10, 14))  # in order of preference
INSTALL_PYTHON = (
    "install it (on Debian 12, Ubuntu 22.04 or later: "
    "'sudo apt install python3 python3-venv') and start again"
)


def say(text: str) -> None:
    """Print a line about the set-up to stderr, because stdout is for the command's output."""
    sys.stderr.write("omni: " + text + "\n")
    sys.stderr.flush()


def find_python(versions: "tuple[tuple[int, int], ...]") -> "str | None":
    """Return the path of the first Python of `versions` that starts; None if none starts."""
    for version in versions:
        name = "python{}.{}".format(*version)
        path = shutil.which(name)
        probe = "import sys; sys.exit(sys.version_info[:2] != {!r})".format(tuple(version))
        try:
            # A name on the PATH may be a version manager's shim for a version that is not
            # installed.
            if path and not subprocess.call(
                [path, "-c", probe], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            ):
                return path
        except OSError:
            continue
    return None


def refuse() -> int:
    """Print that no usable Python was found; return the exit code."""
    old = tuple(sys.version_info[:2]) < min(SUPPORTED)
    say(
        "Python {}.{} is too {}, this needs Python 3.10 to 3.14: {}.".format(
            sys.version_info[0], sys.version_info[1], "old" if old else "new", INSTALL_PYTHON
        )
    )
    return 1
