"""Highest sideways speeds of the two sensors of Tables 3 and 4, computed and simulated.

Table 4 assumes 60 % overlap: ``v = 0.4 w f`` with the width w of the field of view and the line
rate f. Each sensor moves sideways over grounds of fine texture at increasing speeds. The median of
ten consecutive displacements (section 4.6) counts as correct if its error is below 1.5 px. A speed
counts as measurable if, at this speed and all lower speeds, 95 % of the medians at random positions
are correct. The highest speed is the speed at 60 % overlap if the simulation confirms it on every
ground. The study also reports the share of correct medians at this speed on difficult grounds, and
the share of usable pairs on all grounds.

Table 3 also lists the pixel clocks, from which the line rate follows as clock / pixels. According
to the table, the height of the image of the LIS-770i has five steps; it gives only the largest. The
study computes width and speed of the view for five equal steps.

A grating out of focus loses contrast; the study compares the simulated contrast with that of a
Gaussian blur.

The whole odometry is then tested with three cameras of each type at their highest speed, in forward
and in sideways motion.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from linescan_odometry.configuration import METHODS, OdometryConfiguration
from omni_core.configuration import parameter
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_sim.camera.camera import LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.texture import GroundTexture
from omni_studies import line_options
from omni_studies.line_trials import view_grid
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import Rig, View
from omni_tools.line_trials.trials import Matches, ViewMotion, drive, measure
from omni_tools.placement.mounting_area import tangential

_RADIUS = 0.6  # radius of the circle on which the cameras are mounted tangentially [m]
_BATCHES = 8  # number of batches of 10 ms from each random position


class _Preset(NamedTuple):
    """A sensor: file, title, and speed [m/s] and pixel pitch [mm] in Table 4."""

    file: str
    title: str
    speed: float
    pitch: float


_PRESETS = {
    "lis770i": _Preset("lis_770i", "LIS-770i", 3.0, 0.15),
    "s3901": _Preset("s3901", "S3901", 120.0, 0.39),
}

_MODES = {
    "lis770i": (1e6, 335, 2985.0),
    "lis770i_full": (1e6, 770, 1300.0),
    "s3901": (2e6, 128, 15600.0),
}
"""Modes of the sensors in Table 3: pixel clock [Hz], pixels and frame rate [1/s]."""
_IMAGE = (6006e-6, 312.5e-6)  # length and largest height of the image of the LIS-770i [m], Table 3
_HEIGHTS = 5
_SHARES = np.arange(0.2, 2.301, 0.05)  # tested speeds relative to the computed speed
_SECOND = "lis_770i_full"  # mode of Table 3
# A grating under a generic camera whose lens is one depth of field or more from its focus.
_PERIOD, _APERTURE, _HEIGHTS_OFF = 1e-3, 0.1, (1e-3, 2e-3, 4e-3)  # [m], [1], [m]
_DIRECTIONS = {"ahead": (1.0, 0.0, 0.0), "sideways": (0.0, 1.0, 0.0)}


class Options(line_options.TextureOptions):
    """Options of the study: grounds, their resolution, random positions and seed."""

    ground: tuple[str, ...] = line_options.grounds_option("cork", "asphalt", "walking_tile")
    hard: tuple[str, ...] = line_options.grounds_option(
        "brick", "planks", "bark", prefix="difficult ground: "
    )
    runs: int = line_options.runs_option(40)
    noise: float = line_options.noise_option()
    needed: float = parameter(0.95, minimum=0.0, maximum=1.0)
    """minimum share of correct medians at a speed that counts as measurable"""
    method: str = parameter(OdometryConfiguration.method, choices=METHODS)
    """value of the parameter `odometry.method`"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Compute and simulate the highest speeds; write figure, data and metrics."""
    grounds = line_options.grounds_of(options, study.experiments)
    sensors = {name: study.experiments.camera(preset.file) for name, preset in _PRESETS.items()}
    metrics: dict[str, Metric] = {}
    tried = {}
    for name, sensor in sensors.items():
        computed = sensor.sideways_speed
        speeds = _SHARES * computed
        found = {
            (name, ground): _move(sensor, speeds, texture, options)
            for ground, texture in grounds.items()
        }
        right = {
            ground: np.array([m.right_medians(view_grid.GROUP) for m in matches])
            for (_, ground), matches in found.items()
        }
        tried[_PRESETS[name].title] = Tried(computed, speeds, right)
        metrics |= _speeds(name, sensor, speeds, right, options.needed)
        nearest = int(np.argmin(np.abs(speeds - computed)))
        metrics |= {
            f"usable_share.{name}_{ground}": _usable(matches[nearest])
            for (_, ground), matches in found.items()
        }
        table = view_grid.matches_table(("sensor", "ground"), _motions(sensor, speeds), found)
        study.table(f"{name}.csv", *table, digits=6)
    hard = dataclasses.replace(options, ground=options.hard)
    for ground, texture in line_options.grounds_of(hard, study.experiments).items():
        for name, sensor in sensors.items():
            (matches,) = _move(sensor, np.array([sensor.sideways_speed]), texture, options)
            share, note = matches.right_medians(view_grid.GROUP), "medians of 10 at 60 % overlap"
            metrics[f"right_median_share.{name}_{ground}"] = Metric(share, "1", note=note)
            metrics[f"usable_share.{name}_{ground}"] = _usable(matches)
    for ground, texture in grounds.items():
        for name, sensor in sensors.items():
            metrics |= _driven(f"{name}_{ground}", sensor, texture, options)
    metrics |= clock_metrics() | height_metrics(sensors["lis770i"]) | defocus_metrics()
    full = study.experiments.camera(_SECOND).sideways_speed
    metrics["computed_speed.lis770i_full"] = Metric(full, "m/s", note="770 px at 1300 lines/s")
    study.figure("sensor_presets.png", draw_speed_limits(tried, options.needed))
    return study.result(metrics)


def clock_metrics() -> dict[str, Metric]:
    """Return the line rates that follow from the pixel clocks, with those of Table 3."""
    return {
        f"clocked_line_rate.{name}": Metric(clock / pixels, "1/s", frame_rate)
        for name, (clock, pixels, frame_rate) in _MODES.items()
    }


def height_metrics(sensor: LineSensor) -> dict[str, Metric]:
    """Return width of the view and speed at 60 % overlap for each height of the LIS-770i's image.

    Args:
        sensor: camera with this image sensor, whose optics are not changed.
    """
    scale = sensor.length / _IMAGE[0]
    metrics: dict[str, Metric] = {}
    for step in range(1, _HEIGHTS + 1):
        view = dataclasses.replace(sensor, width=scale * _IMAGE[1] * step / _HEIGHTS)
        note = "five equal steps are an assumption; the text gives the largest"
        metrics[f"height_width.step_{step}"] = Metric(1e3 * view.width, "mm", note=note)
        metrics[f"height_speed.step_{step}"] = Metric(view.sideways_speed, "m/s", note=note)
    return metrics


def defocus_metrics() -> dict[str, Metric]:
    """Return the contrast of a grating at heights out of focus, and that in closed form.

    A blur with the standard deviation ``s`` reduces the contrast of a sine of the wavelength L by
    ``exp(-2 (pi s / L)^2)`` compared with a lens in focus, besides the mean over each pixel.
    """
    size = 0.05
    sine = np.sin(math.tau * np.arange(4096) * size / _PERIOD / 4096)
    columns = np.rint(128.0 + 100.0 * sine).astype(np.uint8)
    ground = GroundTexture(np.tile(columns, (4096, 1)), size)
    contrast, closed = {}, {}
    for height in (0.0, *_HEIGHTS_OFF):
        optics = CameraConfiguration(
            noise=0.0, numerical_aperture=_APERTURE, height_error=height, bit_depth=16
        )
        sensor = LineSensor(x=0.0, y=0.0, heading_deg=0.0, length=0.8 * size)
        cameras = LineCameraArray({"": sensor}, ground, optics, np.random.SeedSequence(0))
        contrast[height] = float(np.ptp(cameras.cameras[""].grays(np.zeros((1, 3)))))
        closed[height] = math.exp(-2.0 * (math.pi * optics.focus(0.0)[1] / _PERIOD) ** 2)
    return {
        f"{quantity}.{1e3 * height:.0f}_mm": Metric(values[height] / values[0.0], "1")
        for quantity, values in {
            "grating_contrast": contrast,
            "grating_closed_form": closed,
        }.items()
        for height in _HEIGHTS_OFF
    }


def _speeds(
    name: str,
    sensor: LineSensor,
    speeds: FloatArray,
    right: Mapping[str, FloatArray],
    needed: float,
) -> dict[str, Metric]:
    """Return the maximum speeds of a camera (computed, confirmed, measurable) as metrics.

    Args:
        name: name of the camera.
        sensor: the camera.
        speeds: simulated sideways speeds [m/s], shape (V,).
        right: share of correct medians at each speed, 0 to 1, keyed by ground, shape (V,) each.
        needed: minimum share of correct medians at a speed that counts as measurable, 0 to 1.
    """
    preset, computed = _PRESETS[name], sensor.sideways_speed
    limits = {ground: _highest(speeds, share, needed) for ground, share in right.items()}
    slowest, along = min(computed, *limits.values()), sensor.length / 2.0 * sensor.line_rate
    highest = "at 60 % overlap or more, confirmed on every ground"
    straight = "at the shift limit n/2, moving along the axis"
    measurable = "95 % of medians of 10 correct, at any overlap"
    return {
        f"max_speed.{name}": Metric(slowest, "m/s", preset.speed, note=highest),
        f"computed_speed.{name}": Metric(computed, "m/s", reference=preset.speed),
        f"straight_speed.{name}": Metric(along, "m/s", note=straight),
        f"pixel_length.{name}": Metric(1e3 * sensor.pixel_pitch, "mm", reference=preset.pitch),
        **{
            f"measurable_speed.{name}_{ground}": Metric(value, "m/s", note=measurable)
            for ground, value in limits.items()
        },
    }


def _usable(matches: Matches) -> Metric:
    return Metric(float(np.mean(matches.usable)), "1", note="of pairs at 60 % overlap")


def _motions(sensor: LineSensor, speeds: FloatArray) -> list[ViewMotion]:
    angle = view_grid.MOTION.angle
    return [ViewMotion(View.of(sensor), float(speed), angle) for speed in speeds]


def _move(
    sensor: LineSensor, speeds: FloatArray, texture: GroundTexture, options: Options
) -> list[Matches]:
    pairs, noise = view_grid.GROUP, options.noise
    motions = _motions(sensor, speeds)
    return measure(motions, texture, pairs, noise, options.seed, runs=options.runs)


def _driven(
    case: str, sensor: LineSensor, texture: GroundTexture, options: Options
) -> dict[str, Metric]:
    """Return availability and velocity error of the odometry with three cameras, as metrics.

    The platform moves at ``sensor.sideways_speed``, forward in one test and sideways in another.

    Args:
        case: name of sensor and ground.
        sensor: type of the cameras.
        texture: the ground.
        options: noise, method, number of runs and seed.
    """
    speed, sensors = sensor.sideways_speed, tangential(_RADIUS, sensor)
    configuration = OdometryConfiguration(sensors=sensors, method=options.method)
    rig = Rig(sensors, texture, options.noise, options.seed)
    generator = np.random.default_rng(options.seed)
    places = max(2, options.runs // 8)
    metrics: dict[str, Metric] = {}
    for direction, axis in _DIRECTIONS.items():
        twist = speed * np.array(axis)
        trials = [drive(configuration, rig, twist, _BATCHES, generator) for _ in range(places)]
        error = np.concatenate([trial.error[:, :2] for trial in trials])
        share = 100.0 * float(np.mean([trial.measured for trial in trials]))
        square = float(np.mean(np.sum(error**2, axis=1))) if len(error) else math.nan
        rms = Metric(100.0 * math.sqrt(square) / speed, "%", note="of the speed")
        metrics[f"odometry_availability.{case}_{direction}"] = Metric(share, "%")
        metrics[f"odometry_rms_error.{case}_{direction}"] = rms
    return metrics


def _highest(speeds: FloatArray, share: FloatArray, needed: float) -> float:
    """Return the highest speed up to which all shares are sufficient [m/s]; 0 if none is.

    Args:
        speeds: tested speeds [m/s], increasing, shape (V,).
        share: share of correct measurements at each speed, 0 to 1, shape (V,).
        needed: required share, 0 to 1.
    """
    failing = np.flatnonzero(share < needed)
    count = int(failing[0]) if len(failing) else len(speeds)
    return float(speeds[count - 1]) if count else 0.0


class Tried(NamedTuple):
    """Sideways speeds at which a sensor was tested, and the share of correct measurements.

    Attributes:
        computed: speed at 60 % overlap [m/s].
        speeds: tested speeds [m/s], shape (n,).
        right: share of correct measurements at each speed, 0 to 1, keyed by ground, shape (n,)
            each.
    """

    computed: float
    speeds: FloatArray
    right: Mapping[str, FloatArray]


def draw_speed_limits(sensors: Mapping[str, Tried], needed: float) -> Figure:
    """Draw the share of correct measurements versus speed, one panel for each sensor.

    Args:
        sensors: tested speeds, keyed by the title of the sensor.
        needed: required share of correct measurements, 0 to 1.
    """
    title = "Medians of 10 within 1.5 px while moving sideways at 89 deg (Table 4)"
    size, x, y = (5.2 * len(sensors), 4.2), "speed [m/s]", "share of correct medians"
    figure, grid = style.panels(title, 1, len(sensors), size=size, x=x, y=y, sharey=True)
    for axes, (title, (computed, speeds, right)) in zip(grid[0], sensors.items(), strict=True):
        for i, (ground, share) in enumerate(right.items()):
            axes.plot(speeds, share, color=style.wheel_color(i), label=ground, linewidth=1.6)
        axes.axvline(computed, color=style.BLACK, linewidth=1.0, linestyle="--")
        axes.axhline(needed, color=style.BLACK, linewidth=0.8, linestyle=":")
        words = f"60 % overlap:\n{computed:.3g} m/s"
        style.note(axes, words, (computed, 0.06), (5, 0))
        axes.set_title(title)
        axes.set_ylim(0.0, 1.03)
        axes.set_xlim(left=0.0)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    grid[0, 0].legend(loc="center left")
    return figure
