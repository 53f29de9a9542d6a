"""Brakes estimated from stops of a vehicle whose brakes only the test knows."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.recorded_run import Stream, read_streams
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.brakes import data as brake_data
from omni_tools.brakes.data import BrakeData, BrakeDataError, read_brake_data
from omni_tools.brakes.fit import fit_brakes

CONFIG = Path(__file__).parents[4] / "config"


def stop(
    torque: float, dead_time: float, time_constant: float, variant: str, *more: str
) -> tuple[BrakeData, VehicleConfiguration]:
    """Return the data of a simulated stop, and the vehicle with wrong parameters of the brakes."""
    brake = {"max_torque": torque, "dead_time": dead_time, "time_constant": time_constant}
    overrides = [f"vehicle.brake.{key}={value}" for key, value in brake.items()]
    overrides += ["feedback=velocity_sensor", *more]
    configuration = ExperimentLibrary(CONFIG).load("straight_line", variant, overrides)
    history = run_fast_loop(configuration)
    time = np.asarray(1e-9 * history.stamp_ns, dtype=np.float64)
    enable = np.where(np.isfinite(history.enable), history.enable >= 0.5, True)
    command = history.pedal[:, np.newaxis] * enable
    data = BrakeData(time, history.twist, history.wheel_speed, time, command)
    unknown = dataclasses.replace(configuration.vehicle.brake, max_torque=1.0, dead_time=0.5)
    return data, dataclasses.replace(configuration.vehicle, brake=unknown)


def unmeasured() -> SimpleNamespace:
    """Return a `TwistWithCovariance` without any measured component."""
    zero = SimpleNamespace(x=0.0, y=0.0, z=0.0)
    twist = SimpleNamespace(linear=zero, angular=zero)
    return SimpleNamespace(twist=twist, covariance=1e6 * np.eye(6).ravel())


def noisy(data: BrakeData, seed: int, size: float = 0.01) -> BrakeData:
    """Return the stop with noise of the twist: `size` [m/s], and half of this number in rad/s."""
    noise = np.random.default_rng(seed).normal(0.0, size, data.twist.shape)
    return data._replace(twist=data.twist + noise * [1.0, 1.0, 0.5])


@pytest.mark.parametrize(
    ("torque", "dead_time", "time_constant", "variant", "more"),
    [
        (1500.0, 0.02, 0.05, "unassisted", ("maneuver.pedal=0.05",)),
        (800.0, 0.03, 0.04, "unassisted", ("maneuver.pedal=0.2",)),
        (1500.0, 0.02, 0.05, "assisted", ()),  # valves that open and close at full pedal
        (400.0, 0.01, 0.03, "unassisted", ("maneuver.pedal=0.3", "maneuver.direction_deg=40")),
        (800.0, 0.03, 0.04, "unassisted", ("maneuver.pedal=0.5",)),
    ],
)
def test_hidden_brakes_are_found(
    torque: float, dead_time: float, time_constant: float, variant: str, more: tuple[str, ...]
) -> None:
    data, vehicle = stop(torque, dead_time, time_constant, variant, *more)
    fit = fit_brakes([data], vehicle)
    assert fit.values[0] == pytest.approx(torque, rel=5e-3)
    assert abs(fit.values[0] - torque) < 3.0 * fit.standard_errors[0]  # the radii change
    np.testing.assert_allclose(fit.values[1:], (dead_time, time_constant), atol=1e-3)
    seen = np.isfinite(fit.wheel_torque)
    np.testing.assert_allclose(fit.wheel_torque[seen], torque, rtol=1e-2)


def test_unmeasured_twists_are_left_out() -> None:
    """The odometry has measured nothing before its first two batches."""
    brake = ExperimentLibrary(CONFIG).load("small_stop", "assisted").vehicle.brake
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    measured, true = (
        read_brake_data(CONFIG.parent / "bags/small_stop/assisted", wheels, brake, topic)
        for topic in ("odometry/twist", "ground_truth/odom")
    )
    row = np.searchsorted(true.time, measured.time[0])
    np.testing.assert_allclose(measured.twist[0], true.twist[row], atol=0.05)


@pytest.mark.parametrize(
    ("topic", "empty", "words"),
    [
        ("odometry/twist", {"twist": unmeasured()}, "no message on odometry/twist has a measured"),
        ("brake/pedal", {"position": ()}, "a message on brake/pedal has no finite demand"),
    ],
)
def test_a_recording_without_twist_or_demand_is_refused(
    topic: str, empty: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spoilt(*arguments: Any) -> dict[str, Stream]:
        streams = read_streams(*arguments)
        messages = (SimpleNamespace(**empty),) * len(streams[topic].messages)
        return streams | {topic: Stream(streams[topic].stamp_ns, messages)}

    monkeypatch.setattr(brake_data, "read_streams", spoilt)
    brake = ExperimentLibrary(CONFIG).load("small_stop", "assisted").vehicle.brake
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    with pytest.raises(BrakeDataError, match=words):
        read_brake_data(CONFIG.parent / "bags/small_stop/assisted", wheels, brake, "odometry/twist")


def test_noise_shows_in_the_standard_errors() -> None:
    truth = (800.0, 0.03, 0.04)
    data, vehicle = stop(*truth, "unassisted", "maneuver.pedal=0.2")
    fits = [fit_brakes([noisy(data, seed)], vehicle) for seed in range(8)]
    wrong = np.array([(fit.values - truth) / fit.standard_errors for fit in fits])
    assert np.all(np.abs(wrong) < 5.0)
    # Nor are they padded; that of the torque is mostly of the radii.
    assert np.all(np.sqrt(np.mean(wrong**2, axis=0)) > (0.1, 0.2, 0.2))
    more = fit_brakes([noisy(data, seed) for seed in range(4)], vehicle)
    assert np.all(more.standard_errors < fits[0].standard_errors)


def test_most_hidden_brakes_are_within_two_standard_errors() -> None:
    random = np.random.default_rng(1)
    wrong = []
    for seed in range(12):
        torque, dead_time = random.uniform(300.0, 2000.0), random.uniform(0.005, 0.06)
        truth = (torque, dead_time, random.uniform(0.01, 0.1))
        lightly = f"maneuver.pedal={min(random.uniform(60.0, 300.0) / torque, 1.0)}"
        kind = ("assisted",) if seed % 3 == 0 else ("unassisted", lightly)
        data, vehicle = stop(*truth, *kind, f"maneuver.speed={random.uniform(4.0, 10.0)}")
        fit = fit_brakes([noisy(data, seed)], vehicle)
        wrong.append((fit.values - truth) / fit.standard_errors)
    assert np.mean(np.abs(wrong) < 2.0) > 0.8


def test_wheels_that_lock_at_once_say_so_little_that_the_fit_is_refused() -> None:
    data, vehicle = stop(1500.0, 0.0, 0.0, "unassisted")
    with pytest.raises(BrakeDataError, match="brake with less pedal"):
        fit_brakes([data], vehicle)


def on_blocks(torque: float, dead_time: float, tau: float, start: float) -> BrakeData:
    """Return the data of a vehicle on blocks, whose wheels turn at 20 rad/s until it brakes."""
    vehicle = ExperimentLibrary(CONFIG).vehicle("mecanum_forklift")
    fine, wheels = np.arange(0.0, 1.0, 1e-4), len(vehicle.wheels)
    since = np.maximum(fine - start - dead_time, 0.0)
    braked = torque / vehicle.wheel_inertia * (since + tau * np.expm1(-since / tau))
    speed = np.maximum(20.0 - braked, 0.0)[::100, np.newaxis] * np.ones(wheels)
    command = np.array([[0.0], [1.0]]) * np.ones(wheels)
    return BrakeData(fine[::100], np.zeros((len(speed), 3)), speed, np.array([0.0, start]), command)


def test_brakes_are_found_on_blocks_from_some_applications() -> None:
    vehicle = ExperimentLibrary(CONFIG).vehicle("mecanum_forklift")
    truth = (20.0 * vehicle.wheel_inertia / 0.03, 0.06, 0.01)
    applied = [on_blocks(*truth, 0.3 + 0.0037 * number) for number in range(5)]
    fit = fit_brakes(applied, vehicle)
    assert fit.values[0] == pytest.approx(truth[0], rel=0.05)
    np.testing.assert_allclose(fit.values[1:], truth[1:], atol=2e-3)
    with pytest.raises(BrakeDataError, match="at least 10 are needed"):
        fit_brakes(applied[:1], vehicle)
