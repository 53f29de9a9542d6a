"""Start of a node's process; a signal during the imports ends it without a traceback.

The executables of the packages start the modules that their entry points of the group
``omni_nodes`` name.
"""

import importlib
import os
import signal
import sys
from importlib.metadata import entry_points
from pathlib import Path


def start_lightly() -> None:
    """Disable slow imports and threads; called before numpy is imported.

    numba would import the tool that measures test coverage. Numpy and SciPy each have an OpenBLAS,
    which would start threads that wait actively at first; no matrix here is large enough for them.
    """
    sys.modules.setdefault("coverage", None)  # type: ignore[arg-type]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def start_node(module: str) -> None:
    """Import the module of a node, run its ``main`` and exit with the code that it returns.

    Imports take a second, in which Ctrl-C would print a traceback.

    Args:
        module: full name, such as ``omni_sim.simulator_node``.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    start_lightly()
    code = importlib.import_module(module).main()
    # All is flushed and closed. The clean-up of the interpreter would take a second.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def main() -> None:
    """Run the node of the executable that was started."""
    (entry,) = entry_points(group="omni_nodes", name=Path(sys.argv[0]).name)
    start_node(entry.module)
