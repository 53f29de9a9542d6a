"""Brake pressure compared with its closed form, and its effect on a vehicle."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from logged_steps import advance_logged, kinetic_energy
from numpy.typing import NDArray

from omni_core.brakes import BrakeConfiguration
from omni_sim.masses import MassConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.wheel.brake_pressure import (
    BrakePressure,
    build_brake_pressure,
    passed,
    press,
    set_demand,
)

LAG, DEAD, STEP = 0.03, 0.007, 0.0005
SHARES = np.array([1.0, 0.0, 0.4])
ASKED = 1500.0 * SHARES


def brakes(wheels: int = 3, step: float = STEP, **values: Any) -> BrakePressure:
    """Return proportional brakes without pressure; `values` are parameters of the brakes."""
    brake = BrakeConfiguration(**({"kind": "proportional"} | values))
    return build_brake_pressure(brake, wheels, step)


def brake_torques(pressure: BrakePressure, demand: float, steps: int) -> NDArray[np.float64]:
    """Return the available torque of each brake in each step under a constant demand [N m]."""
    set_demand(pressure, demand, SHARES)
    rows = []
    for _ in range(steps):
        press(pressure)
        rows.append(pressure.acting.copy())
    return np.array(rows)


@pytest.mark.safety(
    "brakes held without pedal",
    "any enable of the assistant",
    "an enable is a share of the pedal's demand, which is zero if the pedal is up",
    within=0.0,
)
def test_pressure_without_lag_equals_the_command() -> None:
    pressure = brakes()
    np.testing.assert_array_equal(brake_torques(pressure, 1500.0, 20), [ASKED] * 20)
    np.testing.assert_array_equal(brake_torques(pressure, 0.0, 20), 0.0)


def test_dead_time_alone_shifts_what_is_asked() -> None:
    pressure = brakes(dead_time=DEAD)
    steps = round(DEAD / STEP)
    torques = [brake_torques(pressure, c * 1500.0, 10) for c in (1.0, 0.5, 0.2)]
    shares = np.concatenate((np.zeros(steps), np.repeat([1.0, 0.5], 10)))[:30]
    np.testing.assert_array_equal(np.concatenate(torques), np.outer(shares, ASKED))


@pytest.mark.parametrize("dead_time", [0.0, 0.06])
def test_a_spring_applied_brake_releases_later_than_it_is_applied(dead_time: float) -> None:
    release_time = 0.1
    pressure = brakes(kind="on_off", dead_time=dead_time, release_time=release_time)
    brake_torques(pressure, 0.0, 500)
    applied = brake_torques(pressure, 1500.0, 500)[:, 0]
    assert np.argmax(applied > 0.0) == round(dead_time / STEP)
    assert np.all(applied[round(dead_time / STEP) :] == 1500.0)
    released = brake_torques(pressure, 0.0, 500)[:, 0]
    assert np.argmin(released) == round(release_time / STEP)
    # A release that is shorter than the difference has no effect.
    brake_torques(pressure, 1500.0, 500)
    brake_torques(pressure, 0.0, round(0.9 * (release_time - dead_time) / STEP))
    assert np.all(brake_torques(pressure, 1500.0, 500)[:, 0] == 1500.0)


@pytest.mark.parametrize("step", [STEP, 0.001])
def test_impulse_of_a_pulse_is_that_of_the_closed_form(step: float) -> None:
    """Integral of ``p`` over 0.1 s with a demand and 0.1 s without."""
    pressure = brakes(3, step, time_constant=LAG, dead_time=DEAD)
    on, off = 0.1, 0.1
    rows = [brake_torques(pressure, demanded, round(0.1 / step)) for demanded in (1500.0, 0.0)]
    impulse = step * np.concatenate(rows).sum(axis=0)
    top = 1.0 - math.exp(-on / LAG)
    rising = on - LAG * top
    falling = LAG * top * (1.0 - math.exp(-(off - DEAD) / LAG))
    np.testing.assert_allclose(impulse, (rising + falling) * ASKED, rtol=1e-12)


def light_brakes(forklift: VehicleConfiguration, **brake: Any) -> VehicleConfiguration:
    """A vehicle with its load in the middle, whose brakes do not lock the wheels."""
    return dataclasses.replace(
        forklift,
        load=MassConfiguration(mass=250.0, height=0.5, yaw_inertia=10.0),
        brake=dataclasses.replace(forklift.brake, max_torque=150.0, **brake),
    )


def distance(vehicle: Vehicle, seconds: float = 6.0) -> float:
    steps = round(seconds / vehicle.physics_step)
    vehicle.advance(steps, 1.0, np.ones(4), np.zeros(3))
    return float(vehicle.pose[0])


@pytest.mark.parametrize(("lag", "dead"), [(0.2, 0.0), (0.0, 0.05), (0.1, 0.02)])
def test_late_brakes_lengthen_the_stop_by_the_closed_form(
    forklift: VehicleConfiguration, lag: float, dead: float
) -> None:
    """From ``v`` with the full deceleration ``a``: ``v (T + t_d) - a T^2/2``."""
    v = 6.0
    at_once = distance(Vehicle(light_brakes(forklift), twist=(v, 0.0, 0.0)))
    a = v**2 / (2.0 * at_once)
    late = light_brakes(forklift, time_constant=lag, dead_time=dead)
    extra = distance(Vehicle(late, twist=(v, 0.0, 0.0))) - at_once
    assert extra == pytest.approx(v * (lag + dead) - 0.5 * a * lag**2, rel=0.01)


def test_late_brakes_add_no_energy(forklift: VehicleConfiguration) -> None:
    brake = dataclasses.replace(forklift.brake, time_constant=LAG, dead_time=DEAD)
    vehicle = Vehicle(dataclasses.replace(forklift, brake=brake), twist=(6.0, 2.0, 1.0))
    allowance = 1e-9 * kinetic_energy(vehicle)
    random = np.random.default_rng(3)
    for _ in range(100):
        before = kinetic_energy(vehicle) + vehicle.energies.elastic
        log = advance_logged(vehicle, 20, 1.0, random.integers(0, 2, 4), np.zeros(3))
        energy = np.concatenate(([before], log.energy.sum(axis=1)))
        assert np.max(np.diff(energy)) <= allowance
        assert np.all(np.abs(log.wheels["brake"]) <= brake.max_torque)


def test_a_vehicle_that_is_placed_anew_has_no_pressure(forklift: VehicleConfiguration) -> None:
    brake = dataclasses.replace(forklift.brake, time_constant=LAG, dead_time=DEAD)
    vehicle = Vehicle(dataclasses.replace(forklift, brake=brake), twist=(6.0, 2.0, 1.0))
    first = vehicle.advance(333, 1.0, np.ones(4), np.zeros(3))
    vehicle.place((0.0, 0.0, 0.0), (6.0, 2.0, 1.0))
    np.testing.assert_array_equal(vehicle.advance(333, 1.0, np.ones(4), np.zeros(3)), first)


def test_valves_are_open_or_shut_and_proportional_ones_take_steps() -> None:
    enable = np.array([0.0, 0.24, 0.49, 0.51, 1.0])
    for kind, resolution, shares in (
        ("proportional", 0.0, enable),
        ("on_off", 0.0, [0, 0, 0, 1, 1]),
        ("proportional", 0.25, [0, 0.25, 0.5, 0.5, 1]),
    ):
        pressure = brakes(5, kind=kind, resolution=resolution)
        np.testing.assert_allclose([passed(pressure, share) for share in enable], shares)
