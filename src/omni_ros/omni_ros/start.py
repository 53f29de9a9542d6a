"""The start of a node's process: a signal ends it quietly, also while it still imports."""

from __future__ import annotations

import importlib
import os
import signal
import sys


def start_node(module: str) -> None:
    """Import the module of a node and run its ``main``.

    Imports take a second, in which Ctrl-C would print a traceback.

    Args:
        module: full name, such as ``omni_sim.simulator_node``.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    # numba imports the tool that measures coverage of tests if it finds it: a tenth of the start.
    sys.modules.setdefault("coverage", None)  # type: ignore[arg-type]
    try:
        importlib.import_module(module).main()
    except SystemExit as end:
        if isinstance(end.code, int):
            # All is said and closed: what the interpreter tidies up besides takes a second.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end.code)
        raise
