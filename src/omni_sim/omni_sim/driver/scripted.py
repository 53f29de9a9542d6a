"""Scripted driver: constant velocity and a stop at a given time, or a table of demands."""

import math
from typing import Protocol

import numpy as np

from omni_core.quantities import SECOND_NS, FloatArray
from omni_sim.driver.configuration import (
    DemandConfiguration,  # noqa: F401 - earlier names
    ManeuverConfiguration,
)
from omni_sim.vehicle.dynamics import in_turned_frame


class Driver(Protocol):
    """Interface of a driver: pedal positions and velocity commands over time."""

    start_pose: FloatArray
    """x, y [m], yaw [rad] of base_link in the world frame at the start, shape (3,)"""
    start_twist: FloatArray
    """Twist of base_link in the body frame at the start [m/s, m/s, rad/s], shape (3,)"""

    def demand(self, stamp_ns: int, yaw: float, /) -> tuple[float, FloatArray]:
        """Return the position of the brake pedal, 0 to 1, and the commanded body twist, shape (3,).

        Arguments are a stamp [ns] and the yaw of the body [rad]; the twist is in m/s, m/s, rad/s.
        """


class ScriptedDriver:
    """Driver whose pedal position and velocity command are functions of time.

    Attributes:
        configuration: the maneuver.
        start_pose: x, y [m], yaw [rad] of base_link in the world frame at the start, shape (3,).
        start_twist: twist of base_link in the body frame at the start [m/s, m/s, rad/s], (3,).
    """

    def __init__(self, configuration: ManeuverConfiguration) -> None:
        self.configuration = configuration
        self._brake_ns = round(configuration.brake_time * SECOND_NS)
        self._ramp_ns = round(configuration.pedal_ramp_time * SECOND_NS)
        demands = configuration.demands
        self._times = np.array(demands.time)
        self._rows = np.array((demands.forward, demands.left, demands.turn, demands.pedal))
        c, direction = configuration, math.radians(configuration.direction_deg)
        self.start_pose: FloatArray = np.array([c.x, c.y, math.radians(c.heading_deg)])
        along, left = c.speed * math.cos(direction), c.speed * math.sin(direction)
        self.start_twist: FloatArray = np.array([along, left, math.radians(c.yaw_rate_deg)])
        if self._times.size:
            self.start_twist = self._row(0)[:3]

    def _row(self, stamp_ns: int) -> FloatArray:
        """Return the demands of the table at a stamp [ns], shape (4,).

        The demands are the body twist [m/s, m/s, rad/s] and the position of the pedal, 0 to 1.
        """
        time = stamp_ns * 1e-9
        return np.array([np.interp(time, self._times, column) for column in self._rows])

    @property
    def first_change_ns(self) -> int:
        """Time until which pedal and command keep their initial values [ns]."""
        return 0 if self._times.size else self._brake_ns

    @property
    def settled_ns(self) -> int:
        """Time after which pedal and command are constant [ns]."""
        if self._times.size:
            return round(float(self._times[-1]) * SECOND_NS)
        return self._brake_ns + self._ramp_ns

    def demand(self, stamp_ns: int, yaw: float) -> tuple[float, FloatArray]:
        """Return the position of the brake pedal, and the commanded twist of base_link.

        Without a table of demands, the command is constant until the pedal reaches its final
        position, so that the drive does not brake before its clutch opens. From then on, the
        command is zero.

        Args:
            stamp_ns: time since the start of the run [ns].
            yaw: yaw of the body in the world frame [rad].

        Returns:
            Position of the pedal, 0 to 1; twist in the body frame [m/s, m/s, rad/s], shape (3,).
        """
        if self._times.size:
            row = self._row(stamp_ns)
            return float(row[3]), row[:3] if stamp_ns < self.settled_ns else np.zeros(3)
        elapsed = stamp_ns - self._brake_ns
        if elapsed >= self._ramp_ns:
            return self.configuration.pedal, np.zeros(3)
        pedal = self.configuration.pedal * (elapsed / self._ramp_ns) if elapsed > 0 else 0.0
        twist = self.start_twist.copy()
        if self.configuration.hold_world_direction:
            turned = yaw - math.radians(self.configuration.heading_deg)
            twist[:2] = in_turned_frame(twist[0], twist[1], turned)
        return pedal, twist
