"""What simulating a vehicle costs: the one place of this package that reads the clock."""

from __future__ import annotations

import dataclasses
import math
import time

from omni_analysis.wheels.trials import TRIALS, go, start
from omni_sim.vehicle.configuration import VehicleConfiguration


def real_time_factor(configuration: VehicleConfiguration, repeats: int) -> float:
    """Return simulated over elapsed time, driving a curve and braking; the best of several runs.

    Args:
        configuration: the vehicle.
        repeats: number of runs.
    """
    trials = (
        dataclasses.replace(TRIALS["drive"], command=(2.0, 1.0, 0.3)),
        dataclasses.replace(TRIALS["brake_gently"], duration=1.5),
    )
    best = math.inf
    for _ in range(repeats):
        elapsed = 0.0
        for trial in trials:
            vehicle = start(configuration, trial, 0.1)
            go(vehicle, trial, 0.0)  # loads the kernel
            begin = time.perf_counter()
            go(vehicle, trial, trial.duration)
            elapsed += time.perf_counter() - begin
        best = min(best, elapsed)
    return sum(trial.duration for trial in trials) / best
