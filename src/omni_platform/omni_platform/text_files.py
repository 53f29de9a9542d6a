"""Reading of text files that a user names."""

import errno
import stat
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
