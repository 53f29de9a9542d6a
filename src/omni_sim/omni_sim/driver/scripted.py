"""The scripted driver: constant velocity and a stop at a given time, or a table of demands."""

import math
from typing import Protocol

import numpy as np

from omni_platform.configuration import Configuration, ConfigurationError, parameter, section
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_sim.vehicle.dynamics import in_turned_frame


class DemandConfiguration(Configuration):
    """Table of a driver's demands over time, interpolated linearly.

    After the last row the drive's velocity is zero and the pedal keeps its position. While the
    pedal opens the clutch, the velocities are ignored.
    """

    time: tuple[float, ...] = parameter((), unit="s")
    """Times of the rows, increasing"""
    forward: tuple[float, ...] = parameter((), unit="m/s")
    """Velocity forward"""
    left: tuple[float, ...] = parameter((), unit="m/s")
    """Velocity to the left"""
    turn: tuple[float, ...] = parameter((), unit="rad/s")
    """Yaw rate"""
    pedal: tuple[float, ...] = parameter(())
    """Position of the pedal, 0..1"""

    def check_consistency(self) -> None:
        """Refuse an invalid table.

        Raises:
            ConfigurationError: a column is invalid; names it.
        """
        for name in ("forward", "left", "turn", "pedal"):
            column = getattr(self, name)
            if len(column) != len(self.time):
                raise ConfigurationError(
                    name, f"has {len(column)} rows, must have {len(self.time)} as time has"
                )
        if np.any(np.diff(self.time) <= 0.0):
            raise ConfigurationError("time", "must increase from row to row")
        if self.time and self.time[0] < 0.0:
            raise ConfigurationError("time", "must not begin before 0")
        if any(not 0.0 <= pedal <= 1.0 for pedal in self.pedal):
            raise ConfigurationError("pedal", "must be in 0..1")


class ManeuverConfiguration(Configuration):
    """Demands of the scripted driver during a run."""

    x: float = parameter(0.0, unit="m")
    """Start of base_link in the world frame"""
    y: float = parameter(0.0, unit="m")
    """Start of base_link in the world frame"""
    heading_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Heading of the body at the start, counter-clockwise from the x axis"""
    speed: float = parameter(10.0, unit="m/s", minimum=0.0, maximum=50.0)
    """Speed before braking"""
    direction_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Direction of motion, counter-clockwise from the body's forward axis"""
    yaw_rate_deg: float = parameter(0.0, unit="deg/s", minimum=-720.0, maximum=720.0)
    """Yaw rate before braking, counter-clockwise"""
    hold_world_direction: bool = parameter(False)
    """Keep the direction of motion in the world while the body turns (turn-while-translate);
    otherwise it turns with the body"""
    brake_time: float = parameter(1.0, unit="s", minimum=0.0, maximum=3600.0)
    """Time at which the brake pedal goes down"""
    pedal: float = parameter(1.0, minimum=0.0, maximum=1.0)
    """Position of the pedal while braking"""
    pedal_ramp_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=60.0)
    """Time that the pedal takes to go down"""
    demands: DemandConfiguration = section(DemandConfiguration)
    """Table in place of speed, direction, yaw rate, pedal and their times; in an experiment or
    --set it may be the name of a CSV file or of a recording"""

    @property
    def earliest_end(self) -> float:
        """Earliest end of a run, even if the vehicle is at rest [s]."""
        return self.demands.time[-1] if self.demands.time else 0.0

    def check_consistency(self) -> None:
        """Refuse a table of demands together with a direction fixed in the world.

        Raises:
            ConfigurationError: both are given; names the key.
        """
        if self.demands.time and self.hold_world_direction:
            raise ConfigurationError(
                "hold_world_direction", "cannot be combined with demands, which turn with the body"
            )


class Driver(Protocol):
    """A source of pedal and velocity commands."""

    @property
    def start_pose(self) -> FloatArray:
        """x, y [m], yaw [rad] of base_link in the world frame at the start, shape (3,)."""

    @property
    def start_twist(self) -> FloatArray:
        """Twist of base_link in the body frame at the start [m/s, m/s, rad/s], shape (3,)."""

    def pedal(self, stamp_ns: int, /) -> float:
        """Return the position of the brake pedal, 0..1, at a stamp [ns]."""

    def command_twist(self, stamp_ns: int, yaw: float, /) -> FloatArray:
        """Return the commanded body twist [m/s, m/s, rad/s] at a stamp [ns] and a yaw [rad]."""


class ScriptedDriver:
    """Pedal and velocity command as functions of time, without state.

    Attributes:
        configuration: the maneuver.
    """

    def __init__(self, configuration: ManeuverConfiguration) -> None:
        self.configuration = configuration
        self._brake_ns = round(configuration.brake_time * SECOND_NS)
        self._ramp_ns = round(configuration.pedal_ramp_time * SECOND_NS)
        demands = configuration.demands
        self._times = np.array(demands.time)
        self._rows = np.array((demands.forward, demands.left, demands.turn, demands.pedal))
        self._start_twist = self._set_off()

    def _row(self, stamp_ns: int) -> FloatArray:
        """Return velocities and pedal of the table at a stamp, shape (4,)."""
        time = stamp_ns * 1e-9
        return np.array([np.interp(time, self._times, column) for column in self._rows])

    @property
    def start_pose(self) -> FloatArray:
        """x, y [m], yaw [rad] of base_link in the world frame at the start, shape (3,)."""
        c = self.configuration
        return np.array([c.x, c.y, math.radians(c.heading_deg)])

    @property
    def start_twist(self) -> FloatArray:
        """Twist of base_link in the body frame at the start [m/s, m/s, rad/s], shape (3,)."""
        return self._start_twist.copy()

    def _set_off(self) -> FloatArray:
        if self._times.size:
            return self._row(0)[:3]
        c = self.configuration
        direction = math.radians(c.direction_deg)
        return np.array(
            [
                c.speed * math.cos(direction),
                c.speed * math.sin(direction),
                math.radians(c.yaw_rate_deg),
            ]
        )

    @property
    def settled_ns(self) -> int:
        """Time after which pedal and command are constant [ns]."""
        if self._times.size:
            return round(float(self._times[-1]) * SECOND_NS)
        return self._brake_ns + self._ramp_ns

    def pedal(self, stamp_ns: int) -> float:
        """Return the position of the brake pedal, 0..1.

        Args:
            stamp_ns: time since the start of the run [ns].
        """
        if self._times.size:
            return float(self._row(stamp_ns)[3])
        elapsed = stamp_ns - self._brake_ns
        if elapsed < 0:
            return 0.0
        share = 1.0 if elapsed >= self._ramp_ns else elapsed / self._ramp_ns
        return self.configuration.pedal * share

    def command_twist(self, stamp_ns: int, yaw: float) -> FloatArray:
        """Return the commanded twist of base_link, zero once the pedal is fully down.

        Until then it is constant, so that the drive does not brake before its clutch opens.

        Args:
            stamp_ns: time since the start of the run [ns].
            yaw: yaw of the body in the world frame [rad].

        Returns:
            In the body frame [m/s, m/s, rad/s], shape (3,).
        """
        if self._times.size and stamp_ns < self.settled_ns:
            return self._row(stamp_ns)[:3]
        if self._times.size or stamp_ns - self._brake_ns >= self._ramp_ns:
            return np.zeros(3)
        twist = self.start_twist
        if self.configuration.hold_world_direction:
            turned = yaw - math.radians(self.configuration.heading_deg)
            twist[:2] = in_turned_frame(twist[0], twist[1], turned)
        return twist
