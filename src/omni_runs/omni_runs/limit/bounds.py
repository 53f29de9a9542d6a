"""Lower bound of the stopping distance on ground with patches and for brakes with lag.

The brake torque is limited by pedal ramp, dead time and lag, and this limit increases with time.
Friction depends on the positions of the wheels. The shortest distance therefore results from the
largest deceleration at every position, ``d(v^2)/ds = -2 a(s, t)``, with the speed ``v``, the
deceleration ``a``, the position ``s`` and the time ``t``. A slower vehicle arrives at a position
later, when at least the same torque is available. Wheel spin cannot shorten the stop: a braked
wheel turns no faster than a rolling wheel, so the impulse of its tire force is at most the impulse
of its brake.

If a brake fails during the stop (`omni_sim.vehicle.configuration.WheelCondition`), the argument
holds only after the failure: a vehicle that arrives later may arrive without this brake. Until the
failure, the largest deceleration at every *time* gives lower limits of speed and position at the
failure. The ground is then anywhere between this position and that of a vehicle that does not
brake. From these limits on, the bound follows from the largest deceleration at every position. A
wheel that was locked exerts its force after the failure until it rolls; `tolerance` contains the
impulse of this force.

For a stop that keeps heading and line, the ground under each wheel is known. Within
`stop_kinds.EDGE_MARGIN` of the edge of a patch, the higher friction is used. For stops with any
heading and path, a wheel may be anywhere within the distance traveled. For stops that keep the
heading on any path, the bound limits only the speed along the initial direction of motion, on
ground of the largest friction.
`limit_share` compares the bound with a recorded stop.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.geometry import turned
from omni_runs import experiment, metrics
from omni_runs.history import RunHistory
from omni_runs.limit import stop_kinds
from omni_runs.limit.stop_kinds import Maneuver
from omni_sim.configuration import GroundConfiguration
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.driver.scripted import ScriptedDriver
from omni_sim.vehicle.configuration import VehicleConfiguration

_WEAK = "friction or brakes are too weak to stop the vehicle"
_SLOPE = "the ground is not level, and the slope force is not modeled"
_FASTER = "the rolling resistance grows with the speed, and the bound assumes that it does not"
_LIFTING = "the fork moves the load during the stop"
_SPRUNG = "the chassis is sprung, and the resulting load oscillation is not modeled"


class Bound(NamedTuple):
    """A lower bound of the stopping distance.

    Attributes:
        distance: the bound [m], NaN if there is none.
        gap: limit on the relative difference between the bound and the distance of a stop with
            feasible forces [1].
        tolerance: length by which a run may be shorter than the bound because of neglected effects
            [m]: lag of the loads, elastic deflection of the tires at rest, deviations of heading
            and direction up to `stop_kinds.KEPT`, and spin-up of wheels whose brakes fail; NaN if
            it is not needed.
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
    pedal, ramp_time = configuration.pedal, configuration.pedal_ramp_time
    return Maneuver(pose + moved, twist, pedal, ramp_time, time)


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
    return _kept(stop_kinds.StraightStops, vehicle, ground, maneuver, run)


def heading_bound(
    vehicle: VehicleConfiguration,
    ground: GroundConfiguration,
    maneuver: Maneuver,
    run: float = 0.0,
) -> Bound:
    """Return the lower bound of the path length of stops that keep the heading, on any path.

    The arguments are those of `straight_bound`.
    """
    return _kept(stop_kinds.HeadingStops, vehicle, ground, maneuver, run)


def _kept(
    kind: type[stop_kinds.StraightStops],
    vehicle: VehicleConfiguration,
    ground: GroundConfiguration,
    maneuver: Maneuver,
    run: float,
) -> Bound:
    """Return the lower bound of the distance of the stops that a class admits."""
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
    cases = kind(vehicle, ground, maneuver)
    stages = cases.stages(speed)
    best = [cases.first(stage) for stage in stages]
    # This excludes the force of locked wheels that the motion does not drive.
    strict = [cases.first(stage, force=math.inf, standing=False) for stage in stages]
    if min(stop_kinds.strongest([found]) for found in (*best, *strict)) <= stop_kinds.LEAST:
        return Bound(
            math.nan,
            reason="no forces of the wheels that this motion drives decelerate the vehicle "
            f"without {kind.WITHOUT}",
        )
    distance = cases.distance(speed)
    if not math.isfinite(distance):
        return Bound(math.nan, reason=_WEAK)
    gap = max(found.bound / found.feasible for found in best if found is not None) - 1.0
    tolerance = cases.tolerance(speed, distance) if run < distance else math.nan
    return Bound(distance, gap, tolerance)


def any_heading_bound(
    vehicle: VehicleConfiguration, ground: GroundConfiguration, maneuver: Maneuver
) -> Bound:
    """Return the lower bound of the path length of the center of gravity in any stop.

    The arguments are those of `straight_bound`.
    """
    if reason := _left_out(vehicle, ground):
        return Bound(math.nan, reason=reason)
    cases = stop_kinds.AnyStops(vehicle, ground, maneuver)
    speed = cases.center_speed
    if speed <= 0.0:
        return Bound(0.0)
    distance = cases.distance(speed)
    if not math.isfinite(distance):
        return Bound(math.nan, reason=_WEAK)
    return Bound(distance, cases.accuracy, cases.tolerance(speed, distance))


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
    cases = stop_kinds.StraightStops(vehicle, ground, maneuver, sketch=True)
    speed = math.hypot(*maneuver.twist[:2])
    if (
        min(stop_kinds.strongest([cases.first(stage)]) for stage in cases.stages(speed))
        <= stop_kinds.LEAST
    ):
        return math.inf
    return cases.distance(speed)


def any_heading_sketch(
    vehicle: VehicleConfiguration, ground: GroundConfiguration, maneuver: Maneuver
) -> float:
    """Return an upper estimate of `any_heading_bound` [m] from a few linear programs."""
    cases = stop_kinds.StopsOfOneHeading(vehicle, ground, maneuver, sketch=True)
    return cases.distance(cases.center_speed)


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
    if configuration.vehicle.has_conventional_wheels:
        note = "limit_share: the bound is for vehicles on omni-wheels"
        return metrics.Metric(math.nan, "1", note=note)
    twist = history.twist[start] * np.array([1.0, 1.0, 0.0])
    pedal, time = float(np.max(history.pedal)), 1e-9 * float(history.stamp_ns[start])
    maneuver = Maneuver(history.pose[start], twist, pedal, start_time=time)
    bound = straight_bound(configuration.vehicle, configuration.ground, maneuver, distance)
    share = bound.distance / distance
    note = ""
    if math.isnan(share):
        note = f"limit_share: {bound.reason}"
    elif distance < bound.distance - bound.tolerance:
        note = "this stop rotates and is shorter than any stop that keeps its heading"
    return metrics.Metric(share, "1", note=note)
