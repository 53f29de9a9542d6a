"""Vehicles on conventional wheels: Figure 23 in closed form, friction circle, energy, symmetry."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from logged_steps import advance_logged

from omni_core.configuration import ConfigurationError
from omni_core.geometry import WheelMount
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.masses import MassConfiguration
from omni_sim.tire.models.tmeasy import TMeasyParameters, curve_at, direction_coefficients
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

FREE: dict[str, Any] = {"pedal": 0.1, "enable": np.zeros(4), "command_twist": np.zeros(3)}


@pytest.fixture
def cart(forklift: VehicleConfiguration) -> VehicleConfiguration:
    """The forklift on conventional wheels, with its load in the middle."""
    return dataclasses.replace(
        forklift,
        wheels={
            name: WheelMount(kind="conventional", x=mount.x, y=mount.y, radius=mount.radius)
            for name, mount in forklift.wheels.items()
        },
        load=dataclasses.replace(forklift.load, x=0.0, y=0.0),
    )


@pytest.mark.parametrize("angle_deg", [30.0, 60.0, 80.0])
def test_pushed_cart_rolls_ahead_as_in_figure_23(
    cart: VehicleConfiguration, angle_deg: float
) -> None:
    """Speed ``F cos t / (m + 4 I / R^2)``, sideslip angle ``F sin / (4 C)``, in closed form."""
    angle, size = math.radians(angle_deg), 0.05 * cart.masses.mass * GRAVITY
    vehicle = Vehicle(cart)
    vehicle.push(size * np.array([math.cos(angle), math.sin(angle)]))
    vehicle.advance(round(3.0 / vehicle.physics_step), **FREE)
    load = cart.masses.mass * GRAVITY / 4.0
    radius = 0.2 - load / cart.tire.vertical_stiffness
    inertia = cart.masses.mass + 4.0 * cart.wheel_inertia / radius**2
    forward, left, turn = vehicle.twist
    assert forward == pytest.approx(size * math.cos(angle) / inertia * 3.0, rel=1e-4)
    lateral = TMeasyParameters(direction_coefficients(cart.tire.tmeasy, "y"))
    stiffness = 4.0 * curve_at(lateral, load, 1.0).slope
    # The curve bends by two percent before this slip.
    assert left / forward == pytest.approx(size * math.sin(angle) / stiffness, rel=0.03)
    assert abs(turn) < 1e-5


def test_locked_wheels_brake_against_the_velocity(cart: VehicleConfiguration) -> None:
    """With the same curve in all directions, the friction of a locked wheel opposes its motion."""
    tire = dataclasses.replace(
        cart.tire, tmeasy=dataclasses.replace(cart.tire.tmeasy, y=cart.tire.tmeasy.x)
    )
    direction = np.array([math.cos(0.7), math.sin(0.7)])
    flat = {
        name: dataclasses.replace(getattr(cart, name), height=0.0) for name in ("body", "load")
    }  # without load transfer
    cart = dataclasses.replace(cart, tire=tire, **flat)
    vehicle = Vehicle(cart, twist=(*(6.0 * direction), 0.0))
    path = vehicle.advance(round(0.6 / vehicle.physics_step), 1.0, np.ones(4), np.zeros(3))
    late = path[-1] - path[400]
    np.testing.assert_allclose(late[3:5] / np.linalg.norm(late[3:5]), -direction, atol=0.01)
    longitudinal = TMeasyParameters(direction_coefficients(cart.tire.tmeasy, "x"))
    load = cart.masses.mass * GRAVITY / 4.0
    force = 4.0 * curve_at(longitudinal, load, 1.0).slide_force
    duration = (len(path) - 401) * vehicle.physics_step
    assert np.linalg.norm(late[3:5]) == pytest.approx(force / cart.masses.mass * duration, rel=0.01)


@pytest.mark.parametrize("pedal", [0.2, 1.0])
def test_brakes_only_take_energy(forklift: VehicleConfiguration, pedal: float) -> None:
    wheels = {
        name: WheelMount(kind="conventional", x=mount.x, y=mount.y, heading_deg=10.0 * row)
        for row, (name, mount) in enumerate(forklift.wheels.items())
    }
    vehicle = Vehicle(dataclasses.replace(forklift, wheels=wheels), twist=(5.0, 1.0, 2.0))
    log = advance_logged(vehicle, 4000, pedal, np.ones(4), np.zeros(3))
    energy = log.energy.sum(axis=1)
    assert np.max(np.diff(energy)) < 1e-6 * energy[0]
    assert energy[-1] < energy[0]


def test_mirrored_cart_moves_in_the_mirror_image(cart: VehicleConfiguration) -> None:
    mirrored = dataclasses.replace(
        cart,
        wheels={
            name: dataclasses.replace(mount, y=-mount.y) for name, mount in cart.wheels.items()
        },
        load=dataclasses.replace(cart.load, x=0.5, y=-0.4),
    )
    cart = dataclasses.replace(cart, load=dataclasses.replace(cart.load, x=0.5, y=0.4))
    one, other = Vehicle(cart, twist=(6.0, 0.5, 0.3)), Vehicle(mirrored, twist=(6.0, -0.5, -0.3))
    for vehicle in (one, other):
        vehicle.advance(1000, 0.3, np.ones(4), np.zeros(3))
    np.testing.assert_allclose(other.pose, one.pose * [1.0, -1.0, -1.0], atol=1e-9)


def test_omni_wheel_beside_conventional_wheels_rolls_freely_across(
    cart: VehicleConfiguration,
) -> None:
    """A differential drive with an omni-wheel as castor turns on the spot without lateral slip."""
    wheels = {
        "left": WheelMount(kind="conventional", x=0.0, y=0.5),
        "right": WheelMount(kind="conventional", x=0.0, y=-0.5),
        "front": WheelMount(x=0.65, y=0.0, roller_angle_deg=0.0),
        "rear": WheelMount(x=-0.65, y=0.0, roller_angle_deg=0.0),
    }
    body = MassConfiguration(mass=800.0, height=0.3, yaw_inertia=250.0)
    vehicle = Vehicle(dataclasses.replace(cart, wheels=wheels, body=body))
    vehicle.advance(6000, 0.0, np.ones(4), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(vehicle.twist, [0.0, 0.0, 1.0], atol=1e-3)
    forces: FloatArray = vehicle.wheel_force_body
    np.testing.assert_allclose(forces[2:], 0.0, atol=1.0)


def test_options_of_rollers_are_refused(cart: VehicleConfiguration) -> None:
    options: tuple[dict[str, Any], ...] = ({"wheel_model": "rollers"}, {"contact": "roller"})
    for changes in options:
        with pytest.raises(ConfigurationError, match="kind: conventional"):
            dataclasses.replace(cart, **changes)
    dead = dataclasses.replace(cart.passive_losses, bearing_friction=0.01)
    with pytest.raises(ConfigurationError, match=r"passive_losses.*conventional"):
        dataclasses.replace(cart, passive_losses=dead)
