"""Effects of both readings of the equations that the project reads differently from the print."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from omni_brake_assist.laws.sliding_mode import SlidingManifold
from omni_brake_assist.weighting import weighting_function
from omni_core.kinematics import PlatformKinematics
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.tire import Tire
from omni_tools.line_trials.trials import error_values

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[4] / "config")
WHEELS = LIBRARY.load("straight_line", "assisted").vehicle.wheels
KINEMATICS = PlatformKinematics(WHEELS)


def states(count: int) -> NDArray[np.float64]:
    random = np.random.default_rng(3)
    return random.uniform([-10.0, -10.0, -2.0], [10.0, 10.0, 2.0], (count, 3))


def test_of_51_the_platform_velocity_makes_drift_vanish_without_drift() -> None:
    # A vehicle that moves along its initial line has no drift at any yaw rate ...
    twist, across = np.array([8.0, 0.0, 1.5]), np.array([0.0, 1.0])
    geometry = KINEMATICS.geometry
    errors = SlidingManifold(geometry, weighting_function("zero", 1)).errors(twist, across)
    np.testing.assert_allclose(errors.perpendicular, 0.0, atol=1e-12)
    # ... but the printed v_i includes the rotation of the wheels about the center.
    hubs = KINEMATICS.wheel_velocities(twist)
    force = -np.sign(np.sum(geometry.active * hubs, axis=1))
    printed = force * (geometry.active @ across) * (hubs @ across)
    assert np.min(np.abs(printed)) > 0.5


def test_of_56_57_the_angle_to_the_line_never_releases_a_wheel_that_brakes() -> None:
    geometry = KINEMATICS.geometry
    psi = weighting_function("enhanced", 1)
    read, printed = [], []
    for twist in states(400) * [1.0, 1.0, 0.0]:  # translation, in which every wheel can brake
        speed = np.linalg.norm(twist[:2])
        hubs = KINEMATICS.wheel_velocities(twist)
        along = twist[:2] / speed
        sliding = np.sum(geometry.active * hubs, axis=1)
        size = np.linalg.norm(hubs, axis=1)
        force = -np.sign(sliding) * (geometry.active @ along) * (hubs @ along)
        signed = np.arccos(np.clip(sliding / size, -1.0, 1.0))
        line = np.minimum(signed, math.pi - signed)
        read.append(psi(line) * force)
        printed.append((2.0 - 4.0 * signed / math.pi - np.cos(signed)) * force)  # (59), k = 1
    braking = np.array(read) < -1e-9
    assert np.all(np.array(read) <= 1e-9)
    share = np.mean(np.array(printed)[braking] > 0.0)
    assert 0.4 < share < 0.6


def test_of_85_only_the_product_with_the_rate_is_the_error_that_was_put_in() -> None:
    # Displacements measured 2 % too long are a velocity that is 2 % too large.
    pitch, rate, speed = 50e-3 / 1024, 2500.0, 10.0
    true = speed / rate / pitch
    *_, percent = error_values(np.zeros(9), np.full(9, 0.02 * true), pitch, rate, speed)
    assert percent == pytest.approx(2.0)
    assert 100.0 * 0.02 * true * pitch / rate / speed < 1e-6  # as printed


def test_slips_by_the_parabola_would_start_curves_flatter_than_their_chord() -> None:
    tire = Tire(TireConfiguration())
    for load in (300.0, 1000.0, 2000.0):
        curve = tire.curve(load)
        assert curve.peak_slip * curve.slope >= curve.peak_force
        q = load / 3000.0
        slip = q * (2.0 * 0.15 - 0.09 - (0.15 - 0.09) * q)  # (3) taken for s_max
        if load <= 300.0:
            assert slip * curve.slope < curve.peak_force


def test_without_the_yaw_offset_noise_does_not_push_the_vehicle_off_its_line() -> None:
    aside = {}
    for offset in ("0.05", "0.0"):
        # On the kinematics alone: the IMU would show the offset.
        changes = [
            f"velocity_sensor.yaw_rate_offset={offset}",
            "brake_assist.fault_detection=false",
        ]
        run = run_fast_loop(LIBRARY.load("ice_patch_noisy", "noisy", changes))
        path = run.pose[run.brake_start :, :2] - run.pose[run.brake_start, :2]
        along = path[1] / np.linalg.norm(path[1])
        aside[offset] = float(np.max(np.abs(path @ np.array([-along[1], along[0]]))))
    assert aside["0.0"] < 0.1
    assert aside["0.05"] > 1.5 * aside["0.0"]
