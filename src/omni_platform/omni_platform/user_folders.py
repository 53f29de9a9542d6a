"""Folders for the files of the user who runs a program, also of a user without a home folder."""

import os
import tempfile
from pathlib import Path


def user_folder(name: str, *wanted: Path | str) -> Path:
    """Return a folder in which this user can write; it is created if it does not exist.

    Args:
        name: name of the folder if it is in the directory for temporary files.
        wanted: folders to use if possible, the first one first; ``~`` is the home folder.

    Returns:
        The first of `wanted` that can be used; otherwise a folder in the directory for temporary
        files. All users share this directory, so the name of the folder contains the user's number.
    """
    for folder in (*wanted, Path(tempfile.gettempdir(), f"{name}_{os.getuid()}")):
        try:
            path = Path(folder).expanduser()
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # RuntimeError: the home folder is unknown
            continue
        if os.access(path, os.W_OK | os.X_OK):
            return path
    return Path(tempfile.mkdtemp(prefix=f"{name}_"))
