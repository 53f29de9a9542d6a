"""CPU time of the simulation of a vehicle; only this module of the package reads a clock.

CPU time is used because elapsed time depends on the load of the machine. The vehicles are run
alternately, so that changes of the processor speed affect all of them.
"""

import dataclasses
import time
from collections.abc import Mapping

import numpy as np

from omni_core.quantities import FloatArray
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.wheels.trials import TRIALS, advance, start

_TRIALS = (
    dataclasses.replace(TRIALS["drive"], command=(2.0, 1.0, 0.3)),
    dataclasses.replace(TRIALS["brake_gently"], duration=1.5),
)
DURATION = sum(trial.duration for trial in _TRIALS)
"""Simulated time of one run [s]."""


def processor_times(
    configurations: Mapping[str, VehicleConfiguration], repeats: int
) -> dict[str, FloatArray]:
    """Return the CPU time of simulating each vehicle, which drives along a curve and then brakes.

    Args:
        configurations: the vehicles, keyed by name.
        repeats: number of runs.

    Returns:
        CPU time of each run [s], shape (repeats,), in the order of the runs; keyed by vehicle.
    """
    times: dict[str, list[float]] = {name: [] for name in configurations}
    for _ in range(repeats):
        for name, configuration in configurations.items():
            spent = 0.0
            for trial in _TRIALS:
                vehicle = start(configuration, trial, 0.1)
                advance(vehicle, trial, 0.0)  # loads the kernel
                begin = time.process_time()
                advance(vehicle, trial, trial.duration)
                spent += time.process_time() - begin
            times[name].append(spent)
    return {name: np.array(spent) for name, spent in times.items()}
