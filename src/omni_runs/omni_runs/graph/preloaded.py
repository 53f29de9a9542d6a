"""Modules and kernels of the nodes, loaded by the process from which nodes are forked.

Import this module only there. An error is ignored here, since the node itself reports it.
"""

import contextlib
import gc
import importlib
import inspect
import os

import numpy as np

from omni_core.background import ALONE
from omni_core.commands.workspace import workspace_folder
from omni_ros.start import start_lightly
from omni_runs.graph.fork_server import nodes, replaced

_USUAL = ("recorder", "odometry", "brake_assist", "simulator")  # nodes of `omni run`
# Modules that nodes import in their work.
_IMPORTED_LATE = ("numpy.ma", "rosbags.typesys.stores.ros2_jazzy")


def _load_kernels() -> None:
    """Load the stored kernels of standard nodes, which would take each node 0.05 to 0.2 s."""
    from linescan_odometry.odometry import LineScanOdometry
    from omni_brake_assist.brake_assist import BrakeAssist
    from omni_core.compilation.cache import NotStoredError, stored_only
    from omni_runs.experiment import ExperimentLibrary
    from omni_sim.simulator import Simulator

    library = ExperimentLibrary(workspace_folder() / "config")
    usual = library.load("straight_line")
    blind = ("simulation.render_lines=false", "feedback=velocity_sensor")
    simulated = library.load("straight_line", overrides=blind)
    with stored_only(), replaced(os.environ, ALONE, "1"):
        with contextlib.suppress(NotStoredError):
            LineScanOdometry(usual.odometry).warm_up()
        with contextlib.suppress(NotStoredError):
            BrakeAssist(usual.brake_assist)
        with contextlib.suppress(NotStoredError):
            simulator = Simulator(simulated)
            simulator.observe()
            simulator.advance(np.ones(len(usual.vehicle.wheels)))
            simulator.observe()


os.setpgrp()  # Ctrl-C reaches only the process that ends the nodes
start_lightly()
for _name in (*(entry.module for entry in nodes() if entry.name in _USUAL), *_IMPORTED_LATE):
    with contextlib.suppress(Exception):
        importlib.import_module(_name)
# With its first kernel, numba compiles functions of its own.
importlib.import_module("omni_sim.ground.friction").FrictionMap().at(0.0, 0.0)
with contextlib.suppress(Exception):
    _load_kernels()
inspect.getframeinfo(inspect.currentframe())  # type: ignore[arg-type] # finds the files of modules
gc.freeze()
