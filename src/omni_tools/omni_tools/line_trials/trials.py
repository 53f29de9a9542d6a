"""Trials of one line camera over a ground: rendered pairs of lines, their matches, their errors.

The camera moves at a known speed and angle, as in section 4.4; consecutive lines are matched by a
full search and refined. Displacements are in pixels along the camera's axis.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.matching import search, subpixel
from omni_platform.quantities import BoolArray, FloatArray, IntArray
from omni_platform.signals import Lines
from omni_sim.camera.camera import LineCamera
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.errors import error_values
from omni_tools.line_trials.rig import PERIOD, View, cameras


@dataclasses.dataclass(frozen=True)
class Matches:
    """Matches of pairs of lines.

    Attributes:
        truth: displacement along the axis [px], shape (m,).
        shift: integer shift of the smallest distance [px], shape (m,).
        displacement: refined shift [px], shape (m,).
        variance: variance stated by the refinement [px^2], infinite if there is none, shape (m,).
        similarity: Pearson's correlation at the shift, shape (m,).
    """

    truth: FloatArray
    shift: IntArray
    displacement: FloatArray
    variance: FloatArray
    similarity: FloatArray

    @property
    def pixel_error(self) -> FloatArray:
        """Measured minus rounded true displacement, Eq. (84) [px].

        A true displacement near the middle between two integers has two valid roundings. Of the
        integers within 0.55 px, the one closer to the measurement is used.
        """
        error = self.shift - np.round(self.truth)
        return np.where(np.abs(self.shift - self.truth) <= 0.55, 0.0, error)

    @property
    def right(self) -> BoolArray:
        """Whether each pair matched within a pixel; an error of one pixel counts as noise."""
        return np.abs(self.pixel_error) <= 1.0

    @property
    def error(self) -> FloatArray:
        """Refined minus true displacement, unrounded [px]."""
        return self.displacement - self.truth

    @property
    def mean_error(self) -> float:
        """Mean magnitude of the error in whole pixels, Eq. (84) [px]."""
        return float(np.mean(np.abs(self.pixel_error)))

    @property
    def usable(self) -> BoolArray:
        """Whether each pair is similar enough for the odometry to use it."""
        return self.similarity >= OdometryConfiguration.minimum_correlation

    @property
    def undetected_share(self) -> float:
        """Share of pairs that the odometry would use although they are more than a pixel off."""
        return float(np.mean(self.usable & ~self.right))

    def median_error(self, group: int) -> FloatArray:
        """Return the errors in whole pixels of medians of consecutive shifts (section 4.6).

        Args:
            group: n of the median; an incomplete group at the end is not used.
        """
        count = len(self.shift) // group * group
        median = np.median(self.shift[:count].reshape(-1, group), axis=1)
        truth = np.mean(self.truth[:count].reshape(-1, group), axis=1)
        # As in `pixel_error`, a true value near a half may be rounded up or down.
        return np.where(np.abs(median - truth) <= 0.55, 0.0, median - np.round(truth))

    def right_medians(self, group: int) -> float:
        """Return the share of medians with a `median_error` of at most a pixel."""
        return float(np.mean(np.abs(self.median_error(group)) <= 1.0))

    def error_values(self, view: View, speed: float) -> tuple[float, float, float, float]:
        """Return the errors in the order of `errors.ERROR_COLUMNS`.

        Args:
            view: field of view of the camera.
            speed: speed of the camera [m/s].
        """
        return error_values(self.pixel_error, self.error, view.pitch, view.line_rate, speed)


@dataclasses.dataclass(frozen=True)
class Motion:
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
        """Share of its area that a frame has in common with the next one, 0..1."""
        return self.view.overlap(self.speed, self.angle)


def measure(
    motions: Sequence[Motion],
    texture: GroundTexture,
    pairs: int,
    noise: float,
    seed: int,
    metric: str = "pearson",
    runs: int = 1,
) -> list[Matches]:
    """Return the matches of consecutive lines of each motion.

    Args:
        motions: the motions; shifts are searched up to half the pixels.
        texture: the ground.
        pairs: number of consecutive lines from each position.
        noise: standard deviation [gray levels].
        seed: seed of positions and noise.
        metric: similarity metric of the search.
        runs: number of random positions for each motion.
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
            # Noise displaces a peak by up to 4 px.
            own.append(match(motion.view, poses, lines, metric, recovery=4))
        fields = [field.name for field in dataclasses.fields(Matches)]
        matches.append(Matches(*(np.concatenate([getattr(m, f) for m in own]) for f in fields)))
    return matches


def path(
    view: View,
    speed: float,
    angle: float,
    lines: int,
    generator: np.random.Generator,
    axis: float = 0.0,
) -> FloatArray:
    """Return the poses of consecutive lines from a random position, shape (lines, 3).

    Args:
        view: field of view of the camera.
        speed: speed of the camera [m/s].
        angle: angle of its motion from its axis [rad].
        lines: number of lines.
        generator: random generator for the position.
        axis: direction of the camera's axis on the ground [rad].
    """
    traveled = speed / view.line_rate * np.arange(lines)
    start = generator.uniform(0.0, PERIOD, 2)
    return np.column_stack(
        (
            start[0] + traveled * math.cos(axis + angle),
            start[1] + traveled * math.sin(axis + angle),
            np.full(lines, axis),
        )
    )


def match(
    view: View,
    poses: FloatArray,
    lines: Lines,
    metric: str = "pearson",
    divisor: float = 2.0,
    recovery: int = 0,
) -> Matches:
    """Match every line with the one before it.

    Args:
        view: field of view of the camera.
        poses: poses of the lines, all with the same axis, shape (m + 1, 3).
        lines: gray values of the lines, shape (m + 1, pixels).
        metric: similarity metric of the search.
        divisor: k; shifts are searched up to pixels / k.
        recovery: distance within which a peak displaced by noise is searched again [px].
    """
    pairs = len(lines) - 1
    shift = np.empty(pairs, np.int64)
    similarity, displacement, variance = np.empty((3, pairs))
    search.METRICS[metric](view.pixels, int(view.pixels / divisor)).match(lines, shift, similarity)
    subpixel.SubpixelRefiner(view.pixels, recovery).refine(lines, shift, displacement, variance)
    axis = poses[0, 2]
    along = math.cos(axis) * np.diff(poses[:, 0]) + math.sin(axis) * np.diff(poses[:, 1])
    return Matches(along / view.pitch, shift, displacement, variance, similarity)


def every_second(matches: Matches) -> Matches:
    """Return every second match, beginning with the first."""
    values = (getattr(matches, field.name)[::2] for field in dataclasses.fields(matches))
    return Matches(*values)


def cramer_rao_bound(
    view: View,
    eye: LineCamera,
    poses: FloatArray,
    truth: FloatArray,
    noise: float,
    step: float = 0.02,
) -> FloatArray:
    """Return the smallest variance of unbiased displacements between pairs of lines [px^2].

    Both lines are noisy and the ground is unknown, so the bound is twice that of a known
    ground: ``2 s^2 / sum(g^2)`` with the gradient g of the noise-free line over the overlap.
    Quantization adds 1/12 to the variance s^2 of the noise.

    Args:
        view: field of view of the camera.
        eye: rendered camera.
        poses: poses of the older line of each pair, shape (m, 3).
        truth: displacement of each pair [px], shape (m,).
        noise: standard deviation [gray levels].
        step: step of the gradient [px].
    """
    moved = np.array([step * view.pitch, 0.0, 0.0])
    change = eye.grays(poses + moved).astype(np.float64) - eye.grays(poses - moved)
    gradient = change / (2.0 * step)
    pixel = np.arange(view.pixels) - np.round(truth)[:, None]  # pixels of the newer line
    common = (pixel >= 0) & (pixel < view.pixels)
    energy = np.sum(gradient**2, axis=1, where=common)
    return np.asarray(2.0 * (noise**2 + 1.0 / 12.0) / energy)
