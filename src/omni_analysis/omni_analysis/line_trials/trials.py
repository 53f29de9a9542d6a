"""Trials of one line camera over a ground: rendered pairs of lines, their matches, their errors.

The camera moves at a known speed and angle, as in section 4.4; consecutive lines are matched by a
full search and refined. Displacements are in pixels along the camera's axis.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.matching.search import METRICS
from linescan_odometry.matching.subpixel import SubpixelRefiner
from omni_analysis.line_trials.errors import error_values
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_sim.camera.camera import CameraConfiguration, LineCamera, LineCameraArray
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.texture import GroundTexture, TextureConfiguration

Lines = NDArray[np.uint8] | NDArray[np.uint16]

PERIOD = 0.2
"""Edge of a ground before it repeats itself [m]."""

_RECOVERY = 4  # px, of peaks that noise has moved
_GRADIENT_STEP = 0.02  # [px]


@dataclasses.dataclass(frozen=True)
class View:
    """What a camera sees.

    Attributes:
        pixels: of a line.
        length: of the field of view along the axis [m].
        width: of it across the axis [m].
        line_rate: [1/s].
    """

    pixels: int = 1024
    length: float = 0.05
    width: float = 0.02
    line_rate: float = 2500.0

    @property
    def pitch(self) -> float:
        """Length of a pixel on the ground [m]."""
        return self.length / self.pixels

    def overlap(self, speed: float, angle: float) -> float:
        """Return the common share of the areas of two consecutive frames, 0..1.

        Args:
            speed: of the camera [m/s].
            angle: of its motion from its axis [rad].
        """
        step = speed / self.line_rate
        along = 1.0 - abs(step * math.cos(angle)) / self.length
        across = 1.0 - abs(step * math.sin(angle)) / self.width
        return max(along, 0.0) * max(across, 0.0)


@dataclasses.dataclass(frozen=True)
class Matches:
    """Matches of pairs of lines.

    Attributes:
        truth: displacement along the axis [px], shape (m,).
        shift: integer shift of the smallest distance [px], shape (m,).
        displacement: refined shift [px], shape (m,).
        variance: that the refinement states [px^2], infinite where there is none, shape (m,).
        similarity: Pearson's correlation at the shift, shape (m,).
    """

    truth: FloatArray
    shift: NDArray[np.int64]
    displacement: FloatArray
    variance: FloatArray
    similarity: FloatArray

    @property
    def pixel_error(self) -> FloatArray:
        """Measured less rounded true displacement, Eq. (84) [px].

        A truth within the half pixel between two whole ones has two right roundings: the nearer
        one of those that are at most 0.55 px off counts.
        """
        error = self.shift - np.round(self.truth)
        return np.where(np.abs(self.shift - self.truth) <= 0.55, 0.0, error)

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether each pair found its match: a neighbouring pixel is noise, not a wrong match."""
        found: NDArray[np.bool_] = np.abs(self.pixel_error) <= 1.0
        return found

    @property
    def error(self) -> FloatArray:
        """Refined less true displacement, unrounded [px]."""
        return self.displacement - self.truth

    def error_values(self, view: View, speed: float) -> tuple[float, float, float, float]:
        """Return the errors under `displacement_errors.ERROR_COLUMNS`.

        Args:
            view: what the camera saw.
            speed: at which it moved [m/s].
        """
        return error_values(self.pixel_error, self.error, view.pitch, view.line_rate, speed)


@functools.lru_cache(maxsize=3)
def ground(kind: str, texels: int = 4096, seed: int = 1) -> GroundTexture:
    """Return a ground of the user's cache.

    Args:
        kind: of `omni_sim.texture.texture.KINDS`.
        texels: per period of 0.2 m.
        seed: of the pattern.
    """
    configuration = TextureConfiguration(kind=kind, size=PERIOD, texels=texels, seed=seed)
    return TextureCache.of_user().texture(configuration)


def camera(view: View, texture: GroundTexture, noise: float, seed: int) -> LineCamera:
    """Return a camera over a ground; see `cameras`."""
    return cameras((view,), texture, noise, seed)[0]


def cameras(
    views: Sequence[View], texture: GroundTexture, noise: float, seed: int
) -> list[LineCamera]:
    """Return cameras over a ground, which they share.

    Args:
        views: what they see.
        texture: the ground.
        noise: standard deviation [grey levels of 8 bit].
        seed: of the noise.
    """
    sensors = {
        f"trial_{i}": LineSensor(
            x=0.0,
            y=0.0,
            heading_deg=0.0,
            pixels=view.pixels,
            length=view.length,
            width=view.width,
            line_rate=view.line_rate,
        )
        for i, view in enumerate(views)
    }
    configuration = CameraConfiguration(noise=float(noise))
    sequence = np.random.SeedSequence(seed)
    array = LineCameraArray(sensors, texture, configuration, sequence)
    return [array.cameras[name] for name in sensors]


@dataclasses.dataclass(frozen=True)
class Motion:
    """Uniform motion of a camera.

    Attributes:
        view: what it sees.
        speed: [m/s].
        angle: from its axis [rad].
    """

    view: View
    speed: float
    angle: float

    @property
    def overlap(self) -> float:
        """Common share of the areas of two consecutive frames, 0..1."""
        return self.view.overlap(self.speed, self.angle)


def measure(
    motions: Sequence[Motion],
    texture: GroundTexture,
    pairs: int,
    noise: float,
    seed: int,
    metric: str = "pearson",
) -> list[Matches]:
    """Return the matches of consecutive lines of each motion, from a random start.

    Args:
        motions: what to try; shifts are searched up to half the pixels.
        texture: the ground.
        pairs: of consecutive lines, for each motion.
        noise: standard deviation [grey levels].
        seed: of starts and noise.
        metric: name of the distance.
    """
    generator = np.random.default_rng(seed)
    views = list(dict.fromkeys(motion.view for motion in motions))
    eyes = dict(zip(views, cameras(views, texture, noise, seed), strict=True))
    matches = []
    for i, motion in enumerate(motions):
        poses = path(motion.view, motion.speed, motion.angle, pairs + 1, generator)
        lines = eyes[motion.view].lines(poses, i * (pairs + 1))
        matches.append(match(motion.view, poses, lines, metric, recovery=_RECOVERY))
    return matches


def path(
    view: View, speed: float, angle: float, lines: int, generator: np.random.Generator
) -> FloatArray:
    """Return the poses of consecutive lines from a random start, axis along x, shape (lines, 3).

    Args:
        view: what the camera sees.
        speed: of the camera [m/s].
        angle: of its motion from its axis [rad].
        lines: how many.
        generator: draws the start.
    """
    travelled = speed / view.line_rate * np.arange(lines)
    start = generator.uniform(0.0, PERIOD, 2)
    return np.column_stack(
        (
            start[0] + travelled * math.cos(angle),
            start[1] + travelled * math.sin(angle),
            np.zeros(lines),
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
        view: what the camera saw.
        poses: of the lines, axis along x, shape (m + 1, 3).
        lines: shape (m + 1, pixels).
        metric: name of the distance.
        divisor: k; shifts are searched up to pixels / k.
        recovery: distance within which a peak that noise has moved is looked for again [px].
    """
    pairs = len(lines) - 1
    shift = np.empty(pairs, np.int64)
    similarity, displacement, variance = np.empty((3, pairs))
    METRICS[metric](view.pixels, int(view.pixels / divisor)).match(lines, shift, similarity)
    SubpixelRefiner(view.pixels, recovery).refine(lines, shift, displacement, variance)
    truth = np.diff(poses[:, 0]) / view.pitch
    return Matches(truth, shift, displacement, variance, similarity)


def every_second(matches: Matches) -> Matches:
    """Return the first, third, ... of some matches: those within pairs of lines in a row."""
    values = (getattr(matches, field.name)[::2] for field in dataclasses.fields(matches))
    return Matches(*values)


def cramer_rao_bound(
    view: View, eye: LineCamera, poses: FloatArray, truth: FloatArray, noise: float
) -> FloatArray:
    """Return the smallest variance of unbiased displacements between pairs of lines [px^2].

    Both lines are noisy and the ground is not known, so that the bound is twice that of a known
    ground: ``2 s^2 / sum(g^2)`` with the gradient g of the noise-free line over the overlap.
    Quantisation adds 1/12 to the variance s^2 of the noise.

    Args:
        view: what the camera sees.
        eye: the camera.
        poses: of the older line of each pair, shape (m, 3).
        truth: displacement of each pair [px], shape (m,).
        noise: standard deviation [grey levels].
    """
    step = np.array([_GRADIENT_STEP * view.pitch, 0.0, 0.0])
    gradient = (eye.greys(poses + step).astype(np.float64) - eye.greys(poses - step)) / (
        2.0 * _GRADIENT_STEP
    )
    pixel = np.arange(view.pixels) - np.round(truth)[:, None]  # of the newer line
    common = (pixel >= 0) & (pixel < view.pixels)
    energy = np.sum(gradient**2, axis=1, where=common)
    bound: FloatArray = 2.0 * (noise**2 + 1.0 / 12.0) / energy
    return bound
