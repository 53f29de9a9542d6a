"""Sideslip angle of a wheel, measured by one line camera along its axis (section 4.6).

A wheel rolls over two grounds with constant sideslip angles from -15 to 15 deg at several speeds.
The camera measures the sideways velocity. The forward velocity is either the true velocity or the
rim speed of a wheel with 1 % longitudinal slip.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter

from linescan_odometry.configuration import SideslipWheel
from linescan_odometry.sideslip import SideslipConfiguration, SideslipMeter
from omni_core.configuration import ConfigurationError, parameter
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_sim.texture.texture import GroundTexture
from omni_studies import line_options
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import Rig

_WHEEL, _CAMERA = "wheel", "camera"
_DRAWN_SPEED = 10.0  # speed at which errors are drawn as a function of the angle [m/s]


@dataclasses.dataclass(frozen=True, eq=False)
class Angles:
    """True and measured sideslip angles at one speed.

    Attributes:
        speed: speed of the wheel over ground [m/s].
        overlap: overlap of consecutive lines across the camera's axis at zero sideslip angle, 0 to
            1.
        truth: sideslip angles [rad], shape (A,).
        angle: measured angles [rad], NaN if unmeasured, shape (A, batches).
        sideways: measured sideways velocities [m/s], NaN if unmeasured, shape (A, batches).
    """

    speed: float
    overlap: float
    truth: FloatArray
    angle: FloatArray
    sideways: FloatArray

    @property
    def error(self) -> FloatArray:
        """Measured minus true angle [rad], NaN if unmeasured, shape (A, batches)."""
        return self.angle - self.truth[:, None]

    @property
    def measured_share(self) -> float:
        """Share of the batches with a measured angle, 0 to 1."""
        return float(np.mean(np.isfinite(self.angle)))

    @property
    def rms_error(self) -> float:
        """Root mean square of the errors [rad], NaN if nothing was measured."""
        return root_mean_square(self.error)

    def rms_error_with(self, wheel_speed: float) -> float:
        """Return the RMS error of the angle [rad] that an incorrect forward velocity causes.

        Args:
            wheel_speed: ratio of the rim speed, which is used as the forward velocity, to the true
                forward velocity, such as 0.99 for a wheel that slips.
        """
        forward = wheel_speed * self.speed * np.cos(self.truth)
        return root_mean_square(-np.arctan(self.sideways / forward[:, None]) - self.truth[:, None])


def root_mean_square(values: FloatArray) -> float:
    """Return the RMS of the finite values, NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else math.nan


def camera_at_a_wheel(name: str, sensor: LineSensor) -> SideslipConfiguration:
    """Return the configuration of a camera at the contact of a wheel, parallel to the wheel's axis.

    Args:
        name: name of the camera.
        sensor: the camera; its position and heading are replaced.

    Raises:
        ConfigurationError: the lines of the camera are too short, or its line rate is too low.
    """
    return SideslipConfiguration(
        sensors={name: dataclasses.replace(sensor, x=0.0, y=0.0, heading_deg=90.0)},
        sideslip={_WHEEL: SideslipWheel(sensor=name, x=0.0, y=0.0)},
    )


class RollingWheel:
    """A wheel that rolls over a ground, with a line camera parallel to the axle of the wheel."""

    def __init__(self, sensor: LineSensor, texture: GroundTexture, noise: float, seed: int) -> None:
        """Place the camera of the wheel over a ground.

        Args:
            sensor: camera, placed at the contact of the wheel and parallel to the wheel's axis.
            texture: the ground.
            noise: standard deviation of the camera noise [gray levels].
            seed: seed of the noise.
        """
        self._configuration = camera_at_a_wheel(_CAMERA, sensor)
        self._sensor = self._configuration.sensors[_CAMERA]
        self._size = texture.size
        self._rig = Rig({_CAMERA: self._sensor}, texture, noise, seed)

    def measure(
        self,
        speed: float,
        angles: FloatArray,
        places: int,
        batches: int,
        generator: np.random.Generator,
    ) -> Angles:
        """Return the angles measured with the true forward velocity from random positions.

        Args:
            speed: speed of the wheel over ground [m/s].
            angles: sideslip angles [rad], shape (A,).
            places: number of random positions for each angle.
            batches: number of batches of 10 ms from each position.
            generator: random generator for the positions.
        """
        found = np.full((2, len(angles), places * batches), math.nan)
        for i, angle in enumerate(angles):
            # A positive angle is a slide to the right, toward -y.
            twist = speed * np.array([math.cos(angle), -math.sin(angle), 0.0])
            for place in range(places):
                meter = SideslipMeter(self._configuration, _WHEEL)
                start = np.append(generator.uniform(0.0, self._size, 2), 0.0)
                for batch, seen in enumerate(self._rig.drive(start, twist, batches)):
                    estimate = meter.update(seen[_CAMERA], float(twist[0]))
                    if estimate.measured:
                        column = place * batches + batch
                        found[:, i, column] = estimate.angle, estimate.sideways
        overlap = max(0.0, 1.0 - speed / self._sensor.line_rate / self._sensor.width)
        return Angles(speed, overlap, np.array(angles), *found)


_SENSORS = ("generic", "s3901")
_SPEEDS = (1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 120.0)  # [m/s]
_ANGLES = np.radians(np.arange(-15.0, 15.1, 2.5))

SideslipCase = tuple[str, str]  # ground, sensor


class Options(line_options.TextureOptions):
    """Options of the study ``sideslip``: grounds, random positions, sensors and seed."""

    ground: tuple[str, ...] = line_options.grounds_option("cork", "asphalt")
    runs: int = line_options.runs_option(2, " for every angle, measured for 40 ms each")
    sensors: tuple[str, ...] = parameter(_SENSORS)
    """a file of config/sensors/ whose first camera is used"""
    noise: float = line_options.noise_option()
    slipping: float = parameter(0.99, above=0.0, maximum=2.0)
    """ratio of wheel speed to forward velocity for the wheel that slips"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Simulate the wheel at every angle and speed; write figure, data and metrics."""
    grounds = line_options.grounds_of(options, study.experiments)
    cameras = {name: _camera(study.experiments, name) for name in options.sensors}
    trials: dict[SideslipCase, list[Angles]] = {}
    for ground, texture in grounds.items():
        for name, camera in cameras.items():
            wheel = RollingWheel(camera, texture, options.noise, options.seed)
            generator = np.random.default_rng(options.seed)
            trials[ground, name] = [
                wheel.measure(speed, _ANGLES, options.runs, 4, generator) for speed in _SPEEDS
            ]
    fastest = {name: camera.sideways_speed for name, camera in cameras.items()}
    note = "forward, at 60 % overlap across the camera's axis"
    metrics = _metrics(trials, options.slipping) | {
        f"overlap_limited_speed.{name}": Metric(speed, "m/s", note=note)
        for name, speed in fastest.items()
    }
    study.plot("sideslip", draw_sideslip(trials, fastest, options.slipping))
    return study.result(metrics)


def _camera(library: ExperimentLibrary, name: str) -> LineSensor:
    cameras = library.sensors(name)
    if not cameras:
        raise ConfigurationError("sensors", f"{name} names no camera")
    place, camera = next(iter(cameras.items()))
    camera_at_a_wheel(place, camera)  # raises an error before anything is rendered
    return camera


def _metrics(trials: Mapping[SideslipCase, Sequence[Angles]], slipping: float) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    slip = f"wheel slip of {100.0 * (1.0 - slipping):g} %"
    for (ground, name), found in trials.items():
        for angles in found:
            case = f"{ground}_{name}_{angles.speed:g}"
            note = "" if angles.measured_share else f"the overlap is {angles.overlap:.0%}"
            error = math.degrees(angles.rms_error), math.degrees(angles.rms_error_with(slipping))
            metrics |= {
                f"rms_error.{case}": Metric(error[0], "deg", note=note),
                f"rms_error_slipping.{case}": Metric(error[1], "deg", note=slip),
                f"measured_share.{case}": Metric(angles.measured_share, "1"),
            }
    return metrics


_MARKERS = ("o", "s", "^", "D")


def draw_sideslip(
    trials: Mapping[SideslipCase, Sequence[Angles]], fastest: Mapping[str, float], slipping: float
) -> Figure:
    """Draw RMS errors versus speed and, at one speed, errors versus the true angle.

    Args:
        trials: trials for each ground and sensor, by increasing speed.
        fastest: speed at 60 % overlap of consecutive lines [m/s], keyed by sensor.
        slipping: ratio of wheel speed to forward velocity of a wheel that slips, such as 0.99.
    """
    title = "Sideslip angle of a wheel from one line camera along its axis of rotation"
    x = ("speed of the wheel [m/s]", "true sideslip angle [deg]")
    figure, ((left, right),) = style.panels(
        title, 1, 2, size=(12.0, 5.6), x=x, width_ratios=(1.15, 1.0)
    )
    _draw_speeds(left, trials, fastest)
    _draw_angles(right, trials, _DRAWN_SPEED)
    truth = next(iter(trials.values()))[0].truth
    fine = np.linspace(truth[0], truth[-1], 201)
    slip = np.degrees(np.arctan(np.tan(fine) / slipping) - fine)
    right.plot(np.degrees(fine), slip, color=style.BLACK, linewidth=1.2, linestyle="--")
    share = f"{100.0 * (1.0 - slipping):.0f} % slip of the wheel"
    right.plot([], [], color=style.BLACK, linewidth=1.2, linestyle="--", label=f"bias by {share}")
    level = math.degrees(math.sqrt(float(np.mean(np.radians(slip) ** 2))))
    left.axhline(level, color=style.BLACK, linewidth=1.2, linestyle="--", label=f"RMS of {share}")
    for axes in (left, right):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=1)
    return figure


def _draw_speeds(
    axes: Axes, trials: Mapping[SideslipCase, Sequence[Angles]], fastest: Mapping[str, float]
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for case, look in _looks(trials).items():
        errors = [math.degrees(angles.rms_error) for angles in trials[case]]
        dashes = "-" if case[1] == next(iter(fastest)) else ":"
        speeds = [angles.speed for angles in trials[case]]
        axes.plot(speeds, errors, dashes, linewidth=1.6, markersize=5.0, **look)
    for sensor, speed in fastest.items():
        axes.axvline(speed, color=style.GRAY, linewidth=1.0)
        words, units = f"{sensor}: 60 %\noverlap", ("data", "axes fraction")
        style.note(axes, words, (speed, 0.98), (-4, 0), xycoords=units, ha="right", va="top")
    speeds = [angles.speed for angles in next(iter(trials.values()))]
    axes.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
    axes.minorticks_off()
    errors = [math.degrees(angles.rms_error) for found in trials.values() for angles in found]
    axes.set_ylim(0.01, max([2.0, *(1.3 * error for error in errors if math.isfinite(error))]))
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.set_title("RMS over -15 to 15 deg, batches of 10 ms; no point: not measured")
    axes.set_ylabel("RMS error [deg]")


def _looks(trials: Mapping[SideslipCase, Sequence[Angles]]) -> dict[SideslipCase, dict[str, Any]]:
    """Return the style of each curve: color of its ground, marker of its sensor, and label."""
    grounds = list(dict.fromkeys(ground for ground, _ in trials))
    sensors = list(dict.fromkeys(sensor for _, sensor in trials))
    return {
        (ground, sensor): {
            "color": style.wheel_color(grounds.index(ground)),
            "marker": _MARKERS[sensors.index(sensor) % len(_MARKERS)],
            "label": f"{ground}, {sensor}",
        }
        for ground, sensor in trials
    }


def _draw_angles(axes: Axes, trials: Mapping[SideslipCase, Sequence[Angles]], speed: float) -> None:
    width = 0.9 / len(trials)
    for i, (case, look) in enumerate(_looks(trials).items()):
        angles = min(trials[case], key=lambda a: abs(a.speed - speed))
        error = np.degrees(angles.error)
        spread = np.repeat(np.degrees(angles.truth)[:, None], error.shape[1], axis=1)
        spread += width * (i - 0.5 * (len(trials) - 1))
        axes.plot(spread.ravel(), error.ravel(), linestyle="", alpha=0.5, ms=3.0, **look)
    axes.set_title(f"every batch at {speed:g} m/s")
    axes.set_ylabel("measured minus true angle [deg]")
