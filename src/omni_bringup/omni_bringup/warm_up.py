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
from omni_brake_assist.brake_assist import BrakeAssist
from omni_bringup.workspace import workspace_folder
from omni_loop import compiled, experiment, loop
from omni_sim.simulator import Simulator

_EXPERIMENT = "straight_line"
_DURATION = 0.1  # [s] simulated; long enough to brake
_OWN_LAW = "omni_brake_assist.laws.sliding_mode:SlidingMode"  # as one from outside is asked


def _assistant(configuration: experiment.ExperimentConfiguration) -> None:
    for law in (_OWN_LAW, configuration.brake_assist.law):
        BrakeAssist(dataclasses.replace(configuration.brake_assist, law=law))


def _vehicle_and_odometry(configuration: experiment.ExperimentConfiguration) -> None:
    simulator = Simulator(configuration)
    simulator.observe()
    simulator.advance(np.ones(len(configuration.vehicle.wheels)))
    simulator.observe()
    LineScanOdometry(configuration.odometry).warm_up()


def _loop_of_lines(configuration: experiment.ExperimentConfiguration) -> None:
    # Lines of 16 bits take other kernels.
    deep = dataclasses.replace(configuration.camera, bit_depth=16)
    for camera in (configuration.camera, deep):
        loop.run_closed_loop(dataclasses.replace(configuration, camera=camera))


def _loop_of_campaigns(configuration: experiment.ExperimentConfiguration) -> None:
    compiled.run_fast_loop(dataclasses.replace(configuration, feedback="velocity_sensor"))


# One after the other; the tasks of a stage side by side.
_STAGES: tuple[tuple[Callable[[experiment.ExperimentConfiguration], None], ...], ...] = (
    (_vehicle_and_odometry, _assistant),
    (_loop_of_campaigns, _loop_of_lines),
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
