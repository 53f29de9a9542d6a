"""Overload of the tire model is reported with wheel, load and time, and only if it occurs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omni_sim.configuration import SimulationConfiguration, SimulatorConfiguration
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.simulator import Overload, Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration


def simulate(vehicle: VehicleConfiguration, periods: int) -> tuple[Simulator, list[bool]]:
    simulator = Simulator(
        SimulatorConfiguration(
            vehicle=vehicle,
            sensors={},
            maneuver=ManeuverConfiguration(speed=8.0, brake_time=0.1),
            simulation=SimulationConfiguration(render_lines=False),
        )
    )
    overloaded = []
    for _ in range(periods):
        simulator.advance(np.ones(len(vehicle.wheels)))
        overloaded.append(simulator.overloaded)
    return simulator, overloaded


@pytest.mark.parametrize("model", ["tmeasy", "linear", "magic_formula"])
def test_overload_while_braking_is_reported_with_wheel_load_and_time(
    model: str, forklift: VehicleConfiguration
) -> None:
    heavy = dataclasses.replace(
        forklift,
        tire=dataclasses.replace(forklift.tire, model=model),
        load=dataclasses.replace(forklift.load, mass=450.0),
    )
    simulator, overloaded = simulate(heavy, 250)
    assert not overloaded[0]  # rolling, nothing is overloaded
    assert any(overloaded)
    assert not overloaded[-1]  # at rest again
    overload = simulator.overload
    assert list(overload.largest_load) == ["front_left"]
    assert 6000.0 < overload.largest_load["front_left"] < 12000.0
    steps = simulator.vehicle.overloaded_steps
    assert overload.time == pytest.approx(0.0005 * steps)
    assert 0.01 * (sum(overloaded) - 2) <= overload.time <= 0.01 * sum(overloaded)
    for word in ("front_left", model, "6000 N"):
        assert word in overload.sentence()


def test_without_overload_nothing_is_reported(forklift: VehicleConfiguration) -> None:
    simulator, overloaded = simulate(forklift, 250)
    assert not any(overloaded)
    assert simulator.overload.time == 0.0


def test_time_is_added_up_over_wheels_and_a_short_overload_is_not_lost() -> None:
    watch = Overload(("a", "b"), "linear", 100.0, 0.01)
    assert not watch.update(np.array([99.0, 100.0]), 0)
    # An overload that begins and ends within the period.
    assert watch.update(np.array([90.0, 100.0]), 3)
    assert watch.largest_load == {}
    assert "0.03 s" in watch.sentence()
    assert watch.update(np.array([120.0, 130.0]), 7)
    assert not watch.update(np.array([80.0, 80.0]), 7)
    assert watch.largest_load == {"a": 120.0, "b": 130.0}
    assert watch.time == pytest.approx(0.07)
