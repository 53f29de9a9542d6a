"""Sideslip angle of a wheel from one line camera along its axis of rotation (section 4.6).

A wheel rolls straight on at angles of sideslip from -15 to 15 deg and several speeds over two
grounds. The camera measures the sideways velocity, the forward velocity is given: once the true
one, and once that of a wheel whose omega R is 1 % too small, because it brakes a little.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omni_figures.data_table import write_table
from omni_figures.style import save_figure
from omni_loop.experiment import ExperimentLibrary
from omni_loop.metrics import Metric
from omni_platform.configuration import ConfigurationError, parameter
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_studies.line_trials.options import (
    TextureOptions,
    grounds_of,
    grounds_option,
    noise_option,
    runs_option,
)
from omni_studies.line_trials.sideslip_figures import draw_sideslip
from omni_studies.line_trials.sideslip_trials import (
    Angles,
    RollingWheel,
    camera_at_a_wheel,
    root_mean_square,
)
from omni_studies.study import StudyResult, StudyRun, claim

_SENSORS = ("generic", "s3901")
_SPEEDS = (1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 120.0)  # [m/s]
_ANGLES = np.radians(np.arange(-15.0, 15.1, 2.5))
_BATCHES = 4
_SLIPPING = 0.99  # wheel speed over forward velocity
_TOLERATED = math.radians(1.0)  # RMS error of an angle that counts as measured
_ENOUGH = 0.6  # overlap that the dissertation asks for
_SHOWN = 10.0  # [m/s], the speed whose errors are drawn over the angle

Case = tuple[str, str]  # ground, sensor


@dataclass(frozen=True, kw_only=True)
class Options(TextureOptions):
    """Grounds, their resolution, random places and seed."""

    ground: tuple[str, ...] = grounds_option("cork", "asphalt")
    runs: int = runs_option(2, "of 40 ms for every angle")
    sensors: tuple[str, ...] = parameter(
        _SENSORS, description="a file of config/sensors/ whose first camera is used"
    )
    noise: float = noise_option()


def run(options: Options, study: StudyRun) -> StudyResult:
    """Roll at every angle and speed; write figure, data and metrics."""
    grounds = grounds_of(options, study.experiments)
    cameras = {name: _camera(study.experiments, name) for name in options.sensors}
    trials: dict[Case, list[Angles]] = {}
    for ground, texture in grounds.items():
        for name, camera in cameras.items():
            wheel = RollingWheel(camera, texture, options.noise, options.seed)
            generator = np.random.default_rng(options.seed)
            trials[ground, name] = [
                wheel.measure(speed, _ANGLES, options.runs, _BATCHES, generator)
                for speed in _SPEEDS
            ]
    figure = draw_sideslip(
        trials, {name: _fastest(camera) for name, camera in cameras.items()}, _SHOWN, _SLIPPING
    )
    files = (
        save_figure(figure, study.folder / "sideslip.png"),
        _write(trials, study.folder / "sideslip.csv"),
    )
    findings = [_finding(case, found) for case, found in trials.items()]
    for name, camera in cameras.items():
        findings += _limits(name, camera, trials)
    return StudyResult(_metrics(trials), files, (*findings, _slip_finding(trials)))


def _camera(library: ExperimentLibrary, name: str) -> LineSensor:
    cameras = library.sensors(name)
    if not cameras:
        raise ConfigurationError("sensors", f"{name} names no camera")
    place, camera = next(iter(cameras.items()))
    camera_at_a_wheel(place, camera)  # refuses what cannot measure before anything is rendered
    return camera


def _fastest(camera: LineSensor) -> float:
    """Return the forward velocity at which 60 % of the lines overlap [m/s]."""
    return (1.0 - _ENOUGH) * camera.width * camera.line_rate


def _metrics(trials: Mapping[Case, Sequence[Angles]]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for (ground, name), found in trials.items():
        for angles in found:
            case = f"{ground}_{name}_{angles.speed:g}"
            note = "" if angles.measured_share else f"the overlap is {angles.overlap:.0%}"
            metrics |= {
                f"rms_error.{case}": Metric(math.degrees(angles.rms_error), "deg", note=note),
                f"measured_share.{case}": Metric(angles.measured_share, "1"),
            }
    return metrics


def _finding(case: Case, found: Sequence[Angles]) -> str:
    ground, name = case
    whole = [angles for angles in found if angles.measured_share == 1.0]
    by_speed = ", ".join(
        f"{math.degrees(angles.rms_error):.2g} deg at {angles.speed:g} m/s" for angles in whole
    )
    return claim(
        f"{ground}, {name}: one camera along the wheel's axis measures its sideslip angle (4.6)",
        f"RMS error from -15 to 15 deg {by_speed}" if whole else "at none of the speeds completely",
        holds=bool(whole) and max(angles.rms_error for angles in whole) <= _TOLERATED,
    )


def _limits(
    name: str, camera: LineSensor, trials: Mapping[Case, Sequence[Angles]]
) -> Iterator[str]:
    """Return the limits of the measurement at low and high speed, and where it fails."""
    whole: list[Angles] = []  # measured completely
    lost: list[float] = []  # speeds that are too high
    blind: dict[str, float] = {}  # highest share of the batches on grounds without such a speed
    for (ground, sensor), row in trials.items():
        if sensor != name:
            continue
        complete = [angles for angles in row if angles.measured_share == 1.0]
        if complete:
            slowest = min(angles.speed for angles in complete)
            lost += [a.speed for a in row if a.speed > slowest and a.measured_share < 1.0]
            whole += complete
        else:
            blind[ground] = max(angles.measured_share for angles in row)
    if whole:
        beyond = f", and at {min(lost):g} m/s lines are too unlike" if lost else ""
        yield (
            f"{name}: what limits it is {_low_speed(whole)}; at high speed that the wheel rolls "
            f"across the camera's axis: 60 % overlap is {_fastest(camera):.3g} m/s{beyond}."
        )
    if blind:
        yield (
            f"{name}: it does not measure reliably on {', '.join(blind)}, where at best "
            f"{100.0 * max(blind.values()):.3g} % of the batches give an angle."
        )


def _low_speed(whole: Sequence[Angles]) -> str:
    speed = min(angles.speed for angles in whole)
    # An angle this small is the velocity over the speed.
    velocity = 1e3 * speed * max(angles.rms_error for angles in whole if angles.speed == speed)
    words = (
        f"at low speed the camera's error in velocity, {velocity:.2g} mm/s at {speed:g} m/s, a "
        "smaller angle the faster the wheel rolls"
    )
    pulled = max(
        (a for a in whole if math.isfinite(a.bias)), key=lambda angles: angles.bias, default=None
    )
    if pulled is None or pulled.bias <= 0.5 * pulled.rms_error:
        return words
    return words + (
        f" (noise and, up to {math.degrees(pulled.bias):.2g} deg at {pulled.speed:g} m/s, the same "
        "at every place: the pull of coarse pixels)"
    )


def _slip_finding(trials: Mapping[Case, Sequence[Angles]]) -> str:
    largest = math.degrees(math.atan(math.tan(_ANGLES[-1]) / _SLIPPING) - _ANGLES[-1])
    worse = {
        case: [a.speed for a in found if a.rms_error_with(_SLIPPING) > 1.5 * a.rms_error]
        for case, found in trials.items()
    }
    from_on = ", ".join(
        f"{ground} {name} {min(speeds):g} m/s" for (ground, name), speeds in worse.items() if speeds
    )
    words = (
        f"A forward velocity from a wheel that slips by 1 % adds up to {largest:.2f} deg at 15 deg"
    )
    if from_on:
        words += f", and more than the camera's own error from these speeds on: {from_on}"
    return words + "; a braked wheel slips by several times that, so take the platform's twist."


def _write(trials: Mapping[Case, Sequence[Angles]], path: Path) -> Path:
    header = (
        "ground", "sensors", "speed_m_per_s", "overlap", "true_angle_deg", "mean_error_deg",
        "rms_error_deg", "stated_deviation_deg", "measured_share",
    )  # fmt: skip
    rows: Iterator[tuple[str | float, ...]] = (
        (ground, name, angles.speed, angles.overlap, *_row(*values))
        for (ground, name), found in trials.items()
        for angles in found
        for values in zip(angles.truth, angles.error, angles.deviation, strict=True)
    )
    return write_table(path, header, rows, digits=6)


def _row(truth: float, error: FloatArray, deviation: FloatArray) -> tuple[float, ...]:
    """Return an angle, mean and RMS of its errors, their stated deviation [deg], and the share."""
    seen = np.isfinite(error)
    return (
        math.degrees(truth),
        math.degrees(float(np.mean(error[seen]))) if seen.any() else math.nan,
        math.degrees(root_mean_square(error)),
        math.degrees(root_mean_square(deviation[seen])),
        float(np.mean(seen)),
    )
