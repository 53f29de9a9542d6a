"""Losses along the passive direction: resistance, inertia and rest, in closed form."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logged_steps import advance_logged, kinetic_energy

from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.ground.configuration import ElevationConfiguration
from omni_sim.masses import MassConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.placing import rolling_radius
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.wheel.configuration import PassiveLossConfiguration
from omni_sim.wheel.passive_losses import passive_force

ON, OFF, NO_COMMAND = np.ones(4), np.zeros(4), np.zeros(3)


def losing(vehicle: VehicleConfiguration, losses: PassiveLossConfiguration) -> VehicleConfiguration:
    """Return a vehicle with passive losses and its load in the middle."""
    middle = dataclasses.replace(vehicle.load, x=0.0, y=0.0)
    return dataclasses.replace(vehicle, load=middle, passive_losses=losses)


def roller_speed(vehicle: Vehicle) -> FloatArray:
    """Return the surface speeds ``u_w . v_i - omega r_D (u_w . u_i)`` of rollers [m/s], (N,)."""
    geometry = vehicle.kinematics.geometry
    rim = np.sum(geometry.passive * geometry.rolling, axis=1)
    hub = np.sum(geometry.passive * vehicle.kinematics.wheel_velocities(vehicle.twist), axis=1)
    return np.asarray(hub - vehicle.wheels["speed"] * rolling_radius(vehicle.state) * rim)


def inertia_sideways(vehicle: Vehicle) -> float:
    """Return mass plus inertia of turning wheels of a Mecanum vehicle in sideways motion [kg]."""
    configuration = vehicle.configuration
    radius = 0.2 - float(np.mean(vehicle.wheels["load"])) / configuration.tire.vertical_stiffness
    return vehicle.masses.mass + 4.0 * configuration.wheel_inertia / radius**2


def test_equation_19_grows_with_load_and_section_and_falls_with_diameter() -> None:
    base = PassiveLossConfiguration(elasticity=1e-7, roller_diameter=0.1, section_ratio=0.25)
    load = 3000.0
    assert base.growing_share * load == pytest.approx(1e-7 * 3000.0 / 0.1 * 0.5)
    wider = dataclasses.replace(base, roller_diameter=0.2, section_ratio=1.0)
    assert wider.growing_share == pytest.approx(base.growing_share)


def test_nothing_is_lost_by_default() -> None:
    assert not PassiveLossConfiguration().active
    assert PassiveLossConfiguration(roller_mass=1.0).active


@given(
    coming=st.floats(-3.0, 3.0),
    now=st.floats(-3.0, 3.0),
    mobility=st.floats(1e-8, 1e-4),
    capacity=st.floats(0.0, 500.0),
    inertia=st.floats(0.0, 50.0),
)
def test_force_obeys_coulomb_and_newton_at_the_end_of_the_step(
    coming: float, now: float, mobility: float, capacity: float, inertia: float
) -> None:
    dt = 5e-4
    force = passive_force(coming, now, 0.0, mobility, capacity, inertia, dt)
    speed = coming + mobility * force
    friction = force + inertia * (speed - now) / dt
    slack = 1e-6 * (capacity + inertia / dt + 1.0)
    assert abs(friction) <= capacity + slack
    if abs(speed) > 1e-9:
        assert friction == pytest.approx(-math.copysign(capacity, speed), abs=slack)


def test_vehicle_coasting_sideways_is_slowed_by_its_rollers(forklift: VehicleConfiguration) -> None:
    configuration = losing(
        forklift,
        PassiveLossConfiguration(
            rolling_resistance=0.01, bearing_friction=0.002, elasticity=1e-7, section_ratio=0.64
        ),
    )
    vehicle = Vehicle(configuration, twist=(0.0, 2.0, 0.0))
    vehicle.advance(1000, 1.0, OFF, NO_COMMAND)
    # The rollers of a Mecanum wheel roll sqrt(2) times as fast as it moves sideways.
    np.testing.assert_allclose(
        np.abs(roller_speed(vehicle)), math.sqrt(2.0) * vehicle.twist[1], rtol=1e-3
    )
    load = vehicle.masses.mass * GRAVITY / 4.0
    resistance = 4.0 * (0.012 + 1e-7 * load / 0.08 * 0.8) * load * math.sqrt(2.0)
    slowed = 2.0 - vehicle.twist[1]
    assert slowed == pytest.approx(0.5 * resistance / inertia_sideways(vehicle), rel=0.01)
    assert np.max(np.abs(vehicle.twist[[0, 2]])) < 1e-6


@pytest.mark.parametrize("model", ["single", "rollers"])
def test_resistance_that_grows_with_the_square_of_the_speed_slows_in_closed_form(
    model: str, forklift: VehicleConfiguration
) -> None:
    """From dv/dt = -k v^2 follows v = v_0 / (1 + k v_0 t).

    Sideways, the rollers of a Mecanum wheel roll sqrt(2) times as fast, and each resists by
    f_2 w^2 F_z along them, so the part in the direction of motion is 2 sqrt(2) f_2 v^2 F_z.
    """
    growth, speed = 0.01, 3.0
    configuration = dataclasses.replace(
        losing(forklift, PassiveLossConfiguration(speed_growth=growth)), wheel_model=model
    )
    vehicle = Vehicle(configuration, twist=(0.0, speed, 0.0))
    assert configuration.passive_losses.active
    rate = math.sqrt(8.0) * growth * vehicle.masses.mass * GRAVITY / inertia_sideways(vehicle)
    vehicle.advance(1000, 1.0, OFF, NO_COMMAND)
    expected = speed / (1.0 + rate * speed * 0.5)
    assert expected < 0.75 * speed
    tolerance = 0.005 if model == "single" else 0.05  # the contact moves along each roller
    assert vehicle.twist[1] == pytest.approx(expected, rel=tolerance)


def test_robot_loses_by_what_each_wheel_moves_across(robot: VehicleConfiguration) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.02)
    middle = MassConfiguration(mass=500.0, height=0.1, yaw_inertia=45.0)
    configuration = dataclasses.replace(
        robot, load=middle, passive_losses=losses, wheel_inertia=1e-3
    )
    vehicle = Vehicle(configuration, twist=(1.0, 0.0, 0.0))
    vehicle.advance(400, 1.0, np.zeros(3), NO_COMMAND)
    # Along x one wheel only rolls, and the rollers of the others go at cos(30 deg) of the speed.
    share = 2.0 / 3.0 * math.cos(math.radians(30.0))
    assert 1.0 - vehicle.twist[0] == pytest.approx(0.2 * 0.02 * GRAVITY * share, rel=0.02)


def test_straight_ahead_no_roller_turns_and_nothing_is_lost(
    forklift: VehicleConfiguration,
) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.05, roller_mass=20.0)
    vehicle = Vehicle(losing(forklift, losses), twist=(2.0, 0.0, 0.0))
    vehicle.advance(1000, 1.0, OFF, NO_COMMAND)
    np.testing.assert_allclose(vehicle.twist, [2.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("roller_mass", [5.0, 100.0])
def test_rollers_add_their_inertia_to_the_passive_direction(
    roller_mass: float, forklift: VehicleConfiguration
) -> None:
    accelerated = {}
    for direction in ((1.0, 0.0), (0.0, 1.0)):
        losses = PassiveLossConfiguration(roller_mass=roller_mass)
        vehicle = Vehicle(losing(forklift, losses))
        vehicle.push(500.0 * np.array(direction))
        vehicle.advance(2000, 1.0, OFF, NO_COMMAND)
        accelerated[direction] = 500.0 / float(vehicle.twist[:2] @ direction)
        inertia = inertia_sideways(vehicle)
    assert accelerated[1.0, 0.0] == pytest.approx(inertia, rel=1e-3)
    # Four times m_r / 2 at sqrt(2) times the speed.
    assert accelerated[0.0, 1.0] == pytest.approx(inertia + 4.0 * roller_mass, rel=1e-3)


def test_losses_converge_with_the_step(forklift: VehicleConfiguration) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.02, roller_mass=10.0)
    ends = []
    for step in (1e-3, 5e-4, 2.5e-4):
        vehicle = Vehicle(losing(forklift, losses), physics_step=step, twist=(1.0, 2.0, 0.7))
        vehicle.advance(round(1.0 / step), 1.0, OFF, NO_COMMAND)
        ends.append(vehicle.pose)
    coarse, fine = np.abs(ends[1] - ends[0]), np.abs(ends[2] - ends[1])
    assert np.max(coarse) < 5e-5
    assert np.max(fine) < 0.7 * np.max(coarse)


def test_energy_lost_is_the_work_of_the_losses(forklift: VehicleConfiguration) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.03)
    vehicle = Vehicle(losing(forklift, losses), twist=(1.0, 1.0, 0.8))
    start = kinetic_energy(vehicle)
    energies, work = [start], 0.0
    for _ in range(2000):
        vehicle.advance(1, 1.0, OFF, NO_COMMAND)
        work += float(vehicle.wheels["passive"] @ roller_speed(vehicle)) * vehicle.physics_step
        energies.append(kinetic_energy(vehicle) + vehicle.energies.elastic)
    assert start - energies[-1] > 200.0
    assert energies[-1] - start == pytest.approx(work, rel=0.02)
    assert np.max(np.diff(energies)) < 1e-6 * start


def test_rollers_that_turn_without_resistance_lose_no_energy(
    forklift: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(
        losing(forklift, PassiveLossConfiguration(roller_mass=50.0)), twist=(2.0, 1.0, 1.5)
    )
    energies = []
    for _ in range(40):
        vehicle.advance(50, 1.0, OFF, NO_COMMAND)
        rollers = 0.5 * 0.5 * 50.0 * float(np.sum(roller_speed(vehicle) ** 2))
        energies.append(kinetic_energy(vehicle) + vehicle.energies.elastic + rollers)
    assert np.ptp(energies) < 2e-3 * energies[0]  # deflecting tires lose a little


def test_coasting_vehicle_comes_to_rest_sideways_and_stays(forklift: VehicleConfiguration) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.02, roller_mass=5.0)
    vehicle = Vehicle(losing(forklift, losses), twist=(0.0, 0.2, 0.0))
    log = advance_logged(vehicle, 6000, 1.0, OFF, NO_COMMAND)
    # It stops gradually: no force exceeds the resistance of about 60 N per wheel by much.
    assert np.max(np.abs(log.wheels["force"])) < 100.0
    stopped = vehicle.pose
    assert np.max(np.abs(vehicle.twist)) < 1e-6
    vehicle.advance(120_000, 1.0, OFF, NO_COMMAND)
    assert np.max(np.abs(vehicle.pose - stopped)) < 1e-6


@pytest.mark.parametrize("uphill_deg", [0.0, 45.0, 90.0])
def test_parked_vehicle_with_losses_does_not_creep(
    uphill_deg: float, forklift: VehicleConfiguration
) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.015, roller_mass=5.0)
    ground = ElevationConfiguration(grade=0.05, uphill_deg=uphill_deg)
    vehicle = Vehicle(losing(forklift, losses), elevation=ground)
    vehicle.advance(8000, 1.0, ON, NO_COMMAND)
    settled, angle = vehicle.pose, vehicle.wheels["angle"]
    vehicle.advance(120_000, 1.0, ON, NO_COMMAND)
    assert np.max(np.abs(vehicle.pose - settled)) < 1e-5
    np.testing.assert_array_equal(vehicle.wheels["angle"], angle)


def test_rolling_resistance_holds_a_vehicle_on_a_gentle_slope_sideways(
    forklift: VehicleConfiguration,
) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.02)
    moved = []
    for grade in (0.02, 0.04):  # it holds up to 0.02 sqrt(2)
        ground = ElevationConfiguration(grade=grade, uphill_deg=90.0)
        vehicle = Vehicle(losing(forklift, losses), elevation=ground)
        vehicle.advance(10_000, 1.0, OFF, NO_COMMAND)
        moved.append(abs(vehicle.pose[1]))
    assert moved[0] < 2e-3
    expected = GRAVITY * (0.04 - 0.02 * math.sqrt(2.0))
    assert moved[1] == pytest.approx(0.5 * expected * 25.0, rel=0.08)


@pytest.mark.parametrize(
    "direction", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, -0.6, 0.0), (0.0, 0.0, 1.0)]
)
def test_speed_passes_smoothly_through_zero_with_losses(
    direction: tuple[float, float, float], forklift: VehicleConfiguration
) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.02, roller_mass=5.0)
    vehicle = Vehicle(losing(forklift, losses))
    forces, errors = [], []
    for k in range(800):
        amplitude = 0.5 * math.sin(2.0 * math.pi * k * 0.01 / 4.0)
        log = advance_logged(vehicle, 20, 0.0, ON, amplitude * np.array(direction))
        forces.append(log.wheels["force"])
        errors.append(np.max(np.abs(vehicle.twist - amplitude * np.array(direction))))
    assert np.max(errors[200:]) < 0.03
    assert np.max(np.abs(np.diff(np.concatenate(forces)[4000:], axis=0))) < 40.0


def test_individual_rollers_lose_as_the_single_roller_does(forklift: VehicleConfiguration) -> None:
    losses = PassiveLossConfiguration(
        rolling_resistance=0.01, bearing_friction=0.01, elasticity=1e-7, section_ratio=0.64
    )
    slowed = {}
    for model in ("single", "rollers"):
        for active in (losses, PassiveLossConfiguration()):
            configuration = dataclasses.replace(losing(forklift, active), wheel_model=model)
            vehicle = Vehicle(configuration, twist=(0.0, 2.0, 0.0))
            vehicle.advance(1000, 1.0, OFF, NO_COMMAND)
            slowed[model, active.active] = 2.0 - float(vehicle.twist[1])
    # Contacts that move to rollers at rest lose a little energy even without losses.
    one, each = (slowed[m, True] - slowed[m, False] for m in ("single", "rollers"))
    assert each == pytest.approx(one, rel=0.05)


@pytest.mark.parametrize(("share", "moves"), [(0.8, False), (1.2, True)])
def test_resistance_of_individual_rollers_holds_the_vehicle(
    share: float, moves: bool, forklift: VehicleConfiguration
) -> None:
    losses = PassiveLossConfiguration(rolling_resistance=0.02)
    vehicle = Vehicle(dataclasses.replace(losing(forklift, losses), wheel_model="rollers"))
    vehicle.push((0.0, share * 0.02 * math.sqrt(2.0) * vehicle.masses.mass * GRAVITY))
    vehicle.advance(2000, 1.0, OFF, NO_COMMAND)
    assert (float(vehicle.twist[1]) > 0.01) == moves
