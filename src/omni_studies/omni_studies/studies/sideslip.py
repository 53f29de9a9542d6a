"""Sideslip angle of a wheel from one line camera along its axis of rotation (section 4.6).

A wheel rolls at constant angles of sideslip from -15 to 15 deg and several speeds over two
grounds. The camera measures the sideways velocity. The forward velocity is either the true one
or omega R of a wheel with 1 % longitudinal slip.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from omni_loop.experiment import ExperimentLibrary
from omni_loop.metrics import Metric
from omni_platform.configuration import ConfigurationError, parameter
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_studies.line_trials import options as line_options
from omni_studies.line_trials import sideslip_figures, sideslip_trials
from omni_studies.study import StudyResult, StudyRun

_SENSORS = ("generic", "s3901")
_SPEEDS = (1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 120.0)  # [m/s]
_ANGLES = np.radians(np.arange(-15.0, 15.1, 2.5))

Case = tuple[str, str]  # ground, sensor


class Options(line_options.TextureOptions):
    """Grounds, their resolution, random positions and seed."""

    ground: tuple[str, ...] = line_options.grounds_option("cork", "asphalt")
    runs: int = line_options.runs_option(2, "of 40 ms for every angle")
    sensors: tuple[str, ...] = parameter(_SENSORS)
    """a file of config/sensors/ whose first camera is used"""
    noise: float = line_options.noise_option()
    slipping: float = parameter(0.99, above=0.0, maximum=2.0)
    """wheel speed over forward velocity of the wheel that slips"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Roll at every angle and speed; write figure, data and metrics."""
    grounds = line_options.grounds_of(options, study.experiments)
    cameras = {name: _camera(study.experiments, name) for name in options.sensors}
    trials: dict[Case, list[sideslip_trials.Angles]] = {}
    for ground, texture in grounds.items():
        for name, camera in cameras.items():
            wheel = sideslip_trials.RollingWheel(camera, texture, options.noise, options.seed)
            generator = np.random.default_rng(options.seed)
            trials[ground, name] = [
                wheel.measure(speed, _ANGLES, options.runs, 4, generator) for speed in _SPEEDS
            ]
    figure = sideslip_figures.draw_sideslip(
        trials,
        {name: camera.sideways_speed for name, camera in cameras.items()},
        options.slipping,
    )
    metrics = _metrics(trials, options.slipping) | {
        f"overlap_limited_speed.{name}": Metric(
            camera.sideways_speed, "m/s", note="forward, at 60 % overlap across the camera's axis"
        )
        for name, camera in cameras.items()
    }
    study.figure("sideslip.png", figure)
    header = (
        "ground", "sensors", "speed_m_per_s", "overlap", "true_angle_deg", "mean_error_deg",
        "rms_error_deg", "stated_deviation_deg", "measured_share",
    )  # fmt: skip
    rows = (
        (ground, name, angles.speed, angles.overlap, *_row(*values))
        for (ground, name), found in trials.items()
        for angles in found
        for values in zip(angles.truth, angles.error, angles.deviation, strict=True)
    )
    study.table("sideslip.csv", header, rows, digits=6)
    return study.result(metrics)


def _camera(library: ExperimentLibrary, name: str) -> LineSensor:
    cameras = library.sensors(name)
    if not cameras:
        raise ConfigurationError("sensors", f"{name} names no camera")
    place, camera = next(iter(cameras.items()))
    sideslip_trials.camera_at_a_wheel(
        place, camera
    )  # refuses what cannot measure before anything is rendered
    return camera


def _metrics(
    trials: Mapping[Case, Sequence[sideslip_trials.Angles]], slipping: float
) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for (ground, name), found in trials.items():
        for angles in found:
            case = f"{ground}_{name}_{angles.speed:g}"
            note = "" if angles.measured_share else f"the overlap is {angles.overlap:.0%}"
            metrics |= {
                f"rms_error.{case}": Metric(math.degrees(angles.rms_error), "deg", note=note),
                f"rms_error_slipping.{case}": Metric(
                    math.degrees(angles.rms_error_with(slipping)),
                    "deg",
                    note=f"wheel slip of {100.0 * (1.0 - slipping):g} %",
                ),
                f"measured_share.{case}": Metric(angles.measured_share, "1"),
            }
    return metrics


def _row(truth: float, error: FloatArray, deviation: FloatArray) -> tuple[float, ...]:
    """Return an angle, mean and RMS of its errors, their stated deviation [deg], and the share."""
    seen = np.isfinite(error)
    return (
        math.degrees(truth),
        math.degrees(float(np.mean(error[seen]))) if seen.any() else math.nan,
        math.degrees(sideslip_trials.root_mean_square(error)),
        math.degrees(sideslip_trials.root_mean_square(deviation[seen])),
        float(np.mean(seen)),
    )
