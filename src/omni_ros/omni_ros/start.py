"""The start of a process: of a node, which a signal ends quietly also while it still imports."""

from __future__ import annotations

import importlib
import os
import signal
import sys


def without_coverage() -> None:
    """Keep numba from importing the tool that measures coverage of tests: a tenth of a start."""
    sys.modules.setdefault("coverage", None)  # type: ignore[arg-type]


def start_node(module: str) -> None:
    """Import the module of a node and run its ``main``.

    Imports take a second, in which Ctrl-C would print a traceback.

    Args:
        module: full name, such as ``omni_sim.simulator_node``.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    without_coverage()
    try:
        importlib.import_module(module).main()
    except SystemExit as end:
        if isinstance(end.code, int):
            # All is said and closed: what the interpreter tidies up besides takes a second.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end.code)
        raise
