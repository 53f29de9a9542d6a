"""Errors of the batches of faulty line cameras that move over a ground.

The motion of fault-free cameras over a ground, called a drive here, is rendered once. For each
fault, the rendered lines are converted to lines of faulty cameras. The odometry estimator is reset
for each drive and fault, so that its estimates of camera properties depend only on this drive.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.odometry import LineScanOdometry
from omni_core.quantities import BoolArray, Float32Array, FloatArray
from omni_core.sensors import sensor_matrix
from omni_core.signals import LineBatch, Lines
from omni_sim.camera.camera import LineCamera, LineCameraArray
from omni_sim.camera.configuration import ORDINARY, TELECENTRIC, CameraConfiguration
from omni_sim.texture.picture import read_picture
from omni_sim.texture.texture import GroundTexture
from omni_studies.line_trials.integrity_cases import SENSORS, IntegrityCase, PathMotion
from omni_tools.line_trials import rig, trials

_HEAVE_RATE = 30.0  # frequency of the heave [Hz]
_MOST_SCORE = 4.0  # limit on the normalized errors of a twist in the autocorrelation [1]


@dataclasses.dataclass(frozen=True)
class Ground:
    """A ground with the direction in which the cameras move over it.

    Attributes:
        kind: kind from `omni_sim.texture.configuration.KINDS`, or the file of a picture.
        angle: direction of motion relative to the texture's x axis (the direction of the fibers)
            [rad]; NaN for a random direction.
        dpi: dots per inch of a picture on the ground.
        seed: seed of the pattern.
        texels: number of texels per period of 0.2 m. With 8192 texels, a camera with 1024 px over
            50 mm has two texels per pixel.
        noise: standard deviation of the noise of the cameras [gray levels].
    """

    kind: str
    angle: float = math.nan
    dpi: float = 0.0
    seed: int = 1
    texels: int = 8192
    noise: float = CameraConfiguration.noise

    def texture(self) -> GroundTexture:
        """Return the texture of the ground; a picture is read, and any other ground is rendered."""
        if self.dpi > 0.0:
            return read_picture(self.kind, self.dpi)
        return rig.ground(self.kind, self.texels, self.seed)


@dataclasses.dataclass(frozen=True)
class Tally:
    """Errors of all batches of all cameras over one ground with one injected fault.

    Attributes:
        ratio: error of the velocity along the camera's axis, divided by the standard deviation that
            the odometry states [1]; NaN if unmeasured, shape (m,).
        error: error of the velocity along the camera's axis [m/s], shape (m,).
        reasons: reasons why batches are unmeasured, and remarks on measured batches.
        covered: whether the batch is that of a covered camera, shape (m,).
        scores: for each drive, the error of the twist of each instant, normalized by its covariance
            [1]; NaN if unmeasured, shape (batches, 3).
    """

    ratio: FloatArray
    error: FloatArray
    reasons: tuple[str, ...]
    covered: BoolArray
    scores: tuple[FloatArray, ...]

    @property
    def undetected(self) -> BoolArray:
        """Whether each batch has an undetected error (measured, but wrong), shape (m,)."""
        return trials.undetected(self.ratio, self.error)

    @property
    def beyond(self) -> BoolArray:
        """Whether the error of each batch exceeds 4 stated standard deviations, shape (m,)."""
        return trials.undetected(self.ratio, self.error, 0.0)

    @property
    def autocovariance(self) -> tuple[float, float]:
        """Sums over pairs of consecutive twists: of the products of their scores, and of squares.

        Their ratio is the autocorrelation at a lag of one batch. Scores are limited to 4, so that a
        single error does not determine it.
        """
        products, squares = 0.0, 0.0
        for scores in self.scores:
            limited = np.clip(scores, -_MOST_SCORE, _MOST_SCORE)
            one, other = limited[:-1], limited[1:]
            pairs = np.isfinite(one[:, 0]) & np.isfinite(other[:, 0])
            products += float(np.sum(one[pairs] * other[pairs]))
            squares += 0.5 * float(np.sum(one[pairs] ** 2 + other[pairs] ** 2))
        return products, squares


def drive_over(
    ground: Ground,
    faults: Mapping[str, IntegrityCase],
    drives: range,
    batches: int,
    seed: int,
    motions: Sequence[PathMotion] = (),
    **settings: Any,
) -> dict[str, Tally]:
    """Return the errors of all simulated drives over a ground, keyed by fault.

    Args:
        ground: the ground.
        faults: faults, keyed by name.
        drives: indices of the drives. Each drive has a random start; the motions are used
            cyclically.
        batches: number of batches of each camera in a drive that are counted.
        seed: seed of positions, headings and noise.
        motions: the motions; by default those of the fault.
        **settings: parameters of the odometry.
    """
    found: dict[str, list[_Reading]] = {name: [] for name in faults}
    scores: dict[str, list[FloatArray]] = {name: [] for name in faults}
    for number in drives:
        for name, fault in faults.items():
            chosen = motions or fault.motions
            motion, lead = chosen[number % len(chosen)], round(fault.lead / rig.BATCH_TIME)
            rest = seed, motion, number, lead + batches, fault.repeats, fault.heave
            drive = _exposed(ground, *rest)
            if fault.before:
                drive = drive.after(_exposed(Ground(fault.before), *rest), fault.lead)
            readings, twists = _measure(
                fault, _developed(ground, fault, drive, number, seed), drive, motion, settings
            )
            found[name] += readings[lead * len(SENSORS) :]
            scores[name].append(twists[lead:])
    return {
        name: Tally(
            np.array([reading.ratio for reading in readings]),
            np.array([reading.error for reading in readings]),
            tuple(reading.words for reading in readings if reading.words),
            np.array([reading.camera in faults[name].covered for reading in readings]),
            tuple(scores[name]),
        )
        for name, readings in found.items()
    }


class _Reading(NamedTuple):
    """Error of the velocity of one camera in one batch.

    Attributes:
        camera: name of the camera.
        ratio: error divided by the stated standard deviation [1]; NaN if unmeasured.
        error: error [m/s].
        words: reason of a rejection, or remark; may be empty.
    """

    camera: str
    ratio: float
    error: float
    words: str


class _Exposed(NamedTuple):
    """Lines of fault-free cameras in one simulated drive.

    Attributes:
        time: times of the lines from the start of the drive [s], shape (t,).
        path: time that the initial twist, if it stayed constant, would take to reach the pose of
            each line [s], shape (t,).
        exposures: exposures [gray levels of 8 bit], shape (t, pixels), keyed by camera.
    """

    time: FloatArray
    path: FloatArray
    exposures: Mapping[str, Float32Array]

    def after(self, first: _Exposed, lead: float) -> _Exposed:
        """Return this drive with the exposures of another drive during the first `lead` [s]."""
        before = (self.time < lead)[:, None]
        exposures = {
            name: np.where(before, first.exposures[name], own)
            for name, own in self.exposures.items()
        }
        return self._replace(exposures=exposures)


def _developed(
    ground: Ground, fault: IntegrityCase, drive: _Exposed, number: int, seed: int
) -> dict[str, Lines]:
    """Return the lines of faulty cameras in one drive, keyed by camera.

    Faults that begin and end are counted from the start of the drive.

    Args:
        ground: the ground.
        fault: the fault.
        drive: lines of fault-free cameras.
        number: index of the drive, which determines the noise.
        seed: seed of noise, dirt and mud.
    """
    texture, camera = _texture(ground), fault.camera
    # These cameras only convert exposures of the others, so a coarse ground is sufficient.
    coarse = GroundTexture(np.ascontiguousarray(texture.gray[::16, ::16]), texture.size)
    if fault.level:
        camera = dataclasses.replace(camera, gain=fault.level / float(coarse.gray.mean()))
    else:
        camera = dataclasses.replace(camera, noise=ground.noise)
    key = np.random.SeedSequence((seed, number) if camera.faults else seed)
    cameras = LineCameraArray(SENSORS, coarse, camera, key).cameras
    first = 0 if camera.faults else number * len(drive.time)
    return {name: own.develop(drive.exposures[name], first) for name, own in cameras.items()}


@functools.lru_cache(4)
def _exposed(
    ground: Ground,
    seed: int,
    motion: PathMotion,
    number: int,
    batches: int,
    repeats: bool,
    heave: float,
) -> _Exposed:
    """Return the rendered lines of one drive; all faults use the same lines.

    Args:
        ground: the ground.
        seed: seed of start and noise.
        motion: motion of the cameras.
        number: index of the drive; each drive has another random start.
        batches: number of batches of each camera.
        repeats: whether the ground repeats within the field of view.
        heave: relative change of the view by heave.
    """
    line_rate = SENSORS["left"].line_rate
    generator = np.random.default_rng((seed, 7, number))
    time = np.arange(rig.batch_lines(line_rate) * batches + 1) / line_rate
    yaw = generator.uniform(0.0, 2.0 * math.pi) if math.isnan(ground.angle) else ground.angle
    start = np.array([*generator.uniform(0.0, _texture(ground).size, 2), yaw])
    path = motion.traveled(time)
    poses = rig.poses_at(path, start, np.array(motion.twist))
    cameras = _cameras(ground, seed, repeats, ORDINARY if heave else TELECENTRIC).cameras
    if heave:
        rise = heave * np.sin(2.0 * math.pi * (_HEAVE_RATE * time + generator.uniform()))
        return _Exposed(time, path, {name: _heaved(c, poses, rise) for name, c in cameras.items()})
    return _Exposed(time, path, {name: own.ground(poses) for name, own in cameras.items()})


def _heaved(camera: LineCamera, poses: FloatArray, rise: FloatArray) -> Float32Array:
    """Return the exposures of a camera that heaves, shape (t, pixels).

    Args:
        camera: camera with an ordinary lens.
        poses: poses of base_link [m, m, rad], shape (t, 3).
        rise: height above the mounting height, as a share of the working distance [1], shape (t,).
    """
    lines = []
    for i in range(len(poses)):
        camera.rise = CameraConfiguration.working_distance * rise[i]
        lines.append(camera.ground(poses[i : i + 1])[0])
    camera.rise = 0.0
    return np.array(lines)


@functools.lru_cache(2)
def _texture(ground: Ground) -> GroundTexture:
    return ground.texture()


@functools.lru_cache(3)
def _cameras(ground: Ground, seed: int, repeats: bool, lens: str) -> LineCameraArray:
    """Return fault-free cameras over the ground, or over a periodic repetition of its beginning."""
    texture = _texture(ground)
    seen = _repeating(texture) if repeats else texture
    optics = CameraConfiguration(lens=lens)
    return LineCameraArray(SENSORS, seen, optics, np.random.SeedSequence(seed))


def _repeating(texture: GroundTexture, period: float = 0.0256) -> GroundTexture:
    """Return a ground that repeats the beginning of `texture` with the given period [m]."""
    texels, times = round(period / texture.texel), math.ceil(0.06 / period)
    return GroundTexture(np.tile(texture.gray[:texels, :texels], (times, times)), times * period)


def _measure(
    fault: IntegrityCase,
    lines: Mapping[str, Lines],
    drive: _Exposed,
    motion: PathMotion,
    settings: Mapping[str, Any],
) -> tuple[list[_Reading], FloatArray]:
    """Return the errors of all batches of one drive; the odometry is reset before the first one.

    Args:
        fault: the fault. Its effects on stamps, order and number of the lines are applied here; its
            effects on the pixels are already part of `lines`.
        lines: lines of the faulty cameras, keyed by camera, shape (t, pixels) each.
        drive: true times and path of the lines.
        motion: motion of the cameras.
        settings: parameters of the odometry.

    Returns:
        The errors of each camera in each batch except the first, and the normalized errors of the
        twists, shape (batches, 3).
    """
    configured = {
        n: dataclasses.replace(s, line_rate=s.line_rate * fault.rate) for n, s in SENSORS.items()
    }
    odometry = LineScanOdometry(OdometryConfiguration(sensors=configured, **settings))
    rows = sensor_matrix(SENSORS)
    time, path, _ = drive
    kept = np.arange(len(time))
    if fault.lost:
        kept = kept[(kept % fault.lost) != fault.lost // 2]
    size = rig.batch_lines(SENSORS["left"].line_rate)
    ends = np.arange(0, len(kept), size)
    order = list(range(len(ends)))
    for i in range(fault.swapped, len(order) - 1, fault.swapped) if fault.swapped else ():
        order[i], order[i + 1] = order[i + 1], order[i]
    found, scores = [], []
    for turn, number in enumerate(order):
        shown = number
        if fault.repeated and turn > 1 and turn % fault.repeated == 0:
            shown = number - 1
        end = ends[shown]
        chosen = kept[max(0, end - size + 1) : end + 1]
        stamp_ns = 10**9 + round(1e9 * time[kept[ends[number]]])
        estimate = odometry.update(
            {n: LineBatch(stamp_ns, own[chosen]) for n, own in lines.items()}
        )
        if number == 0:
            continue
        first, last = kept[ends[number] - size], kept[ends[number]]
        pace = (path[last] - path[first]) / (time[last] - time[first])
        twist = np.array(motion.twist) * pace
        spread = np.linalg.cholesky(estimate.covariance)
        score = np.linalg.solve(spread, estimate.twist - twist)
        scores.append(score if estimate.measured else np.full(3, math.nan))
        for (name, reading), velocity in zip(estimate.readings.items(), rows @ twist, strict=True):
            error = reading.velocity - velocity
            ratio = error / math.sqrt(reading.variance) if reading.measured else math.nan
            found.append(_Reading(name, ratio, error, reading.reason or reading.remark))
    return found, np.array(scores)
