"""Text files that a user names, and folders in which the user can write."""

import errno
import os
import stat
import tempfile
from pathlib import Path


def read_text(path: Path, encoding: str = "utf-8") -> str:
    """Return the content of a text file.

    Raises:
        OSError: the file cannot be read, or is a pipe, a device or another special file;
            `strerror` is the reason.
        UnicodeDecodeError: the file is not text.
    """
    # Opening a pipe would wait forever, and reading a device would never end.
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return path.read_text(encoding=encoding)


def user_folder(name: str, *wanted: Path | str) -> Path:
    """Return a folder in which this user can write; it is created if it does not exist.

    Args:
        name: name of the folder if it is in the directory for temporary files.
        wanted: folders to use if possible, the first one first; ``~`` is the home folder.

    Returns:
        The first of `wanted` that can be used; otherwise a folder in the directory for temporary
        files. All users share this directory, so the name of the folder contains the user's number,
        and a folder or link of this name that another user has made is not used.
    """
    shared = Path(tempfile.gettempdir(), f"{name}_{os.getuid()}")
    for folder in (*wanted, shared):
        try:
            path = Path(folder).expanduser()
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            foreign = path == shared and path.lstat().st_uid != os.getuid()
        except (OSError, RuntimeError):  # RuntimeError: the home folder is unknown
            continue
        if os.access(path, os.W_OK | os.X_OK) and not foreign:
            return path
    return Path(tempfile.mkdtemp(prefix=f"{name}_"))
