"""Trials of the sideslip meter: a wheel with constant sideslip over rendered ground."""

import dataclasses
import math

import numpy as np

from linescan_odometry.sideslip.angle import SideslipWheel
from linescan_odometry.sideslip.meter import SideslipConfiguration, SideslipMeter
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import Rig

_WHEEL, _CAMERA = "wheel", "camera"


@dataclasses.dataclass(frozen=True, eq=False)
class Angles:
    """Measurements of some angles at one speed.

    Attributes:
        speed: speed of the wheel over ground [m/s].
        overlap: overlap of consecutive lines across the camera's axis at angle 0, 0..1.
        truth: sideslip angles [rad], shape (A,).
        angle: measured angles, NaN if unmeasured [rad], shape (A, batches).
        deviation: stated standard deviations, NaN if unmeasured [rad], shape (A, batches).
        sideways: measured sideways velocities, NaN if unmeasured [m/s], shape (A, batches).
    """

    speed: float
    overlap: float
    truth: FloatArray
    angle: FloatArray
    deviation: FloatArray
    sideways: FloatArray

    @property
    def error(self) -> FloatArray:
        """Measured less true angle, NaN where not measured [rad], shape (A, batches)."""
        return self.angle - self.truth[:, None]

    @property
    def measured_share(self) -> float:
        """Share of the batches that gave an angle, 0..1."""
        return float(np.mean(np.isfinite(self.angle)))

    @property
    def rms_error(self) -> float:
        """Root mean square of the errors [rad], NaN if nothing was measured."""
        return root_mean_square(self.error)

    def rms_error_with(self, wheel_speed: float) -> float:
        """Return the RMS error [rad] if the forward velocity is wrong.

        Args:
            wheel_speed: wheel speed over the true forward velocity, such as 0.99 for a wheel that
                slips.
        """
        forward = wheel_speed * self.speed * np.cos(self.truth)
        return root_mean_square(-np.arctan(self.sideways / forward[:, None]) - self.truth[:, None])


def root_mean_square(values: FloatArray) -> float:
    """Return the RMS of the finite values, NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else math.nan


def camera_at_a_wheel(name: str, sensor: LineSensor) -> SideslipConfiguration:
    """Move a camera to the contact of a wheel, along its axis of rotation.

    Args:
        name: name of the camera.
        sensor: the camera; its position and heading are replaced.

    Raises:
        ConfigurationError: its lines are too short or its rate is too low.
    """
    return SideslipConfiguration(
        sensors={name: dataclasses.replace(sensor, x=0.0, y=0.0, heading_deg=90.0)},
        sideslip={_WHEEL: SideslipWheel(sensor=name, x=0.0, y=0.0)},
    )


class RollingWheel:
    """A wheel with a camera along its axis of rotation, over one ground."""

    def __init__(self, sensor: LineSensor, texture: GroundTexture, noise: float, seed: int) -> None:
        """Place the camera.

        Args:
            sensor: the camera; its position and heading are those of the wheel.
            texture: the ground.
            noise: standard deviation [gray levels].
            seed: seed of the noise.
        """
        self._configuration = camera_at_a_wheel(_CAMERA, sensor)
        self._sensor = self._configuration.sensors[_CAMERA]
        self._size = texture.size
        self._rig = Rig({_CAMERA: self._sensor}, texture, noise, seed)

    def measure(
        self,
        speed: float,
        angles: FloatArray,
        places: int,
        batches: int,
        generator: np.random.Generator,
    ) -> Angles:
        """Roll at every angle from random positions, with the true forward velocity.

        Args:
            speed: speed of the wheel over ground [m/s].
            angles: angles of sideslip [rad], shape (A,).
            places: number of random positions for each angle.
            batches: batches of 10 ms from each.
            generator: draws the positions.
        """
        found = np.full((3, len(angles), places * batches), math.nan)
        for i, angle in enumerate(angles):
            # A positive angle is a slide to the right, -y.
            twist = speed * np.array([math.cos(angle), -math.sin(angle), 0.0])
            for place in range(places):
                meter = SideslipMeter(self._configuration, _WHEEL)
                start = np.append(generator.uniform(0.0, self._size, 2), 0.0)
                for batch, seen in enumerate(self._rig.drive(start, twist, batches)):
                    estimate = meter.update(seen[_CAMERA], float(twist[0]))
                    if estimate.measured:
                        column = place * batches + batch
                        found[:, i, column] = estimate.angle, estimate.deviation, estimate.sideways
        overlap = max(0.0, 1.0 - speed / self._sensor.line_rate / self._sensor.width)
        return Angles(speed, overlap, np.array(angles), found[0], found[1], found[2])
