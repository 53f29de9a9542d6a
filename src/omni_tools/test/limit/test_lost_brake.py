"""Bounds after the loss of a brake: closed forms, another optimizer, and simulated stops."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from omni_core.configuration import ConfigurationError
from omni_core.geometry import turned
from omni_core.quantities import GRAVITY, FloatArray
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.limit.bounds import (
    Bound,
    any_heading_bound,
    heading_bound,
    maneuver_of,
    straight_bound,
)
from omni_runs.limit.forces import Case, LimitVehicle
from omni_runs.limit.stop_kinds import Maneuver
from omni_runs.workspace import ExperimentWorkspace
from omni_sim.configuration import GroundConfiguration
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.masses import MassConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration, WheelCondition
from omni_sim.vehicle.loads import load_plane
from omni_tools.limit.command import Options, run

ROOT = Path(__file__).parents[4]
LIBRARY = ExperimentLibrary(ROOT / "config")
FLAT = GroundConfiguration()
MASS, HEIGHT, HALF = 1200.0, 0.4, 0.65


def _moving(speed: float, direction: float = 0.0) -> Maneuver:
    angle = math.radians(direction)
    return Maneuver(np.zeros(3), np.array([speed * math.cos(angle), speed * math.sin(angle), 0.0]))


def _lose(vehicle: VehicleConfiguration, *wheels: str, time: float = 0.0) -> VehicleConfiguration:
    conditions = {wheel: WheelCondition(brake=0.0, onset=time) for wheel in wheels}
    return dataclasses.replace(vehicle, conditions=conditions)


@pytest.fixture(scope="module")
def forklift() -> VehicleConfiguration:
    return LIBRARY.vehicle("mecanum_forklift")


@pytest.fixture(scope="module")
def symmetric(forklift: VehicleConfiguration) -> VehicleConfiguration:
    body = MassConfiguration(mass=MASS, height=HEIGHT, yaw_inertia=400.0)
    return dataclasses.replace(forklift, body=body, load=MassConfiguration(mass=0.0, height=0.0))


def _axles(vehicle: VehicleConfiguration, sides: tuple[float, ...]) -> float:
    """Return the deceleration of the symmetric vehicle in forward motion [m/s^2].

    Args:
        vehicle: the symmetric vehicle.
        sides: 1 for the front axle, -1 for the rear axle, for each axle that brakes.
    """
    limit = LimitVehicle(vehicle)

    def missing(a: float) -> float:
        shift = MASS * a * HEIGHT / (4.0 * HALF)
        loads = MASS * GRAVITY / 4.0 + shift * np.array(sides)
        return 2.0 * math.sqrt(0.5) * float(np.sum(limit.peak(loads))) / MASS - a

    return float(brentq(missing, 0.5, 9.0))


@pytest.mark.parametrize(("wheel", "left"), [("front_left", -1.0), ("rear_right", 1.0)])
def test_without_one_brake_only_the_other_axle_stops_a_symmetric_vehicle(
    symmetric: VehicleConfiguration, wheel: str, left: float
) -> None:
    """Yaw moment and side force are zero only if both wheels of an axle brake equally."""
    rate = _axles(symmetric, (left,))
    bound = straight_bound(_lose(symmetric, wheel), FLAT, _moving(8.0))
    assert bound.distance == pytest.approx(8.0**2 / (2.0 * rate), rel=1e-4)
    assert bound.distance <= 8.0**2 / (2.0 * rate)


def test_a_side_force_does_not_help_a_low_symmetric_vehicle(
    symmetric: VehicleConfiguration,
) -> None:
    """The moment of one full side equals that of the other: both brake with one wheel's force."""
    body = dataclasses.replace(symmetric.body, height=0.0)
    low = _lose(dataclasses.replace(symmetric, body=body), "front_left")
    peak = float(LimitVehicle(low).peak(np.array([MASS * GRAVITY / 4.0]))[0])
    distance = 8.0**2 * MASS / (4.0 * math.sqrt(0.5) * peak)
    for bound_of in (straight_bound, heading_bound):
        assert bound_of(low, FLAT, _moving(8.0)).distance == pytest.approx(distance, rel=1e-4)


@pytest.mark.parametrize("time", [0.1, 0.5, 0.9])
def test_a_loss_in_mid_stop_is_two_stages_of_constant_deceleration(
    symmetric: VehicleConfiguration, time: float
) -> None:
    first, last = _axles(symmetric, (1.0, -1.0)), _axles(symmetric, (-1.0,))
    after = 8.0 - first * time
    distance = 0.5 * (8.0 + after) * time + after**2 / (2.0 * last)
    late = _moving(8.0)._replace(start_time=2.0)
    bound = straight_bound(_lose(symmetric, "front_left", time=2.0 + time), FLAT, late)
    assert bound.distance == pytest.approx(distance, rel=1e-4)
    assert bound.distance <= distance


def test_a_lost_pair_counts_as_one_lost_brake(symmetric: VehicleConfiguration) -> None:
    one, pair = (
        straight_bound(_lose(symmetric, *lost, time=0.4), FLAT, _moving(8.0)).distance
        for lost in (("front_left",), ("front_left", "front_right"))
    )
    assert one == pytest.approx(pair, rel=1e-6)
    three = _lose(symmetric, "front_left", "front_right", "rear_left")
    assert "without yaw moment" in straight_bound(three, FLAT, _moving(8.0)).reason


def _strongest_by_slsqp(
    vehicle: VehicleConfiguration, lost: int, direction: FloatArray, *, straight: bool
) -> float:
    """Return the largest deceleration without yaw moment [m/s^2], and without side force.

    A sequential quadratic program finds it with the exact, curved friction limit. If the stop need
    not be straight, a side force is allowed, and wheels may also drive.
    """
    limit = LimitVehicle(vehicle)
    masses, wheels = limit.masses, len(limit.active)
    plane = load_plane(limit.position - masses.center)
    braking = -np.sign(limit.active @ direction)
    across = np.array([-direction[1], direction[0]])

    def forces(x: FloatArray) -> FloatArray:
        return np.where(np.arange(wheels) == lost, 0.0, 1e4 * x * braking)

    def rate(x: FloatArray) -> float:
        return -float(direction @ limit.active.T @ forces(x)) / masses.mass

    def spare(x: FloatArray) -> FloatArray:
        z = -masses.height / GRAVITY * limit.active.T @ forces(x) / masses.mass
        loads = masses.mass * GRAVITY * plane @ np.array([1.0, *z])
        return (limit.peak(loads) - np.abs(forces(x))) / 1e4

    none = [lambda x: limit.lever @ forces(x) / 1e4]
    if straight:
        none.append(lambda x: across @ limit.active.T @ forces(x) / 1e4)
    found = minimize(
        lambda x: -rate(x),
        np.full(wheels, 0.05),
        method="SLSQP",
        bounds=[(0.0 if straight else -1.0, 1.0)] * wheels,
        constraints=[{"type": "ineq", "fun": spare}, *({"type": "eq", "fun": one} for one in none)],
        options={"maxiter": 300, "ftol": 1e-9},
    )
    assert found.success
    return rate(found.x)


@pytest.mark.parametrize(
    ("name", "lost", "direction", "straight"),
    [
        ("six_wheel_mecanum", 1, 0.0, True),
        ("six_wheel_mecanum", 4, 20.0, True),
        ("mecanum_forklift", 1, 0.0, False),
        ("mecanum_forklift", 3, 30.0, False),
        ("six_wheel_mecanum", 0, 0.0, False),
    ],
)
def test_another_optimizer_finds_the_same_deceleration(
    name: str, lost: int, direction: float, straight: bool
) -> None:
    vehicle = LIBRARY.vehicle(name)
    e = np.array([math.cos(math.radians(direction)), math.sin(math.radians(direction))])
    torque = np.where(np.arange(len(vehicle.wheels)) == lost, 0.0, math.inf)
    grip = np.ones(len(vehicle.wheels))
    case = Case(grip, straight, torque, heading=True)
    bound = LimitVehicle(vehicle).strongest(e, case)
    assert bound is not None
    assert bound.bound > 1.0
    assert bound.force[lost] == pytest.approx(0.0, abs=1e-6)
    found = _strongest_by_slsqp(vehicle, lost, e, straight=straight)
    assert found == pytest.approx(bound.bound, rel=2e-3)


@pytest.mark.parametrize("bound_of", [straight_bound, heading_bound, any_heading_bound])
@pytest.mark.parametrize("icy", [False, True])
def test_a_later_loss_never_raises_the_bound(
    symmetric: VehicleConfiguration, bound_of: Callable[..., Bound], icy: bool
) -> None:
    patch = FrictionPatch(x=5.0, y=0.0, length=3.0, width=50.0, friction=0.3)
    ground = dataclasses.replace(FLAT, patches={"ice": patch}) if icy else FLAT
    late = dataclasses.replace(symmetric.brake, dead_time=0.03)
    slow = dataclasses.replace(symmetric, brake=late)
    times = (0.0, 0.02, 0.3, 30.0)
    bounds = [
        bound_of(_lose(slow, "front_left", time=time), ground, _moving(8.0)).distance
        for time in times
    ]
    all_brakes = bound_of(slow, ground, _moving(8.0)).distance
    assert np.all(np.diff(bounds) <= 1e-3)
    assert bounds[0] > 1.1 * all_brakes
    assert bounds[-1] == pytest.approx(all_brakes, rel=1e-3)
    assert min(bounds) >= all_brakes * (1.0 - 1e-3)


@pytest.mark.parametrize("time", [0.0, 0.4])
@pytest.mark.parametrize("law", ["unassisted", "assisted", "allocation"])
def test_no_run_without_a_brake_is_below_its_bounds(law: str, time: float) -> None:
    for direction in (0.0, 31.0):
        moving = ["feedback=velocity_sensor", f"maneuver.direction_deg={direction}"]
        start = LIBRARY.load("straight_line", law, moving).maneuver.brake_time
        lost = f"vehicle.conditions.front_left={{brake: 0.0, onset: {start + time}}}"
        experiment = LIBRARY.load("straight_line", law, [*moving, lost])
        stop = run_fast_loop(experiment)
        maneuver = maneuver_of(experiment.maneuver)
        bound = any_heading_bound(experiment.vehicle, experiment.ground, maneuver)
        assert stop.stopped
        pose = stop.pose[stop.brake_start :]
        center = np.asarray(experiment.vehicle.masses.center)
        path = np.diff(pose[:, :2] + turned(center, pose[:, 2]), axis=0)
        assert np.sum(np.hypot(*path.T)) >= bound.distance - bound.tolerance


@pytest.mark.parametrize("time", [0.0, 0.4])
def test_a_stop_with_the_other_axle_is_near_the_bound(
    symmetric: VehicleConfiguration, time: float
) -> None:
    """If the whole front axle is lost, the rear axle brakes without yaw moment and side force."""
    experiment = LIBRARY.load("straight_line", "unassisted", ["feedback=velocity_sensor"])
    onset = experiment.maneuver.brake_time + time
    one = _lose(symmetric, "front_left", time=onset)
    pair = _lose(symmetric, "front_left", "front_right", time=onset)
    stop = run_fast_loop(dataclasses.replace(experiment, vehicle=pair))
    bound = straight_bound(one, experiment.ground, maneuver_of(experiment.maneuver))
    assert stop.orientation_change < 0.5
    # Locked wheels slide, with less than the peak force.
    assert bound.distance - bound.tolerance <= stop.stopping_distance <= 1.3 * bound.distance


def test_fewer_conditions_never_raise_the_bound(forklift: VehicleConfiguration) -> None:
    for wheel in ("front_left", "rear_right"):
        lost = _lose(forklift, wheel, time=0.2)
        straight, heading, anyhow = (
            bound_of(lost, FLAT, _moving(8.0)).distance
            for bound_of in (straight_bound, heading_bound, any_heading_bound)
        )
        assert anyhow <= heading * (1.0 + 1e-3)
        assert math.isnan(straight) or heading <= straight * (1.0 + 1e-6)


def test_three_wheels_cannot_keep_their_heading_without_a_brake() -> None:
    robot = _lose(LIBRARY.vehicle("three_wheel_robot"), "first")
    bound = straight_bound(robot, FLAT, _moving(4.0, 60.0))
    assert math.isnan(bound.distance)
    assert "without yaw moment" in bound.reason
    assert math.isfinite(any_heading_bound(robot, FLAT, _moving(4.0, 60.0)).distance)


def test_the_command_reports_the_bounds_with_and_without_the_loss() -> None:
    workspace = ExperimentWorkspace(ROOT)
    chosen = Options(experiment="straight_line", lost_brake=("rear_left",), since=0.5)
    found = run(chosen, workspace).document["metrics"]
    lost, whole = (
        found[f"stopping_distance.bound_heading{word}"]["value"] for word in ("", "_all_brakes")
    )
    assert found["stopping_distance.bound_all_brakes"]["value"] == pytest.approx(8.65, abs=0.005)
    assert lost > 1.1 * whole


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"lost_brake": ("front_lef",)}, "^--lost-brake: .*did you mean 'front_left'"),
        ({"since": 0.5}, "^--from: can only be used with --lost-brake"),
        ({"lost_brake": ("front_left",), "since": 0.5, "best": True}, "^--from: .*--best"),
        ({"vehicle": "swerve_robot"}, r"^wheels.rear_left.kind: is conventional, but limit "),
    ],
)
def test_wrong_options_are_refused_with_a_sentence(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        run(Options(**options), ExperimentWorkspace(ROOT))
