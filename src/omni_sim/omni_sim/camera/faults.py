"""Faults of the line cameras that begin and end during a run.

A fault affects one camera, or all of them, from its onset for a limited time. Let ``y`` be the
light on a pixel in gray levels, ``tau`` the time since the onset, ``a`` the amplitude and ``T`` the
period. During the fault the light is

    dirt     y times the transmission of ``a`` specks of dirt on the optics
    cover    that of mud on a share ``a`` of the line, at the end with the highest pixel numbers
    light    (1 - a) y
    flicker  (1 + a sin(2 pi tau / T)) y; mains light has a period of 0.01 s (50 Hz)
    shadow   (1 - a) y in a shadow, whose edge moves over the line from pixel 0 to its end within T
    bump     y of a camera whose mounting has turned by the angle ``a`` about the vertical through
             the center of its view
"""

import dataclasses
import math

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import Float32Array, FloatArray, IntArray
from omni_core.sensors import LineSensor
from omni_sim.camera import optics
from omni_sim.camera.configuration import BUMP, CameraConfiguration, CameraFault


@dataclasses.dataclass(frozen=True, eq=False)
class TimedFault:
    """A fault with the properties of the camera that it affects.

    Attributes:
        fault: configuration of the fault.
        sensor: the camera.
        pattern: transmission of the specks of dirt [1], or gray levels of the mud, shape (pixels,).
    """

    fault: CameraFault
    sensor: LineSensor
    pattern: Float32Array

    def active(self, time: FloatArray) -> IntArray:
        """Return the indices of the times [s] at which the fault is active."""
        since = time - self.fault.time
        active = np.flatnonzero((since >= 0.0) & (since < self.fault.duration))
        return np.asarray(active, np.int64)

    def turns(self, time: FloatArray) -> IntArray:
        """Return the indices of the times [s] at which the mounting is turned."""
        return self.active(time) if self.fault.kind == BUMP else np.zeros(0, np.int64)

    def change(self, grays: Float32Array, time: FloatArray) -> None:
        """Change the light of the lines that are exposed during the fault, in place.

        Args:
            grays: light on each pixel [gray levels], shape (m, pixels).
            time: times of the lines since the start of the run [s], shape (m,).
        """
        rows = self.active(time)
        if not len(rows) or self.fault.kind == BUMP:
            return
        if self.fault.kind == "cover":
            pixels = grays.shape[1]
            first = round((1.0 - self.fault.amplitude) * pixels)
            grays[rows, first:] = self.pattern[first:]
            return
        grays[rows] *= self._transmission(time[rows] - self.fault.time)

    def _transmission(self, tau: FloatArray) -> Float32Array:
        """Return the factor of the light, shape (m, pixels), (1, pixels) or (m, 1).

        `tau` is the time since the onset [s], shape (m,).
        """
        share, phase = self.fault.amplitude, tau[:, None] / self.fault.period
        if self.fault.kind == "dirt":
            return self.pattern[None]
        if self.fault.kind == "flicker":
            return np.asarray(1.0 + share * np.sin(2.0 * math.pi * phase), np.float32)
        if self.fault.kind == "light":
            return np.full((1, 1), 1.0 - share, np.float32)
        shaded = 1.0 - optics.lit(self.sensor, np.minimum(phase[:, 0], 1.0))
        return np.asarray(1.0 - share * shaded, np.float32)


def faults_of(
    name: str, sensor: LineSensor, configuration: CameraConfiguration, key: np.uint64
) -> tuple[TimedFault, ...]:
    """Return the faults of one camera, in the order of the configuration.

    Args:
        name: name of the camera.
        sensor: the camera.
        configuration: optics and faults of all cameras.
        key: seed of the positions of dirt and mud.
    """
    faults = []
    for number, fault in enumerate(configuration.faults.values()):
        generator = optics.pattern(key, 4, number)
        grays = optics.mud(generator, sensor)
        if fault.kind == "dirt":
            grays = optics.specks(generator, sensor, configuration, round(fault.amplitude))
        if fault.camera in {"", name}:
            faults.append(TimedFault(fault, sensor, grays.astype(np.float32)))
    return tuple(faults)


def turned_poses(
    poses: FloatArray, footprints: FloatArray, rows: IntArray, angle: float
) -> FloatArray:
    """Return poses from which the same mounting gives the same footprints, turned by an angle.

    Args:
        poses: x, y, yaw of base_link [m, m, rad], shape (m, 3).
        footprints: x, y and direction of the footprints at these poses [m, m, rad], shape (m, 3).
        rows: indices of the poses to change.
        angle: angle about the center of each footprint [rad].
    """
    changed = poses.copy()
    arm = poses[rows, :2] - footprints[rows, :2]
    changed[rows, :2] = footprints[rows, :2] + turned(arm, np.full(len(rows), angle))
    changed[rows, 2] += angle
    return changed


def moved_to(velocities: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the velocities of other points of the same rigid bodies.

    Args:
        velocities: velocity [m/s, m/s] and yaw rate [rad/s], shape (m, 3).
        offset: position of the other point relative to the first one in its columns 0 and 1 [m],
            shape (m, 3).
    """
    moved = velocities.copy()
    moved[:, 0] -= velocities[:, 2] * offset[:, 1]
    moved[:, 1] += velocities[:, 2] * offset[:, 0]
    return moved
