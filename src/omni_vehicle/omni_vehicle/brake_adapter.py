"""Converts the brake enables of the wheels to commands of brakes and drives.

An enable is the share of the braking demand that passes to a wheel [0, 1]. The command to the
controller depends on the kind of the brake:

- ``spring``: a spring-applied brake that a coil releases; command 1 energizes the coil,
- ``proportional``: a brake that follows a demand of 0 to 1,
- ``torque``: a drive with a torque command [N m], which must never drive the wheel,
- ``velocity``: a drive with a speed command [rad/s], which follows the ramp set here.

Missing and NaN inputs count as full braking.
"""

import dataclasses
import math

import numpy as np

from omni_platform.brakes import PROPORTIONAL, SPRING, TORQUE, VELOCITY
from omni_platform.configuration import Configuration, ConfigurationError, parameter
from omni_platform.quantities import FloatArray

KINDS = (SPRING, PROPORTIONAL, TORQUE, VELOCITY)


class BrakeAdapterConfiguration(Configuration):
    """Brakes of a vehicle and the timing of their commands."""

    wheels: tuple[str, ...] = parameter()
    """Names of the wheels in the order of the controller's joints"""
    kind: str = parameter(SPRING, choices=KINDS)
    """Kind of the brakes"""
    max_torque: float = parameter(10.0, unit="N m", above=0.0, maximum=1.0e6)
    """Braking torque of a wheel at full demand, for torque drives"""
    standstill_speed: float = parameter(0.5, unit="rad/s", above=0.0, maximum=100.0)
    """Wheel speed below which a torque command fades out, so that it never drives"""
    ramp: float = parameter(50.0, unit="rad/s^2", above=0.0, maximum=1.0e5)
    """Deceleration of a braked wheel's speed command, for velocity drives"""
    minimum_dwell_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=10.0)
    """Shortest time between a brake's application and its next release, for spring-applied
    brakes"""
    enable_timeout: float = parameter(0.05, unit="s", above=0.0, maximum=1.0)
    """Silence or age of the enables after which all brakes are on"""

    def check_consistency(self) -> None:
        """Refuse wheels that are missing or named twice."""
        if not self.wheels or len(set(self.wheels)) != len(self.wheels):
            raise ConfigurationError("wheels", "must name every wheel once")


@dataclasses.dataclass(frozen=True, eq=False)
class WheelDemand:
    """Inputs of a step, N wheels.

    Attributes:
        pedal: braking demand, 0 to 1; NaN if it is unknown.
        enable: share of the demand that passes to each wheel, NaN where unknown, shape (N,).
        speed: speed of the wheels [rad/s], NaN where unknown, shape (N,).
        drive: command of the vehicle's own drive, passed on while the pedal is released [N m] or
            [rad/s], shape (N,).
    """

    pedal: float
    enable: FloatArray
    speed: FloatArray
    drive: FloatArray


class BrakeAdapter:
    """Converts enables to the commands of one kind of brake."""

    def __init__(self, configuration: BrakeAdapterConfiguration) -> None:
        self.configuration = configuration
        wheels = len(configuration.wheels)
        self._applied_for = np.full(wheels, math.inf)  # time since each application [s]
        self._applied = np.ones(wheels, np.bool_)
        self._command = np.zeros(wheels)  # speed command while braking [rad/s]

    def step(self, demand: WheelDemand, dt: float) -> FloatArray:
        """Return the command of each wheel, shape (N,).

        Args:
            demand: demand of the driver and of the assistant.
            dt: time since the step before [s].
        """
        pedal = demand.pedal if 0.0 <= demand.pedal <= 1.0 else 1.0
        # False for NaN: such a wheel brakes fully.
        valid = (demand.enable >= 0.0) & (demand.enable <= 1.0)
        share = pedal * np.where(valid, demand.enable, 1.0)
        return {
            SPRING: self._spring,
            PROPORTIONAL: self._proportional,
            TORQUE: self._torque,
            VELOCITY: self._velocity,
        }[self.configuration.kind](demand, pedal, share, dt)

    def _spring(
        self, _demand: WheelDemand, _pedal: float, share: FloatArray, dt: float
    ) -> FloatArray:
        self._applied_for += dt
        dwelt = self._applied_for >= self.configuration.minimum_dwell_time
        wanted = share >= 0.5
        applied = wanted | (self._applied & ~dwelt)
        self._applied_for[applied & ~self._applied] = 0.0
        self._applied = applied
        return np.where(applied, 0.0, 1.0)

    def _proportional(
        self, _demand: WheelDemand, _pedal: float, share: FloatArray, _dt: float
    ) -> FloatArray:
        return share

    def _torque(
        self, demand: WheelDemand, pedal: float, share: FloatArray, _dt: float
    ) -> FloatArray:
        if pedal == 0.0:
            return _finite(demand.drive)
        # Without a speed the sign is unknown, and a torque of the wrong sign would drive.
        fade = np.clip(_finite(demand.speed) / self.configuration.standstill_speed, -1.0, 1.0)
        return -fade * share * self.configuration.max_torque

    def _velocity(
        self, demand: WheelDemand, pedal: float, share: FloatArray, dt: float
    ) -> FloatArray:
        speed = _finite(demand.speed)
        if pedal == 0.0:
            self._command = speed
            return _finite(demand.drive)
        # A released wheel is commanded the speed at which it turns: the drive then adds no torque.
        falling = np.sign(self._command) * np.maximum(
            np.abs(self._command) - share * self.configuration.ramp * dt, 0.0
        )
        self._command = np.where(share > 0.0, falling, speed)
        return self._command


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, 0.0)
