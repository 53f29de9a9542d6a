"""Highest sideways speed of the two sensors of Tables 3 and 4, computed and simulated.

Table 4 assumes 60 % overlap: ``v = 0.4 w f`` with the width w of the field of view and the line
rate f. Each sensor moves sideways over grounds of fine texture at increasing speeds. A speed is
measurable if the median of ten consecutive displacements (section 4.6) is within 1.5 px of the
truth at 95 % of random places, at this speed and all lower ones. The highest speed is that at 60 %
overlap if the simulation confirms it on every ground. On difficult grounds the study reports
the share of right medians at that speed, and on all grounds the share of usable pairs.

The whole odometry is then driven with three of the sensors at that speed, ahead and sideways.
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from linescan_odometry.configuration import METHODS, OdometryConfiguration
from omni_loop.experiment import ExperimentLibrary
from omni_loop.metrics import Metric
from omni_platform.configuration import parameter
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_sim.texture.texture import GroundTexture
from omni_studies.line_trials import speed_figures, tables, view_grid
from omni_studies.line_trials.options import TextureOptions, grounds_of, grounds_option, runs_option
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import Rig, View
from omni_tools.line_trials.trials import Matches, Motion, measure
from omni_tools.line_trials.twist_trials import drive
from omni_tools.placement.common_placements import tangential

_PRESETS = {"lis770i": "lis_770i", "s3901": "s3901"}
_TITLES = {"lis770i": "LIS-770i", "s3901": "S3901"}
_TABLE_4 = {"lis770i": 3.0, "s3901": 120.0}  # [m/s]
_PITCH = {"lis770i": 0.15, "s3901": 0.39}  # of Table 4 [mm]
_SHARES = np.arange(0.2, 2.301, 0.05)  # speeds tried, over the computed one
_NEEDED = 0.95
_SECOND = "lis_770i_full"  # mode of Table 3
_NOISE = 1.0  # [gray levels]
_LIMIT_DIVISOR = 2.0  # k of section 4.4
_DIRECTIONS = {"ahead": (1.0, 0.0, 0.0), "sideways": (0.0, 1.0, 0.0)}
_RADIUS = 0.6  # m, of the circle along whose tangents three cameras look
_BATCHES = 8  # of 10 ms from each random place
_AVAILABLE, _LARGEST_ERROR = 95.0, 1.0  # %


@dataclass(frozen=True, kw_only=True)
class Options(TextureOptions):
    """Grounds, their resolution, random positions and seed."""

    ground: tuple[str, ...] = grounds_option("cork", "asphalt", "walking_tile")
    hard: tuple[str, ...] = grounds_option("brick", "planks", "bark")
    runs: int = runs_option(40)
    method: str = parameter(OdometryConfiguration.method, choices=METHODS)
    """value of the parameter odometry.method"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Compute and simulate the speeds; write figure, data and metrics."""
    grounds = grounds_of(options, study.experiments)
    sensors = {name: _preset(study.experiments, preset) for name, preset in _PRESETS.items()}
    computed = {name: sensor.sideways_speed for name, sensor in sensors.items()}
    speeds = {name: _SHARES * value for name, value in computed.items()}
    hard = dataclasses.replace(options, ground=options.hard)
    found: dict[str, dict[str, list[Matches]]] = {name: {} for name in sensors}
    for ground, texture in grounds.items():
        for name, sensor in sensors.items():
            found[name][ground] = _move(sensor, speeds[name], texture, options)
    right = {
        name: {
            ground: np.array([m.right_medians(view_grid.GROUP) for m in seen])
            for ground, seen in own.items()
        }
        for name, own in found.items()
    }
    limits = {
        name: {ground: _highest(speeds[name], share) for ground, share in right[name].items()}
        for name in sensors
    }
    metrics: dict[str, Metric] = {}
    for name, sensor in sensors.items():
        metrics |= {
            f"max_speed.{name}": Metric(
                min(computed[name], *limits[name].values()),
                "m/s",
                _TABLE_4[name],
                note="at 60 % overlap or more, confirmed on every ground",
            ),
            f"computed_speed.{name}": Metric(computed[name], "m/s", reference=_TABLE_4[name]),
            f"straight_speed.{name}": Metric(
                sensor.length / _LIMIT_DIVISOR * sensor.line_rate,
                "m/s",
                note="at the shift limit n/2, moving along the axis",
            ),
            f"pixel_length.{name}": Metric(1e3 * sensor.pixel_pitch, "mm", reference=_PITCH[name]),
        }
        metrics |= {
            f"measurable_speed.{name}_{ground}": Metric(
                value, "m/s", note="95 % of medians of 10 right, at any overlap"
            )
            for ground, value in limits[name].items()
        }
        nearest = int(np.argmin(np.abs(speeds[name] - computed[name])))
        metrics |= {
            f"usable_share.{name}_{ground}": Metric(
                float(np.mean(found[name][ground][nearest].usable)),
                "1",
                note="of pairs at 60 % overlap",
            )
            for ground in grounds
        }
    for ground, texture in grounds_of(hard, study.experiments).items():
        for name, sensor in sensors.items():
            case = f"{name}_{ground}"
            (matches,) = _move(sensor, np.array([computed[name]]), texture, options)
            metrics |= {
                f"right_median_share.{case}": Metric(
                    matches.right_medians(view_grid.GROUP),
                    "1",
                    at_least=_NEEDED,
                    note="medians of 10 at 60 % overlap",
                ),
                f"usable_share.{case}": Metric(
                    float(np.mean(matches.usable)), "1", note="of pairs at 60 % overlap"
                ),
            }
    for ground, texture in grounds.items():
        for name, sensor in sensors.items():
            metrics |= _driven(f"{name}_{ground}", sensor, computed[name], texture, options)
    second = _preset(study.experiments, _SECOND)
    metrics["computed_speed.lis770i_full"] = Metric(
        second.sideways_speed, "m/s", note="770 px at 1300 lines/s"
    )
    titled = {_TITLES[name]: name for name in sensors}
    figure = speed_figures.draw_speed_limits(
        {title: computed[name] for title, name in titled.items()},
        {title: speeds[name] for title, name in titled.items()},
        {title: right[name] for title, name in titled.items()},
        _NEEDED,
    )
    study.figure("sensor_presets.png", figure)
    study.written.extend(_write(sensors, speeds, found, study.folder))
    return study.result(metrics)


def _motions(sensor: LineSensor, speeds: FloatArray) -> list[Motion]:
    return [Motion(View.of(sensor), float(speed), view_grid.ANGLE) for speed in speeds]


def _move(
    sensor: LineSensor, speeds: FloatArray, texture: GroundTexture, options: Options
) -> list[Matches]:
    motions = _motions(sensor, speeds)
    return measure(motions, texture, view_grid.GROUP, _NOISE, options.seed, runs=options.runs)


def _driven(
    case: str, sensor: LineSensor, speed: float, texture: GroundTexture, options: Options
) -> dict[str, Metric]:
    """Drive three cameras of one kind at a speed [m/s]; return availability and error."""
    configuration = OdometryConfiguration(
        sensors=tangential(_RADIUS, sensor), method=options.method
    )
    rig = Rig(configuration.sensors, texture, _NOISE, options.seed)
    generator = np.random.default_rng(options.seed)
    places = max(2, options.runs // 8)
    metrics: dict[str, Metric] = {}
    for direction, axis in _DIRECTIONS.items():
        twist = speed * np.array(axis)
        trials = [drive(configuration, rig, twist, _BATCHES, generator) for _ in range(places)]
        error = np.concatenate([trial.error[:, :2] for trial in trials])
        share = 100.0 * float(np.mean([trial.measured for trial in trials]))
        rms = (
            100.0 * math.sqrt(float(np.mean(np.sum(error**2, axis=1)))) / speed
            if len(error)
            else math.nan
        )
        metrics |= {
            f"odometry_availability.{case}_{direction}": Metric(share, "%", at_least=_AVAILABLE),
            f"odometry_rms_error.{case}_{direction}": Metric(
                rms, "%", at_most=_LARGEST_ERROR, note="of the speed"
            ),
        }
    return metrics


def _preset(library: ExperimentLibrary, preset: str) -> LineSensor:
    variant = library.variants("straight_line")[0]
    sensors = library.load("straight_line", variant, [f"sensors={preset}"]).sensors
    return next(iter(sensors.values()))


def _highest(speeds: FloatArray, share: FloatArray) -> float:
    """Return the highest speed up to which every share is sufficient [m/s], else 0."""
    failing = np.flatnonzero(share < _NEEDED)
    count = int(failing[0]) if len(failing) else len(speeds)
    return float(speeds[count - 1]) if count else 0.0


def _write(
    sensors: dict[str, LineSensor],
    speeds: dict[str, FloatArray],
    found: dict[str, dict[str, list[Matches]]],
    folder: Path,
) -> Iterator[Path]:
    for name, own in found.items():
        cases: dict[tuple[str, ...], list[Matches]] = {
            (name, ground): matches for ground, matches in own.items()
        }
        motions = _motions(sensors[name], speeds[name])
        yield tables.write_matches(folder / f"{name}.csv", ("sensor", "ground"), motions, cases)
