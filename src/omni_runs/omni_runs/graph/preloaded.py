"""Modules of the nodes, imported by the process from which nodes are forked; import it only there.

An error of an import is ignored here, since the node itself reports it.
"""

import contextlib
import gc
import importlib
import inspect
import os

from omni_ros.start import start_lightly
from omni_runs.graph.fork_server import nodes

# Modules that nodes import in their work; numba.np.arraymath imports scipy.linalg.
_IMPORTED_LATE = ("numba.np.arraymath", "numpy.ma", "rosbags.typesys.stores.ros2_jazzy")

os.setpgrp()  # Ctrl-C reaches only the process that ends the nodes
start_lightly()
for _name in (*(entry.module for entry in nodes()), *_IMPORTED_LATE):
    with contextlib.suppress(Exception):
        importlib.import_module(_name)
# With its first kernel, numba compiles functions of its own.
importlib.import_module("omni_sim.ground.friction").FrictionMap().at(0.0, 0.0)
inspect.getframeinfo(inspect.currentframe())  # type: ignore[arg-type] # finds the files of modules
gc.freeze()
