"""The best known stop is between the bound and the stops of the laws."""

import dataclasses
import importlib.util
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.limit.bounds import maneuver_of, straight_bound
from omni_sim.masses import MassConfiguration
from omni_tools.limit import front as front_module
from omni_tools.limit.best import OptimalStop, Transcription, load_casadi
from omni_tools.limit.front import LimitStop, draw_front

CONFIG = Path(__file__).resolve().parents[4] / "config"
needs_casadi = pytest.mark.skipif(
    importlib.util.find_spec("casadi") is None, reason="CasADi is optional and not installed"
)


@pytest.fixture(scope="module")
def symmetric() -> ExperimentConfiguration:
    changes = ["feedback=velocity_sensor", "vehicle.brake.kind=proportional"]
    law = ["brake_assist.law=allocation", "maneuver.speed=8"]
    experiment = ExperimentLibrary(CONFIG).load("straight_line", "assisted", changes + law)
    empty = dataclasses.replace(
        experiment.vehicle,
        body=MassConfiguration(mass=1200.0, height=0.4, yaw_inertia=400.0),
        load=MassConfiguration(mass=0.0, height=0.0),
    )
    return dataclasses.replace(experiment, vehicle=empty)


@needs_casadi
def test_a_symmetric_vehicle_stops_best_near_its_bound(symmetric: ExperimentConfiguration) -> None:
    maneuver = maneuver_of(symmetric.maneuver)
    bound = straight_bound(symmetric.vehicle, symmetric.ground, maneuver)
    guess = run_fast_loop(symmetric)
    stops = [OptimalStop(symmetric.vehicle, 1.0, maneuver, Transcription(n)) for n in (10, 20)]
    plans = [stop.plan(0.5, guess) for stop in stops]
    for plan in plans:
        # Brakes need 20 ms, and slip a few more, to build up the full friction.
        assert bound.distance - bound.tolerance < plan.distance < 1.05 * bound.distance
        assert plan.rotation <= 0.5 + 1e-3
        assert np.all(plan.torque <= 1500.0 * (1.0 + 1e-6))
    assert plans[0].distance == pytest.approx(plans[1].distance, rel=0.02)  # refinement
    # Friction only removes energy, so the speed decreases until the end.
    speed = np.hypot(plans[1].state[:, 3], plans[1].state[:, 4])
    assert speed[0] == pytest.approx(8.0)
    assert np.all(np.diff(speed) < 0.0)


def test_without_casadi_a_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ConfigurationError, match="omni install casadi"):
        load_casadi()


def test_a_stop_that_turns_less_stands_where_no_better_one_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = iter([8.6, math.nan, 8.7, 8.5])

    class Planner:
        def __init__(self, *_: object) -> None: ...

        def plan(self, rotation: float, _: object) -> SimpleNamespace:
            return SimpleNamespace(distance=next(found), rotation=rotation)

    monkeypatch.setattr(front_module, "OptimalStop", Planner)
    library = ExperimentLibrary(CONFIG)
    stops = front_module.front(
        lambda changes: library.load("straight_line", "assisted", changes),
        maneuver_of(library.load("straight_line", "assisted").maneuver),
    )
    best = [stops[f"best_{rotation:g}"] for rotation in front_module.ROTATIONS]
    assert best == [LimitStop(8.6, 0.5)] * 3 + [LimitStop(8.5, 30.0)]


def test_a_front_shows_every_stop() -> None:
    stops = {"unassisted": LimitStop(9.9, 35.0), "sliding_mode": LimitStop(10.1, 2.7)}
    for rotation in (0.5, 5.0):
        stops[f"allocation_{rotation:g}"] = LimitStop(8.6, rotation)
        stops[f"best_{rotation:g}"] = LimitStop(math.nan if rotation > 1.0 else 8.5, rotation)
    axes = draw_front("a_b", stops, 8.65).axes[0]
    assert len(axes.lines) == 5
