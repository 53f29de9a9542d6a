"""Stops with other rates of the IMU and other control periods.

The stop of ``straight_line`` and random fault-free stops are repeated under each law. A stop is
compared with the stop that has one IMU reading in each control period of 10 ms. The density of the
IMU's noise is the same at all rates. In ``straight_line``, the velocity sensor has a rate of 50 Hz:
with an exact twist in every period, no decision would depend on the IMU. A longer control period
delays the brakes by half of the difference; this time, multiplied by the initial speed, is
subtracted from the change of the distance.
"""

import itertools
from functools import partial
from typing import NamedTuple

import numpy as np

from omni_core.configuration import parameter
from omni_core.quantities import CONTROL_PERIOD, FloatArray
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.metrics import Metric
from omni_studies.campaign.random_braking import ALLOWED, RandomBraking, draw, without
from omni_studies.campaign.sensor_faults import LAWS
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions, digest

_CONDITIONS: dict[str, tuple[str, float]] = {
    "imu_50_hz": ("imu.rate=50", CONTROL_PERIOD),
    "imu_100_hz": ("imu.rate=100", CONTROL_PERIOD),
    "imu_400_hz": ("imu.rate=400", CONTROL_PERIOD),
    "imu_1000_hz": ("imu.rate=1000", CONTROL_PERIOD),
    "period_5_ms": ("simulation.control_period=0.005", 0.005),
    "period_20_ms": ("simulation.control_period=0.02", 0.02),
}
"""Changed value and control period [s], keyed by condition."""
_USUAL = "imu.rate=0"
# Limits on the changes under `allocation`: of distance [1] and rotation [deg] of straight_line, and
# of their medians in the random stops.
_LIMITS = {"imu": (0.01, 0.5), "period": (0.03, 1.0)}


class Options(CampaignOptions):
    """Options of the study ``rates``: number of random stops, and worker processes."""

    random: int = parameter(40, minimum=0, maximum=1_000_000)
    """number of random stops under each law"""
    seed: int = parameter(96_000_000, minimum=0)
    """seed of the first random stop"""


class RateTrial(NamedTuple):
    """Result of one stop under one law and condition.

    Attributes:
        seed: number of the trial. Each stop has one trial for each of `_CASES`.
        distance: stopping distance [m].
        rotation: change of orientation while braking [deg].
        speed: initial speed [m/s].
    """

    seed: int
    distance: float
    rotation: float
    speed: float


_CASES = tuple(itertools.product(LAWS, ("", *_CONDITIONS)))
"""Law, and condition or an empty text for the usual rates."""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run all stops; report the changes of distance and rotation."""
    work = partial(_run_trial, study.experiments, options.seed)
    numbers = range((1 + options.random) * len(_CASES))
    fingerprint = digest(_CASES, options.seed, [draw(seed) for seed in range(20)])
    trials = study.campaign(work, numbers, RateTrial, options, fingerprint)
    if len(trials) < len(numbers):
        return study.result({}, f"{len(trials)} of {len(numbers)} stops were run.")
    shape = 1 + options.random, len(LAWS), 1 + len(_CONDITIONS)
    distance, rotation, speed = (
        np.reshape([getattr(trial, name) for trial in trials], shape)
        for name in ("distance", "rotation", "speed")
    )
    metrics: dict[str, Metric] = {}
    for i, law in enumerate(LAWS):
        usual = distance[:, i, 0]
        for k, (name, (_, period)) in enumerate(_CONDITIONS.items(), start=1):
            lost = speed[:, i, k] * max(period - CONTROL_PERIOD, 0.0) / 2.0
            longer = (distance[:, i, k] - lost - usual) / np.maximum(usual, ALLOWED.shortest)
            turned = rotation[:, i, k] - rotation[:, i, 0]
            metrics |= _metrics(f"{law}_{name}", longer, turned)
    return study.result(metrics)


def _metrics(case: str, longer: FloatArray, turned: FloatArray) -> dict[str, Metric]:
    """Return the metrics of a law and condition.

    Args:
        case: law and condition.
        longer: changes of the distance [1], first of ``straight_line``, shape (n,).
        turned: changes of the rotation [deg], shape (n,).
    """
    limits: tuple[float | None, float | None] = None, None
    if case.startswith("allocation"):
        limits = _LIMITS["imu" if "imu" in case else "period"]
    metrics = {
        f"distance_change.{case}": Metric(abs(float(longer[0])), "1", at_most=limits[0]),
        f"rotation_change.{case}": Metric(abs(float(turned[0])), "deg", at_most=limits[1]),
    }
    if len(longer) > 1:
        medians = [float(np.median(np.abs(values[1:]))) for values in (longer, turned)]
        metrics |= {
            f"random_mean_change.{case}": Metric(float(np.mean(longer[1:])), "1"),
            f"random_change.{case}": Metric(medians[0], "1", at_most=limits[0]),
            f"random_rotation.{case}": Metric(medians[1], "deg", at_most=limits[1]),
        }
    return metrics


def _run_trial(library: ExperimentLibrary, first: int, number: int) -> RateTrial:
    """Run the trial with a number; `first` is the seed of the first random stop."""
    stop, case = divmod(number, len(_CASES))
    law, condition = _CASES[case]
    change = _CONDITIONS[condition][0] if condition else _USUAL
    changes = (*LAWS[law], change)
    if stop == 0:
        plain = ("feedback=velocity_sensor", "velocity_sensor.sample_time=0.02", *changes)
        configuration = library.load("straight_line", "assisted", plain)
    else:
        drawn = without(draw(first + stop - 1), "failure")
        configuration = RandomBraking(library, changes).configurations(drawn)["assisted"]
    run = run_fast_loop(configuration)
    speed = configuration.maneuver.speed
    return RateTrial(number, run.stopping_distance, run.orientation_change, speed)
