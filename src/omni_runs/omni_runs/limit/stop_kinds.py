"""Kinds of stops, and the least distance of a stop of each kind.

The module `bounds` explains the computation, and what each kind of stop admits.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import BoolArray, FloatArray
from omni_runs.limit.forces import Case, Deceleration, LimitVehicle
from omni_sim.configuration import GroundConfiguration
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle.configuration import VehicleConfiguration

EDGE_MARGIN = 0.02
"""Distance from the edge of a patch within which the higher of both frictions is used [m]."""

KEPT = math.radians(0.5)
"""Allowed deviation of the heading and of the direction of motion [rad]."""

LEAST = 1e-6
"""Smaller decelerations do not stop the vehicle [m/s^2]."""

_TIME_STEP = 2e-3  # time step during the torque build-up [s]
_PLACES = 200  # number of positions along the path over patches
_LEVELS = 64  # number of torque levels during build-up, rounded up
_LONG = 10.0  # duration of the impulse of a released wheel in the computation of its effect [s]
_SKETCHED = 12  # number of torque levels of a sketch, rounded down, and number of its headings


class Maneuver(NamedTuple):
    """Motion at the start of braking, and the pedal.

    Attributes:
        pose: x, y [m], yaw [rad] of base_link, shape (3,).
        twist: twist of base_link in the body frame [m/s, m/s, rad/s], shape (3,).
        pedal: final position of the pedal [1].
        ramp_time: time in which the pedal reaches its final position [s].
        start_time: time at which the pedal begins to move [s], on the clock of the onsets of brake
            faults.
    """

    pose: FloatArray
    twist: FloatArray
    pedal: float = 1.0
    ramp_time: float = 0.0
    start_time: float = 0.0


class StopKind:
    """Computes a lower bound of the distance of all stops that a subclass admits.

    At every position of the stop, the vehicle has the largest deceleration that friction and brake
    torque permit. Results for equal friction and torque are stored.
    """

    def __init__(
        self,
        vehicle: VehicleConfiguration,
        ground: GroundConfiguration,
        maneuver: Maneuver,
        *,
        sketch: bool = False,
    ) -> None:
        self.limit = LimitVehicle(vehicle)
        self._vehicle, self._maneuver = vehicle, maneuver
        self._map = FrictionMap(ground.friction, ground.patches)
        self._faulty = vehicle.by_wheel("brake")
        self._onset = vehicle.by_wheel("onset") - maneuver.start_time
        self._onsets = sorted({float(onset) for onset in self._onset[self._during]})
        self._final = vehicle.brake.max_torque * maneuver.pedal
        self._solved: dict[tuple[object, ...], float] = {}
        top = max((self._map.base, *self._map.table[:, 6])) * float(np.max(self.limit.grip))
        acting = np.where(self._faulty > 0.0, np.minimum(self._faulty, 1.0), 1.0)
        weakest = max(float(np.min(acting / self.limit.rim_lever)), LEAST)
        self._enough_torque: float = top * self.limit.strongest_peak / weakest
        self._level = self._enough_torque / (_SKETCHED if sketch else _LEVELS)
        self._rounded: Callable[[float], int] = math.floor if sketch else math.ceil
        self._step = max(math.hypot(*maneuver.twist[:2]) ** 2 / (2.0 * 3.0) / _PLACES, 1e-3)

    @property
    def _during(self) -> BoolArray:
        """Whether the brake of each wheel changes after the start of braking, shape (N,)."""
        changes: BoolArray = (self._faulty != 1.0) & (self._onset > 0.0)
        return changes

    def shares(self, time: float) -> FloatArray:
        """Return the share of its torque that each brake has [1], shape (N,).

        Args:
            time: time since the pedal began to move [s].
        """
        return np.where(self._onset <= time, self._faulty, 1.0)

    def stages(self, speed: float) -> list[FloatArray]:
        """Return `shares` at the start and, unless the vehicle is then at rest, after all onsets.

        Args:
            speed: speed at the start of braking [m/s].
        """
        first, last = self.shares(0.0), self.shares(math.inf)
        return [first, last] if self._onsets and self._until_onsets(speed)[1] > 0.0 else [first]

    def distance(self, speed: float, *, eased: bool = False) -> float:
        """Return the stopping distance [m] from a speed [m/s] at the largest decelerations.

        It is infinite if the vehicle does not come to rest.

        Args:
            speed: speed at the start of braking [m/s].
            eased: whether the effects that the bound neglects shorten the stop.
        """
        distance, slower, time = self._until_onsets(speed, eased=eased)
        least = self._along(distance, slower, time, self.shares(math.inf), eased=eased)
        if not self._onsets or not len(self._map.table):
            return least
        # On patches, a stop in which every brake always has its larger torque may have the higher
        # bound, because it does not need the least speed at a time.
        largest = np.maximum(self.shares(0.0), self._faulty)
        return max(least, self._along(0.0, speed, 0.0, largest, eased=eased))

    def _along(
        self, distance: float, speed: float, time: float, shares: FloatArray, *, eased: bool
    ) -> float:
        """Return the position of rest [m] at the largest decelerations at every position.

        Args:
            distance: position at the start [m].
            speed: speed at the start [m/s].
            time: time of the start since the pedal began to move [s].
            shares: share of its torque that each brake has [1], shape (N,).
            eased: as for `distance`.
        """
        gain, speed = self._eased(shares, speed) if eased else (1.0, speed)
        while speed > 0.0:
            torque, settled = self._available(time + _TIME_STEP)
            if settled and not len(self._map.table):
                rate = gain * self.deceleration(distance, distance, torque * shares)
                return distance + speed**2 / (2.0 * rate) if rate > LEAST else math.inf
            step = max(speed, 1e-3) * _TIME_STEP if not settled else self._step
            rate = gain * self.deceleration(distance, distance + step, torque * shares)
            if settled and rate <= LEAST and distance > 1e4:
                return math.inf
            square = speed**2 - 2.0 * rate * step
            if square <= 0.0:
                return distance + speed**2 / (2.0 * rate)
            after = math.sqrt(square)
            time += 2.0 * step / (speed + after)
            distance, speed = distance + step, after
        return distance

    def _until_onsets(self, speed: float, *, eased: bool = False) -> tuple[float, float, float]:
        """Return least distance [m], least speed [m/s] and time [s] at the last change of a brake.

        Without such a change, this is the start of braking. The arguments are those of `distance`.
        """
        distance = time = 0.0
        fastest = speed
        for onset in self._onsets:
            shares = self.shares(time)
            gain, speed = self._eased(shares, speed) if eased else (1.0, speed)
            while time < onset and speed > 0.0:
                end = min(time + _TIME_STEP, onset)
                torque = self._available(end)[0] * shares
                rate = gain * self.deceleration(distance, fastest * end, torque)
                after = speed - rate * (end - time)
                if after <= 0.0:
                    return distance + speed**2 / (2.0 * rate), 0.0, end
                distance += 0.5 * (speed + after) * (end - time)
                time, speed = end, after
        return distance, speed, time

    def _eased(self, shares: FloatArray, speed: float) -> tuple[float, float]:
        """Return the effects that the bound neglects from a time on.

        Args:
            shares: `shares` from this time on.
            speed: speed at this time [m/s].

        Returns:
            Factor on the deceleration [1], and speed at this time after the effects that end soon
            [m/s].
        """
        raise NotImplementedError

    def _spin_up(self, shares: FloatArray, speed: float) -> FloatArray:
        """Return the impulse of each wheel that was locked when its brake failed [N s], shape (N,).

        The force of the ground accelerates the wheel until it rolls. The arguments are those of
        `_eased`.
        """
        impulse = self._vehicle.wheel_inertia * speed / self.limit.rim_lever**2
        return np.where(self._during & (shares < 1.0), impulse, 0.0)

    def _available(self, time: float) -> tuple[float, bool]:
        """Return the torque of a fault-free brake [N m], and whether it is the final one.

        While the torque builds up, it is rounded, up for a bound and down for a sketch, which
        limits the number of cases.

        Args:
            time: time since the pedal began to move [s].
        """
        torque, final = self._torque(time), self._final
        if torque >= min(self._enough_torque, 0.999 * final):
            return final, True
        return min(self._rounded(torque / self._level) * self._level, final), False

    def _torque(self, time: float) -> float:
        """Return the maximum torque of a brake [N m], `time` [s] after the pedal begins to move."""
        brake, ramp = self._vehicle.brake, self._maneuver.ramp_time
        on = time - brake.dead_time
        if on <= 0.0:
            return 0.0
        share, lag = 1.0, brake.time_constant
        if ramp > 0.0:
            share = min(on / ramp, 1.0)
        elif lag > 0.0:
            share = -math.expm1(-on / lag)
        return self._final * share

    def deceleration(self, start: float, end: float, torque: FloatArray) -> float:
        """Return an upper bound of the deceleration on a segment of the path [m/s^2].

        Args:
            start: position of the start of the segment, as the distance traveled [m].
            end: position of its end [m].
            torque: torque of each brake [N m], shape (N,).
        """
        friction = self.friction(start, end)
        key = (*friction.tolist(), *torque.tolist())
        if key not in self._solved:
            self._solved[key] = self._solve(friction, torque)
        return self._solved[key]

    def friction(self, start: float, end: float) -> FloatArray:
        """Return the largest friction factor under each wheel on a path segment [1], shape (N,).

        The arguments are those of `deceleration`.
        """
        raise NotImplementedError

    def _solve(self, friction: FloatArray, torque: FloatArray) -> float:
        raise NotImplementedError

    def tolerance(self, speed: float, distance: float) -> float:
        """Return the tolerance of a bound [m].

        Args:
            speed: speed at the start of braking [m/s].
            distance: the bound [m].
        """
        return distance - self.distance(speed, eased=True)


class StraightStops(StopKind):
    """Stops that keep heading and line of motion."""

    WITHOUT = "yaw moment and side force"
    """Forces that these stops exclude."""

    @property
    def _direction(self) -> FloatArray:
        v = self._maneuver.twist[:2]
        return v / math.hypot(*v)

    def friction(self, start: float, end: float) -> FloatArray:
        """Return the largest friction near the place of each wheel on the line, shape (N,)."""
        middle = self.limit.position + 0.5 * (start + end) * self._direction
        places = self._maneuver.pose[:2] + turned(middle, self._maneuver.pose[2])
        near = 0.5 * (end - start) + EDGE_MARGIN
        return self.limit.grip * [_largest_friction(self._map, place, near) for place in places]

    def _solve(self, friction: FloatArray, torque: FloatArray) -> float:
        return strongest([self.limit.strongest(self._direction, self._case(friction, torque))])

    def _case(self, friction: FloatArray, torque: FloatArray) -> Case:
        return Case(friction, True, torque)

    def first(
        self, shares: FloatArray, angle: float = 0.0, force: float = 0.0, **changes: Any
    ) -> Deceleration | None:
        """Return the largest deceleration that the wheels can cause at the start of braking.

        The result is None if no admissible forces exist.

        Args:
            shares: share of its torque that each brake has [1], shape (N,).
            angle: angle by which the direction of motion differs from that of the maneuver [rad].
            force: additional force of each wheel whose brake acts [N].
            **changes: fields of `Case` that differ from a straight stop with these brakes.
        """
        torque = self._final * shares + np.where(shares > 0.0, force, 0.0)
        case = self._case(self.friction(0.0, 0.0), torque)._replace(**changes)
        return self.limit.strongest(turned(self._direction, angle), case)

    def _eased(self, shares: FloatArray, speed: float) -> tuple[float, float]:
        first = strongest([self.first(shares)])
        if first <= LEAST:
            return 1.0, speed
        near = strongest(self.first(shares, angle) for angle in self.near)
        lagging = strongest(self.first(shares, lag=share) for share in (0.25, 0.5, 0.75, 1.0))
        lost = self._vehicle.load_transfer_time * max(lagging - first, 0.0)
        driven = np.abs(self.limit.active @ self._direction)
        impulse = self._spin_up(shares, speed) * driven
        if np.any(impulse > 0.0):
            # The deceleration is a concave function of the force, so the effect per force is
            # largest for a small force, which acts for a long time.
            torque = self._final * shares + impulse / _LONG * self.limit.rim_lever
            lost += _LONG * max(strongest([self.first(shares, torque=torque)]) - first, 0.0)
        return max(near / first, 1.0), max(speed - lost, 0.0)

    def tolerance(self, speed: float, distance: float) -> float:
        """Return the tolerance of a bound with the elastic deflection of the tires at rest [m]."""
        first = max(strongest([self.first(stage)]) for stage in self.stages(speed))
        rebound = self.limit.rebound(self._direction, first)
        return super().tolerance(speed, distance) + rebound

    @property
    def near(self) -> list[float]:
        """Deviations of the direction of motion for which the bound is computed [rad].

        Heading and direction of motion may each deviate by `KEPT`, so the range extends to twice
        this angle on both sides. Directions in which the motion does not drive a wheel are special:
        in exactly such a direction, the locked wheel may exert a force of either sign. Such
        directions within the range are therefore included.
        """
        d, active = self._direction, self.limit.active
        away = np.arctan2(d[0] * active[:, 1] - d[1] * active[:, 0], active @ d)
        square = [float(a - side * 0.5 * math.pi) for a in away for side in (-1.0, 1.0)]
        return [-2.0 * KEPT, 2.0 * KEPT, *{a for a in square if abs(a) < 2.0 * KEPT}]


class HeadingStops(StraightStops):
    """Stops that keep the heading, on any path.

    The deceleration along the initial direction of motion may come with any side force.
    """

    WITHOUT = "yaw moment"

    def friction(self, start: float, end: float) -> FloatArray:
        """Return the largest friction of the ground for every wheel, shape (N,)."""
        del start, end
        return np.multiply(self.limit.grip, max((self._map.base, *self._map.table[:, 6])))

    def _case(self, friction: FloatArray, torque: FloatArray) -> Case:
        return Case(friction, False, torque, heading=True)


class AnyStops(StopKind):
    """Stops with any heading and any path."""

    accuracy = 1e-3
    """Limit on the relative excess of the bound of the deceleration [1]."""

    @property
    def center_speed(self) -> float:
        """Speed of the center of gravity [m/s]."""
        center, twist = self.limit.masses.center, self._maneuver.twist
        return math.hypot(*(twist[:2] + twist[2] * np.array([-center[1], center[0]])))

    def friction(self, start: float, end: float) -> FloatArray:
        """Return the largest friction within the distance traveled for every wheel, shape (N,)."""
        del start
        masses = self.limit.masses
        pose = self._maneuver.pose
        center = pose[:2] + turned(np.asarray(masses.center), pose[2])
        arms = np.hypot(*(self.limit.position - masses.center).T)
        return self.limit.grip * [_largest_friction(self._map, center, end + arm) for arm in arms]

    def _solve(self, friction: FloatArray, torque: FloatArray) -> float:
        return self.limit.largest(Case(friction, False, torque), self.accuracy)

    def _eased(self, shares: FloatArray, speed: float) -> tuple[float, float]:
        friction = self.friction(0.0, 0.0)
        first = self.deceleration(0.0, 0.0, self._final * shares)
        braked = friction[shares > 0.0]
        # While the loads lag, any load distribution is possible.
        lagging = self.limit.any_load_bound(braked) if first > 0.0 and len(braked) else 0.0
        lost = self._vehicle.load_transfer_time * max(lagging - first, 0.0)
        lost += float(np.sum(self._spin_up(shares, speed))) / self.limit.masses.mass
        return 1.0, max(speed - lost, 0.0)


class StopsOfOneHeading(AnyStops):
    """Stops with one constant heading, for the upper estimate of the bound.

    This heading is the one with the largest deceleration among `_SKETCHED` equally spaced headings.
    """

    _heading: FloatArray | None = None

    def _solve(self, friction: FloatArray, torque: FloatArray) -> float:
        if self._heading is None:
            case = Case(friction, False, self._final * self.shares(math.inf))
            angles = np.arange(_SKETCHED) * 2.0 * math.pi / _SKETCHED
            headings = np.column_stack((np.cos(angles), np.sin(angles)))
            self._heading = max(headings, key=lambda one: self.limit.at_least(one, case))
        case = Case(friction, False, torque)
        return self.limit.at_least(self._heading, case)


def strongest(found: Iterable[Deceleration | None]) -> float:
    """Return the largest of several bounds of the deceleration [m/s^2]; None counts as 0."""
    return max(0.0 if one is None else one.bound for one in found)


def _largest_friction(friction: FrictionMap, center: FloatArray, radius: float) -> float:
    """Return the largest friction factor of the ground near a point [1].

    Args:
        friction: friction of the ground.
        center: x, y of the point in `odom` [m], shape (2,).
        radius: limit on the distance from the point [m].
    """
    largest = -math.inf
    for x, y, cos, sin, length, width, factor, ellipse in friction.table[::-1]:
        d_x, d_y = center[0] - x, center[1] - y
        # Distance from the patch. An ellipse is replaced by the rectangle that contains it.
        away = max(abs(d_x * cos + d_y * sin) - length, abs(d_y * cos - d_x * sin) - width)
        if away <= radius:
            largest = max(largest, float(factor))
        if away <= -radius and ellipse == 0.0:  # this patch contains the circle
            return largest
    return max(largest, friction.base)
