"""The fast loop and the loop of the cores give bit-identical results."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_histories import first_difference

from omni_brake_assist.conditions import AssistState
from omni_core.configuration import ConfigurationError
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.signals import UNMEASURED_VARIANCE, TwistSample
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.loop import run_closed_loop
from omni_runs.metrics import run_metrics
from omni_sim.velocity_sensor import VelocitySensor

CONFIG = Path(__file__).resolve().parents[3] / "config"
BLIND = ("simulation.render_lines=false", "feedback=velocity_sensor")
VALVES = (
    "brake_assist.minimum_dwell_time=0.03",
    "vehicle.brake.dead_time=0.004",
    "vehicle.brake.time_constant=0.02",
)
OUTSIDE = "brake_assist.law=omni_brake_assist.laws.sliding_mode:SlidingMode"
MONITORED = ("brake_assist.fault_detection=true",)
BARE = "imu.enabled=false"
WITHOUT_FORCE = (
    "faults={a: {channel: accelerometer, kind: drop_out, time: 1.0},"
    " b: {channel: twist, kind: offset, time: 1.3, amplitude: 1.0}}",
)
MOVED = 0.4, -0.2  # base_link from the center of the wheels [m]
TURNING = ("maneuver.yaw_rate_deg=70", "maneuver.direction_deg=30")


NOISE = (
    "velocity_sensor.sample_time=0.03",
    "velocity_sensor.linear_noise=0.02",
    "velocity_sensor.offset_x=0.05",
)


def failing(failure: str, time: float, duration: float) -> tuple[str, ...]:
    return (
        f"velocity_sensor.failure={failure}",
        f"velocity_sensor.failure_time={time}",
        f"velocity_sensor.failure_duration={duration}",
    )


def twist_fault(kind: str, amplitude: float) -> tuple[str, ...]:
    fault = f"{{channel: twist, kind: {kind}, time: 1.0, amplitude: {amplitude}}}"
    return (f"faults={{fault: {fault}}}",)


def load(experiment: str, variant: str, *overrides: str) -> ExperimentConfiguration:
    return ExperimentLibrary(CONFIG).load(experiment, variant, [*BLIND, *overrides])


@pytest.mark.parametrize(
    ("experiment", "variant", "overrides"),
    [
        ("straight_line", "unassisted", ()),
        ("straight_line", "assisted", ()),
        ("straight_line", "assisted", (*TURNING, "brake_assist.weighting=cosine")),
        ("straight_line", "assisted", (*TURNING, "maneuver.hold_world_direction=true")),
        ("straight_line", "assisted", ("maneuver.pedal_ramp_time=0.3", "maneuver.pedal=0.8")),
        ("straight_line", "assisted", ("velocity_sensor.sample_time=0.03",)),
        ("straight_line", "assisted", ("simulation.duration_limit=1.003",)),
        ("straight_line", "assisted", ("simulation.control_period=0.005",)),
        ("straight_line", "assisted", VALVES),
        ("straight_line", "assisted", ("vehicle.fork={time: [1, 2], height: [0.2, 2.5]}",)),
        ("three_wheel_diagonal", "assisted", ()),
        ("ice_patch_noisy", "noisy", ()),
        ("turn_while_translate", "k1", ()),
        # Inputs that the fail-safe rejects: too much noise, jumps, and all kinds of failures.
        ("ice_patch_noisy", "noisy", ("brake_assist.maximum_speed_deviation=0.2",)),
        ("ice_patch_noisy", "noisy", ("brake_assist.speed_noise=0.3", "seed=3")),
        ("straight_line", "assisted", (*failing("frozen", 1.0, 0.5), *TURNING)),
        ("straight_line", "assisted", (*failing("invalid", 0.9, 0.1), *TURNING)),
        ("straight_line", "assisted", (*failing("invalid", 1.1, 0.4), *TURNING)),
        ("straight_line", "assisted", (*failing("zero", 0.0, 1.0), "seed=2", *NOISE)),
        ("straight_line", "assisted", (*failing("zero", 0.803, 0.604), *NOISE)),
        # A fault that the fail-safe detects, and one with the covariance of its readings.
        ("straight_line", "assisted", (*twist_fault("drift", 0.5), *TURNING, *NOISE)),
        ("straight_line", "assisted", (*twist_fault("noise", 0.2), *TURNING)),
        # Twists without an IMU are compared only with each other.
        ("straight_line", "assisted", (*twist_fault("offset", 1.5), *TURNING, *MONITORED, BARE)),
        ("straight_line", "assisted", (*twist_fault("noise", 0.5), *TURNING, *MONITORED, BARE)),
        ("straight_line", "assisted", (*WITHOUT_FORCE, *TURNING, *MONITORED)),
        ("straight_line", "assisted", (OUTSIDE, *TURNING, *VALVES)),
    ],
)
def test_same_bits_as_the_loop_of_the_cores(
    experiment: str, variant: str, overrides: tuple[str, ...]
) -> None:
    configuration = load(experiment, variant, *overrides)
    fast = run_fast_loop(configuration)
    cores = run_closed_loop(configuration)
    assert first_difference(fast, cores) is None
    faulty = {state.value for state in AssistState if state.is_fault}
    faults = np.array([state in faulty for state in cores.assist_state])
    if configuration.brake_assist.enabled:
        braking = fast.pedal >= configuration.brake_assist.pedal_threshold
        np.testing.assert_array_equal(faults[braking], ~fast.valid[braking])
    metrics = run_metrics(cores)
    if fast.stopped:
        assert fast.orientation_change == pytest.approx(metrics["orientation_change"].value)
        assert fast.stopping_distance == metrics["stopping_distance"].value


def test_noise_is_that_of_the_seed_and_within_its_bounds() -> None:
    noisy = run_fast_loop(load("ice_patch_noisy", "noisy"))
    again = run_fast_loop(load("ice_patch_noisy", "noisy"))
    other = run_fast_loop(load("ice_patch_noisy", "noisy", "seed=2"))
    np.testing.assert_array_equal(noisy.feedback, again.feedback)
    assert not np.array_equal(noisy.feedback[:20], other.feedback[:20])
    offset = np.array([0.01, 0.01, 0.05])
    assert np.all(
        np.abs(noisy.feedback - offset - noisy.twist)
        <= 0.15 * np.abs(noisy.twist) + 1e-12  # rounding
    )


def test_a_law_from_outside_runs_like_a_built_in_one() -> None:
    outside = run_fast_loop(load("straight_line", "assisted", OUTSIDE, *TURNING))
    built_in = run_fast_loop(load("straight_line", "assisted", *TURNING))
    assert first_difference(outside, built_in) is None


def test_a_source_in_python_gives_the_bits_of_the_built_in_one() -> None:
    # The noise of the IMU is drawn again after 512 stamps.
    configuration = load("straight_line", "assisted", *TURNING, *NOISE, "maneuver.brake_time=5.0")
    seed = np.random.SeedSequence(configuration.seed).spawn(1)[0]
    sensor = VelocitySensor(configuration.velocity_sensor, np.random.default_rng(seed))
    built_in = run_fast_loop(configuration)
    own = run_fast_loop(configuration, lambda now, twist, _speeds: sensor.measure(now, twist))
    assert len(own.pedal) > 550
    assert first_difference(own, built_in) is None


@pytest.mark.parametrize("law", ["sliding_mode", "allocation"])
def test_an_unmeasured_twist_is_no_twist(law: str) -> None:
    configuration = load("turn_while_translate", "k1", f"brake_assist.law={law}")
    unknown = np.zeros(3), UNMEASURED_VARIANCE * np.eye(3)
    unmeasured = run_fast_loop(configuration, lambda now, *_: TwistSample(now, *unknown))
    silent = run_fast_loop(configuration, lambda *_: TwistSample(-SECOND_NS, *unknown))
    assert silent.enable.min() < 0.5
    assert first_difference(unmeasured, silent) is None


def test_without_a_stop_the_run_ends_at_its_limit() -> None:
    run = run_fast_loop(load("straight_line", "assisted", "simulation.duration_limit=0.8"))
    assert not run.stopped
    assert len(run.pedal) == 81
    assert run.brake_start == 50
    assert math.hypot(*run.twist[-1, :2]) > 1.0


def test_optical_feedback_is_refused() -> None:
    configuration = ExperimentLibrary(CONFIG).load("straight_line", "assisted")
    with pytest.raises(ConfigurationError, match="velocity_sensor"):
        run_fast_loop(configuration)


@pytest.mark.parametrize("law", ["sliding_mode", "allocation"])
def test_trust_holds_up_to_the_fastest_maneuver(law: str) -> None:
    configuration = load(
        "straight_line",
        "assisted",
        "feedback=velocity_sensor",
        "simulation.render_lines=false",
        "simulation.duration_limit=40",
        "maneuver.speed=50",
        f"brake_assist.law={law}",
    )
    run = run_fast_loop(configuration)
    assert run.stopped
    assert np.all(run.valid[run.brake_start :])


@pytest.mark.parametrize("law", ["sliding_mode", "allocation"])
def test_a_stop_does_not_depend_on_the_position_of_base_link(law: str) -> None:
    centered = load("straight_line", "assisted", f"brake_assist.law={law}", *TURNING)
    moved = run_fast_loop(with_base_link_elsewhere(centered))
    run = run_fast_loop(centered)
    both = slice(min(len(run.pose), len(moved.pose)))  # they rock on their tires at the end
    between = run.pose[both, :2] - moved.pose[both, :2]
    np.testing.assert_allclose(moved.pose[both, 2], run.pose[both, 2], atol=1e-6)
    np.testing.assert_allclose(np.hypot(*between.T), math.hypot(*MOVED), rtol=1e-6)
    np.testing.assert_allclose(moved.enable[both], run.enable[both], atol=1e-6)


@pytest.mark.parametrize("law", ["sliding_mode", "allocation"])
def test_a_fault_of_a_gyro_that_also_gives_the_twist_is_no_worse_than_no_assistance(
    law: str,
) -> None:
    error, onset = 0.5, 1.2  # [rad/s], [s]
    fault = f"faults={{a: {{channel: gyro, kind: offset, time: {onset}, amplitude: {error}}}}}"
    given = f"brake_assist.law={law}", "brake_assist.shared_gyro=true", "imu.enabled=true", fault
    random = np.random.default_rng(5)

    def flow_and_gyro(stamp_ns: int, true: FloatArray, _: FloatArray) -> TwistSample:
        value = true + random.normal(0.0, 0.01, 3)
        value[2] += error if stamp_ns >= onset * SECOND_NS else 0.0
        return TwistSample(stamp_ns, value, 1e-4 * np.eye(3))

    assisted = run_fast_loop(load("straight_line", "assisted", *given), flow_and_gyro)
    unassisted = run_fast_loop(load("straight_line", "unassisted"))
    assert abs(assisted.pose[-1, 2]) < abs(unassisted.pose[-1, 2])


def with_base_link_elsewhere(experiment: ExperimentConfiguration) -> ExperimentConfiguration:
    """Return an experiment with the same vehicle and motion, described about another base_link."""
    x, y = MOVED
    vehicle, imu = experiment.vehicle, experiment.imu

    def seen(part: Any) -> Any:
        return dataclasses.replace(part, x=part.x - x, y=part.y - y)

    wheels = {name: seen(wheel) for name, wheel in vehicle.wheels.items()}
    yaw_rate = math.radians(experiment.maneuver.yaw_rate_deg)
    v_x, v_y = experiment.maneuver.speed * np.array(
        [
            math.cos(math.radians(experiment.maneuver.direction_deg)),
            math.sin(math.radians(experiment.maneuver.direction_deg)),
        ]
    )
    v_x, v_y = v_x - yaw_rate * y, v_y + yaw_rate * x  # Eq. (23)
    return dataclasses.replace(
        experiment,
        vehicle=dataclasses.replace(
            vehicle,
            wheels=wheels,
            body=seen(vehicle.body),
            load=seen(vehicle.load),
            chassis_x=-x,
            chassis_y=-y,
        ),
        imu=seen(imu),
        maneuver=dataclasses.replace(
            experiment.maneuver,
            x=experiment.maneuver.x + x,
            y=experiment.maneuver.y + y,
            speed=math.hypot(v_x, v_y),
            direction_deg=math.degrees(math.atan2(v_y, v_x)),
        ),
        brake_assist=dataclasses.replace(
            experiment.brake_assist, wheels=wheels, imu_x=imu.x - x, imu_y=imu.y - y
        ),
    )
