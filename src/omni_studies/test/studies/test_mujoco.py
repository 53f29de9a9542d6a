"""MuJoCo and the simulator agree on stops; MuJoCo is optional."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.quantities import GRAVITY
from omni_runs.experiment import ExperimentLibrary
from omni_runs.loop import run_closed_loop
from omni_runs.metrics import run_metrics
from omni_sim.mujoco_import import load_mujoco
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.mujoco_vehicle import MujocoVehicle
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.wheels.kinds import on_wheels
from omni_tools.vehicles.estimates import Measured, write_vehicle

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[4] / "config")
needs_mujoco = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="MuJoCo is optional and not installed"
)


def stop(
    variant: str, engine: str, experiment: str = "straight_line", *changes: str
) -> dict[str, float]:
    """Return the metrics of an experiment's stop in an engine."""
    changes += (f"vehicle.wheel_model={engine}", "feedback=velocity_sensor",
                "simulation.render_lines=false")  # fmt: skip
    history = run_closed_loop(LIBRARY.load(experiment, variant, changes))
    return {name: metric.value for name, metric in run_metrics(history).items()}


def test_without_mujoco_a_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ConfigurationError, match="omni install mujoco"):
        load_mujoco()


def test_rollers_heavier_than_the_vehicle_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", ModuleType("mujoco"))
    vehicle = LIBRARY.vehicle("mecanum_forklift")
    light = dataclasses.replace(vehicle, body=dataclasses.replace(vehicle.body, mass=30.0))
    with pytest.raises(ConfigurationError, match=r"give 9\.48 kg per wheel, but .* weigh 30 kg"):
        MujocoVehicle(light)


@pytest.mark.parametrize("engine", ["single", "rollers"])
def test_a_machine_brakes_to_rest_and_the_assistant_keeps_it_straight(engine: str) -> None:
    assert stop("unassisted", engine)["orientation_change"] > 30.0
    assert stop("assisted", engine)["orientation_change"] < 4.0


@needs_mujoco
@pytest.mark.parametrize(("variant", "swerve"), [("unassisted", 6.5), ("assisted", 1.5)])
def test_mujoco_swerves_and_stops_as_our_vehicle_does(variant: str, swerve: float) -> None:
    other = stop(variant, "mujoco")
    for engine in ("single", "rollers"):
        ours = stop(variant, engine)
        assert ours["orientation_change"] == pytest.approx(other["orientation_change"], abs=swerve)
        assert ours["stopping_distance"] == pytest.approx(other["stopping_distance"], rel=0.07)


@needs_mujoco
def test_the_row_on_which_the_wheels_lock_matters_in_mujoco_as_in_our_simulation() -> None:
    turned, loads = [], []
    for apart in (0.0, 0.08):
        vehicle = LIBRARY.vehicle("mecanum_forklift")
        rollers = dataclasses.replace(vehicle.rollers, rows_apart=apart, small_radius=0.04)
        vehicle = dataclasses.replace(vehicle, wheel_model="rollers", rollers=rollers)
        # The wheels lock on an even roller, whose row is 40 mm to the left.
        begin: dict[str, Any] = {"twist": (5.0, 0.0, 0.0), "wheel_angle": -0.15}
        ours, other = Vehicle(vehicle, **begin), mujoco(vehicle, **begin)
        for _ in range(65):
            for machine in (ours, other):
                machine.advance(20, 1.0, np.ones(4), np.zeros(3), traced=False)
        assert other.pose[0] == pytest.approx(ours.pose[0], rel=0.03)
        turned.append((ours.pose[2], other.pose[2]))
        for machine in (ours, other):
            machine.place(np.zeros(3), np.zeros(3))
            machine.advance(1000, 1.0, np.ones(4), np.zeros(3), traced=False)
            loads.append(machine.wheels["load"].copy())
    np.testing.assert_allclose(loads[0], loads[1], atol=40.0)
    np.testing.assert_allclose(loads[2], loads[3], atol=40.0)
    effect = np.degrees(np.diff(turned, axis=0)[0])
    assert effect[0] < -2.0
    assert effect[0] == pytest.approx(effect[1], abs=2.0)


@needs_mujoco
def test_conventional_wheels_move_in_mujoco_as_in_our_simulation() -> None:
    """A stop from 10 m/s, and a cart that is put down obliquely to its wheels."""
    vehicle = on_wheels(LIBRARY.vehicle("mecanum_forklift"), "conventional")
    ours, other = Vehicle(vehicle, twist=(10.0, 0.0, 0.0)), mujoco(vehicle, twist=(10.0, 0.0, 0.0))
    for _ in range(150):  # MuJoCo's friction follows the loads from call to call
        for machine in (ours, other):
            machine.advance(20, 1.0, np.ones(4), np.zeros(3), traced=False)
    assert other.pose[0] == pytest.approx(ours.pose[0], rel=0.02)
    assert ours.pose[2] < other.pose[2] < 0.0  # both turn to the right, in MuJoCo less
    assert other.pose[2] == pytest.approx(ours.pose[2], abs=np.radians(7.0))
    even = dataclasses.replace(vehicle, load=dataclasses.replace(vehicle.load, x=0.0, y=0.0))
    ours, other = Vehicle(even, twist=(3.0, 1.0, 0.0)), mujoco(even, twist=(3.0, 1.0, 0.0))
    for machine in (ours, other):
        machine.advance(1000, 0.1, np.zeros(4), np.zeros(3), traced=False)
        assert abs(machine.twist[1]) < 0.05  # the wheels grip sideways, and roll ahead
    np.testing.assert_allclose(other.twist, ours.twist, atol=0.1)


def mujoco(vehicle: VehicleConfiguration, **begin: Any) -> MujocoVehicle:
    """Return a vehicle in MuJoCo."""
    return MujocoVehicle(dataclasses.replace(vehicle, wheel_model="mujoco"), **begin)


@needs_mujoco
def test_a_new_vehicle_stops_in_mujoco_as_in_our_simulation(tmp_path: Path) -> None:
    robot = Measured(length=0.58, width=0.38, mass=30.0, wheel_radius=0.05)
    write_vehicle("robot", robot, tmp_path)
    experiment = str(tmp_path / "experiment.yaml")
    changes = ("maneuver.direction_deg=30", "maneuver.speed=2")
    ours, other = (
        stop("assisted", engine, experiment, *changes) for engine in ("single", "mujoco")
    )
    assert ours["stopping_distance"] == pytest.approx(other["stopping_distance"], rel=0.12)


@needs_mujoco
def test_wheels_on_springs_carry_the_weight_and_forgive_a_millimeter() -> None:
    vehicle = LIBRARY.vehicle("mecanum_forklift")
    weight = (vehicle.body.mass + vehicle.load.mass) * GRAVITY
    level, tilted = (
        MujocoVehicle(vehicle, height_offset=offset) for offset in (0.0, [0.001, 0.0, 0.0, 0.0])
    )
    for machine in (level, tilted):
        machine.advance(4000, 1.0, np.ones(4), np.zeros(3), traced=False)
        assert machine.wheels["load"].sum() == pytest.approx(weight, rel=0.01)
    change = tilted.wheels["load"] - level.wheels["load"]
    # The loads of diagonal wheels change equally: a quarter of 1 mm at 200 N/mm on each wheel.
    np.testing.assert_allclose(change, [-50.0, 50.0, -50.0, 50.0], atol=15.0)
