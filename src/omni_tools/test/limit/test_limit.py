"""No stop is shorter than its bound: closed forms, random forces, and runs of every law."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from omni_core.geometry import cross
from omni_core.quantities import GRAVITY
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.limit.bounds import (
    any_heading_bound,
    heading_bound,
    limit_share,
    maneuver_of,
    straight_bound,
)
from omni_runs.limit.forces import Case, LimitVehicle, farthest
from omni_runs.limit.stop_kinds import Maneuver
from omni_sim.configuration import GroundConfiguration
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.masses import ForkConfiguration, MassConfiguration
from omni_sim.vehicle.configuration import (
    SuspensionConfiguration,
    VehicleConfiguration,
)
from omni_sim.vehicle.loads import load_plane
from omni_sim.wheel.configuration import PassiveLossConfiguration

ROOT = Path(__file__).parents[4]
FLAT = GroundConfiguration()


def _moving(speed: float, direction: float = 0.0) -> Maneuver:
    angle = math.radians(direction)
    return Maneuver(np.zeros(3), np.array([speed * math.cos(angle), speed * math.sin(angle), 0.0]))


@pytest.fixture(scope="module")
def library() -> ExperimentLibrary:
    return ExperimentLibrary(ROOT / "config")


@pytest.fixture(scope="module")
def forklift(library: ExperimentLibrary) -> VehicleConfiguration:
    return library.vehicle("mecanum_forklift")


@pytest.fixture(scope="module")
def symmetric(forklift: VehicleConfiguration) -> VehicleConfiguration:
    body = MassConfiguration(mass=1200.0, height=0.4, yaw_inertia=400.0)
    return dataclasses.replace(forklift, body=body, load=MassConfiguration(mass=0.0, height=0.0))


def test_a_symmetric_vehicle_stops_as_two_axles_do(symmetric: VehicleConfiguration) -> None:
    limit = LimitVehicle(symmetric)
    mass, height, half = 1200.0, 0.4, 0.65

    def missing(a: float) -> float:
        shift = mass * a * height / (4.0 * half)
        loads = mass * GRAVITY / 4.0 + np.array([shift, -shift])
        return 2.0 * math.sqrt(0.5) * float(np.sum(limit.peak(loads))) / mass - a

    rate = brentq(missing, 1.0, 9.0)
    bound = straight_bound(symmetric, FLAT, _moving(8.0))
    assert bound.distance == pytest.approx(8.0**2 / (2.0 * rate), rel=1e-4)
    assert bound.distance <= 8.0**2 / (2.0 * rate)


def test_a_sprung_chassis_has_no_bound_and_says_why(forklift: VehicleConfiguration) -> None:
    springs = SuspensionConfiguration(stiffness=2.0e5)
    sprung = dataclasses.replace(forklift, suspension=springs)
    for bound_of in (straight_bound, any_heading_bound):
        bound = bound_of(sprung, FLAT, _moving(10.0))
        assert math.isnan(bound.distance)
        assert "sprung" in bound.reason


def test_losses_that_grow_with_the_speed_have_no_bound(forklift: VehicleConfiguration) -> None:
    losses = PassiveLossConfiguration(speed_growth=1e-4)
    lossy = dataclasses.replace(forklift, passive_losses=losses)
    for bound_of in (straight_bound, any_heading_bound):
        assert "grows with the speed" in bound_of(lossy, FLAT, _moving(10.0)).reason


def test_a_moving_fork_has_no_bound(forklift: VehicleConfiguration) -> None:
    lifting = dataclasses.replace(
        forklift, fork=ForkConfiguration(time=(0.0, 1.0), height=(0.5, 1.5))
    )
    assert "fork" in straight_bound(lifting, FLAT, _moving(10.0)).reason


def test_straight_line_has_the_known_bound(forklift: VehicleConfiguration) -> None:
    bound = straight_bound(forklift, FLAT, _moving(10.0))
    assert bound.distance == pytest.approx(8.65, abs=0.005)
    assert 0.0 <= bound.gap < 1e-3
    assert any_heading_bound(forklift, FLAT, _moving(10.0)).distance < bound.distance


@pytest.mark.parametrize("direction", [0.0, 45.0])
def test_the_gap_is_small_although_a_wheel_lifts_off(
    library: ExperimentLibrary, direction: float
) -> None:
    robot = library.vehicle("three_wheel_robot")
    assert heading_bound(robot, FLAT, _moving(3.0, direction)).gap < 1e-3


@pytest.mark.parametrize("direction", [0.0, 20.0, 90.0, 135.0])
def test_no_random_forces_slow_a_straight_stop_down_faster(
    forklift: VehicleConfiguration, direction: float
) -> None:
    limit = LimitVehicle(forklift)
    e = np.array([math.cos(math.radians(direction)), math.sin(math.radians(direction))])
    found = limit.strongest(e, Case(np.ones(4), straight=True))
    assert found is not None
    masses = forklift.masses
    plane = load_plane(limit.position - masses.center)
    wrench = np.vstack((limit.active.T, limit.lever))
    wanted = np.linalg.lstsq(wrench, np.append(-e, 0.0), rcond=None)[0]
    null = np.linalg.svd(wrench)[2][-1]
    random = np.random.default_rng(1)
    strongest = 0.0
    for share in random.uniform(-1.0, 1.0, 400):
        unit = wanted + share * null
        low, high = 0.0, 3e4  # scales of these forces up to the friction limit
        for _ in range(40):
            scale = 0.5 * (low + high)
            z = -masses.height / GRAVITY * limit.active.T @ (scale * unit) / masses.mass
            loads = masses.mass * GRAVITY * plane @ np.array([1.0, *z])
            inside = np.min(loads) >= 0 and np.all(np.abs(scale * unit) <= limit.peak(loads))
            low, high = (scale, high) if inside else (low, scale)
        if np.all(limit.active @ e * unit <= 1e-9):
            strongest = max(strongest, low / masses.mass)
    assert strongest <= found.bound
    assert strongest > 0.9 * found.bound  # the bound is tight


def test_a_bound_over_headings_is_above_every_heading(forklift: VehicleConfiguration) -> None:
    limit, case = LimitVehicle(forklift), Case(np.ones(4), straight=False)
    largest = limit.largest(case, 1e-3)
    angles = np.random.default_rng(3).uniform(-math.pi, math.pi, 12)
    for angle in angles:
        found = limit.strongest(np.array([math.cos(angle), math.sin(angle)]), case)
        assert found is not None
        assert found.bound <= largest


def test_pushing_helps_only_near_a_direction_in_which_wheels_are_not_driven(
    forklift: VehicleConfiguration,
) -> None:
    """At 45 deg, two locked wheels exert forces of either sign; at 44 deg, only by pushing."""
    limit, deceleration = LimitVehicle(forklift), {}
    for degrees in (0.0, 44.0, 45.0):
        direction = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
        for pushes in (False, True):
            found = limit.strongest(direction, Case(np.ones(4), straight=True, pushes=pushes))
            assert found is not None
            deceleration[degrees, pushes] = found.bound
    assert deceleration[0.0, True] == pytest.approx(deceleration[0.0, False], rel=1e-9)
    assert deceleration[45.0, True] == pytest.approx(deceleration[45.0, False], rel=1e-9)
    assert deceleration[44.0, True] >= deceleration[44.0, False]
    assert deceleration[44.0, True] == pytest.approx(deceleration[45.0, True], rel=0.02)


def test_the_farthest_corner_of_a_polygon_is_found() -> None:
    corners = np.array([[2.0, 1.0], [-1.0, 1.5], [-0.5, -2.0]])
    bound = farthest(lambda t: max(corners @ [math.cos(t), math.sin(t)]), 1e-4)
    assert math.sqrt(5.0) * (1.0 - 1e-12) <= bound <= math.sqrt(5.0) * 1.0001


def test_a_kiwi_along_a_passive_direction_has_no_straight_stop(library: ExperimentLibrary) -> None:
    robot = library.vehicle("three_wheel_robot")
    bound = straight_bound(robot, FLAT, _moving(4.0, 90.0))
    assert math.isnan(bound.distance)
    assert "without yaw moment" in bound.reason
    assert any_heading_bound(robot, FLAT, _moving(4.0, 90.0)).distance > 0.0


def test_ice_all_along_the_way_is_a_ground_of_ice(forklift: VehicleConfiguration) -> None:
    patch = FrictionPatch(x=5.0, y=0.0, length=100.0, width=50.0, friction=0.3)
    icy = dataclasses.replace(FLAT, patches={"ice": patch})
    same = straight_bound(forklift, dataclasses.replace(FLAT, friction=0.3), _moving(5.0))
    over = straight_bound(forklift, icy, _moving(5.0))
    assert over.distance == pytest.approx(same.distance, rel=0.01)
    far = dataclasses.replace(icy.patches["ice"], x=80.0)
    beyond = straight_bound(forklift, dataclasses.replace(FLAT, patches={"ice": far}), _moving(5.0))
    assert beyond.distance == pytest.approx(
        straight_bound(forklift, FLAT, _moving(5.0)).distance, rel=0.01
    )


def test_weak_and_late_brakes_take_longer(forklift: VehicleConfiguration) -> None:
    weak = dataclasses.replace(
        forklift, brake=dataclasses.replace(forklift.brake, max_torque=200.0)
    )
    late = dataclasses.replace(
        forklift, brake=dataclasses.replace(forklift.brake, dead_time=0.1, time_constant=0.05)
    )
    free = straight_bound(forklift, FLAT, _moving(10.0)).distance
    assert straight_bound(weak, FLAT, _moving(10.0)).distance > 1.5 * free
    # The dead time passes at full speed.
    assert straight_bound(late, FLAT, _moving(10.0)).distance > free + 0.1 * 10.0 - 0.05


def test_a_slope_has_no_bound(library: ExperimentLibrary) -> None:
    ramp = library.load("straight_line", "assisted", ["ground=cork_ramp"]).ground
    bound = straight_bound(library.vehicle("mecanum_forklift"), ramp, _moving(10.0))
    assert math.isnan(bound.distance)
    assert "level" in bound.reason


@pytest.mark.parametrize("direction", [0.0, 31.0, 45.0, 117.0])
@pytest.mark.parametrize("variant", ["unassisted", "assisted"])
def test_no_run_is_below_its_bounds(
    library: ExperimentLibrary, direction: float, variant: str
) -> None:
    settings = ["feedback=velocity_sensor", f"maneuver.direction_deg={direction}"]
    experiment = library.load("straight_line", variant, settings)
    run = run_fast_loop(experiment)
    maneuver = maneuver_of(experiment.maneuver)
    any_bound = any_heading_bound(experiment.vehicle, experiment.ground, maneuver)
    center = experiment.vehicle.masses.center
    yaw = run.pose[run.brake_start :, 2]
    turned = np.column_stack(
        (
            np.cos(yaw) * center[0] - np.sin(yaw) * center[1],
            np.sin(yaw) * center[0] + np.cos(yaw) * center[1],
        )
    )
    path = np.diff(run.pose[run.brake_start :, :2] + turned, axis=0)
    assert np.sum(np.hypot(*path.T)) >= any_bound.distance - any_bound.tolerance
    straight = straight_bound(experiment.vehicle, experiment.ground, maneuver)
    if run.orientation_change <= 0.5:
        assert run.stopping_distance >= straight.distance - straight.tolerance


def test_a_maneuver_that_turns_is_where_the_drive_takes_it(library: ExperimentLibrary) -> None:
    experiment = library.load("turn_while_translate", "unassisted", ["feedback=velocity_sensor"])
    run = run_fast_loop(experiment)
    maneuver = maneuver_of(experiment.maneuver)
    assert maneuver.pose == pytest.approx(run.pose[run.brake_start], abs=0.02)
    assert maneuver.twist == pytest.approx(run.twist[run.brake_start], abs=0.05)


def test_forces_of_the_bound_neither_turn_nor_push(forklift: VehicleConfiguration) -> None:
    limit = LimitVehicle(forklift)
    found = limit.strongest(np.array([1.0, 0.0]), Case(np.ones(4), straight=True))
    assert found is not None
    assert found.force @ limit.active[:, 1] == pytest.approx(0.0, abs=1e-6)
    arm = limit.position - limit.masses.center
    assert np.sum(cross(arm, found.force[:, None] * limit.active)) == pytest.approx(0.0, abs=1e-6)
    assert np.sum(found.load) == pytest.approx(limit.masses.mass * GRAVITY)


def test_a_run_says_how_near_it_comes_to_the_limit(library: ExperimentLibrary) -> None:
    shares = {}
    for variant in ("unassisted", "allocation"):
        experiment = library.load("straight_line", variant, ["feedback=velocity_sensor"])
        run = run_fast_loop(experiment)
        shares[variant] = limit_share(run, experiment, run.stopping_distance)
        assert not shares[variant].note
    assert shares["unassisted"].value < 0.9
    assert 0.97 < shares["allocation"].value < 1.02


def test_the_share_is_continuous_in_the_yaw_rate(library: ExperimentLibrary) -> None:
    experiment = library.load("turn_while_translate", "k7", ["feedback=velocity_sensor"])
    history = run_fast_loop(experiment)
    shares = []
    for yaw_rate in (0.0, 1e-4, 2e-3, 0.5):
        twist = history.twist.copy()
        twist[history.brake_start, 2] = yaw_rate
        turning = dataclasses.replace(history, twist=twist)
        shares.append(limit_share(turning, experiment, 20.0).value)
    assert shares == pytest.approx([shares[0]] * 4, rel=1e-6)
    assert 0.3 < shares[0] < 1.0
