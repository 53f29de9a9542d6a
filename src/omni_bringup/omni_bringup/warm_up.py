"""Compile every kernel and render the ground of the standard experiment in advance.

Started by the launcher after a build; the results are in the caches on disk. Two processes compile
in parallel. Shared kernels are compiled by one of them before, because numba's cache has no lock.
"""

import dataclasses
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context

import numpy as np

from linescan_odometry.odometry import LineScanOdometry
from omni_brake_assist.assist_step import make_constants, new_memory
from omni_brake_assist.brake_assist import BrakeAssist
from omni_brake_assist.laws import built_in
from omni_brake_assist.laws.law import Motion
from omni_bringup.workspace import workspace_folder
from omni_loop import compiled, experiment, loop
from omni_platform.geometry import PlatformGeometry
from omni_sim.simulator import Simulator

_EXPERIMENT = "straight_line"
_DURATION = 0.1  # [s] simulated; long enough to brake
_OWN_LAW = "omni_brake_assist.laws.sliding_mode:SlidingMode"  # as one from outside is asked


def _vehicle_and_laws(configuration: experiment.ExperimentConfiguration) -> None:
    geometry = PlatformGeometry.from_wheels(configuration.brake_assist.wheels)
    wheels = len(geometry.names)
    constants, memory = make_constants(configuration.brake_assist, geometry), new_memory(wheels)
    motion = Motion(True, 0.01, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, np.ones(wheels))
    built_in.step(constants.laws, memory.laws, motion, np.zeros(wheels), np.ones(wheels))
    simulator = Simulator(configuration)
    simulator.observe()
    simulator.advance(np.ones(wheels))
    simulator.observe()


def _fail_safe_and_observer(configuration: experiment.ExperimentConfiguration) -> None:
    BrakeAssist(dataclasses.replace(configuration.brake_assist, law=_OWN_LAW))


def _line_odometry(configuration: experiment.ExperimentConfiguration) -> None:
    LineScanOdometry(configuration.odometry).warm_up()
    # Lines of 16 bits take other kernels.
    deep = dataclasses.replace(configuration.camera, bit_depth=16)
    for camera in (configuration.camera, deep):
        loop.run_closed_loop(dataclasses.replace(configuration, camera=camera))


def _loop_of_campaigns(configuration: experiment.ExperimentConfiguration) -> None:
    BrakeAssist(configuration.brake_assist)
    compiled.run_fast_loop(dataclasses.replace(configuration, feedback="velocity_sensor"))


# One after the other; the tasks of a stage side by side.
_STAGES: tuple[tuple[Callable[[experiment.ExperimentConfiguration], None], ...], ...] = (
    (_fail_safe_and_observer, _vehicle_and_laws),
    (_loop_of_campaigns, _line_odometry),
)


def _standard_run() -> experiment.ExperimentConfiguration:
    library = experiment.ExperimentLibrary(workspace_folder() / "config")
    variant = library.variants(_EXPERIMENT)[-1]
    short = (f"simulation.duration_limit={_DURATION}", f"maneuver.brake_time={_DURATION / 2}")
    return library.load(_EXPERIMENT, variant, short)


def every_task() -> list[Callable[[], None]]:
    """Return the functions that compile the kernels, in the order of their dependencies."""
    configuration = _standard_run()
    return [partial(task, configuration) for stage in _STAGES for task in stage]


def warm_up() -> None:
    """Run a short part of the standard experiment and of each of its components."""
    configuration = _standard_run()
    begin, done = time.monotonic(), 0
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for stage in _STAGES:
            tasks = {pool.submit(task, configuration): task.__name__ for task in stage}
            for task in as_completed(tasks):
                task.result()
                done += 1
                share, name = done / sum(map(len, _STAGES)), tasks[task].strip("_")
                elapsed = time.monotonic() - begin
                words = f"{share:.0%} of the kernels: {name.replace('_', ' ')}, {elapsed:.0f} s"
                print(words, flush=True)


if __name__ == "__main__":
    warm_up()
    sys.exit(0)
