"""Exit codes of commands and nodes."""

import enum


class ExitCode(enum.IntEnum):
    """Exit code of a process."""

    OK = 0
    FAILED = 1
    REFUSED = 2
    """Rejected before anything started, for example because of an invalid configuration"""
    INTERRUPTED = 130
    """Ended by Ctrl-C"""
    TERMINATED = 143
    """Ended by SIGTERM"""
