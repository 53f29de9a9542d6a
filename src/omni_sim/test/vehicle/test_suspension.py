"""A sprung chassis: closed forms of heave, warp and rough ride; agreement with a rigid one."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from logged_steps import advance_logged

from omni_core.configuration import ConfigurationError
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.ground.configuration import BumpConfiguration, ElevationConfiguration
from omni_sim.vehicle.configuration import (
    SuspensionConfiguration,
    VehicleConfiguration,
    WheelCondition,
)
from omni_sim.vehicle.vehicle import Vehicle, VehicleInputError

STIFFNESS, STEP = 2.0e5, 0.0005  # [N/m], [s]
OFF, ON, STILL = np.zeros(4), np.ones(4), np.zeros(3)


def sprung(
    vehicle: VehicleConfiguration, stiffness: float = STIFFNESS, damping_ratio: float = 0.3
) -> VehicleConfiguration:
    """Return a sprung vehicle with its center of gravity in the middle of its wheels."""
    parts = {
        name: dataclasses.replace(getattr(vehicle, name), x=0.0, y=0.0) for name in ("body", "load")
    }
    springs = SuspensionConfiguration(stiffness=stiffness, damping_ratio=damping_ratio)
    return dataclasses.replace(vehicle, **parts, suspension=springs)


def loads_while(vehicle: Vehicle, steps: int, pedal: float = 0.0) -> FloatArray:
    """Advance and return the loads after every step [N], shape (steps, N)."""
    log = advance_logged(vehicle, steps, pedal, np.full(4, pedal), vehicle.twist)
    return np.asarray(log.wheels["load"])


def test_it_stands_as_without_springs_and_stays_there(forklift: VehicleConfiguration) -> None:
    springs = SuspensionConfiguration(stiffness=STIFFNESS)
    vehicle = Vehicle(dataclasses.replace(forklift, suspension=springs))
    loads = loads_while(vehicle, 200)
    np.testing.assert_allclose(loads, np.tile(Vehicle(forklift).wheels["load"], (200, 1)))
    np.testing.assert_allclose(vehicle.attitude, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("stiffness", "damping_ratio"), [(STIFFNESS, 0.0), (5e5, 0.0), (STIFFNESS, 0.3)]
)
def test_it_bounces_with_its_natural_frequency(
    stiffness: float, damping_ratio: float, forklift: VehicleConfiguration
) -> None:
    vehicle = Vehicle(sprung(forklift, stiffness, damping_ratio))
    vehicle.state.suspension.chassis["heave"] += 1e-3
    loads = loads_while(vehicle, 2000).sum(axis=1)
    weight = vehicle.masses.mass * GRAVITY
    frequency = math.sqrt(4.0 * stiffness / vehicle.masses.mass)
    crossings = np.flatnonzero(np.diff(np.sign(loads - weight)) > 0)
    period = STEP * float(np.diff(crossings).mean())
    damped = frequency * math.sqrt(1.0 - damping_ratio**2)
    assert period == pytest.approx(2.0 * math.pi / damped, rel=0.01)
    peaks = [np.ptp(loads[a:b]) for a, b in itertools.pairwise(crossings)]
    decay = math.exp(-damping_ratio * frequency * period)
    assert peaks[1] / peaks[0] == pytest.approx(decay, rel=0.05, abs=0.01)


def test_a_wheel_mounted_higher_hands_its_load_to_its_neighbors(
    forklift: VehicleConfiguration,
) -> None:
    """One wheel that is higher by h changes each load by a quarter of c h."""
    height = 0.002
    vehicle = sprung(forklift)
    high = dataclasses.replace(vehicle, conditions={"rear_left": WheelCondition(mounted=height)})
    change = Vehicle(high).wheels["load"] - Vehicle(vehicle).wheels["load"]
    warp = {"front_left": 1.0, "front_right": -1.0, "rear_left": -1.0, "rear_right": 1.0}
    expected = [0.25 * STIFFNESS * height * warp[name] for name in vehicle.wheels]
    np.testing.assert_allclose(change, expected, rtol=1e-9)


def test_a_wheel_far_too_high_carries_nothing(forklift: VehicleConfiguration) -> None:
    high = {"rear_left": WheelCondition(mounted=0.1)}
    vehicle = Vehicle(dataclasses.replace(sprung(forklift), conditions=high))
    loads = loads_while(vehicle, 4000)[-1]
    index = list(vehicle.wheel_names).index("rear_left")
    assert loads[index] == 0.0
    assert loads.sum() == pytest.approx(vehicle.masses.mass * GRAVITY, rel=1e-3)
    # The opposite wheel's neighbors carry half each: the center of gravity is between them.
    assert loads[list(vehicle.wheel_names).index("front_right")] == pytest.approx(0.0, abs=200.0)


def test_braking_moves_the_loads_to_where_they_are_without_springs(
    forklift: VehicleConfiguration,
) -> None:
    """After pitching, the loads are those of the zero-moment point, for any springs."""
    ends = []
    for vehicle in (sprung(forklift), sprung(forklift, 0.0)):
        moving = Vehicle(vehicle, twist=(6.0, 0.0, 0.0))
        loads = loads_while(moving, 1600, pedal=1.0)
        ends.append(loads[-400:].mean(axis=0))
        assert not moving.tipping
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.03)


def test_a_bump_under_a_wheel_is_a_wheel_mounted_lower(forklift: VehicleConfiguration) -> None:
    height, name = 0.002, "rear_left"
    vehicle = sprung(forklift)
    mount = vehicle.wheels[name]
    bump = BumpConfiguration(x=mount.x, y=mount.y, radius=0.4, height=height)
    on_bump = Vehicle(vehicle, elevation=ElevationConfiguration(bumps={name: bump}))
    low = dataclasses.replace(vehicle, conditions={name: WheelCondition(mounted=-height)})
    np.testing.assert_allclose(on_bump.wheels["load"], Vehicle(low).wheels["load"], rtol=0.02)


def test_gaps_between_rollers_give_a_rough_ride(forklift: VehicleConfiguration) -> None:
    """All wheels sink at the same time; with stiff springs the chassis follows them."""
    gap, speed = 0.03, 0.3
    rollers = dataclasses.replace(forklift.rollers, gap=gap)
    vehicle = dataclasses.replace(
        sprung(forklift, 5.0e6, 0.5), wheel_model="rollers", rollers=rollers
    )
    moving = Vehicle(vehicle, twist=(speed, 0.0, 0.0))
    heights = []
    for _ in range(3000):
        moving.advance(1, 0.0, OFF, (speed, 0.0, 0.0))
        heights.append(moving.attitude[0])
    radius = next(iter(vehicle.wheels.values())).radius
    depth = radius * (1.0 - math.cos(0.5 * gap / radius))
    assert np.ptp(heights) == pytest.approx(depth, rel=0.3)


def test_heights_without_springs_are_refused(forklift: VehicleConfiguration) -> None:
    high = {"rear_left": WheelCondition(mounted=0.001)}
    with pytest.raises(ConfigurationError, match="require springs"):
        dataclasses.replace(forklift, conditions=high).check_consistency()
    gaps = dataclasses.replace(forklift.rollers, gap=0.01)
    with pytest.raises(ConfigurationError, match="requires wheel_model"):
        dataclasses.replace(sprung(forklift), rollers=gaps).check_consistency()


def test_springs_too_stiff_for_the_step_are_refused(forklift: VehicleConfiguration) -> None:
    with pytest.raises(VehicleInputError, match="physics step below"):
        Vehicle(sprung(forklift, 1.0e8), physics_step=0.005)
