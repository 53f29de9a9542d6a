"""Messages with repeated stamps or different rates do not change a stop."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import Decision
from omni_runs.experiment import ExperimentLibrary
from omni_runs.loop import SensorEstimator, steps
from omni_sim.simulator import Simulator

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")


class Repeating(BrakeAssist):
    """Receives some of its demands twice, with the same stamp."""

    share = 0.0
    random = np.random.default_rng(1)

    def update(self, demand: BrakeDemand) -> Decision:
        decision = super().update(demand)
        return super().update(demand) if self.random.uniform() < self.share else decision


class HalfRate(BrakeAssist):
    """Receives pedal and IMU at half the rate of the twist."""

    newest = False  # whether a demand has the newest stamp of all inputs, or the pedal's
    held: BrakeDemand | None = None

    def update(self, demand: BrakeDemand) -> Decision:
        if self.held is None or demand.stamp_ns % 20_000_000 == 0:
            self.held = demand
        stamp_ns = demand.stamp_ns if self.newest else self.held.stamp_ns
        return super().update(
            dataclasses.replace(demand, stamp_ns=stamp_ns, pedal=self.held.pedal, imu=self.held.imu)
        )


def _rotation(law: str, kind: type[BrakeAssist]) -> float:
    """Return the change of orientation of a stop under an assistant [deg]."""
    changes = (
        "feedback=velocity_sensor",
        "simulation.render_lines=false",
        "vehicle.brake.kind=proportional",
        f"brake_assist.law={law}",
    )
    configuration = LIBRARY.load("small_stop", "assisted", changes)
    assist = kind(configuration.brake_assist)
    for moment in steps(Simulator(configuration), SensorEstimator(), assist):
        observation = moment.observation
        if observation.pedal > 0.0 and math.hypot(*observation.twist) < 1e-3:
            return abs(math.degrees(observation.pose[2]))
    raise AssertionError("unreachable: the loop ends at a stop")


@pytest.mark.parametrize("share", [0.02, 0.05, 0.1])
def test_a_repeated_stamp_takes_no_step(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Repeating, "share", share)
    monkeypatch.setattr(Repeating, "random", np.random.default_rng(1))
    expected = pytest.approx(_rotation("allocation", BrakeAssist), abs=0.1)
    assert _rotation("allocation", Repeating) == expected


@pytest.mark.parametrize("newest", [False, True])
@pytest.mark.parametrize("law", ["allocation", "sliding_mode"])
def test_pedal_and_imu_may_come_at_half_the_rate(
    law: str, newest: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(HalfRate, "newest", newest)
    assert _rotation(law, HalfRate) < 2.0 + _rotation(law, BrakeAssist)
