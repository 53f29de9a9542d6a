"""Handling of Ctrl-C and SIGTERM by a command."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

from omni_core.commands.exit_codes import ExitCode

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def leave_at_once_on_signals() -> None:
    """Make signals end the process without a traceback while there is nothing to clean up.

    An exception raised by a signal handler could interrupt an import, and some extension modules
    replace such an exception by another one.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:  # a shell sets SIG_IGN for background jobs
            signal.signal(number, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)  # the launcher has blocked the signals


@contextmanager
def clean_up_on_signals() -> Iterator[None]:
    """Make signals raise `KeyboardInterrupt` or `SystemExit`, so that a command ends its nodes.

    The body of the `with` statement should not import large modules, because such an exception
    could interrupt an import. After the body, signals again end the process at once.
    """
    changed = [number for number in _SIGNALS if signal.getsignal(number) == _leave]
    for number in changed:
        signal.signal(number, _raise)
    try:
        yield
    finally:
        for number in changed:
            signal.signal(number, _leave)


def _leave(number: int, _: object) -> None:
    if number == signal.SIGINT:
        os.write(2, b"interrupted\n")
    os._exit(128 + number)


def _raise(number: int, _: object) -> None:
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(ExitCode.TERMINATED)
