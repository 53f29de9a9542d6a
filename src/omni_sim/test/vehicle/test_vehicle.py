"""Motion of whole vehicles: driving by inverse kinematics, Newton and Euler, symmetries."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from logged_steps import Log, advance_logged

from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.ground.friction import FrictionMap
from omni_sim.masses import MassConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle, VehicleInputError

MOTIONS = {
    "forward": (1.5, 0.0, 0.0),
    "backward": (-1.5, 0.0, 0.0),
    "sideways": (0.0, 1.0, 0.0),
    "diagonal": (1.0, -1.0, 0.0),
    "spin": (0.0, 0.0, 1.0),
    "curve": (1.0, 0.3, -0.5),
}


def turned(x: float, y: float, angle: float) -> FloatArray:
    return np.array(
        [x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)]
    )


def six_wheels(forklift: VehicleConfiguration) -> VehicleConfiguration:
    middle = {
        "middle_left": WheelMount(x=0.0, y=0.6, roller_angle_deg=45.0),
        "middle_right": WheelMount(x=0.0, y=-0.6, roller_angle_deg=-45.0),
    }
    return dataclasses.replace(forklift, wheels={**forklift.wheels, **middle})


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("kind", ["forklift", "robot", "six wheels"])
def test_vehicle_follows_its_command_and_wheels_roll_as_equation_28(
    motion: str, kind: str, forklift: VehicleConfiguration, robot: VehicleConfiguration
) -> None:
    configuration = {
        "forklift": forklift,
        "robot": robot,
        "six wheels": six_wheels(forklift),
    }[kind]
    stiff = dataclasses.replace(configuration.tire, vertical_stiffness=1.0e9)
    configuration = dataclasses.replace(configuration, tire=stiff)
    vehicle = Vehicle(configuration)
    n = len(configuration.wheels)
    command = np.array(MOTIONS[motion])
    vehicle.advance(6000, 0.0, np.ones(n), command)
    # Inertia on a curve takes a small steady slip.
    np.testing.assert_allclose(vehicle.twist, command, atol=0.01)
    expected = PlatformKinematics(configuration.wheels).wheel_speeds(vehicle.twist)
    np.testing.assert_allclose(vehicle.wheels["speed"], expected, rtol=0.01, atol=0.03)

    before, angle = vehicle.pose, vehicle.wheels["angle"]
    vehicle.advance(1000, 0.0, np.ones(n), command)
    moved = vehicle.pose - before
    assert moved[2] == pytest.approx(0.5 * command[2], abs=0.005)
    middle = turned(0.5 * command[0], 0.5 * command[1], before[2] + 0.25 * command[2])
    np.testing.assert_allclose(moved[:2], middle, atol=0.01)
    np.testing.assert_allclose(
        vehicle.wheels["angle"] - angle, 0.5 * expected, rtol=0.01, atol=0.02
    )


def test_placed_vehicle_rolls_on_without_any_force(forklift: VehicleConfiguration) -> None:
    for twist in ((10.0, 0.0, 0.0), (0.0, -6.0, 0.0), (3.0, 4.0, 0.0)):
        vehicle = Vehicle(forklift, twist=twist)
        np.testing.assert_allclose(vehicle.slip_velocity, 0.0, atol=1e-12)
        log = advance_logged(vehicle, 2000, 0.0, np.ones(4), twist)
        assert np.max(np.abs(log.wheels["force"])) < 1e-6
        np.testing.assert_allclose(log.trajectory[-1], [*twist, *twist], atol=1e-9)


@pytest.mark.parametrize("calls", [1, 200])
def test_turn_while_translate_keeps_its_direction_in_the_world(
    calls: int, forklift: VehicleConfiguration
) -> None:
    vehicle = Vehicle(forklift, twist=(4.0, 0.0, 1.2))
    for _ in range(calls):
        v = turned(4.0, 0.0, -vehicle.pose[2])
        path = vehicle.advance(
            4000 // calls, 0.0, np.ones(4), [v[0], v[1], 1.2], hold_world_direction=True
        )
    np.testing.assert_allclose(path[-1], [8.0, 0.0, 2.4, 4.0, 0.0, 1.2], atol=0.03)


def test_vehicle_is_where_and_as_fast_as_it_was_placed(forklift: VehicleConfiguration) -> None:
    pose, twist = (1.0, -2.0, 0.7), (3.0, -1.0, 1.5)
    vehicle = Vehicle(forklift, pose=pose, twist=twist)
    np.testing.assert_allclose(vehicle.pose, pose)
    np.testing.assert_allclose(vehicle.twist, twist)
    start = vehicle.advance(0, 0.0, np.ones(4), twist)[0]
    np.testing.assert_allclose(start[:3], pose)
    np.testing.assert_allclose(start[3:], [*turned(3.0, -1.0, 0.7), 1.5])
    np.testing.assert_allclose(vehicle.slip_velocity, 0.0, atol=1e-12)


def momentum_balance(vehicle: Vehicle, log: Log) -> tuple[FloatArray, FloatArray]:
    """Return the changes of momentum (p_x, p_y, L) in a log, and the impulses of the wheels."""
    masses = vehicle.masses
    yaw = log.trajectory[:, 2]
    rate = log.trajectory[:, 5]
    lever = np.array([turned(masses.center[0], masses.center[1], angle) for angle in yaw])
    velocity = log.trajectory[:, 3:5] + rate[:, np.newaxis] * np.column_stack(
        (-lever[:, 1], lever[:, 0])
    )
    gained = np.array(
        [*(masses.mass * (velocity[-1] - velocity[0])), masses.yaw_inertia * (rate[-1] - rate[0])]
    )
    geometry = vehicle.kinematics.geometry
    impulse = np.zeros(3)
    for k, forces in enumerate(log.wheels["force"]):
        angle = 0.5 * (yaw[k] + yaw[k + 1])
        for force, direction, contact in zip(
            forces, geometry.active, geometry.position, strict=True
        ):
            arm = contact - masses.center
            push = turned(force * direction[0], force * direction[1], angle)
            impulse[:2] += push * vehicle.physics_step
            impulse[2] += (
                arm[0] * force * direction[1] - arm[1] * force * direction[0]
            ) * vehicle.physics_step
    return gained, impulse


@pytest.mark.parametrize("wheel", range(4))
def test_a_single_braked_wheel_moves_the_body_as_newton_and_euler_say(
    wheel: int, forklift: VehicleConfiguration
) -> None:
    light = dataclasses.replace(forklift, wheel_inertia=1e-3)
    vehicle = Vehicle(light, pose=(0.0, 0.0, 0.4), twist=(6.0, 1.0, 0.3))
    log = advance_logged(vehicle, 600, 1.0, np.eye(4)[wheel], np.zeros(3))
    gained, impulse = momentum_balance(vehicle, log)
    scale = float(np.linalg.norm(impulse))
    assert scale > 300.0
    np.testing.assert_allclose(gained, impulse, atol=1e-4 * scale)
    # The others only turn their own wheels.
    assert np.max(np.abs(np.delete(log.wheels["force"], wheel, axis=1))) < 0.05 * np.max(
        np.abs(log.wheels["force"])
    )


def test_trajectory_is_the_integral_of_its_velocities(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift, twist=(8.0, 1.0, 0.8))
    path = vehicle.advance(3000, 1.0, np.ones(4), np.zeros(3))
    mean = 0.5 * (path[1:, 3:] + path[:-1, 3:])
    np.testing.assert_allclose(np.diff(path[:, :3], axis=0), 0.0005 * mean, atol=1e-8)
    np.testing.assert_array_equal(path[-1, :3], vehicle.pose)


def test_calls_may_be_split_anywhere(forklift: VehicleConfiguration) -> None:
    whole, parts = (
        Vehicle(forklift, twist=(9.0, 0.0, 0.5)),
        Vehicle(forklift, twist=(9.0, 0.0, 0.5)),
    )
    path = whole.advance(900, 1.0, np.ones(4), np.zeros(3))
    pieces = [parts.advance(n, 1.0, np.ones(4), np.zeros(3)) for n in (1, 299, 0, 600)]
    np.testing.assert_array_equal(path[1:], np.concatenate([piece[1:] for piece in pieces]))
    np.testing.assert_array_equal(whole.wheels["speed"], parts.wheels["speed"])
    assert parts.advance(0, 1.0, np.ones(4), np.zeros(3)).shape == (1, 6)


def test_mirrored_vehicle_moves_in_a_mirror(forklift: VehicleConfiguration) -> None:
    def mirror(mass: MassConfiguration) -> MassConfiguration:
        return dataclasses.replace(mass, y=-mass.y)

    mirrored = dataclasses.replace(
        forklift,
        body=mirror(forklift.body),
        load=mirror(forklift.load),
        wheels={
            name: dataclasses.replace(mount, y=-mount.y, roller_angle_deg=-mount.roller_angle_deg)
            for name, mount in forklift.wheels.items()
        },
    )
    one = Vehicle(forklift, twist=(9.0, 1.0, 0.5)).advance(4000, 1.0, np.ones(4), np.zeros(3))
    other = Vehicle(mirrored, twist=(9.0, -1.0, -0.5)).advance(4000, 1.0, np.ones(4), np.zeros(3))
    flip = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    np.testing.assert_allclose(other, one * flip, atol=1e-6)
    assert abs(one[-1, 2]) > 0.1


def test_world_frame_may_be_turned_and_moved(forklift: VehicleConfiguration) -> None:
    twist = (9.0, 1.0, 0.5)
    one = Vehicle(forklift, twist=twist).advance(4000, 1.0, np.ones(4), np.zeros(3))
    other = Vehicle(forklift, pose=(3.0, -2.0, 2.0), twist=twist).advance(
        4000, 1.0, np.ones(4), np.zeros(3)
    )
    for a, b in zip(one[::200], other[::200], strict=True):
        np.testing.assert_allclose(
            b[:2], turned(a[0], a[1], 2.0) + np.array([3.0, -2.0]), atol=1e-6
        )
        np.testing.assert_allclose(b[3:5], turned(a[3], a[4], 2.0), atol=1e-6)
        assert b[2] == pytest.approx(a[2] + 2.0, abs=1e-6)


def test_braking_shifts_load_to_the_front(forklift: VehicleConfiguration) -> None:
    even = dataclasses.replace(forklift, load=MassConfiguration(mass=0.0, height=0.0))
    vehicle = Vehicle(even, twist=(10.0, 0.0, 0.0))
    log = advance_logged(vehicle, 2000, 1.0, np.ones(4), np.zeros(3))
    masses = vehicle.masses
    np.testing.assert_allclose(log.wheels["load"].sum(axis=1), masses.mass * GRAVITY)
    deceleration = -np.diff(log.trajectory[1500:, 3]).mean() / 0.0005
    assert deceleration > 5.0
    base = forklift.wheels["front_left"].x - forklift.wheels["rear_left"].x
    transfer = masses.mass * deceleration * masses.height / base  # m a h / L
    front, rear = log.wheels["load"][-1, [1, 2]].sum(), log.wheels["load"][-1, [0, 3]].sum()
    assert front - rear == pytest.approx(2.0 * transfer, rel=0.01)
    # Evenly loaded, it stays on its line.
    np.testing.assert_allclose(log.trajectory[:, [1, 2]], 0.0, atol=1e-6)


def test_wheels_on_ice_have_the_grip_of_ice(forklift: VehicleConfiguration) -> None:
    even = dataclasses.replace(forklift, load=MassConfiguration(mass=0.0, height=0.0))
    left = FrictionPatch(x=0.0, y=5.0, length=100.0, width=10.0, friction=0.25)
    vehicle = Vehicle(even, FrictionMap(1.0, {"ice": left}), twist=(5.0, 0.0, 0.0))
    log = advance_logged(vehicle, 1, 1.0, np.ones(4), np.zeros(3))
    np.testing.assert_allclose(log.wheels["limit"][0, :2], 0.25 * log.wheels["limit"][0, 2:])
    log = advance_logged(vehicle, 800, 1.0, np.ones(4), np.zeros(3))
    assert abs(log.trajectory[-1, 2]) > 0.05
    assert np.all(np.abs(log.wheels["force"]) <= log.wheels["limit"])


def test_overload_is_reported_and_its_force_not_extrapolated(
    forklift: VehicleConfiguration,
) -> None:
    heavy = dataclasses.replace(forklift, load=dataclasses.replace(forklift.load, mass=900.0))
    vehicle = Vehicle(heavy, twist=(8.0, 0.0, 0.0))
    log = advance_logged(vehicle, 1000, 1.0, np.ones(4), np.zeros(3))
    assert np.max(log.wheels["load"]) > 6000.0
    assert vehicle.overloaded_steps == np.sum(log.wheels["load"] > 6000.0)
    assert np.max(log.wheels["limit"]) == pytest.approx(4500.0)


def test_tall_load_tips_and_says_so(forklift: VehicleConfiguration) -> None:
    tall = dataclasses.replace(forklift, load=dataclasses.replace(forklift.load, height=8.0))
    vehicle = Vehicle(tall, twist=(8.0, 0.0, 0.0))
    log = advance_logged(vehicle, 1000, 1.0, np.ones(4), np.zeros(3))
    assert vehicle.tipping
    assert vehicle.tipping_steps > 0
    assert np.all(log.wheels["load"] >= 0.0)
    np.testing.assert_allclose(log.wheels["load"].sum(axis=1), vehicle.masses.mass * GRAVITY)
    assert np.all(np.isfinite(log.trajectory))


@pytest.mark.parametrize(
    ("pedal", "enable", "command"),
    [
        (1.2, np.ones(4), np.zeros(3)),
        (-0.1, np.ones(4), np.zeros(3)),
        (math.nan, np.ones(4), np.zeros(3)),
        (1.0, np.ones(3), np.zeros(3)),
        (1.0, [1.0, 1.0, 1.0, 1.5], np.zeros(3)),
        (0.0, [1.0, -1.0, 1.0, 1.0], np.zeros(3)),
        (1.0, [1.0, math.nan, 1.0, 1.0], np.zeros(3)),
        (0.0, np.ones(4), [math.inf, 0.0, 0.0]),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(
    pedal: float, enable: FloatArray, command: FloatArray, forklift: VehicleConfiguration
) -> None:
    vehicle = Vehicle(forklift, twist=(1.0, 0.0, 0.0))
    with pytest.raises(VehicleInputError):
        vehicle.advance(10, pedal, enable, command)
    np.testing.assert_array_equal(vehicle.pose, np.zeros(3))
