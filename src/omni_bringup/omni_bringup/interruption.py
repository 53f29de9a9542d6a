"""Handling of Ctrl-C and SIGTERM by a command."""

import os
import signal

from omni_platform.exit_codes import ExitCode

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


def clean_up_on_signals() -> None:
    """Make signals raise `KeyboardInterrupt` or `SystemExit`, so that a command ends its nodes.

    This function must be called after the last import, because such an exception could interrupt an
    import.
    """
    if signal.getsignal(signal.SIGINT) == _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGTERM) == _leave:
        signal.signal(signal.SIGTERM, _terminate)


def _leave(number: int, _: object) -> None:
    if number == signal.SIGINT:
        os.write(2, b"interrupted\n")
    os._exit(128 + number)


def _terminate(*_: object) -> None:
    raise SystemExit(ExitCode.TERMINATED)
