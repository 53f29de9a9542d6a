"""Simulation of line cameras that move over a ground along known paths.

The platform moves with a constant twist in its own frame, on a circle or a straight line.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import SECOND_NS, FloatArray, IntArray
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch
from omni_sim.camera.camera import LineCamera, LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.texture.texture import GroundTexture

PERIOD = 0.2
"""Period of the ground texture [m]."""

BATCH_TIME = 0.01
"""Duration of a batch of lines, one control period [s]."""


def batch_lines(line_rate: float) -> int:
    """Return the number of lines in a batch at a line rate [1/s]."""
    return max(1, round(BATCH_TIME * line_rate))


@dataclasses.dataclass(frozen=True)
class View:
    """Field of view and line rate of a camera.

    Attributes:
        pixels: number of pixels of a line.
        length: field of view along the axis [m].
        width: field of view across the axis [m].
        line_rate: lines per second [1/s].
    """

    pixels: int = 1024
    length: float = 0.05
    width: float = 0.02
    line_rate: float = 2500.0

    @property
    def pitch(self) -> float:
        """Distance on the ground between neighboring pixels [m]."""
        return self.length / self.pixels

    def overlap(self, speed: float, angle: float) -> float:
        """Return the share of a line's area on the ground that the next line also covers, 0 to 1.

        Args:
            speed: speed of the camera [m/s].
            angle: angle between the direction of motion and the camera's axis [rad].
        """
        step = speed / self.line_rate
        along = 1.0 - abs(step * math.cos(angle)) / self.length
        across = 1.0 - abs(step * math.sin(angle)) / self.width
        return max(along, 0.0) * max(across, 0.0)

    @classmethod
    def of(cls, sensor: LineSensor) -> View:
        """Return the field of view and line rate of a mounted camera."""
        return cls(sensor.pixels, sensor.length, sensor.width, sensor.line_rate)

    def mounted(self, x: float = 0.0, y: float = 0.0, heading_deg: float = 0.0) -> LineSensor:
        """Return a camera with this view at a position [m] of the platform and a heading [deg]."""
        return LineSensor(x=x, y=y, heading_deg=heading_deg, **dataclasses.asdict(self))


@functools.lru_cache(maxsize=3)
def ground(kind: str, texels: int = 4096, seed: int = 1) -> GroundTexture:
    """Return the texture of a ground from the user's cache; it is rendered if necessary.

    Args:
        kind: one of `omni_sim.texture.configuration.KINDS`.
        texels: number of texels per period of 0.2 m.
        seed: seed of the pattern.
    """
    configuration = TextureConfiguration(kind=kind, size=PERIOD, texels=texels, seed=seed)
    return TextureCache.of_user().texture(configuration)


def poses_at(elapsed: FloatArray, start: FloatArray, twist: FloatArray) -> FloatArray:
    """Return the poses of a platform that moves with a constant twist.

    Args:
        elapsed: times since the start [s], shape (m,).
        start: x, y [m] and yaw [rad], shape (3,).
        twist: (v_x, v_y [m/s], yaw rate [rad/s]) in the platform's frame, shape (3,).

    Returns:
        x, y [m], yaw [rad], shape (m, 3).
    """
    angle = twist[2] * elapsed
    # Direction and length of the chord; np.sinc(x) is sin(pi x) / (pi x).
    chord = elapsed * np.sinc(0.5 * angle / math.pi)
    moved = chord[:, np.newaxis] * turned(twist[:2], start[2] + 0.5 * angle)
    return np.column_stack((start[:2] + moved, start[2] + angle))


class Rig:
    """Simulated line cameras over one ground.

    Attributes:
        sensors: mounting and field of view of each camera, keyed by name.
        array: simulated cameras; this object counts the lines of each camera, because the noise
            depends on the count.
    """

    def __init__(
        self, sensors: Mapping[str, LineSensor], texture: GroundTexture, noise: float, seed: int
    ) -> None:
        """Place the cameras over the ground.

        Args:
            sensors: mounting and field of view of each camera, keyed by name.
            texture: the ground.
            noise: standard deviation [gray levels of 8 bit].
            seed: seed of the camera noise.

        Raises:
            ConfigurationError: a field of view exceeds the ground.
        """
        self.sensors = sensors
        configuration, key = CameraConfiguration(noise=float(noise)), np.random.SeedSequence(seed)
        self.array = LineCameraArray(sensors, texture, configuration, key)

    def expose(
        self, start: FloatArray, twist: FloatArray, lines: Mapping[str, IntArray], begin_ns: int = 0
    ) -> dict[str, LineBatch]:
        """Return a batch of lines from each camera, keyed by camera name.

        Args:
            start: x, y [m] and yaw [rad] at line 0, shape (3,).
            twist: (v_x, v_y [m/s], yaw rate [rad/s]) in the platform's frame, shape (3,).
            lines: indices of the lines to expose, keyed by camera name, shape (m,) each.
            begin_ns: stamp of line 0 [ns].
        """
        elapsed = {name: own / self.sensors[name].line_rate for name, own in lines.items()}
        poses = {name: poses_at(own, start, twist) for name, own in elapsed.items()}
        return {
            name: LineBatch(begin_ns + round(SECOND_NS * float(elapsed[name][-1])), own)
            for name, own in self.array.render(poses).items()
        }

    def drive(
        self, start: FloatArray, twist: FloatArray, batches: int, first: int = 0
    ) -> Iterator[dict[str, LineBatch]]:
        """Yield consecutive batches of duration `BATCH_TIME`, keyed by camera name.

        Args:
            start: x, y [m] and yaw [rad] at line 0, shape (3,).
            twist: (v_x, v_y [m/s], yaw rate [rad/s]) in the platform's frame, shape (3,).
            batches: number of batches.
            first: index of the first line.
        """
        sizes = {name: batch_lines(sensor.line_rate) for name, sensor in self.sensors.items()}
        for batch in range(batches):
            lines = {
                name: first + np.arange(batch * size, (batch + 1) * size)
                for name, size in sizes.items()
            }
            yield self.expose(start, twist, lines)


def cameras(
    views: Sequence[View], texture: GroundTexture, noise: float, seed: int
) -> list[LineCamera]:
    """Return one camera for each of `views`, at the platform's center over one ground.

    The other arguments are those of `Rig`.
    """
    sensors = {f"trial_{i}": view.mounted() for i, view in enumerate(views)}
    return list(Rig(sensors, texture, noise, seed).array.cameras.values())


def camera(view: View, texture: GroundTexture, noise: float, seed: int) -> LineCamera:
    """Return a single camera with the given view, at the platform's center.

    The other arguments are those of `Rig`.
    """
    return cameras((view,), texture, noise, seed)[0]
