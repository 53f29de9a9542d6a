"""Start of the process of a node.

A signal during the imports ends the process without a traceback. For each executable of a package,
an entry point of the group `NODES` names the module to run.
"""

import atexit
import gc
import importlib
import os
import signal
import sys
from importlib.metadata import entry_points
from pathlib import Path

NODES = "omni_nodes"
"""Group of entry points, each of which names the module that an executable runs."""

_COLLECTION_THRESHOLD = 50_000  # number of new objects per garbage collection of 2 ms


def start_lightly() -> None:
    """Disable slow imports and threads; call this function before numpy is imported if possible.

    numba would import the coverage tool, and the message packages would import a message generator.
    NumPy and SciPy each contain an OpenBLAS library. Each library would start threads that wait
    actively at first, but no matrix of the nodes is large enough to need these threads. Frequent
    garbage collections would take a tenth of the import time and free nothing. Garbage collections
    at the exit of the interpreter would take 0.3 s.
    """
    gc.set_threshold(_COLLECTION_THRESHOLD)
    atexit.register(gc.freeze)
    for unneeded in ("coverage", "rosidl_parser.parser"):
        sys.modules.setdefault(unneeded, None)  # type: ignore[arg-type]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def start_node(module: str) -> None:
    """Import the module of a node, run ``main`` of this module, and exit with the returned code.

    The imports take a second, in which Ctrl-C would otherwise print a traceback.

    Args:
        module: full name of the module, such as ``omni_sim.simulator_node``.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    start_lightly()
    code = importlib.import_module(module).main()
    # Everything is flushed and closed; the clean-up of the interpreter would take a second.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def main() -> None:
    """Run the node that belongs to the started executable."""
    # A renamed package and the new one may both declare the executable, of the same module.
    entry, *_ = entry_points(group=NODES, name=Path(sys.argv[0]).name)
    start_node(entry.module)
