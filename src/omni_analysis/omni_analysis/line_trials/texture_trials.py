"""Trials of one line camera that moves sideways over a ground (sections 4.4 and 4.5).

The camera keeps a constant velocity at an angle to its axis; consecutive lines are compared at
every shift up to half a line by Pearson's correlation, as the odometry does.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.matching.search import METRICS
from linescan_odometry.matching.subpixel import SubpixelRefiner
from linescan_odometry.measurements import LineBatch, SensorReading
from linescan_odometry.sensor import SensorOdometry
from omni_analysis.line_trials.errors import error_values
from omni_analysis.line_trials.trials import View
from omni_analysis.line_trials.twist_trials import batch_lines, cameras_over, poses_at
from omni_analysis.line_trials.view_grid import LENGTHS, SHAPES, as_map
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_sim.camera.camera import LineCamera
from omni_sim.texture.texture import GroundTexture

_LIMIT_DIVISOR = 2  # k of section 4.4


@dataclasses.dataclass(frozen=True)
class Sideways:
    """A motion and how it is looked at.

    Attributes:
        speed: of the camera [m/s].
        angle: of its motion from its axis [rad].
        axis: heading of the axis on the ground [rad].
        noise: standard deviation [grey levels].
        runs: random places on the ground.
        pairs: consecutive pairs of lines from each.
        seed: of places and noise.
    """

    speed: float
    angle: float = math.radians(89.0)
    axis: float = 0.0
    noise: float = 1.0
    runs: int = 2
    pairs: int = 10
    seed: int = 1


@dataclasses.dataclass(frozen=True, eq=False)
class Shifts:
    """What a trial found.

    Attributes:
        truth: displacement along the axis between two lines [px].
        shift: of the best match of each pair, shape (runs, pairs) [px].
        similarity: Pearson's correlation there, shape (runs, pairs).
        displacement: refined shift, shape (runs, pairs) [px].
        errors: under `displacement_errors.ERROR_COLUMNS`.
    """

    truth: float
    shift: NDArray[np.int64]
    similarity: FloatArray
    displacement: FloatArray
    errors: tuple[float, ...]

    @property
    def mean_error(self) -> float:
        """Mean magnitude of the error in whole pixels over all pairs, Eq. (84) [px]."""
        return self.errors[0]

    @property
    def wrong_share(self) -> float:
        """Share of pairs more than a pixel off that the odometry would take for measured."""
        taken = self.similarity >= OdometryConfiguration.minimum_correlation
        return float(np.mean(taken & (np.abs(self.shift - self.truth) > 1.5)))

    @property
    def flagged_share(self) -> float:
        """Share of pairs that are too unlike for the odometry to use them."""
        return float(np.mean(self.similarity < OdometryConfiguration.minimum_correlation))

    @property
    def median_right(self) -> float:
        """Share of runs whose median shift is within 1.5 px of the truth (section 4.6)."""
        medians = np.median(self.shift, axis=1)
        return float(np.mean(np.abs(medians - self.truth) <= 1.5))


def overlap(sensor: LineSensor, trial: Sideways) -> float:
    """Return the share of its field of view that two consecutive lines have in common, 0..1."""
    view = View(sensor.pixels, sensor.length, sensor.width, sensor.line_rate)
    return view.overlap(trial.speed, trial.angle)


def shape_grid(pixels: int = 1024, line_rate: float = 2500.0) -> dict[str, LineSensor]:
    """Return cameras of every shape, then every length, named by both."""
    return {
        f"shape_{i}_length_{j}": LineSensor(
            x=0.0,
            y=0.0,
            heading_deg=0.0,
            pixels=pixels,
            length=length,
            width=shape * length,
            line_rate=line_rate,
        )
        for i, shape in enumerate(SHAPES)
        for j, length in enumerate(LENGTHS)
    }


class Eyes:
    """Cameras over one ground, for many trials."""

    def __init__(
        self, sensors: Mapping[str, LineSensor], texture: GroundTexture, noise: float, seed: int
    ) -> None:
        """Place the cameras.

        Args:
            sensors: what they see, by name; each one's place is the trial's.
            texture: the ground.
            noise: standard deviation [grey levels].
            seed: of the noise.

        Raises:
            ConfigurationError: a field of view does not fit the ground.
        """
        self._size = texture.size
        self._cameras = cameras_over(texture, sensors, noise, seed).cameras

    def read(
        self, name: str, trial: Sideways, configuration: OdometryConfiguration, batches: int
    ) -> list[SensorReading]:
        """Move one of the cameras in batches of 10 ms, as the odometry gets them.

        Args:
            name: of the camera.
            trial: the motion; runs and pairs are not used.
            configuration: of the odometry.
            batches: how many.
        """
        camera = self._cameras[name]
        odometry = SensorOdometry(camera.sensor, configuration)
        start = np.random.default_rng((trial.seed, 2)).uniform(0.0, self._size, 2)
        count = batch_lines(camera.sensor.line_rate)
        whole = dataclasses.replace(trial, pairs=count * batches - 1)
        lines = _lines(camera, whole, start, 0)
        period_ns = 1e9 / camera.sensor.line_rate
        return [
            odometry.update(LineBatch(round((end - 1) * period_ns), lines[end - count : end]))
            for end in range(count, count * batches + 1, count)
        ]

    def look(self, name: str, trial: Sideways) -> Shifts:
        """Move one of the cameras and match what it sees."""
        camera = self._cameras[name]
        sensor = camera.sensor
        generator = np.random.default_rng((trial.seed, 1))
        starts = generator.uniform(0.0, self._size, (trial.runs, 2))
        shift = np.empty((trial.runs, trial.pairs), np.int64)
        similarity, displacement, variance = np.empty((3, trial.runs, trial.pairs))
        search = METRICS["pearson"](sensor.pixels, sensor.pixels // _LIMIT_DIVISOR)
        refiner = SubpixelRefiner(sensor.pixels, OdometryConfiguration.peak_recovery)
        for run, start in enumerate(starts):
            lines = _lines(camera, trial, start, run * (trial.pairs + 1))
            search.match(lines, shift[run], similarity[run])
            refiner.refine(lines, shift[run], displacement[run], variance[run])
        truth = trial.speed / sensor.line_rate * math.cos(trial.angle) / sensor.pixel_pitch
        whole = (shift - round(truth)).astype(np.float64)
        errors = error_values(
            whole, displacement - truth, sensor.pixel_pitch, sensor.line_rate, trial.speed
        )
        return Shifts(truth, shift, similarity, displacement, errors)


def _lines(
    camera: LineCamera, trial: Sideways, start: FloatArray, first: int
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    elapsed = np.arange(trial.pairs + 1) / camera.sensor.line_rate
    twist = trial.speed * np.array([math.cos(trial.angle), math.sin(trial.angle), 0.0])
    return camera.lines(poses_at(elapsed, np.append(start, trial.axis), twist), first)


def look_at_shapes(texture: GroundTexture, trial: Sideways) -> tuple[list[Shifts], FloatArray]:
    """Try every shape of the field of view; return what each found, and the map of overlaps."""
    sensors = shape_grid()
    eyes = Eyes(sensors, texture, trial.noise, trial.seed)
    found = [eyes.look(name, trial) for name in sensors]
    return found, as_map([overlap(sensor, trial) for sensor in sensors.values()])
