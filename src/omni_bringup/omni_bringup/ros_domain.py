"""A ROS domain of one's own for each run, so that two runs on one machine do not meet."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Domains 0-101 work with the default port range of every operating system; 0 is everybody's.
_DOMAINS = range(1, 102)


class NoFreeDomainError(RuntimeError):
    """Every ROS domain of this machine is taken by another run."""


@contextlib.contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other run of this machine's user holds.

    The reservation is a lock on a small file, which ends with the process that holds it.

    Yields:
        The domain's number; `ROS_DOMAIN_ID` itself where the user has set it.

    Raises:
        NoFreeDomainError: all domains are taken.
    """
    chosen = os.environ.get("ROS_DOMAIN_ID")
    if chosen:
        yield int(chosen)
        return
    folder = Path(tempfile.gettempdir()) / f"omni-ros-domains-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    # Starting at a place of one's own keeps two runs from racing for the same files.
    first = os.getpid() % len(_DOMAINS)
    for number in (*_DOMAINS[first:], *_DOMAINS[:first]):
        with (folder / str(number)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            yield number
            return
    raise NoFreeDomainError(
        f"all {len(_DOMAINS)} ROS domains are taken by other runs; end some of them, or choose one "
        "with ROS_DOMAIN_ID"
    )
