"""The exit codes of commands and nodes."""

import enum


class ExitCode(enum.IntEnum):
    """Exit code of a process."""

    OK = 0
    FAILED = 1
    REFUSED = 2
    """Refused before anything started, such as an invalid configuration"""
    INTERRUPTED = 130
    """Ended by Ctrl-C"""
    TERMINATED = 143
    """Ended by SIGTERM"""
