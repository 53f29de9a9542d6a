"""Conversion of the brake enables of the wheels to commands for brakes or motor drives.

An enable is the share of the braking demand that passes to a wheel, 0 to 1. The resulting command
to the controller depends on the kind of brake:

- ``spring``: a spring-applied brake that a coil releases; command 1 energizes the coil,
- ``on_off``, ``proportional``: a valve or brake that follows a demand of 0 to 1,
- ``torque``: a motor drive that receives a torque [N m]; this torque must never accelerate the
  wheel,
- ``velocity``: a motor drive that receives a speed [rad/s]; the commanded speed decreases along a
  configured ramp.

A pedal position or an enable that is missing or NaN causes full braking. A torque drive cannot
brake a wheel whose speed is unknown, because the torque could have the wrong sign. A velocity drive
brakes such a wheel along the ramp, from the last commanded speed.
"""

import dataclasses
import math

import numpy as np

from omni_core.brakes import BRAKES, SPRING, TORQUE
from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import FloatArray


class BrakeAdapterConfiguration(Configuration):
    """Brakes of a vehicle and the timing of their commands."""

    wheels: tuple[str, ...] = parameter()
    """Names of the wheels in the order of the controller's joints"""
    kind: str = parameter(SPRING, choices=tuple(BRAKES))
    """Kind of brakes"""
    max_torque: float = parameter(10.0, unit="N m", above=0.0, maximum=1.0e6)
    """Braking torque of a wheel at full demand, for torque drives"""
    standstill_speed: float = parameter(0.5, unit="rad/s", above=0.0, maximum=100.0)
    """Wheel speed below which a torque command decreases in proportion to the speed, so that it
    never drives the wheel"""
    ramp: float = parameter(50.0, unit="rad/s^2", above=0.0, maximum=1.0e5)
    """Deceleration with which the speed command of a braked wheel decreases, for velocity drives"""
    minimum_dwell_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=10.0)
    """Minimum time between the application of a brake and its next release, for spring-applied
    brakes"""
    enable_timeout: float = parameter(0.05, unit="s", above=0.0, maximum=1.0)
    """Limit on the time since the last message of enables, and on the age of its stamp; beyond it,
    all brakes are on"""

    def check_consistency(self) -> None:
        """Check that wheels are given and that no wheel is named twice."""
        if not self.wheels or len(set(self.wheels)) != len(self.wheels):
            raise ConfigurationError("wheels", "must name every wheel once")


@dataclasses.dataclass(frozen=True, eq=False)
class WheelDemand:
    """Inputs of one step of the brake adapter, for N wheels.

    Attributes:
        pedal: braking demand of the driver, 0 to 1; NaN if it is unknown.
        enable: share of the demand that passes to each wheel [1], NaN where unknown, shape (N,).
        speed: speed of the wheels [rad/s], NaN where unknown, shape (N,).
        drive: command for each motor drive while the pedal is up, a torque [N m] or a speed
            [rad/s], shape (N,).
    """

    pedal: float
    enable: FloatArray
    speed: FloatArray
    drive: FloatArray


def is_silent(age: float, timeout: float, period: float) -> bool:
    """Return whether this step must react to an input that no longer sends.

    The step reacts if the timeout may have passed at the next step.

    Args:
        age: time since the last message [s].
        timeout: longest time without a message and without a reaction [s].
        period: time between two steps [s]; it should be at most half of the timeout.
    """
    return age > timeout - min(period, 0.5 * timeout)


class BrakeAdapter:
    """Converts brake enables to commands for one kind of brake or motor drive."""

    def __init__(self, configuration: BrakeAdapterConfiguration) -> None:
        self.configuration = configuration
        wheels = len(configuration.wheels)
        self._applied_for = np.full(wheels, math.inf)  # time since each application [s]
        self._applied = np.ones(wheels, np.bool_)
        self._command = np.zeros(wheels)  # speed command while braking [rad/s]

    def step(self, demand: WheelDemand, dt: float) -> FloatArray:
        """Return the command to each wheel, in the unit of its kind of brake, shape (N,).

        Args:
            demand: braking demand of the driver, brake enables of the assistant, and wheel speeds.
            dt: time since the previous step [s].
        """
        pedal = demand.pedal if 0.0 <= demand.pedal <= 1.0 else 1.0
        # false for NaN, so that a wheel with this value brakes fully
        valid = (demand.enable >= 0.0) & (demand.enable <= 1.0)
        share = pedal * np.where(valid, demand.enable, 1.0)
        kind = BRAKES[self.configuration.kind]
        if kind.is_coil:
            return self._spring(share, dt)
        if not kind.is_drive:
            return share
        known, drive = np.isfinite(demand.speed), _finite(demand.drive)
        if pedal == 0.0:
            self._command = np.where(known, demand.speed, drive)
            return drive
        if self.configuration.kind == TORQUE:
            # Without a speed the sign is unknown, and a torque of the wrong sign would drive the
            # wheel.
            fade = np.clip(_finite(demand.speed) / self.configuration.standstill_speed, -1.0, 1.0)
            return -fade * share * self.configuration.max_torque
        share = np.where(known, share, pedal)
        falling = np.sign(self._command) * np.maximum(
            np.abs(self._command) - share * self.configuration.ramp * dt, 0.0
        )
        # A released wheel is commanded its own speed, so that the drive adds no torque.
        self._command = np.where(share > 0.0, falling, demand.speed)
        return self._command

    def _spring(self, share: FloatArray, dt: float) -> FloatArray:
        self._applied_for += dt
        dwelt = self._applied_for >= self.configuration.minimum_dwell_time
        applied = (share >= 0.5) | (self._applied & ~dwelt)
        self._applied_for[applied & ~self._applied] = 0.0
        self._applied = applied
        return np.where(applied, 0.0, 1.0)


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, 0.0)
