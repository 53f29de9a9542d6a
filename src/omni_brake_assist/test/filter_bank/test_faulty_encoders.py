"""Encoders whose readings a rolling or sliding wheel can, or cannot, have."""

from collections.abc import Callable

import numpy as np
import pytest

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.filter_bank.bank import estimate
from omni_brake_assist.filter_bank.state import (
    ALL,
    UNKNOWN_LAG,
    Readings,
    bank_constants,
    bank_memory,
)
from omni_core.brakes import BrakeConfiguration
from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.signals import TwistSample

PERIOD_NS = 10_000_000
STEP = 0.01  # [s]
DIRECT = BrakeConfiguration()  # on-off valves without delay
PEDAL, START, BRAKE = 50, 8.0, 4.0  # step; [m/s], [m/s^2]


def isolated_encoder(
    mounts: dict[str, WheelMount],
    speed: Callable[[float, float], float],
    enable: float,
    *,
    seconds: float = 1.0,
    change: float = 0.0,
    brake: BrakeConfiguration = DIRECT,
    lag: float | None = None,
) -> bool:
    """Brake from 8 m/s with 4 m/s^2; return whether the first encoder is isolated at the end.

    Args:
        mounts: mounts of four wheels.
        speed: speed of the first wheel [rad/s] as a function of time [s] and rolling speed [rad/s].
        enable: brake command of this wheel from the time `change` on; before, it is 1.
        seconds: time for which the pedal is down [s].
        change: time at which the brake command of the first wheel changes [s].
        brake: brake of each wheel.
        lag: dead time of the brakes that `allocation` estimates, in excess of the configured one
            [s]. This law requires the torque of the brakes and the wheels' inertia. If it is None,
            the law is `sliding_mode`.
    """
    law = "sliding_mode" if lag is None else "allocation"
    configuration = BrakeAssistConfiguration(wheels=mounts, brake=brake, law=law)
    constants = bank_constants(configuration, PlatformGeometry.from_wheels(mounts))
    memory, answer = bank_memory(constants), np.empty(3)
    for k in range(-PEDAL, round(seconds / STEP)):
        time = max(k * STEP, 0.0)
        v, braking = START - BRAKE * time, k >= 0
        rolling = v * constants.n_x / constants.roll
        speeds = 0.9 * rolling if braking else rolling.copy()
        if braking:
            speeds[0] = speed(time, float(rolling[0]))
        estimate(
            constants,
            memory,
            (k + PEDAL) * PERIOD_NS,
            Readings(
                1.0 if braking else 0.0,
                np.array([enable if time >= change else 1.0, 1.0, 1.0, 1.0]),
                np.array([0.0, -BRAKE if k > 0 else 0.0, 0.0]),
                speeds,
                lag=UNKNOWN_LAG if lag is None else lag,
            ),
            TwistSample((k + PEDAL) * PERIOD_NS, np.array([v, 0.0, 0.0]), 1e-6 * np.eye(3)),
            answer,
        )
        assert memory.record[0]["best"] == ALL
        assert np.all(memory.faulty[ALL, 1:] < 0.5)
    return bool(memory.faulty[ALL, 0] > 0.5)


@pytest.mark.safety(
    "the stop is longer or rotates more",
    "an encoder reads nothing, too little, too much, or backwards, with the law `allocation`",
    "fault isolation: no wheel can have this speed, so the law does not receive the speed",
    within=0.3,
)
@pytest.mark.parametrize(
    ("speed", "enable"),
    [
        (lambda _t, _rolling: 0.0, 0.0),
        (lambda _t, rolling: rolling - 6.0, 0.0),
        (lambda _t, _rolling: 20.0, 0.0),
        (lambda _t, rolling: -rolling, 1.0),
        (lambda _t, rolling: rolling + 6.0, 1.0),
    ],
)
def test_an_impossible_wheel_speed_is_isolated(
    mecanum: dict[str, WheelMount],
    speed: Callable[[float, float], float],
    enable: float,
    within: float,
) -> None:
    assert isolated_encoder(mecanum, speed, enable, seconds=within)


@pytest.mark.parametrize(
    ("speed", "enable"),
    [
        (lambda _t, _rolling: 0.0, 1.0),  # locked
        (lambda _t, rolling: rolling, 1.0),  # no brake, or a weak one
        (lambda t, rolling: min(3.0 + 12.0 * t, rolling), 0.0),  # gains, on ice of 0.02
        (lambda t, rolling: min(8.0 + 60.0 * abs(t - 0.1), rolling), 0.0),  # the brake acts late
        (lambda t, rolling: rolling + (1.2 if t < 0.15 else 0.0), 0.0),  # the tire springs back
    ],
)
def test_a_possible_wheel_speed_is_used(
    mecanum: dict[str, WheelMount], speed: Callable[[float, float], float], enable: float
) -> None:
    assert not isolated_encoder(mecanum, speed, enable, change=STEP)


def test_a_wheel_that_its_drive_pushes_is_no_faulty_encoder(mecanum: dict[str, WheelMount]) -> None:
    def slower(time: float, rolling: float) -> float:  # than the vehicle slows down
        return rolling + 5.0 * time

    assert isolated_encoder(mecanum, slower, 1.0)
    assert not isolated_encoder(mecanum, slower, 1.0, brake=BrakeConfiguration(kind="velocity"))


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_wheel_of_a_drive_is_judged_from_its_first_reading_in_a_stop(
    mecanum: dict[str, WheelMount], sense: float
) -> None:
    def speed(time: float, rolling: float) -> float:
        return sense * rolling if time > 0.1 else np.nan

    drive = BrakeConfiguration(kind="velocity")
    assert isolated_encoder(mecanum, speed, 1.0, brake=drive) == (sense < 0.0)


@pytest.mark.safety(
    "the stop is longer or rotates more",
    "an encoder of a released wheel reads 0, with `allocation` and brakes that act at once",
    "fault isolation: no brake holds the wheel for longer than its estimated lag",
    within=0.15,
)
@pytest.mark.parametrize(("lag", "isolated"), [(0.0, True), (UNKNOWN_LAG, False)])
def test_an_encoder_that_reads_0_is_isolated_after_the_estimated_lag(
    mecanum: dict[str, WheelMount], lag: float, isolated: bool, within: float
) -> None:
    faulty = isolated_encoder(
        mecanum,
        lambda _t, _rolling: 0.0,
        0.0,
        seconds=within,
        change=0.02,
        lag=lag,
    )
    assert faulty is isolated


def test_a_wheel_that_a_lagging_brake_holds_is_no_faulty_encoder(
    mecanum: dict[str, WheelMount],
) -> None:
    def speed(time: float, rolling: float) -> float:
        return 0.0 if time < 0.12 else min(100.0 * (time - 0.12), rolling)

    assert not isolated_encoder(mecanum, speed, 0.0, seconds=0.4, change=0.02, lag=0.09)


def test_a_released_wheel_does_not_slip_more_again(mecanum: dict[str, WheelMount]) -> None:
    """The encoder gives the speed of another wheel, whose slip is controlled."""

    def speed(time: float, rolling: float) -> float:
        return (0.25 + 0.05 * float(np.sin(20.0 * np.pi * time))) * rolling

    assert isolated_encoder(mecanum, speed, 0.0, seconds=0.6, change=STEP)


def test_a_wheel_whose_brake_releases_late_is_no_faulty_encoder(
    mecanum: dict[str, WheelMount],
) -> None:
    brake = BrakeConfiguration(dead_time=0.06, release_time=0.2)

    assert not isolated_encoder(
        mecanum, lambda _t, _rolling: 0.0, 0.0, seconds=0.3, change=0.1, brake=brake
    )


@pytest.mark.parametrize(("slip", "isolated"), [(0.25, True), (0.1, False)])
def test_the_slip_of_a_wheel_falls_at_least_as_much_as_its_brake_torque(
    mecanum: dict[str, WheelMount], slip: float, isolated: bool
) -> None:
    def speed(time: float, rolling: float) -> float:
        return (0.75 if time < 0.2 else 1.0 - slip) * rolling

    assert isolated_encoder(mecanum, speed, 0.4, seconds=0.6, change=0.2) is isolated


def test_a_slip_that_falls_slowly_must_also_fall_as_much_as_the_brake_torque(
    mecanum: dict[str, WheelMount],
) -> None:
    """The encoder reads 25 % too little; its wheel has a slip of 13 % at first, and rolls later."""

    def speed(time: float, rolling: float) -> float:
        return (0.65 + 0.1 * float(np.clip(10.0 * (time - 0.2), 0.0, 1.0))) * rolling

    assert isolated_encoder(mecanum, speed, 0.2, seconds=0.8, change=0.2)


@pytest.mark.safety(
    "the stop is longer or rotates more",
    "an encoder of a braked wheel reads 0 from one reading to the next, with the law `allocation`",
    "fault isolation: the torque of the brake cannot lock the wheel so quickly",
    within=0.1,
)
@pytest.mark.parametrize(("lag", "isolated"), [(UNKNOWN_LAG, True), (None, False)])
def test_a_wheel_that_stops_faster_than_its_brake_can_stop_it_is_isolated(
    mecanum: dict[str, WheelMount], lag: float | None, isolated: bool, within: float
) -> None:
    """The configuration of the law `sliding_mode` need not describe the brakes."""

    def speed(time: float, rolling: float) -> float:
        return 0.9 * rolling if time < 0.2 else 0.0

    seconds = 0.2 + within
    assert isolated_encoder(mecanum, speed, 0.1, seconds=seconds, lag=lag) is isolated


def test_a_wheel_that_its_brake_locks_is_no_faulty_encoder(mecanum: dict[str, WheelMount]) -> None:
    """A tenth of the largest torque, 2000 N m, slows a wheel of 1 kg m^2 down by 200 rad/s^2."""

    def speed(time: float, rolling: float) -> float:
        return max(0.9 * rolling - 200.0 * max(time - 0.2, 0.0), 0.0)

    assert not isolated_encoder(mecanum, speed, 0.1, seconds=0.8, lag=UNKNOWN_LAG)
