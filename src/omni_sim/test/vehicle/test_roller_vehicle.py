"""Vehicles whose contacts follow the rollers: with free rollers, and with the single roller."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from logged_steps import advance_logged, kinetic_energy
from reference_equations import wheel_rate

from omni_core.configuration import ConfigurationError
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.configuration import SimulationConfiguration, SimulatorConfiguration
from omni_sim.simulator import Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle, VehicleInputError
from omni_sim.wheel.roller_geometry import RollerConfiguration

NO_COMMAND = np.zeros(3)
MINUTE = 120_000
KINDS: dict[str, dict[str, Any]] = {
    "rollers": {"wheel_model": "rollers"},
    "roller contact": {"contact": "roller"},
}


@pytest.fixture(params=KINDS)
def moving_contact(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Overrides with which the contacts of a vehicle move."""
    return KINDS[request.param]


@pytest.fixture(params=["mecanum", "three wheels"])
def platform(
    request: pytest.FixtureRequest, forklift: VehicleConfiguration, robot: VehicleConfiguration
) -> VehicleConfiguration:
    """Each of the two platforms."""
    return forklift if request.param == "mecanum" else robot


def phases(n: int) -> FloatArray:
    # Where one roller alone carries each wheel: two cannot roll without slip at once.
    return np.linspace(0.03, 0.22, n)


def velocity(vehicle: Vehicle) -> FloatArray:
    """Return the velocity of the center of gravity along the ground in the world [m/s], (2,)."""
    body = vehicle.state.body[0]
    return np.array([body["v_x"], body["v_y"]])


def full(vehicle: Vehicle) -> FloatArray:
    return np.ones(len(vehicle.wheel_names))


def braked(configuration: VehicleConfiguration, twist: Any, **options: Any) -> Vehicle:
    """Return a vehicle after three seconds of full braking."""
    vehicle = Vehicle(configuration, twist=twist, **options)
    steps = round(3.0 / vehicle.physics_step)
    vehicle.advance(steps, 1.0, full(vehicle), NO_COMMAND)
    return vehicle


def test_configuration_chooses_the_wheel(forklift: VehicleConfiguration) -> None:
    rollers = Vehicle(dataclasses.replace(forklift, wheel_model="rollers"))
    assert rollers.rollers.shape == (4, forklift.rollers.count)
    with pytest.raises(VehicleInputError, match="no individual rollers"):
        _ = Vehicle(forklift).rollers


@pytest.mark.parametrize("angle", [math.nan, [0.0, 0.1], [0.0, 0.0, 0.0, math.inf]])
def test_bad_wheel_angles_are_refused(angle: Any, forklift: VehicleConfiguration) -> None:
    with pytest.raises(VehicleInputError, match="wheel angle"):
        Vehicle(forklift, wheel_angle=angle)


@pytest.mark.parametrize("radius", [0.005, 0.25])
def test_rollers_that_do_not_fit_are_refused(radius: float, forklift: VehicleConfiguration) -> None:
    rollers = RollerConfiguration(radius=radius)
    assert dataclasses.replace(forklift, rollers=rollers).contact == "ideal"
    for change in KINDS.values():
        with pytest.raises(ConfigurationError, match=r"rollers\.radius.*rear_left"):
            dataclasses.replace(forklift, rollers=rollers, **change)


def test_placed_vehicle_rolls_as_equation_16(
    moving_contact: dict[str, Any], platform: VehicleConfiguration
) -> None:
    configuration = dataclasses.replace(platform, **moving_contact)
    n = len(platform.wheels)
    twist = np.array([1.0, 0.4, 0.3])
    vehicle = Vehicle(configuration, twist=twist, wheel_angle=phases(n))
    squeeze = vehicle.wheels["load"] / platform.tire.vertical_stiffness
    rates = [
        wheel_rate(
            dataclasses.replace(geometry, radius=geometry.radius - deflected),
            float(geometry.roller_angle(angle)),
            twist,
        )
        for geometry, angle, deflected in zip(
            configuration.roller_geometries, phases(n), squeeze, strict=True
        )
    ]
    np.testing.assert_allclose(vehicle.wheels["speed"], rates, rtol=1e-12)
    if configuration.contact == "roller":
        np.testing.assert_allclose(vehicle.slip_velocity, 0.0, atol=1e-12)
    # Nothing slides, so a first step finds hardly any force; the grip is some 3000 N.
    vehicle.advance(1, 0.05, np.zeros(n), NO_COMMAND)
    assert np.max(np.abs(vehicle.wheel_force_body)) < 5.0


def test_driving_straight_turns_no_roller_of_a_mecanum_wheel(
    forklift: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(dataclasses.replace(forklift, wheel_model="rollers"), twist=(3.0, 0.0, 0.0))
    np.testing.assert_allclose(vehicle.rollers["spin"], 0.0, atol=1e-12)
    log = advance_logged(vehicle, 2000, 0.0, full(vehicle), (3.0, 0.0, 0.0))
    # The loads follow the contacts along the rollers, and the rolling radii follow the loads.
    assert np.max(np.abs(log.wheels["force"])) < 0.01 * vehicle.masses.mass * GRAVITY / 4.0
    np.testing.assert_allclose(log.trajectory[-1, :3], [3.0, 0.0, 0.0], atol=1e-3)


def test_contact_of_an_unturned_wheel_is_the_ideal_one(forklift: VehicleConfiguration) -> None:
    # A locked wheel stays on one roller, whose force in the lowest position is the ideal one.
    moving = dataclasses.replace(forklift, contact="roller")
    ideal, roller = Vehicle(forklift), Vehicle(moving)
    for vehicle in (ideal, roller):
        vehicle.push((0.0, 9000.0))
        vehicle.advance(2000, 1.0, full(vehicle), NO_COMMAND)
    np.testing.assert_allclose(roller.pose, ideal.pose, atol=1e-4)
    assert ideal.pose[1] > 0.05


def test_forces_move_the_body_as_newton_says_and_stay_in_their_limits(
    moving_contact: dict[str, Any], forklift: VehicleConfiguration
) -> None:
    vehicle = Vehicle(
        dataclasses.replace(forklift, **moving_contact), twist=(3.0, 1.5, 0.8), wheel_angle=0.2
    )
    mass, dt = vehicle.masses.mass, vehicle.physics_step
    for _ in range(300):
        before, yaw = velocity(vehicle), vehicle.pose[2]
        vehicle.advance(1, 1.0, full(vehicle), NO_COMMAND)
        force = vehicle.wheel_force_body.sum(axis=0)
        middle = 0.5 * (yaw + vehicle.pose[2])
        cos, sin = math.cos(middle), math.sin(middle)
        turned = np.array([cos * force[0] - sin * force[1], sin * force[0] + cos * force[1]])
        gained = mass * (velocity(vehicle) - before)
        np.testing.assert_allclose(gained, dt * turned, atol=1e-3 * mass * dt)
        pushes = np.linalg.norm(vehicle.wheel_force_body, axis=1)
        assert np.all(pushes <= vehicle.wheels["limit"] * (1.0 + 1e-9))
        if vehicle.configuration.wheel_model == "rollers":
            rollers = vehicle.rollers
            each = np.hypot(rollers["f_a"], rollers["f_p"])
            assert np.all(each <= rollers["limit"] * (1.0 + 1e-9))
            np.testing.assert_allclose(rollers["load"].sum(axis=1), vehicle.wheels["load"])


@pytest.mark.parametrize("twist", [(4.0, 0.0, 0.0), (0.0, 3.0, 0.0), (2.0, -1.0, 1.5)])
def test_braking_adds_no_energy(
    twist: tuple[float, float, float],
    moving_contact: dict[str, Any],
    platform: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(dataclasses.replace(platform, **moving_contact), twist=twist)
    start = kinetic_energy(vehicle) + vehicle.energies.elastic
    log = advance_logged(vehicle, 4000, 1.0, full(vehicle), NO_COMMAND)
    energy = np.concatenate(([start], log.energy.sum(axis=1)))
    assert energy[-1] == pytest.approx(kinetic_energy(vehicle) + vehicle.energies.elastic)
    assert np.max(np.diff(energy)) < 1e-3 * start
    assert np.max(energy) <= start * (1.0 + 1e-9)


def test_mirrored_vehicle_moves_in_a_mirror(
    moving_contact: dict[str, Any], forklift: VehicleConfiguration
) -> None:
    def mirrored(configuration: VehicleConfiguration) -> VehicleConfiguration:
        return dataclasses.replace(
            configuration,
            load=dataclasses.replace(configuration.load, y=-configuration.load.y),
            wheels={
                name: dataclasses.replace(
                    mount, y=-mount.y, roller_angle_deg=-mount.roller_angle_deg
                )
                for name, mount in configuration.wheels.items()
            },
        )

    one = dataclasses.replace(forklift, **moving_contact)
    path = Vehicle(one, twist=(4.0, 1.0, 0.5)).advance(2000, 1.0, np.ones(4), NO_COMMAND)
    other = Vehicle(mirrored(one), twist=(4.0, -1.0, -0.5)).advance(
        2000, 1.0, np.ones(4), NO_COMMAND
    )
    np.testing.assert_allclose(other, path * [1.0, -1.0, -1.0, 1.0, -1.0, -1.0], atol=1e-6)


def test_calls_may_be_split_anywhere(
    moving_contact: dict[str, Any], forklift: VehicleConfiguration
) -> None:
    configuration = dataclasses.replace(forklift, **moving_contact)
    whole, parts = (Vehicle(configuration, twist=(5.0, 0.0, 0.5)) for _ in range(2))
    path = whole.advance(600, 0.3, np.ones(4), NO_COMMAND)
    pieces = [parts.advance(n, 0.3, np.ones(4), NO_COMMAND) for n in (1, 199, 0, 400)]
    np.testing.assert_array_equal(path[1:], np.concatenate([piece[1:] for piece in pieces]))


@pytest.mark.parametrize("twist", [(5.0, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 3.0, 0.0)])
def test_halving_the_step_hardly_changes_the_stopping_distance(
    twist: tuple[float, float, float],
    moving_contact: dict[str, Any],
    platform: VehicleConfiguration,
) -> None:
    configuration = dataclasses.replace(platform, **moving_contact)
    coarse, fine = (
        float(np.linalg.norm(braked(configuration, twist, physics_step=step).pose[:2]))
        for step in (0.0005, 0.00025)
    )
    assert coarse == pytest.approx(fine, rel=0.01)


@pytest.mark.parametrize("direction_deg", [0.0, 90.0, 200.0])
def test_parked_vehicle_does_not_creep_on_a_slope_whatever_roller_it_stands_on(
    direction_deg: float, moving_contact: dict[str, Any], platform: VehicleConfiguration
) -> None:
    half_pitch = math.pi / 12.0
    vehicle = Vehicle(
        dataclasses.replace(platform, **moving_contact),
        wheel_angle=np.linspace(0.0, half_pitch, len(platform.wheels)),
    )
    angle = math.radians(direction_deg)
    weight = vehicle.masses.mass * GRAVITY
    vehicle.push(0.05 * weight * np.array([math.cos(angle), math.sin(angle)]))
    vehicle.advance(8000, 1.0, full(vehicle), NO_COMMAND)  # the tires give way a little
    settled = vehicle.pose
    vehicle.advance(MINUTE, 1.0, full(vehicle), NO_COMMAND)
    assert np.max(np.abs(vehicle.pose - settled)) < 1e-5


def test_stopped_vehicle_stays_stopped(
    moving_contact: dict[str, Any], platform: VehicleConfiguration
) -> None:
    vehicle = braked(dataclasses.replace(platform, **moving_contact), (2.0, 3.0, 0.5))
    vehicle.advance(2000, 1.0, full(vehicle), NO_COMMAND)
    stopped = vehicle.pose
    path = vehicle.advance(MINUTE // 2, 1.0, full(vehicle), NO_COMMAND)
    assert np.max(np.abs(path[:, :3] - stopped)) < 1e-5


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, -0.6, 0.0)])
def test_speed_passes_smoothly_through_zero(
    direction: tuple[float, float, float],
    moving_contact: dict[str, Any],
    platform: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(dataclasses.replace(platform, **moving_contact))
    forces, speeds, commands = [], [], []
    for k in range(500):
        amplitude = 0.5 * math.sin(2.0 * math.pi * k * 0.01 / 4.0)
        log = advance_logged(vehicle, 20, 0.0, full(vehicle), amplitude * np.array(direction))
        forces.append(log.wheels["force"])
        speeds.append(vehicle.twist @ np.array(direction))
        commands.append(amplitude * np.dot(direction, direction))
    np.testing.assert_allclose(speeds[100:], commands[100:], atol=0.04)
    # A tire that chattered would jump by its grip of 3000 N.
    assert np.max(np.abs(np.diff(np.concatenate(forces)[2000:], axis=0))) < 150.0


@pytest.mark.parametrize("rollers", [12, 24])
def test_rollers_agree_with_the_single_roller_in_the_mean(
    rollers: int, platform: VehicleConfiguration
) -> None:
    individual = dataclasses.replace(
        platform, wheel_model="rollers", rollers=RollerConfiguration(count=rollers)
    )
    random = np.random.default_rng(rollers)
    for twist in ((4.0, 0.0, 0.0), (0.0, 3.0, 0.0)):
        single = np.linalg.norm(braked(platform, twist).pose[:2])
        stops = [
            np.linalg.norm(
                braked(
                    individual, twist, wheel_angle=random.uniform(0.0, 1.0, len(platform.wheels))
                ).pose[:2]
            )
            for _ in range(8)
        ]
        assert np.mean(stops) == pytest.approx(single, rel=0.05)


def test_what_is_left_of_a_sideways_push_is_the_inertia_of_the_rollers(
    forklift: VehicleConfiguration,
) -> None:
    # At 45 deg a wheel turns with v_y / R, and its rollers with sqrt(2) v_y over their radius.
    single = Vehicle(forklift)
    light = RollerConfiguration(inertia=1.0e-6)
    individual = Vehicle(dataclasses.replace(forklift, wheel_model="rollers", rollers=light))
    for vehicle in (single, individual):
        vehicle.push((0.0, 0.15 * vehicle.masses.mass * GRAVITY))
        vehicle.advance(4000, 0.1, np.zeros(4), NO_COMMAND)
    assert individual.pose[1] == pytest.approx(single.pose[1], rel=0.003)


def test_simulator_runs_on_individual_rollers(forklift: VehicleConfiguration) -> None:
    simulator = Simulator(
        SimulatorConfiguration(
            vehicle=dataclasses.replace(forklift, wheel_model="rollers"),
            sensors={},
            simulation=SimulationConfiguration(render_lines=False),
        )
    )
    assert simulator.vehicle.configuration.wheel_model == "rollers"
    for _ in range(20):
        simulator.advance(np.ones(4))
    observation = simulator.observe()
    assert observation.stamp_ns == 200_000_000
    np.testing.assert_array_equal(observation.wheel_force_body, simulator.vehicle.wheel_force_body)


@pytest.mark.parametrize("model", ["tmeasy", "linear"])  # each compiles; the rest: a roller alone
def test_any_tire_makes_rollers_that_agree_with_the_single_roller(
    model: str, platform: VehicleConfiguration
) -> None:
    tire = dataclasses.replace(platform.tire, model=model)
    single = dataclasses.replace(platform, tire=tire)
    individual = dataclasses.replace(single, wheel_model="rollers")
    stops = [
        float(np.linalg.norm(braked(configuration, (4.0, 0.0, 0.0), physics_step=step).pose[:2]))
        for configuration, step in ((single, 0.0005), (individual, 0.0005), (individual, 0.00025))
    ]
    assert stops[1] == pytest.approx(stops[0], rel=0.05)
    assert stops[1] == pytest.approx(stops[2], rel=0.01)
