"""A push changes the momentum of the vehicle by force times duration."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentLibrary
from omni_sim.push import Push

CONFIG = Path(__file__).resolve().parents[3] / "config"


def test_without_friction_a_push_changes_momentum_and_nothing_else() -> None:
    changes = (*WITHOUT_CAMERAS, "simulation.duration_limit=1", "ground.friction=0")
    experiment = ExperimentLibrary(CONFIG).load("straight_line", "assisted", changes)
    load = dataclasses.replace(experiment.vehicle.load, mass=0.0)
    vehicle = dataclasses.replace(experiment.vehicle, load=load)  # center of gravity at base_link
    experiment = dataclasses.replace(experiment, vehicle=vehicle)
    push = Push(time=0.5, duration=0.2, force=(-300.0, 600.0), moment=50.0)
    plain, pushed = run_fast_loop(experiment), run_fast_loop(experiment, push=push)
    before = pushed.stamp_ns <= 0.5e9
    np.testing.assert_array_equal(pushed.twist[before], plain.twist[before])
    turned = pushed.pose[-1, 2]
    (v_x, v_y), rate = pushed.twist[-1, :2], pushed.twist[-1, 2]
    world = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
    masses = vehicle.masses
    gained = masses.mass * (world @ (v_x, v_y) - plain.twist[-1, :2])
    np.testing.assert_allclose(gained, [-60.0, 120.0], rtol=1e-6)
    assert masses.yaw_inertia * rate == pytest.approx(10.0, rel=1e-6)
