"""The start of a node's process: a signal ends it quietly, also while it still imports."""

from __future__ import annotations

import importlib
import os
import signal


def start_node(module: str) -> None:
    """Import the module of a node and run its ``main``.

    Imports take a second, in which Ctrl-C would print a traceback.

    Args:
        module: full name, such as ``omni_sim.simulator_node``.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    importlib.import_module(module).main()
