"""Vehicles on slopes, hills and waves: closed forms, conserved energy, contact of the wheels."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logged_steps import advance_logged, kinetic_energy
from numpy.typing import NDArray
from reference_equations import wheel_contacts

from omni_core.configuration import from_mapping
from omni_core.quantities import GRAVITY
from omni_sim.configuration import (
    GroundConfiguration,
    SimulationConfiguration,
    SimulatorConfiguration,
)
from omni_sim.ground.configuration import (
    BumpConfiguration,
    ElevationConfiguration,
    WaveConfiguration,
)
from omni_sim.messages import ground_truth
from omni_sim.simulator import Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.uneven_ground import frame_turn, level, orientation
from omni_sim.vehicle.vehicle import Vehicle

ON, OFF, NO_COMMAND = np.ones(4), np.zeros(4), np.zeros(3)
TILTS = st.floats(-0.4, 0.4)


def slope(grade: float, uphill_deg: float) -> ElevationConfiguration:
    return ElevationConfiguration(grade=grade, uphill_deg=uphill_deg)


def light_wheels(forklift: VehicleConfiguration) -> VehicleConfiguration:
    return dataclasses.replace(forklift, wheel_inertia=1e-3)


def velocity(vehicle: Vehicle) -> NDArray[np.float64]:
    """Return the velocity of the center of gravity along the ground in the world [m/s], (2,)."""
    body = vehicle.state.body[0]
    return np.array([body["v_x"], body["v_y"]])


def lean(a: float, b: float, yaw: float) -> NDArray[np.float64]:
    """Return the rotation from body to world on a plane with the unit normal (a, b, c)."""
    c = math.sqrt(1.0 - a * a - b * b)
    forward = -(a * math.cos(yaw) + b * math.sin(yaw)) / c
    left = (a * math.sin(yaw) - b * math.cos(yaw)) / c
    return orientation(yaw, forward, left)


@given(TILTS, TILTS, st.floats(-3.0, 3.0))
def test_level_components_are_those_of_the_rotated_vector(a: float, b: float, yaw: float) -> None:
    turn = lean(a, b, yaw)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turn[:, 2], [a, b, math.sqrt(1.0 - a * a - b * b)], atol=1e-12)
    along = level(a, b, 0.3 * math.cos(yaw), 0.3 * math.sin(yaw))
    np.testing.assert_allclose(along, turn[:2] @ [0.3, 0.0, 0.0], atol=1e-12)


@given(TILTS, TILTS, TILTS, TILTS)
def test_directions_carried_along_do_not_spin_about_the_normal(
    a: float, b: float, c: float, d: float
) -> None:
    step = 1e-5
    before, after = lean(a, b, 0.0), lean(a + c * step, b + d * step, 0.0)
    spin = (before.T @ after)[1, 0]  # of the frame about its own normal
    turned = frame_turn(a, b, a + c * step, b + d * step)
    assert turned == pytest.approx(-spin, abs=1e-9)


@pytest.mark.parametrize("heading_deg", [0.0, 33.0, 90.0, 200.0])
def test_vehicle_coasts_down_an_incline_as_its_inertia_allows(
    heading_deg: float, forklift: VehicleConfiguration
) -> None:
    heading = math.radians(heading_deg)
    central = dataclasses.replace(forklift, load=dataclasses.replace(forklift.load, x=0.0, y=0.0))
    vehicle = Vehicle(central, pose=(1.0, 2.0, heading), elevation=slope(0.1, heading_deg - 180.0))
    path = vehicle.advance(2000, 1.0, OFF, NO_COMMAND)
    angle, mass = math.atan(0.1), vehicle.masses.mass
    radius = 0.2 - float(np.mean(vehicle.wheels["load"])) / forklift.tire.vertical_stiffness
    inertia = mass + 4.0 * forklift.wheel_inertia / radius**2
    acceleration = mass * GRAVITY * math.sin(angle) / inertia
    assert vehicle.twist[0] == pytest.approx(acceleration, rel=0.002)
    assert abs(vehicle.twist[1]) < 1e-9
    level_path = math.hypot(path[-1, 0] - 1.0, path[-1, 1] - 2.0)
    assert level_path == pytest.approx(0.5 * acceleration * math.cos(angle), rel=0.004)
    assert vehicle.wheels["load"].sum() == pytest.approx(mass * GRAVITY * math.cos(angle))


def test_vehicle_coasts_down_sideways_too(forklift: VehicleConfiguration) -> None:
    light = light_wheels(forklift)
    central = dataclasses.replace(light, load=dataclasses.replace(light.load, x=0.0, y=0.0))
    vehicle = Vehicle(central, elevation=slope(0.05, 270.0))
    vehicle.advance(2000, 1.0, OFF, NO_COMMAND)
    expected = GRAVITY * math.sin(math.atan(0.05))
    np.testing.assert_allclose(vehicle.twist, [0.0, expected, 0.0], atol=2e-3 * expected)


@pytest.mark.parametrize("uphill_deg", [0.0, 45.0, 90.0, 200.0])
def test_vehicle_parked_on_an_incline_does_not_creep(
    uphill_deg: float, forklift: VehicleConfiguration
) -> None:
    vehicle = Vehicle(forklift, elevation=slope(0.05, uphill_deg))
    vehicle.advance(8000, 1.0, ON, NO_COMMAND)  # the tires give way by 1 to 2 mm
    settled = vehicle.pose
    vehicle.advance(120_000, 1.0, ON, NO_COMMAND)
    assert np.max(np.abs(vehicle.pose - settled)) < 1e-5
    # Downhill wheels carry more: the weight acts at the height of the center of gravity.
    angle, masses = math.atan(0.05), vehicle.masses
    uphill = np.array([math.cos(math.radians(uphill_deg)), math.sin(math.radians(uphill_deg))])
    lever = vehicle.kinematics.geometry.position - masses.center
    moment = -masses.height * masses.mass * GRAVITY * math.sin(angle) * uphill
    np.testing.assert_allclose(vehicle.wheels["load"] @ lever, moment, atol=0.5)


def test_braked_vehicle_stops_sooner_uphill(forklift: VehicleConfiguration) -> None:
    paths = []
    for uphill_deg in (0.0, 90.0, 180.0):
        vehicle = Vehicle(forklift, twist=(3.0, 0.0, 0.0), elevation=slope(0.1, uphill_deg))
        vehicle.advance(4000, 1.0, ON, NO_COMMAND)
        assert np.max(np.abs(vehicle.twist)) < 1e-3
        paths.append(vehicle.pose[0])
    assert paths[0] < 0.95 * paths[1] < 0.9 * paths[2]


def test_ground_of_no_height_is_flat(forklift: VehicleConfiguration) -> None:
    calm = ElevationConfiguration(waves={"calm": WaveConfiguration(amplitude=0.0, length=3.0)})
    paths = []
    for ground in (None, calm):
        vehicle = Vehicle(forklift, twist=(8.0, 1.0, 0.5), elevation=ground)
        paths.append(vehicle.advance(3000, 1.0, [1.0, 0.0, 1.0, 1.0], NO_COMMAND))
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-9)


def over_the_hill(
    forklift: VehicleConfiguration, step: float, distance: float
) -> tuple[float, float, float]:
    """Turn across a hill; return initial energy, its final and its largest change [J]."""
    hill = BumpConfiguration(x=6.0, y=0.7, height=0.35, radius=4.0)
    ground = ElevationConfiguration(bumps={"hill": hill}, sampling_distance=distance)
    vehicle = Vehicle(
        light_wheels(forklift),
        physics_step=step,
        pose=(0.0, 0.0, 0.3),
        twist=(4.0, 0.0, 0.4),
        elevation=ground,
    )
    assert vehicle.attitude[0] == 0.0
    start = kinetic_energy(vehicle)
    log = advance_logged(vehicle, round(3.2 / step), 1.0, OFF, NO_COMMAND)
    assert np.max(log.energy[:, 4]) > 2000.0
    assert log.energy[-1, 4] == pytest.approx(0.0, abs=1e-9)  # on the flat again
    total = log.energy.sum(axis=1)
    return start, float(total[-1] - start), float(np.max(np.abs(total - start)))


def test_energy_is_conserved_over_a_hill(forklift: VehicleConfiguration) -> None:
    # A plane of four points 0.1 m apart is no exact derivative of the ground.
    for distance, share in ((0.05, 5e-5), (1e-3, 2e-6)):
        start, gain, most = over_the_hill(forklift, 2.5e-4, distance)
        assert abs(gain) < share * start
        assert most < 1e-4 * start
    gains = [over_the_hill(forklift, step, 1e-3)[1] for step in (2e-3, 1e-3, 5e-4)]
    assert abs(gains[2] - gains[1]) < 0.7 * abs(gains[1] - gains[0])


def test_speed_on_the_crest_and_its_load_are_those_of_a_point_mass(
    forklift: VehicleConfiguration,
) -> None:
    # A long wave, so that the four wheels see nearly the same curvature.
    wave = WaveConfiguration(amplitude=1.0, length=40.0, phase_deg=-90.0)
    bend = (2.0 * math.pi / 40.0) ** 2
    vehicle = Vehicle(
        light_wheels(forklift),
        twist=(9.0, 0.0, 0.0),
        elevation=ElevationConfiguration(waves={"long": wave}),
    )
    mass = vehicle.masses.mass
    vehicle.advance(2, 1.0, OFF, NO_COMMAND)
    assert vehicle.wheels["load"].sum() == pytest.approx(mass * (GRAVITY + bend * 9.0**2), rel=0.01)
    while velocity(vehicle)[0] > 0.0 and vehicle.pose[0] < 20.0 - 0.13:
        vehicle.advance(10, 1.0, OFF, NO_COMMAND)
    crest = math.sqrt(9.0**2 - 4.0 * GRAVITY)
    assert velocity(vehicle)[0] == pytest.approx(crest, rel=0.004)
    assert vehicle.wheels["load"].sum() == pytest.approx(
        mass * (GRAVITY - bend * crest**2), rel=0.01
    )
    assert vehicle.tipping_steps == 0


def test_vehicle_that_would_take_off_is_reported(forklift: VehicleConfiguration) -> None:
    wave = WaveConfiguration(amplitude=0.3, length=8.0, phase_deg=90.0)  # 0.19 1/m on its crest
    vehicle = Vehicle(
        forklift,
        twist=(10.0, 0.0, 0.0),
        elevation=ElevationConfiguration(waves={"ramp": wave}),
    )
    log = advance_logged(vehicle, 200, 1.0, ON, NO_COMMAND)
    assert vehicle.tipping
    assert np.all(log.wheels["load"] >= 0.0)
    assert np.any(np.all(log.wheels["load"] == 0.0, axis=1))
    assert np.all(np.isfinite(log.trajectory))


@pytest.mark.parametrize(
    ("heading_deg", "roll", "pitch"),
    [(0.0, 0.0, -1.0), (180.0, 0.0, 1.0), (90.0, -1.0, 0.0), (-90.0, 1.0, 0.0)],
)
def test_vehicle_pitches_and_rolls_with_the_incline(
    heading_deg: float, roll: float, pitch: float, forklift: VehicleConfiguration
) -> None:
    # REP-103: the nose goes up with negative pitch, the left side with positive roll.
    vehicle = Vehicle(
        forklift, pose=(4.0, 1.0, math.radians(heading_deg)), elevation=slope(0.2, 0.0)
    )
    angle = math.atan(0.2)
    np.testing.assert_allclose(vehicle.attitude, [0.8, roll * angle, pitch * angle], atol=1e-12)
    np.testing.assert_allclose(vehicle.pose, [4.0, 1.0, math.radians(heading_deg)], atol=1e-12)
    assert vehicle.energies.height > 0.8 * vehicle.masses.mass * GRAVITY * 0.8


def test_wheels_on_an_incline_stand_upright_on_it(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift, pose=(1.0, -2.0, 0.6), elevation=slope(0.2, 70.0))
    normal = np.array([-0.2 * math.cos(math.radians(70)), -0.2 * math.sin(math.radians(70)), 1.0])
    points = np.array([contact.point for contact in wheel_contacts(vehicle)])
    for contact, load in zip(wheel_contacts(vehicle), vehicle.wheels["load"], strict=True):
        np.testing.assert_allclose(contact.normal, normal / np.linalg.norm(normal), atol=1e-9)
        np.testing.assert_allclose(contact.radial, contact.normal, atol=1e-9)
        assert contact.camber == pytest.approx(0.0, abs=1e-9)
        assert contact.point @ normal == pytest.approx(0.0, abs=1e-9)
        deflection = load / forklift.tire.vertical_stiffness
        assert contact.static_radius == pytest.approx(0.2 - deflection)
    # The wheels are as far apart on the slope as on the flat.
    position = vehicle.kinematics.geometry.position
    for i in range(4):
        for j in range(i):
            apart = np.linalg.norm(points[i] - points[j])
            assert apart == pytest.approx(np.linalg.norm(position[i] - position[j]))


def test_wheels_on_a_ridge_have_the_camber_of_its_flanks(forklift: VehicleConfiguration) -> None:
    ridge = WaveConfiguration(amplitude=0.1, length=10.0, direction_deg=90.0, phase_deg=90.0)
    vehicle = Vehicle(forklift, elevation=ElevationConfiguration(waves={"ridge": ridge}))
    number = 2.0 * math.pi / 10.0
    flank = math.atan(0.1 * number * math.sin(number * 0.5))
    for contact, y in zip(wheel_contacts(vehicle), (0.5, 0.5, -0.5, -0.5), strict=True):
        assert contact.camber == pytest.approx(math.copysign(flank, y), rel=0.01)
        np.testing.assert_allclose(contact.longitudinal, [1.0, 0.0, 0.0], atol=1e-9)


def test_ground_configuration_makes_a_slope() -> None:
    assert len(GroundConfiguration().elevation.table()) == 0
    ground = from_mapping(
        GroundConfiguration,
        {
            "elevation": {
                "grade": 0.05,
                "uphill_deg": 90.0,
                "bumps": {"sill": {"x": 3.0, "y": 0.0, "height": 0.02, "radius": 0.3}},
            }
        },
    )
    assert ground.elevation.table().shape == (2, 5)


def test_simulated_vehicle_starts_level_or_leaning_as_its_ground(
    forklift: VehicleConfiguration,
) -> None:
    for uphill_deg in (0.0, 120.0):
        configuration = SimulatorConfiguration(
            vehicle=forklift,
            ground=GroundConfiguration(elevation=slope(0.1, uphill_deg)),
            sensors={},
            simulation=SimulationConfiguration(render_lines=False),
        )
        simulator = Simulator(configuration)
        simulator.advance(ON)
        observation = simulator.observe()
        message = ground_truth(observation)
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        up = np.array([math.cos(math.radians(uphill_deg)), math.sin(math.radians(uphill_deg))])
        assert place.z == pytest.approx(0.1 * float(observation.pose[:2] @ up))
        # The vehicle's z axis by the quaternion is the normal of the slope.
        axis = [
            2.0 * (turn.x * turn.z + turn.w * turn.y),
            2.0 * (turn.y * turn.z - turn.w * turn.x),
            1.0 - 2.0 * (turn.x**2 + turn.y**2),
        ]
        normal = np.array([*(-0.1 * up), 1.0]) / math.hypot(0.1, 1.0)
        np.testing.assert_allclose(axis, normal, atol=1e-9)
        assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(float(observation.pose[2]))
