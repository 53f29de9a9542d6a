"""Wheels that cannot be as they say, and such that can though it looks odd."""

from collections.abc import Callable

import numpy as np
import pytest

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.monitors.brake_monitor import BrakedWheels, brake_constants
from omni_brake_assist.monitors.wheel_monitor import watch_wheels, wheel_memory
from omni_platform.geometry import PlatformGeometry, WheelMount

STEP = 0.01  # [s]


def rejected(
    mounts: dict[str, WheelMount],
    speed: Callable[[float, float], float],
    released: bool,
    *,
    seconds: float = 1.0,
) -> bool:
    """Brake from 8 m/s with 4 m/s^2; return whether the first wheel is not believed in the end.

    Args:
        mounts: of four wheels.
        speed: of the first wheel [rad/s], by time [s] and its speed if it rolled [rad/s].
        released: whether its brake is let go.
        seconds: for which the pedal is down.
    """
    geometry = PlatformGeometry.from_wheels(mounts)
    constants = brake_constants(BrakeAssistConfiguration(wheels=mounts), geometry)
    memory, heard = wheel_memory(4), np.empty(4)
    told = np.array([0.0 if released else 1.0, 1.0, 1.0, 1.0])
    for k in range(round(seconds / STEP)):
        v = 8.0 - 4.0 * k * STEP
        rolling = v * constants.n_x / constants.roll
        speeds = 0.9 * rolling
        speeds[0] = speed(k * STEP, float(rolling[0]))
        heard[:] = speeds
        wheels = BrakedWheels(told, speeds, 0.0)
        watch_wheels(constants, memory, STEP, 1.0, wheels, (v, 0.0, 0.0), heard)
        assert not np.isnan(heard[1:]).any()
    return bool(np.isnan(heard[0]))


@pytest.mark.safety(
    "the stop is longer or turns more",
    "an encoder that reads nothing, too little, too much, or backwards, under `allocation`",
    "monitor of the wheels: no wheel can have that speed; it is withheld from the law",
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
def test_a_wheel_that_may_be_so_is_heard(
    mecanum: dict[str, WheelMount], speed: Callable[[float, float], float], released: bool
) -> None:
    assert not rejected(mecanum, speed, released)
