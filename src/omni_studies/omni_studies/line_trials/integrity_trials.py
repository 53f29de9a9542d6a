"""Errors of the batches of faulty line cameras that move over a ground.

The motion of fault-free cameras over a ground, called a drive here, is rendered once. For each
fault, the rendered lines are converted to lines of faulty cameras. The odometry estimator is reset
for each drive and fault, so that its estimates of camera properties depend only on this drive.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.odometry import LineScanOdometry
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor, sensor_matrix
from omni_core.signals import LineBatch
from omni_sim.camera.camera import LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.picture import read_picture
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials import rig, trials

SENSORS: Mapping[str, LineSensor] = {
    "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
    "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
    "front": LineSensor(x=0.6, y=0.0, heading_deg=90.0),
}


@dataclasses.dataclass(frozen=True)
class PathMotion:
    """Motion along a circle or a straight line, with a speed that changes linearly with time.

    Attributes:
        twist: initial twist (v_x, v_y [m/s], yaw rate [rad/s]).
        growth: rate of change of the twist, relative to its initial value [1/s].
    """

    twist: tuple[float, float, float]
    growth: float = 0.0

    def traveled(self, time: FloatArray) -> FloatArray:
        """Return how long the initial twist, kept constant, would take for the same path [s].

        The result has the shape (t,).

        Args:
            time: time that this motion takes for the path [s], shape (t,).
        """
        return time + 0.5 * self.growth * time**2


MOTIONS: tuple[PathMotion, ...] = (
    PathMotion((10.0, 0.0, 0.0)),
    PathMotion((8.0, 0.0, 0.3), -1.0),
    PathMotion((5.0, 0.0, 0.0), -1.5),
    PathMotion((4.0, -3.0, 0.8)),
    PathMotion((3.0, 1.0, 0.5)),
    PathMotion((2.0, 0.0, 0.0)),
    PathMotion((1.0, 0.3, -0.3), 1.0),
    PathMotion((0.5, 0.0, 0.0)),
    PathMotion((0.2, 0.1, 0.05)),
    PathMotion((0.05, 0.0, 0.0)),
    PathMotion((0.0, 0.0, 0.0)),
    PathMotion((0.0, 3.0, 0.0)),
    PathMotion((0.0, -1.0, 0.2)),
    PathMotion((0.0, 0.0, 1.5)),
)


@dataclasses.dataclass(frozen=True)
class CameraFault:
    """A fault of line cameras or of their data.

    Attributes:
        camera: optics and pixels of the cameras.
        rate: ratio of the configured to the true line rate [1].
        lost: interval between missing lines [lines]; 0 for none.
        swapped: interval between batches that arrive in the wrong order [batches]; 0 for none.
        repeated: interval between batches that are repeated in place of the next batch [batches]; 0
            for none.
        repeats: whether the ground repeats within the field of view.
    """

    camera: CameraConfiguration = dataclasses.field(default_factory=CameraConfiguration)
    rate: float = 1.0
    lost: int = 0
    swapped: int = 0
    repeated: int = 0
    repeats: bool = False


def _camera(**changes: Any) -> CameraFault:
    return CameraFault(camera=CameraConfiguration(**changes))


FAULTS: Mapping[str, CameraFault] = {
    "none": CameraFault(),
    "dirt_spots": _camera(dirt_spots=30),
    "stuck_pixel": _camera(stuck_pixels=1),
    "hot_pixels": _camera(hot_pixels=10),
    "prnu": _camera(photo_response=0.05),
    "dark_steps": _camera(dark_steps=3.0),
    "mud": _camera(mud=0.25),
    "shadow_fixed": _camera(shadow=0.5),
    "shadow_moving": _camera(shadow=0.5, shadow_speed=0.3),
    "lost_lines": CameraFault(lost=30),
    "wrong_rate": CameraFault(rate=1.04),
    "swapped_batches": CameraFault(swapped=5),
    "repeated_batches": CameraFault(repeated=5),
    "repeating_ground": CameraFault(repeats=True),
}
OF_TIME = ("lost_lines", "wrong_rate", "swapped_batches", "repeated_batches")


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
    """

    kind: str
    angle: float = math.nan
    dpi: float = 0.0
    seed: int = 1
    texels: int = 8192

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
    """

    ratio: FloatArray
    error: FloatArray
    reasons: tuple[str, ...] = ()

    @property
    def undetected(self) -> NDArray[np.bool_]:
        """Whether each batch has an undetected error (measured, but wrong), shape (m,)."""
        return trials.undetected(self.ratio, self.error)


def drive_over(
    ground: Ground,
    faults: Mapping[str, CameraFault],
    drives: range,
    batches: int,
    seed: int,
    motions: Sequence[PathMotion] = MOTIONS,
    **settings: Any,
) -> dict[str, Tally]:
    """Return the errors of all simulated drives over a ground, keyed by fault.

    Args:
        ground: the ground.
        faults: faults, keyed by name.
        drives: indices of the drives. Each drive has a random start; the motions are used
            cyclically.
        batches: number of batches of each camera in a drive.
        seed: seed of positions, headings and noise.
        motions: the motions.
        **settings: parameters of the odometry.
    """
    texture = _texture(ground)
    # These cameras only convert exposures of the others, so a coarse ground is sufficient.
    gray = np.ascontiguousarray(texture.gray[::16, ::16])
    coarse = GroundTexture(gray, texture.size)
    key = np.random.SeedSequence(seed)
    faulty = {
        name: LineCameraArray(SENSORS, coarse, fault.camera, key) for name, fault in faults.items()
    }
    found: dict[str, list[tuple[float, float, str]]] = {name: [] for name in faults}
    for number in drives:
        motion = motions[number % len(motions)]
        for name, fault in faults.items():
            drive = _exposed(ground, seed, motion, number, batches, fault.repeats)
            lines = {
                eye: camera.develop(drive.exposures[eye], number * len(drive.time))
                for eye, camera in faulty[name].cameras.items()
            }
            found[name] += _measure(fault, lines, drive, motion, settings)
    return {
        name: Tally(
            np.array([ratio for ratio, _, _ in entries]),
            np.array([error for _, error, _ in entries]),
            tuple(words for _, _, words in entries if words),
        )
        for name, entries in found.items()
    }


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
    exposures: Mapping[str, NDArray[np.float32]]


@functools.lru_cache(2)
def _exposed(
    ground: Ground, seed: int, motion: PathMotion, number: int, batches: int, repeats: bool
) -> _Exposed:
    """Return the rendered lines of one drive; all faults use the same lines.

    Args:
        ground: the ground.
        seed: seed of start and noise.
        motion: motion of the cameras.
        number: index of the drive; each drive has another random start.
        batches: number of batches of each camera.
        repeats: whether the ground repeats within the field of view.
    """
    line_rate = SENSORS["left"].line_rate
    generator = np.random.default_rng((seed, 7, number))
    time = np.arange(rig.batch_lines(line_rate) * batches + 1) / line_rate
    yaw = generator.uniform(0.0, 2.0 * math.pi) if math.isnan(ground.angle) else ground.angle
    start = np.array([*generator.uniform(0.0, _texture(ground).size, 2), yaw])
    path = motion.traveled(time)
    poses = rig.poses_at(path, start, np.array(motion.twist))
    cameras = _cameras(ground, seed, repeats).cameras
    return _Exposed(time, path, {name: own.ground(poses) for name, own in cameras.items()})


@functools.lru_cache(1)
def _texture(ground: Ground) -> GroundTexture:
    return ground.texture()


@functools.lru_cache(2)
def _cameras(ground: Ground, seed: int, repeats: bool) -> LineCameraArray:
    """Return fault-free cameras over the ground, or over a periodic repetition of its beginning."""
    texture = _texture(ground)
    seen = _repeating(texture) if repeats else texture
    return LineCameraArray(SENSORS, seen, CameraConfiguration(), np.random.SeedSequence(seed))


def _repeating(texture: GroundTexture, period: float = 0.0256) -> GroundTexture:
    """Return a ground that repeats the beginning of `texture` with the given period [m]."""
    texels, times = round(period / texture.texel), math.ceil(0.06 / period)
    return GroundTexture(np.tile(texture.gray[:texels, :texels], (times, times)), times * period)


def _measure(
    fault: CameraFault,
    lines: Mapping[str, NDArray[np.uint8] | NDArray[np.uint16]],
    drive: _Exposed,
    motion: PathMotion,
    settings: Mapping[str, Any],
) -> list[tuple[float, float, str]]:
    """Return the errors of all batches of one drive; the odometry is reset before the first one.

    Args:
        fault: the fault. Its effects on stamps, order and number of the lines are applied here; its
            effects on the pixels are already part of `lines`.
        lines: lines of the faulty cameras, keyed by camera, shape (t, pixels) each.
        drive: true times and path of the lines.
        motion: motion of the cameras.
        settings: parameters of the odometry.

    Returns:
        For each camera and each batch except the first: error of the velocity along the axis
        divided by the stated standard deviation [1], error [m/s], and reason of a rejection or
        remark. Errors are NaN if the batch is unmeasured.
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
    found = []
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
        truth = rows @ np.array(motion.twist) * pace
        for reading, velocity in zip(estimate.readings.values(), truth, strict=True):
            error = reading.velocity - velocity
            ratio = error / math.sqrt(reading.variance) if reading.measured else math.nan
            found.append((ratio, error, reading.reason or reading.remark))
    return found
