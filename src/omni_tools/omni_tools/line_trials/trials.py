"""Trials of line cameras over a ground: rendered line pairs, matches, estimated twists, errors.

The camera moves with a known speed and angle, as in section 4.4. Consecutive lines are matched by a
full search and refined. Displacements are in pixels along the camera's axis. In the trials of the
odometry (`drive`), a platform moves uniformly.

In print, Eq. (85) contains a division by the frame rate, which would give meters times seconds.
Here, the velocity error is computed as the displacement error *times* the rate.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.matching import search, subpixel
from linescan_odometry.odometry import LineScanOdometry
from omni_core.quantities import BoolArray, FloatArray, IntArray
from omni_core.sensors import sensor_matrix
from omni_core.signals import Lines
from omni_sim.camera.camera import LineCamera
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import PERIOD, Rig, View, cameras, poses_at

ERROR_COLUMNS = ("mean_error_px", "rmse_px", "rmse_mm", "rmse_percent_of_speed")
"""Column names for the results of `error_values`."""

_DEVIATIONS = 4.0  # limit on the ratio that the stated standard deviation explains [1]


SearchChoice = str | Callable[[int], search.ShiftSearch]
"""Similarity metric of a full search, or a constructor of a search as in `search.METRICS`."""


def within_95(ratio: FloatArray) -> BoolArray:
    """Return whether each ratio of error to stated deviation is within +-1.96, same shape."""
    return np.abs(ratio) <= 1.96


def undetected(ratio: FloatArray, error: FloatArray, least: float = 0.05) -> BoolArray:
    """Return whether each velocity error is an undetected error, shape (m,).

    The magnitude of such an error exceeds both `least` and 4 stated standard deviations.

    Args:
        ratio: ratio of error to stated standard deviation [1], NaN if unmeasured, shape (m,).
        error: error of the velocity [m/s], shape (m,).
        least: minimum error that counts as undetected [m/s].
    """
    return (np.abs(ratio) > _DEVIATIONS) & (np.abs(error) > least)


def error_values(
    pixel_error: FloatArray, error: FloatArray, pitch: float, line_rate: float, speed: float
) -> tuple[float, float, float, float]:
    """Return the mean error that the dissertation defines, and the RMS error in three units.

    Args:
        pixel_error: error in whole pixels, Eq. (84) [px], shape (m,).
        error: error of the refined displacements, without rounding [px], shape (m,).
        pitch: length of a pixel on the ground [m].
        line_rate: lines per second [1/s].
        speed: speed of the motion, to which the velocity error refers, Eq. (85) [m/s].

    Returns:
        Mean magnitude of `pixel_error` [px]; root mean square of `error` in px, in mm, and in per
        cent of the speed.
    """
    rmse = math.sqrt(float(np.mean(np.square(error))))
    length = rmse * pitch
    percent = 100.0 * length * line_rate / speed if speed > 0.0 else math.nan
    return float(np.mean(np.abs(pixel_error))), rmse, 1e3 * length, percent


class Matches(NamedTuple):
    """True and measured displacements of m pairs of consecutive lines.

    Attributes:
        truth: true displacement along the axis [px], shape (m,).
        shift: integer shift with the smallest distance measure [px], shape (m,).
        displacement: refined shift [px], shape (m,).
        variance: variance computed by the refinement [px^2], infinite if it failed, shape (m,).
        similarity: Pearson's correlation at the shift [1], shape (m,).
    """

    truth: FloatArray
    shift: IntArray
    displacement: FloatArray
    variance: FloatArray
    similarity: FloatArray

    @property
    def pixel_error(self) -> FloatArray:
        """Measured minus true displacement, both in whole pixels, Eq. (84) [px], shape (m,)."""
        return _whole_error(self.shift, self.truth)

    @property
    def right(self) -> BoolArray:
        """Whether the displacement of each pair is correct within one pixel, shape (m,)."""
        return np.abs(self.pixel_error) <= 1.0

    @property
    def error(self) -> FloatArray:
        """Refined minus true displacement, without rounding [px], shape (m,)."""
        return self.displacement - self.truth

    @property
    def mean_error(self) -> float:
        """Mean magnitude of the error in whole pixels, Eq. (84) [px]."""
        return float(np.mean(np.abs(self.pixel_error)))

    @property
    def usable(self) -> BoolArray:
        """Whether each pair is similar enough for the odometry to use it, shape (m,)."""
        return self.similarity >= OdometryConfiguration.minimum_correlation

    @property
    def undetected_share(self) -> float:
        """Share of pairs that the odometry would use although their error exceeds a pixel."""
        return float(np.mean(self.usable & ~self.right))

    def median_error(self, group: int) -> FloatArray:
        """Return the error of the median of each group of consecutive shifts [px] (section 4.6).

        Args:
            group: number of shifts in a group; an incomplete group at the end is omitted.
        """
        count = len(self.shift) // group * group
        shift, truth = (v[:count].reshape(-1, group) for v in (self.shift, self.truth))
        return _whole_error(np.median(shift, axis=1), np.mean(truth, axis=1))

    def right_medians(self, group: int) -> float:
        """Return the share of medians whose `median_error` is at most one pixel, 0 to 1."""
        return float(np.mean(np.abs(self.median_error(group)) <= 1.0))

    def error_values(self, view: View, speed: float) -> tuple[float, float, float, float]:
        """Return the errors in the order of `ERROR_COLUMNS`.

        Args:
            view: field of view of the camera.
            speed: speed of the camera [m/s].
        """
        return error_values(self.pixel_error, self.error, view.pitch, view.line_rate, speed)


def _whole_error(shift: FloatArray | IntArray, truth: FloatArray) -> FloatArray:
    """Return measured minus rounded true displacements [px].

    A true displacement near the middle between two integers has two valid roundings. The error is
    therefore 0 if the measurement is within 0.55 px of the true displacement.
    """
    return np.where(np.abs(shift - truth) <= 0.55, 0.0, shift - np.round(truth))


class ViewMotion(NamedTuple):
    """Uniform motion of a camera.

    Attributes:
        view: field of view of the camera.
        speed: speed of the camera [m/s].
        angle: angle of the motion from the camera's axis [rad].
        axis: direction of the camera's axis on the ground [rad].
    """

    view: View
    speed: float
    angle: float
    axis: float = 0.0

    @property
    def overlap(self) -> float:
        """Share of a line's area on the ground that the next line also covers, 0 to 1."""
        return self.view.overlap(self.speed, self.angle)


def measure(
    motions: Sequence[ViewMotion],
    texture: GroundTexture,
    pairs: int,
    noise: float,
    seed: int,
    metric: SearchChoice = "pearson",
    runs: int = 1,
) -> list[Matches]:
    """Render consecutive lines for each motion; return their true and measured displacements.

    Args:
        motions: motions of the camera; the search covers displacements between two lines of up to
            half the length of a line.
        texture: the ground.
        pairs: number of consecutive line pairs from each start position.
        noise: standard deviation [gray levels].
        seed: seed of positions and noise.
        metric: the search.
        runs: number of random start positions for each motion.
    """
    generator = np.random.default_rng(seed)
    views = list(dict.fromkeys(motion.view for motion in motions))
    eyes = dict(zip(views, cameras(views, texture, noise, seed), strict=True))
    matches = []
    for i, motion in enumerate(motions):
        own = []
        for run in range(runs):
            poses = path(motion.view, motion.speed, motion.angle, pairs + 1, generator, motion.axis)
            lines = eyes[motion.view].lines(poses, (i * runs + run) * (pairs + 1))
            own.append(match(motion.view, poses, lines, metric))
        matches.append(Matches._make(map(np.concatenate, zip(*own, strict=True))))
    return matches


def path(
    view: View,
    speed: float,
    angle: float,
    lines: int,
    generator: np.random.Generator,
    axis: float = 0.0,
) -> FloatArray:
    """Return the camera's x, y [m], yaw [rad] at each line from a random start, shape (lines, 3).

    Args:
        view: field of view of the camera.
        speed: speed of the camera [m/s].
        angle: angle of the motion from the camera's axis [rad].
        lines: number of lines.
        generator: random generator for the position.
        axis: direction of the camera's axis on the ground [rad].
    """
    start = np.append(generator.uniform(0.0, PERIOD, 2), axis)
    twist = np.array([speed * math.cos(angle), speed * math.sin(angle), 0.0])
    return poses_at(np.arange(lines) / view.line_rate, start, twist)


def match(view: View, poses: FloatArray, lines: Lines, metric: SearchChoice = "pearson") -> Matches:
    """Return the true and the measured displacement of each line from the previous line.

    The search covers displacements of up to half the length of a line.

    Args:
        view: field of view of the camera.
        poses: x, y [m] and yaw [rad] of the camera at each line, with constant yaw, shape (m + 1,
            3).
        lines: gray values of the lines, shape (m + 1, pixels).
        metric: as for `measure`.
    """
    pairs = len(lines) - 1
    shift = np.empty(pairs, np.int64)
    similarity = np.empty(pairs)
    construct = search.METRICS[metric] if isinstance(metric, str) else metric
    construct(view.pixels // 2).match(lines, shift, similarity)
    displacement, errors = subpixel.SubpixelRefiner(view.pixels).refine(lines, shift)
    axis = poses[0, 2]
    along = math.cos(axis) * np.diff(poses[:, 0]) + math.sin(axis) * np.diff(poses[:, 1])
    variance = np.sum(errors**2, axis=1)
    return Matches(along / view.pitch, shift, displacement, variance, similarity)


def every_second(matches: Matches) -> Matches:
    """Return every second of the matches, which then have no line in common."""
    return Matches._make(values[::2] for values in matches)


def cramer_rao_bound(
    view: View,
    eye: LineCamera,
    poses: FloatArray,
    truth: FloatArray,
    noise: float,
    step: float = 0.02,
) -> FloatArray:
    """Return the smallest variance that an unbiased estimate of each displacement can have [px^2].

    Both lines are noisy and the ground is unknown, so the bound is twice the bound for a known
    ground: ``2 s^2 / sum(g^2)``. Here, g is the gradient of the noise-free line, and the sum covers
    the overlap. Quantization adds 1/12 to the variance s^2 of the noise.

    Args:
        view: field of view of the camera.
        eye: camera that renders the lines.
        poses: x, y [m] and yaw [rad] of the older line of each pair, shape (m, 3).
        truth: displacement of each pair [px], shape (m,).
        noise: standard deviation [gray levels].
        step: step of the numerical gradient [px].
    """
    moved = np.array([step * view.pitch, 0.0, 0.0])
    change = eye.grays(poses + moved).astype(np.float64) - eye.grays(poses - moved)
    gradient = change / (2.0 * step)
    pixel = np.arange(view.pixels) - np.round(truth)[:, None]  # pixels of the newer line
    common = (pixel >= 0) & (pixel < view.pixels)
    energy = np.sum(gradient**2, axis=1, where=common)
    return np.asarray(2.0 * (noise**2 + 1.0 / 12.0) / energy)


class TwistTrial(NamedTuple):
    """Estimates of the odometry in a uniform motion, one estimate for each batch.

    Attributes:
        twist: twist of the platform (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        estimate: estimated twist of each measured batch [m/s, m/s, rad/s], shape (m, 3).
        covariance: covariance that the odometry states for each estimate, in the squares of its
            units, shape (m, 3, 3).
        measured: share of the batches with a measurement, 0 to 1.
        ratio: ratio of the error of a camera's velocity to the stated standard deviation [1], for
            all cameras and batches with a measurement, shape (k,).
    """

    twist: FloatArray
    estimate: FloatArray
    covariance: FloatArray
    measured: float
    ratio: FloatArray

    @property
    def error(self) -> FloatArray:
        """Estimated minus true twist [m/s, m/s, rad/s], shape (m, 3)."""
        return self.estimate - self.twist

    @property
    def normalized_error_squared(self) -> FloatArray:
        """Normalized squared error ``e^T C^-1 e / 3``, whose expectation is 1, shape (m,)."""
        weighted = np.linalg.solve(self.covariance, self.error[:, :, None])[:, :, 0]
        return np.asarray(np.sum(self.error * weighted, axis=1) / 3.0)


def drive(
    configuration: OdometryConfiguration,
    rig: Rig,
    twist: FloatArray,
    batches: int,
    generator: np.random.Generator,
) -> TwistTrial:
    """Return the odometry's estimates of a constant twist from a random position and heading.

    Args:
        configuration: configuration of the odometry, with its line cameras.
        rig: rig with these line cameras.
        twist: twist of the platform (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        batches: number of batches after the first line.
        generator: random generator for position and heading.
    """
    sensors = configuration.sensors
    start = np.array([*generator.uniform(0.0, PERIOD, 2), generator.uniform(0.0, 2.0 * math.pi)])
    odometry = LineScanOdometry(configuration)
    odometry.update(rig.expose(start, twist, {name: np.arange(1) for name in sensors}))
    truth = dict(zip(sensors, sensor_matrix(sensors) @ twist, strict=True))
    estimates, covariances, ratios = [], [], []
    for batch in rig.drive(start, twist, batches, first=1):
        estimate = odometry.update(batch)
        if estimate.measured:
            estimates.append(estimate.twist)
            covariances.append(estimate.covariance)
        for name, reading in estimate.readings.items():
            if reading.measured:
                ratios.append((reading.velocity - truth[name]) / math.sqrt(reading.variance))
    twists = np.array(estimates).reshape(-1, 3), np.array(covariances).reshape(-1, 3, 3)
    return TwistTrial(twist, *twists, len(estimates) / batches, np.array(ratios))
