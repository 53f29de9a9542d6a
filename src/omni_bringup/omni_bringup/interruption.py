"""What Ctrl-C and SIGTERM do to a command."""

from __future__ import annotations

import os
import signal

from omni_bringup.exit_codes import EXIT_TERMINATED

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def leave_at_once_on_signals() -> None:
    """End without a word of Python's while there is nothing to clean up.

    An exception out of a signal handler would meet an import half way, and not every extension
    module passes it on as what it is.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as a shell has it for background jobs
            signal.signal(number, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)  # the launcher holds them back


def clean_up_on_signals() -> None:
    """Raise `KeyboardInterrupt` or `SystemExit` from now on, since there is something to end.

    To be called after the last import; see `leave_at_once_on_signals`.
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
    raise SystemExit(EXIT_TERMINATED)
