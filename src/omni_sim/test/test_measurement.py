"""IMU, encoders and their faults against closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.faults import build_faults, corrupt
from omni_sim.measurement import (
    build_encoders,
    build_imu,
    read_encoders,
    read_imu,
    write_world,
)
from omni_sim.sensor_configuration import (
    CHANNELS,
    KINDS,
    EncoderConfiguration,
    FaultConfiguration,
    ImuConfiguration,
)
from omni_sim.vehicle.state import WHEEL

PERIOD, PERIOD_NS = 0.01, 10_000_000
PERFECT = dict.fromkeys(
    (
        "misalignment_deg",
        "gyro_bias",
        "gyro_noise",
        "gyro_scale",
        "bias_x",
        "bias_y",
        "noise",
        "scale",
    ),
    0.0,
)


def read(
    motions: list[FloatArray], tilt: tuple[float, float] = (0.0, 0.0), **changes: Any
) -> FloatArray:
    imu = build_imu(ImuConfiguration(**(PERFECT | changes)), PERIOD_NS)
    readings, random, row = np.empty((len(motions), 3)), np.random.default_rng(1), np.empty(6)
    for step, motion in enumerate(motions):
        write_world(motion, row)
        read_imu(imu, step * PERIOD_NS, row, tilt, random.standard_normal(3), readings[step])
    return readings


def circle(speed: float, rate: float, count: int = 50) -> list[FloatArray]:
    """A vehicle that drives forward on a circle; `base_link` is at rest in the body frame."""
    return [np.array([0.0, 0.0, rate * PERIOD * k, speed, 0.0, rate]) for k in range(count)]


def test_on_a_circle_the_force_points_to_its_center() -> None:
    readings = read(circle(3.0, 0.8))
    assert readings[:, 0] == pytest.approx(0.8)
    assert readings[1:, 1] == pytest.approx(0.0, abs=1e-4)
    assert readings[1:, 2] == pytest.approx(3.0 * 0.8, rel=1e-5)


def test_a_spinning_vehicle_is_felt_off_center_only() -> None:
    assert read(circle(0.0, 2.0), x=0.5)[1:, 1] == pytest.approx(-4.0 * 0.5, rel=1e-3)
    assert read(circle(0.0, 2.0))[1:, 1:] == pytest.approx(0.0, abs=1e-12)


def test_gravity_along_a_slope_is_felt_in_the_axes_of_the_body() -> None:
    still = [np.array([0.0, 0.0, math.pi / 2, 0.0, 0.0, 0.0])] * 5
    assert read(still, tilt=(0.1, 0.0))[:, 2] == pytest.approx(0.1 * GRAVITY)


def test_bias_noise_scale_and_latency_are_what_they_say() -> None:
    readings = read(circle(0.0, 1.0, 4000), gyro_bias=0.1, gyro_noise=0.05, gyro_scale=0.5)
    assert np.mean(readings[:, 0]) == pytest.approx(1.6, abs=0.003)
    assert np.std(readings[:, 0]) == pytest.approx(0.05, rel=0.05)
    speeding = [np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.1 * k]) for k in range(10)]
    late = read(speeding, latency=0.03)[:, 0]
    assert late == pytest.approx([0, 0, 0, 0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def test_without_a_unit_there_are_no_numbers() -> None:
    assert np.all(np.isnan(read(circle(1.0, 0.0, 2), enabled=False)))


def test_counts_lose_no_angle() -> None:
    encoders = build_encoders(EncoderConfiguration(resolution=64), 2)
    wheels, speed, total = np.zeros(2, WHEEL), np.array([3.0, -0.7]), np.zeros(2)
    wheels["speed"] = speed
    for step in range(200):
        reading = np.empty(2)
        read_encoders(encoders, step, PERIOD, wheels, np.zeros(2), reading)
        total += reading * PERIOD * (step > 0)
        wheels["angle"] += speed * PERIOD
    assert total == pytest.approx(199 * PERIOD * speed, abs=2 * math.pi / 64)


def test_perfect_encoders_read_the_speed() -> None:
    reading, wheels = np.empty(1), np.ones(1, WHEEL)
    wheels["speed"] = 2.5
    encoders = build_encoders(EncoderConfiguration(), 1)
    read_encoders(encoders, 7, PERIOD, wheels, np.zeros(1), reading)
    assert reading[0] == 2.5


def faulty_readings(
    kind: str, channel: str = "encoder", steps: int = 20, **entries: Any
) -> FloatArray:
    """Return readings of the values ``(1, 2, 3) + step / 10`` with a fault that begins at 0.1 s."""
    fault = FaultConfiguration(channel=channel, kind=kind, time=0.1, **entries)
    faults, size = build_faults({"fault": fault}, 3, PERIOD), 3
    rows, random = [], np.random.default_rng(1)
    for step in range(steps):
        values = np.arange(1.0, size + 1.0) + 0.1 * step
        draw = random.standard_normal(size)
        corrupt(faults, CHANNELS.index(channel), step, step * 10_000_000, draw, values)
        rows.append(values)
    return np.array(rows)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("offset", 2.5 + 0.5),
        ("drift", 2.5 + 0.5 * 0.05),
        ("ramp", 2.5 + 0.5 * 0.5),
        ("scale", 2.5 * 1.5),
        ("sine", 2.5 + 0.5 * math.sin(math.pi)),
        ("sign", -2.5),
        ("zero", 0.0),
        ("stuck", 2.0),
        ("stuck_noise", 2.0),
        ("delay", 1.5),
        ("swap", 3.5),
        ("echo", 0.5 * 2.5 + 0.5 * 2.0),
        ("square", 2.5 - 0.5),
        ("quantized", 2.5),
    ],
)
def test_a_fault_reads_what_its_formula_says(kind: str, expected: float) -> None:
    readings = faulty_readings(kind, amplitude=0.5, period=0.1)
    assert readings[:10, 0] == pytest.approx(1.0 + 0.1 * np.arange(10))
    assert readings[15, 0] == pytest.approx(expected, abs=1e-7)
    assert np.ptp(faulty_readings("stuck_noise")[10:, 0]) > 0.0


def test_a_square_wave_of_two_samples_changes_its_sign_at_every_reading() -> None:
    readings = faulty_readings("square", amplitude=0.5, period=0.02, axis=0)
    error = readings[10:, 0] - readings[10:, 1] + 1.0
    assert error == pytest.approx(0.5 * (-1.0) ** np.arange(error.size))


def test_a_quantized_reading_is_a_multiple_of_the_step() -> None:
    readings = faulty_readings("quantized", amplitude=0.3)[10:] / 0.3
    assert readings == pytest.approx(np.round(readings))


@pytest.mark.parametrize("delay", [0.1, 0.8, 2.5])
def test_a_delay_may_last_longer_than_a_stop(delay: float) -> None:
    steps = round(delay / PERIOD) + 30
    readings = faulty_readings("delay", steps=steps, period=delay)
    assert readings[-1, 0] == pytest.approx(1.0 + 0.1 * (steps - 1 - delay / PERIOD))


def test_a_channel_that_drops_out_reads_no_number_and_comes_back() -> None:
    readings = faulty_readings("drop_out", axis=1, duration=0.05)
    assert np.flatnonzero(np.isnan(readings[:, 1])).tolist() == [10, 11, 12, 13, 14]
    assert np.all(np.isfinite(readings[:, 0]))


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_leaves_other_channels_alone(kind: str) -> None:
    fault = FaultConfiguration(channel="gyro", kind=kind, amplitude=1.0)
    values = np.ones(3)
    corrupt(build_faults({"f": fault}, 3, PERIOD), 0, 30, 300_000_000, np.ones(3), values)
    assert values.tolist() == [1.0, 1.0, 1.0]


def test_a_wheel_that_there_is_not_is_refused_by_name() -> None:
    fault = FaultConfiguration(channel="encoder", kind="zero", axis=4)
    with pytest.raises(ConfigurationError, match=r"faults.hub.axis: 4 must be -1 to 3"):
        build_faults({"hub": fault}, 4, PERIOD)
