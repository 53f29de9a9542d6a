"""Driver that follows pedal positions and velocity commands from another program.

Without commands, the vehicle brakes fully (dead man's switch). After braking, the velocity command
starts from the vehicle's velocity. Its rate of change is limited, so that it does not follow steps
of a joystick.
"""

import math

import numpy as np

from omni_core.configuration import Configuration, parameter
from omni_core.quantities import FloatArray
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.driver.scripted import ScriptedDriver

FULL_BRAKING = 1.0


class ManualDriverConfiguration(Configuration):
    """Limits on acceleration and command age for a vehicle that is driven over topics."""

    acceleration: float = parameter(2.5, unit="m/s^2", above=0.0, maximum=100.0)
    """Limit on the rate of change of the commanded velocity"""
    yaw_acceleration: float = parameter(3.0, unit="rad/s^2", above=0.0, maximum=100.0)
    """Limit on the rate of change of the commanded yaw rate"""
    driver_timeout: float = parameter(0.3, unit="s", above=0.0, maximum=10.0)
    """Time without a message from the driver (wall clock) after which the vehicle brakes fully"""


class DemandInbox:
    """Stores the latest demand of a driver; without a recent demand, the vehicle brakes fully.

    Args:
        timeout: age after which a demand is ignored [s].
        pedal_required: whether a pedal message is required. If not, a velocity command suffices
            until the first pedal message arrives.
    """

    def __init__(self, timeout: float, pedal_required: bool = True) -> None:
        self._timeout = timeout
        self._pedal_required = pedal_required
        self._pedal, self._pedal_time = FULL_BRAKING, -math.inf
        self._twist, self._twist_time = np.zeros(3), -math.inf

    def take_pedal(self, pedal: float, now: float) -> None:
        """Store a pedal position from 0 to 1; any other value means full braking.

        Args:
            pedal: pedal position.
            now: time of arrival on a monotonic clock [s].
        """
        self._pedal = pedal if 0.0 <= pedal <= 1.0 else FULL_BRAKING
        self._pedal_time = now
        self._pedal_required = True

    def take_twist(self, twist: FloatArray, now: float) -> None:
        """Store a commanded body twist; a twist that is not finite is replaced by zero.

        Args:
            twist: commanded body twist [m/s, m/s, rad/s], shape (3,).
            now: time of arrival on a monotonic clock [s].
        """
        self._twist = np.where(np.isfinite(twist).all(), twist, 0.0)
        self._twist_time = now

    def demand(self, now: float) -> tuple[float, FloatArray]:
        """Return the demanded pedal position, 0 to 1, and body twist [m/s, m/s, rad/s], shape (3,).

        `now` is the present time on the monotonic clock [s].
        """
        fresh = now - self._twist_time <= self._timeout
        if not self._pedal_required:
            return (0.0, self._twist) if fresh else (FULL_BRAKING, np.zeros(3))
        if now - self._pedal_time > self._timeout:
            return FULL_BRAKING, np.zeros(3)
        return self._pedal, self._twist if fresh else np.zeros(3)


class ManualDriver:
    """Driver that starts at rest at the maneuver's start pose and follows the commands of `steer`.

    Args:
        configuration: limits of the driver.
        maneuver: maneuver, of which only the start pose is used.

    Attributes:
        start_pose: x, y [m], yaw [rad] of base_link in the world frame at the start, shape (3,).
        start_twist: twist of base_link at the start, zero [m/s, m/s, rad/s], shape (3,).
    """

    def __init__(
        self, configuration: ManualDriverConfiguration, maneuver: ManeuverConfiguration
    ) -> None:
        self._limits = configuration
        self.start_pose, self.start_twist = ScriptedDriver(maneuver).start_pose, np.zeros(3)
        self._pedal = FULL_BRAKING
        self._command = np.zeros(3)

    def halt(self) -> None:
        """Set the velocity command to zero; used after the vehicle was moved to another pose."""
        self._command = np.zeros(3)

    def steer(self, pedal: float, target: FloatArray, twist: FloatArray, period: float) -> None:
        """Set pedal position and velocity target for the next control period.

        Args:
            pedal: position of the brake pedal, 0 to 1.
            target: body twist to accelerate to [m/s, m/s, rad/s], shape (3,).
            twist: present body twist of the vehicle [m/s, m/s, rad/s], shape (3,).
            period: control period [s].
        """
        self._pedal = pedal
        if pedal > 0.0:
            # With this command, the drive neither brakes before its clutch opens nor jerks when the
            # clutch closes.
            self._command = twist.copy()
            return
        change = target - self._command
        speed_change = float(np.hypot(change[0], change[1]))
        longest = self._limits.acceleration * period
        if speed_change > longest:
            change[:2] *= longest / speed_change
        turn = self._limits.yaw_acceleration * period
        change[2] = min(max(change[2], -turn), turn)
        self._command = self._command + change

    def demand(self, _stamp_ns: int, _yaw: float) -> tuple[float, FloatArray]:
        """Return the position of the brake pedal, 0 to 1, and the commanded body twist, shape (3,).

        The twist is in m/s, m/s, rad/s.
        """
        return self._pedal, self._command.copy()
