"""Compilation of kernels and rendering of the standard ground in advance.

The launcher starts this program after a build, at the same time as the first command. The program
compiles the kernels of ``omni run``. Processes share the compiled kernels
(`omni_core.compilation.cache`). With ``--all`` the program also compiles the kernels for
campaigns, 16-bit lines and external control laws, which otherwise are compiled at their first use.
"""

import sys

import numpy as np

from linescan_odometry.odometry import LineScanOdometry
from omni_brake_assist.brake_assist import BrakeAssist
from omni_core.commands.workspace import workspace_folder
from omni_runs import compiled, experiment, loop
from omni_sim.simulator import Simulator

_EXPERIMENT = "straight_line"
_OWN_LAW = "omni_brake_assist.laws.sliding_mode:SlidingMode"  # the name of an external law


def compile_for_run(configuration: experiment.ExperimentConfiguration) -> None:
    """Compile the kernels of the nodes.

    The kernels of the odometry take the longest, so they are compiled first. Meanwhile, the other
    nodes of a run that has already begun compile their own kernels.
    """
    LineScanOdometry(configuration.odometry).warm_up()
    simulator = Simulator(configuration)
    simulator.observe()
    simulator.advance(np.ones(len(configuration.vehicle.wheels)))
    simulator.observe()
    BrakeAssist(configuration.brake_assist)


def compile_others(configuration: experiment.ExperimentConfiguration) -> None:
    """Compile the kernels for campaigns, 16-bit lines, and external control laws."""
    compiled.run_fast_loop(experiment.changed(configuration, feedback="velocity_sensor"))
    loop.run_closed_loop(experiment.changed(configuration, camera={"bit_depth": 16}))
    BrakeAssist(experiment.changed(configuration.brake_assist, law=_OWN_LAW))


def standard_run() -> experiment.ExperimentConfiguration:
    """Return a short part of the standard experiment."""
    library = experiment.ExperimentLibrary(workspace_folder() / "config")
    short = ("simulation.duration_limit=0.1", "maneuver.brake_time=0.05")
    return library.load(_EXPERIMENT, overrides=short)


if __name__ == "__main__":
    configuration = standard_run()
    compile_for_run(configuration)
    if "--all" in sys.argv:
        compile_others(configuration)
