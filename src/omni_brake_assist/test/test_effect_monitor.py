"""The monitor of the effect against the paths that it books."""

import numpy as np
import pytest

from omni_brake_assist.effect_monitor import (
    EffectConstants,
    effect_constants,
    effect_memory,
    watch_effect,
)
from omni_platform.geometry import PlatformGeometry, WheelMount

DT = 0.01
WHEELS = 4


@pytest.fixture
def constants(mecanum: dict[str, WheelMount]) -> EffectConstants:
    return effect_constants(PlatformGeometry.from_wheels(mecanum))


def trip_time(
    constants: EffectConstants, enable: float, speed: float = 30.0, seconds: float = 3.0
) -> float:
    """Return when the monitor puts all brakes on if wheels roll at a constant speed [rad/s]."""
    memory = effect_memory(WHEELS)
    speeds, told = np.full(WHEELS, speed), np.full(WHEELS, enable)
    watch_effect(constants, memory, DT, False, told, speeds)
    for step in range(1, round(seconds / DT)):
        if watch_effect(constants, memory, DT, True, told, speeds):
            return step * DT
    return np.inf


def test_a_vehicle_that_rolls_unbraked_is_braked_once_the_path_is_used_up(
    constants: EffectConstants,
) -> None:
    rim = abs(constants.roll[0]) * 30.0
    allowed = (constants.creep + constants.allowance * rim) / rim
    assert trip_time(constants, 0.0) == pytest.approx(allowed, abs=2 * DT)


def test_brakes_that_act_are_never_told_to_act(constants: EffectConstants) -> None:
    assert trip_time(constants, 1.0, seconds=20.0) == np.inf


def test_brakes_are_not_released_for_longer_than_a_modest_stop_lasts(
    constants: EffectConstants,
) -> None:
    rim = abs(constants.roll[0]) * 30.0
    due = constants.grace + rim / constants.least
    assert trip_time(constants, 0.95, seconds=due - 0.1) == np.inf
    assert trip_time(constants, 0.95, seconds=due + 0.5) == pytest.approx(due, abs=2 * DT)


def test_wheels_that_stand_miss_nothing(constants: EffectConstants) -> None:
    assert trip_time(constants, 0.0, speed=0.0, seconds=0.9) == np.inf


def test_once_exceeded_it_holds_until_the_pedal_is_released(constants: EffectConstants) -> None:
    memory = effect_memory(WHEELS)
    speeds, ones = np.full(WHEELS, 30.0), np.ones(WHEELS)
    watch_effect(constants, memory, DT, False, ones, speeds)
    told = [watch_effect(constants, memory, DT, True, 0.0 * ones, speeds) for _ in range(200)]
    assert told[-1]
    assert watch_effect(constants, memory, DT, True, ones, 0.0 * speeds)
    assert not watch_effect(constants, memory, DT, False, ones, 0.0 * speeds)
    assert not watch_effect(constants, memory, DT, True, ones, 0.0 * speeds)


def test_encoders_without_a_number_cannot_hide_a_vehicle_that_rolls(
    constants: EffectConstants,
) -> None:
    memory = effect_memory(WHEELS)
    speeds, none = np.full(WHEELS, 30.0), np.full(WHEELS, np.nan)
    watch_effect(constants, memory, DT, False, none, speeds)
    told = [watch_effect(constants, memory, DT, True, np.zeros(WHEELS), none) for _ in range(300)]
    assert any(told)
