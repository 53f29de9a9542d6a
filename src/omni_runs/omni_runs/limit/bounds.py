"""Lower bound of the stopping distance on ground with patches and for brakes with lag.

The brake torque is limited by pedal ramp, dead time and lag, and this limit increases with time.
Friction depends on the positions of the wheels. The shortest distance therefore results from the
largest deceleration at every position, ``d(v^2)/ds = -2 a(s, t)``, with the speed ``v``, the
deceleration ``a``, the position ``s`` and the time ``t``. A slower vehicle arrives at a position
later, when at least the same torque is available. Wheel spin cannot shorten the stop: a braked
wheel turns no faster than a rolling wheel, so the impulse of its tire force is at most the impulse
of its brake.

For a stop that keeps heading and line, the ground under each wheel is known. Within `EDGE_MARGIN`
of the edge of a patch, the higher friction is used. For stops with any heading and path, a wheel
may be anywhere within the distance traveled. `limit_share` compares the bound with a recorded stop.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import FloatArray
from omni_runs import experiment, metrics
from omni_runs.history import RunHistory
from omni_runs.limit.forces import Case, Deceleration, LimitVehicle
from omni_sim.configuration import GroundConfiguration
from omni_sim.driver.scripted import ManeuverConfiguration, ScriptedDriver
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle.configuration import VehicleConfiguration

EDGE_MARGIN = 0.02
"""Distance from the edge of a patch within which the higher of both frictions is used [m]."""

KEPT = math.radians(0.5)
"""Allowed deviation of the heading and of the direction of motion [rad]."""

_TIME_STEP = 2e-3  # time step during the torque build-up [s]
_PLACES = 200  # number of positions along the path over patches
_LEAST = 1e-6  # smaller decelerations do not stop the vehicle [m/s^2]
_LEVELS = 64  # number of torque levels during build-up, rounded up
_SKETCHED = 12  # number of torque levels of a sketch, rounded down, and number of its headings
_WEAK = "friction or brakes are too weak to stop the vehicle"
_SLOPE = "the ground is not level, and the slope force is not modeled"
_FASTER = "the rolling resistance grows with the speed, and the bound assumes that it does not"
_LIFTING = "the fork moves the load during the stop"
_SPRUNG = "the chassis is sprung, and the resulting load oscillation is not modeled"


class Maneuver(NamedTuple):
    """Motion at the start of braking, and the pedal.

    Attributes:
        pose: x, y [m], yaw [rad] of base_link, shape (3,).
        twist: twist of base_link in the body frame [m/s, m/s, rad/s], shape (3,).
        pedal: final position of the pedal [1].
        ramp_time: time in which the pedal reaches its final position [s].
    """

    pose: FloatArray
    twist: FloatArray
    pedal: float = 1.0
    ramp_time: float = 0.0


class Bound(NamedTuple):
    """A lower bound of the stopping distance.

    Attributes:
        distance: the bound [m], NaN if there is none.
        gap: limit on the relative difference between the bound and the distance of a stop with
            feasible forces [1].
        tolerance: length by which a run may be shorter than the bound because of neglected effects
            [m]: lag of the loads, elastic deflection of the tires at rest, and deviations of
            heading and direction up to `KEPT`; NaN if it is not needed.
        reason: reason why no bound was computed; otherwise empty.
    """

    distance: float
    gap: float = 0.0
    tolerance: float = 0.0
    reason: str = ""


def maneuver_of(configuration: ManeuverConfiguration) -> Maneuver:
    """Return the motion at the time at which the scripted driver presses the pedal."""
    driver = ScriptedDriver(configuration)
    pose, twist = driver.start_pose, driver.start_twist
    time, rate = configuration.brake_time, float(twist[2])
    rotation = rate * time
    # The velocity either turns with the body or keeps its direction; this is its mean direction.
    half = 0.0 if configuration.hold_world_direction else 0.5 * rotation
    chord = time * np.sinc(half / math.pi)  # np.sinc(x) is sin(pi x) / (pi x)
    moved = np.append(chord * turned(twist[:2], pose[2] + half), rotation)
    if configuration.hold_world_direction:
        twist[:2] = turned(twist[:2], -rotation)
    return Maneuver(pose + moved, twist, configuration.pedal, configuration.pedal_ramp_time)


def straight_bound(
    vehicle: VehicleConfiguration,
    ground: GroundConfiguration,
    maneuver: Maneuver,
    run: float = 0.0,
) -> Bound:
    """Return the lower bound of the distance of stops that keep heading and line of motion.

    Args:
        vehicle: the vehicle.
        ground: ground under the vehicle.
        maneuver: motion at the start of braking.
        run: distance of a stop that is compared with the bound [m]; the tolerance is only computed
            for a shorter stop, otherwise it is NaN.
    """
    if reason := _left_out(vehicle, ground):
        return Bound(math.nan, reason=reason)
    speed = math.hypot(maneuver.twist[0], maneuver.twist[1])
    if speed <= 0.0:
        return Bound(math.nan, reason="the vehicle is at rest or only spins")
    if maneuver.twist[2] != 0.0:
        return Bound(
            math.nan,
            reason="the vehicle rotates at the start of braking, so it has no heading to keep",
        )
    cases = _Straight(vehicle, ground, maneuver)
    best = cases.first()
    # This excludes the force of locked wheels that the motion does not drive.
    strict = cases.first(torque=math.inf, standing=False)
    if best is None or best.bound <= _LEAST or strict is None or strict.bound <= _LEAST:
        return Bound(
            math.nan,
            reason="no forces of the wheels that this motion drives decelerate the vehicle "
            "without yaw moment and side force",
        )
    distance = cases.distance(speed)
    if not math.isfinite(distance):
        return Bound(math.nan, reason=_WEAK)
    gap = best.bound / best.feasible - 1.0
    tolerance = cases.tolerance(distance, best.bound) if run < distance else math.nan
    return Bound(distance, gap, tolerance)


def any_heading_bound(
    vehicle: VehicleConfiguration, ground: GroundConfiguration, maneuver: Maneuver
) -> Bound:
    """Return the lower bound of the path length of the center of gravity in any stop.

    The arguments are those of `straight_bound`.
    """
    if reason := _left_out(vehicle, ground):
        return Bound(math.nan, reason=reason)
    cases = _AnyHeading(vehicle, ground, maneuver)
    speed = cases.center_speed
    if speed <= 0.0:
        return Bound(0.0)
    distance = cases.distance(speed)
    if not math.isfinite(distance):
        return Bound(math.nan, reason=_WEAK)
    # While the loads lag, any load distribution is possible.
    first = cases.deceleration(0.0, 0.0, math.inf)
    any_load_bound = cases.limit.any_load_bound(cases.friction(0.0, 0.0))
    gain = max(any_load_bound / first - 1.0, 0.0) if first > 0.0 else 0.0
    return Bound(distance, cases.tolerance, speed * vehicle.load_transfer_time * gain)


def _left_out(vehicle: VehicleConfiguration, ground: GroundConfiguration) -> str:
    """Return the reason why no bound can be computed; empty if a bound can be computed."""
    if len(ground.elevation.table()):
        return _SLOPE
    if vehicle.passive_losses.speed_growth > 0.0:
        return _FASTER
    if vehicle.fork.time:
        return _LIFTING
    return _SPRUNG if vehicle.suspension.stiffness > 0.0 else ""


def straight_sketch(
    vehicle: VehicleConfiguration, ground: GroundConfiguration, maneuver: Maneuver
) -> float:
    """Return an upper estimate of `straight_bound` [m] from a few linear programs.

    A run that is longer than this estimate is also longer than the bound, so the check of this run
    needs no exact bound. While the brake torque builds up, it is rounded down to a few values. This
    limits the number of linear programs, and can only increase the estimate.
    """
    cases = _Straight(vehicle, ground, maneuver, sketch=True)
    if _strongest([cases.first()]) <= _LEAST:
        return math.inf
    return cases.distance(math.hypot(*maneuver.twist[:2]))


def any_heading_sketch(
    vehicle: VehicleConfiguration, ground: GroundConfiguration, maneuver: Maneuver
) -> float:
    """Return an upper estimate of `any_heading_bound` [m] from a few linear programs."""
    cases = _OneHeading(vehicle, ground, maneuver, sketch=True)
    return cases.distance(cases.center_speed)


class _Cases:
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
        self._brake, self._load_transfer_time = vehicle.brake, vehicle.load_transfer_time
        self._map = FrictionMap(ground.friction, ground.patches)
        self._maneuver = maneuver
        self._final = vehicle.brake.max_torque * maneuver.pedal
        self._solved: dict[tuple[object, ...], float] = {}
        top = max((self._map.base, *self._map.table[:, 6])) * float(np.max(self.limit.grip))
        weakest = max(float(np.min(self.limit.torque_force)), _LEAST)
        self._enough_torque: float = top * self.limit.strongest_peak / weakest
        self._level = self._enough_torque / (_SKETCHED if sketch else _LEVELS)
        self._rounded: Callable[[float], int] = math.floor if sketch else math.ceil
        self._step = max(math.hypot(*maneuver.twist[:2]) ** 2 / (2.0 * 3.0) / _PLACES, 1e-3)

    def distance(self, speed: float) -> float:
        """Return the stopping distance [m] from a speed [m/s] at the largest decelerations.

        It is infinite if the vehicle does not come to rest.
        """
        enough, final = self._enough_torque, self._final
        distance = time = 0.0
        while speed > 0.0:
            torque = self._torque(time + _TIME_STEP)
            settled = torque >= min(enough, 0.999 * final)
            if settled:
                torque = math.inf if torque >= enough else final
            else:
                # The number of cases is limited by rounding, up for a bound and down for a sketch.
                torque = min(self._rounded(torque / self._level) * self._level, final)
            if settled and not len(self._map.table):
                rate = self.deceleration(distance, distance, torque)
                return distance + speed**2 / (2.0 * rate) if rate > _LEAST else math.inf
            step = max(speed, 1e-3) * _TIME_STEP if not settled else self._step
            rate = self.deceleration(distance, distance + step, torque)
            if settled and rate <= _LEAST and distance > 1e4:
                return math.inf
            square = speed**2 - 2.0 * rate * step
            if square <= 0.0:
                return distance + speed**2 / (2.0 * rate)
            after = math.sqrt(square)
            time += 2.0 * step / (speed + after)
            distance, speed = distance + step, after
        return distance

    def _torque(self, time: float) -> float:
        """Return the maximum torque of a brake [N m], `time` [s] after the pedal begins to move."""
        brake, ramp = self._brake, self._maneuver.ramp_time
        on = time - brake.dead_time
        if on <= 0.0:
            return 0.0
        share, lag = 1.0, brake.time_constant
        if ramp > 0.0:
            share = min(on / ramp, 1.0)
        elif lag > 0.0:
            share = -math.expm1(-on / lag)
        return self._final * share

    def deceleration(self, start: float, end: float, torque: float) -> float:
        """Return an upper bound of the deceleration on a segment of the path [m/s^2].

        Args:
            start: position of the start of the segment, as the distance traveled [m].
            end: position of its end [m].
            torque: torque of every brake [N m].
        """
        friction = self.friction(start, end)
        key = (*friction.tolist(), torque)
        if key not in self._solved:
            self._solved[key] = self._solve(friction, torque)
        return self._solved[key]

    def friction(self, start: float, end: float) -> FloatArray:
        """Return the largest friction factor under each wheel on a path segment [1], shape (N,).

        The arguments are those of `deceleration`.
        """
        raise NotImplementedError

    def _solve(self, friction: FloatArray, torque: float) -> float:
        raise NotImplementedError


class _Straight(_Cases):
    """Stops that keep heading and line of motion."""

    @property
    def _direction(self) -> FloatArray:
        v = self._maneuver.twist[:2]
        return v / math.hypot(*v)

    def friction(self, start: float, end: float) -> FloatArray:
        middle = self.limit.position + 0.5 * (start + end) * self._direction
        places = self._maneuver.pose[:2] + turned(middle, self._maneuver.pose[2])
        near = 0.5 * (end - start) + EDGE_MARGIN
        return self.limit.grip * [_largest_friction(self._map, place, near) for place in places]

    def _solve(self, friction: FloatArray, torque: float) -> float:
        return _strongest([self.limit.strongest(self._direction, Case(friction, True, torque))])

    def first(self, angle: float = 0.0, **changes: Any) -> Deceleration | None:
        """Return the largest deceleration that the wheels can cause at the start of braking.

        The result is None if no admissible forces exist.

        Args:
            angle: angle by which the direction of motion differs from that of the maneuver [rad].
            **changes: fields of `Case` that differ from a straight stop with the full torque.
        """
        case = Case(self.friction(0.0, 0.0), True, self._final)._replace(**changes)
        return self.limit.strongest(turned(self._direction, angle), case)

    def tolerance(self, distance: float, first: float) -> float:
        """Return the tolerance of a bound [m].

        Args:
            distance: the bound [m].
            first: largest deceleration at the start of braking [m/s^2].
        """
        lagging = _strongest(self.first(lag=share) for share in (0.25, 0.5, 0.75, 1.0))
        gain = max(lagging / first - 1.0, 0.0)
        near = _strongest(self.first(angle) for angle in self.near)
        leeway = distance * (1.0 - first / max(near, first))
        rebound = self.limit.rebound(self._direction, first)
        speed = math.hypot(*self._maneuver.twist[:2])
        return speed * self._load_transfer_time * gain + leeway + rebound

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


class _AnyHeading(_Cases):
    """Stops with any heading and any path."""

    tolerance = 1e-3

    @property
    def center_speed(self) -> float:
        """Speed of the center of gravity [m/s]."""
        center, twist = self.limit.masses.center, self._maneuver.twist
        return math.hypot(*(twist[:2] + twist[2] * np.array([-center[1], center[0]])))

    def friction(self, start: float, end: float) -> FloatArray:
        del start
        masses = self.limit.masses
        pose = self._maneuver.pose
        center = pose[:2] + turned(np.asarray(masses.center), pose[2])
        arms = np.hypot(*(self.limit.position - masses.center).T)
        return self.limit.grip * [_largest_friction(self._map, center, end + arm) for arm in arms]

    def _solve(self, friction: FloatArray, torque: float) -> float:
        return self.limit.largest(Case(friction, False, min(torque, self._final)), self.tolerance)


class _OneHeading(_AnyHeading):
    """Stops with one constant heading, for the upper estimate of the bound.

    This heading is the one with the largest deceleration among `_SKETCHED` equally spaced headings.
    """

    _heading: FloatArray | None = None

    def _solve(self, friction: FloatArray, torque: float) -> float:
        if self._heading is None:
            case = Case(friction, False, self._final)
            angles = np.arange(_SKETCHED) * 2.0 * math.pi / _SKETCHED
            headings = np.column_stack((np.cos(angles), np.sin(angles)))
            self._heading = max(headings, key=lambda one: self.limit.at_least(one, case))
        case = Case(friction, False, min(torque, self._final))
        return self.limit.at_least(self._heading, case)


def _strongest(found: Iterable[Deceleration | None]) -> float:
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


def limit_share(
    history: RunHistory, configuration: experiment.ExperimentConfiguration, distance: float
) -> metrics.Metric:
    """Return the lower bound of the stopping distance, divided by the distance of a run [1].

    The bound is valid for stops that keep heading and line of motion. It is computed for the
    velocity at the start of braking, without the yaw rate, and for the largest pedal position of
    the run.

    Args:
        history: history of the run.
        configuration: configuration of the run, with vehicle and ground.
        distance: stopping distance of the run [m].
    """
    start = history.brake_start
    if start is None or not distance > 0.0:
        return metrics.Metric(math.nan, "1", note="limit_share: there is no stopping distance")
    twist = history.twist[start] * np.array([1.0, 1.0, 0.0])
    maneuver = Maneuver(history.pose[start], twist, float(np.max(history.pedal)))
    bound = straight_bound(configuration.vehicle, configuration.ground, maneuver, distance)
    share = bound.distance / distance
    note = ""
    if math.isnan(share):
        note = f"limit_share: {bound.reason}"
    elif distance < bound.distance - bound.tolerance:
        note = "this stop rotates and is shorter than any stop that keeps its heading"
    return metrics.Metric(share, "1", note=note)
