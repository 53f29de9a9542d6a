"""Lock of the workspace: set-up holds it exclusively, and running commands share it."""

import errno
import fcntl
import os

from setup.pythons import say
from setup.workspace import Workspace


def open_lock(workspace: Workspace) -> int | None:
    """Return the descriptor of the workspace's lock file."""
    path = workspace.cache / "lock"
    try:
        workspace.cache.mkdir(exist_ok=True)
        return os.open(str(path), os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        if path.exists():  # the folder may have become read-only after a set-up
            return os.open(str(path), os.O_RDONLY)
        raise


def take_lock(lock: int | None, mode: int) -> None:
    """Take the lock in a mode of `fcntl.flock`; print a message before waiting for it.

    Do nothing if `lock` is None, or if the file system does not support locks.
    """
    if lock is None:
        return
    try:
        fcntl.flock(lock, mode | fcntl.LOCK_NB)
    except BlockingIOError:
        say("waiting for another start in this folder to finish")
        fcntl.flock(lock, mode)
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.EINVAL, errno.EBADF):
            raise  # on a file system without locks, set-up runs without one
