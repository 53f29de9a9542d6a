"""Wheel speeds that no wheel can have, and unusual ones that a wheel can have."""

from collections.abc import Callable

import numpy as np
import pytest

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.monitors.brake_monitor import BrakedWheels, brake_constants
from omni_brake_assist.monitors.wheel_monitor import (
    REFUTED,
    SUPPORTED,
    watch_wheels,
    wheel_memory,
)
from omni_platform.geometry import PlatformGeometry, WheelMount

STEP = 0.01  # [s]


def rejected(
    mounts: dict[str, WheelMount],
    speed: Callable[[float, float], float],
    released: bool,
    *,
    seconds: float = 1.0,
) -> bool:
    """Brake from 8 m/s with 4 m/s^2; return whether the first wheel is rejected in the end.

    Args:
        mounts: of four wheels.
        speed: of the first wheel [rad/s], by time [s] and its speed if it rolled [rad/s].
        released: whether its brake is released.
        seconds: for which the pedal is down.
    """
    geometry = PlatformGeometry.from_wheels(mounts)
    constants = brake_constants(BrakeAssistConfiguration(wheels=mounts), geometry)
    memory, law_speeds = wheel_memory(4), np.empty(4)
    commanded = np.array([0.0 if released else 1.0, 1.0, 1.0, 1.0])
    for k in range(round(seconds / STEP)):
        v = 8.0 - 4.0 * k * STEP
        rolling = v * constants.n_x / constants.roll
        speeds = 0.9 * rolling
        speeds[0] = speed(k * STEP, float(rolling[0]))
        law_speeds[:] = speeds
        wheels = BrakedWheels(commanded, speeds, 0.0)
        found = watch_wheels(constants, memory, STEP, 1.0, wheels, (v, 0.0, 0.0), law_speeds)
        assert found != REFUTED
        assert not np.isnan(law_speeds[1:]).any()
    return bool(np.isnan(law_speeds[0]))


@pytest.mark.safety(
    "the stop is longer or turns more",
    "an encoder that reads nothing, too little, too much, or backwards, under `allocation`",
    "wheel monitor: the speed is physically impossible and is not passed to the law",
    within=0.3,
)
@pytest.mark.parametrize(
    ("speed", "released"),
    [
        (lambda _t, _rolling: 0.0, True),
        (lambda _t, rolling: rolling - 6.0, True),
        (lambda _t, _rolling: 20.0, True),
        (lambda _t, rolling: -rolling, False),
        (lambda _t, rolling: rolling + 6.0, False),
    ],
)
def test_an_impossible_wheel_speed_is_withheld(
    mecanum: dict[str, WheelMount], speed: Callable[[float, float], float], released: bool
) -> None:
    assert rejected(mecanum, speed, released, seconds=0.3)


@pytest.mark.parametrize(
    ("speed", "released"),
    [
        (lambda _t, _rolling: 0.0, False),  # locked
        (lambda _t, rolling: rolling, False),  # no brake, or a weak one
        (lambda t, rolling: min(3.0 + 12.0 * t, rolling), True),  # gains, on ice of 0.02
        (lambda t, rolling: rolling + (1.2 if t < 0.15 else 0.0), True),  # the tire springs back
    ],
)
def test_a_possible_wheel_speed_is_used(
    mecanum: dict[str, WheelMount], speed: Callable[[float, float], float], released: bool
) -> None:
    assert not rejected(mecanum, speed, released)


@pytest.mark.safety(
    "the stop is longer or turns more",
    "a fault that twist and IMU share",
    "wheel monitor: two wheels contradict the estimate; all brakes on",
    within=0.15,
)
def test_two_wheels_contradict_the_estimate(mecanum: dict[str, WheelMount], within: float) -> None:
    """The vehicle moves ahead at 5 m/s and brakes with all wheels; the twist is 60 % of it."""
    geometry = PlatformGeometry.from_wheels(mecanum)
    constants = brake_constants(BrakeAssistConfiguration(wheels=mecanum), geometry)
    memory, law_speeds = wheel_memory(4), np.empty(4)
    speeds = 0.9 * 5.0 * constants.n_x / constants.roll
    wheels, found = BrakedWheels(np.ones(4), speeds, 0.0), []
    for _ in range(round(within / STEP)):
        law_speeds[:] = speeds
        twist = (3.0, 0.0, 0.0)
        found.append(watch_wheels(constants, memory, STEP, 1.0, wheels, twist, law_speeds))
    assert found[0] == SUPPORTED
    assert found[-1] == REFUTED
