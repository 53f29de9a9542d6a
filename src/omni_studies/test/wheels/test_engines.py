"""Another engine agrees with ours on how a vehicle brakes, and is optional."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from omni_loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_platform.configuration import ConfigurationError
from omni_sim.vehicle.loads import GRAVITY
from omni_sim.vehicle.mujoco_vehicle import MujocoVehicle, load_mujoco
from omni_studies.wheels.engines import ENGINES, brake_to_rest, in_engine

CONFIG = Path(__file__).resolve().parents[4] / "config"
needs_mujoco = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="MuJoCo is optional and not installed"
)


def experiment(variant: str) -> ExperimentConfiguration:
    return ExperimentLibrary(CONFIG).load("straight_line", variant)


def test_without_mujoco_a_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ConfigurationError, match=r"pip install .* requirements/mujoco\.lock"):
        load_mujoco()


@pytest.mark.parametrize("engine", ["single", "rollers"])
def test_a_machine_brakes_to_rest_and_the_assistant_keeps_it_straight(engine: str) -> None:
    swerves = {}
    for variant in ("unassisted", "assisted"):
        setup = experiment(variant)
        stop = brake_to_rest(in_engine(setup.vehicle, engine, (10.0, 0.0, 0.0)), setup.brake_assist)
        assert stop.stopped
        swerves[variant] = abs(stop.swerve)
    assert swerves["unassisted"] > 30.0
    assert swerves["assisted"] < 4.0


@needs_mujoco
@pytest.mark.parametrize(("variant", "swerve"), [("unassisted", 5.0), ("assisted", 1.5)])
def test_mujoco_swerves_and_stops_as_our_vehicle_does(variant: str, swerve: float) -> None:
    setup = experiment(variant)
    stops = {
        engine: brake_to_rest(
            in_engine(setup.vehicle, engine, (10.0, 0.0, 0.0)), setup.brake_assist
        )
        for engine in ENGINES
    }
    assert stops["mujoco"].stopped
    for engine in ("single", "rollers"):
        assert stops[engine].swerve == pytest.approx(stops["mujoco"].swerve, abs=swerve)
        assert stops[engine].distance == pytest.approx(stops["mujoco"].distance, rel=0.07)


@needs_mujoco
def test_wheels_on_springs_carry_the_weight_and_forgive_a_millimeter() -> None:
    vehicle = experiment("unassisted").vehicle
    weight = (vehicle.body.mass + vehicle.load.mass) * GRAVITY
    level, tilted = (
        MujocoVehicle(vehicle, height_offset=offset) for offset in (0.0, [0.001, 0.0, 0.0, 0.0])
    )
    for machine in (level, tilted):
        machine.advance(4000, 1.0, np.ones(4), np.zeros(3), traced=False)
        assert machine.wheels["load"].sum() == pytest.approx(weight, rel=0.01)
    change = tilted.wheels["load"] - level.wheels["load"]
    # Diagonal wheels give and take alike; springs of 200 N/mm share a warp of 1 mm by quarters.
    np.testing.assert_allclose(change, [-50.0, 50.0, -50.0, 50.0], atol=15.0)
