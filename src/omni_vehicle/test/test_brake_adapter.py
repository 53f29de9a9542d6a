"""The brake adapter brakes fully if any input is missing, and a drive never accelerates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike

from omni_core.brakes import ON_OFF, PROPORTIONAL, SPRING, TORQUE, TYPICAL, VELOCITY
from omni_core.configuration import ConfigurationError
from omni_vehicle.brake_adapter import (
    BrakeAdapter,
    BrakeAdapterConfiguration,
    WheelDemand,
    is_silent,
)

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
DT = 0.01


def adapter(kind: str, **changes: float) -> BrakeAdapter:
    return BrakeAdapter(BrakeAdapterConfiguration(wheels=WHEELS, kind=kind, **changes))


def demand(
    pedal: float, enable: ArrayLike, speed: ArrayLike = 10.0, drive: ArrayLike = 0.0
) -> WheelDemand:
    rows = (np.broadcast_to(np.asarray(v, np.float64), 4).copy() for v in (enable, speed, drive))
    return WheelDemand(pedal, *rows)


@pytest.mark.parametrize("period", [0.001, 0.01, 0.025])
def test_the_brakes_are_on_when_the_timeout_has_passed(period: float) -> None:
    timeout = 0.05
    for phase in np.linspace(0.0, period, 11):  # time from the last message to the next step
        ages = phase + period * np.arange(100)
        reaction = next(age for age in ages if is_silent(age, timeout, period))
        assert timeout - 2.0 * period - 1e-9 <= reaction <= timeout + 1e-9


@pytest.mark.parametrize("pedal", [math.nan, -1.0, 2.0, math.inf, 1.0])
@pytest.mark.parametrize("enable", [math.nan, -0.1, 1.1, 1.0])
def test_what_makes_no_sense_is_full_braking(pedal: float, enable: float) -> None:
    for kind in TYPICAL:
        given = adapter(kind, minimum_dwell_time=0.0)
        given.step(demand(0.0, 0.0), DT)
        command = given.step(demand(pedal, enable), DT)
        if kind == SPRING:
            assert not command.any()  # coils without current
        elif kind in (ON_OFF, PROPORTIONAL):
            assert np.all(command == 1.0)
        elif kind == TORQUE:
            assert np.all(command == -given.configuration.max_torque)
        else:
            assert np.all(command < 10.0)


def test_a_torque_never_drives() -> None:
    rng = np.random.default_rng(4)
    given = adapter(TORQUE)
    for _ in range(500):
        speed = rng.normal(0.0, 2.0, 4)
        command = given.step(demand(rng.uniform(0.01, 1.0), rng.uniform(0, 1, 4), speed), DT)
        assert np.all(command * speed <= 0.0)
        assert np.all(np.abs(command) <= given.configuration.max_torque)
    # A wheel at rest, or with unknown speed, gets no torque, as its sign would be a guess.
    assert not given.step(demand(1.0, 1.0, [0.0, math.nan, 0.0, math.nan]), DT).any()


def test_a_speed_command_falls_along_its_ramp_and_follows_a_released_wheel() -> None:
    given = adapter(VELOCITY, ramp=100.0)
    given.step(demand(0.0, 1.0, [10.0, -10.0, 10.0, 10.0]), DT)
    enable = [1.0, 1.0, 0.5, 0.0]
    for step in range(1, 12):
        command = given.step(demand(1.0, enable, [8.0, -8.0, 8.0, 7.0]), DT)
        falling = max(10.0 - step, 0.0)
        np.testing.assert_allclose(command, [falling, -falling, 10.0 - 0.5 * step, 7.0], atol=1e-9)


def test_a_speed_command_falls_along_its_ramp_even_if_the_speed_is_unknown() -> None:
    given = adapter(VELOCITY, ramp=100.0)
    given.step(demand(0.0, 1.0, 39.0, 40.0), DT)
    speed = np.array([39.0, math.nan, math.nan, math.nan])
    given.step(demand(0.0, 1.0, speed, [40.0, 40.0, -40.0, math.nan]), DT)
    enable = [1.0, 1.0, 0.0, 1.0]  # a wheel of unknown speed cannot be commanded its own speed
    for step in range(1, 5):
        command = given.step(demand(0.5, enable, speed), DT)
        falling = 0.5 * step
        np.testing.assert_allclose(command, [39.0 - falling, 40.0 - falling, falling - 40.0, 0.0])


@pytest.mark.parametrize("kind", [TORQUE, VELOCITY])
def test_the_drive_command_passes_without_a_braking_demand(kind: str) -> None:
    command = adapter(kind).step(demand(0.0, 1.0, 3.0, [1.0, 2.0, 3.0, math.nan]), DT)
    np.testing.assert_array_equal(command, [1.0, 2.0, 3.0, 0.0])


def test_a_spring_brake_is_applied_at_once_and_released_after_its_dwell() -> None:
    given = adapter(SPRING, minimum_dwell_time=0.1)
    for _ in range(20):
        given.step(demand(0.0, 0.0), DT)
    assert given.step(demand(0.0, 0.0), DT).all()
    assert not given.step(demand(1.0, 1.0), DT).any()
    released_after = 0
    while not given.step(demand(1.0, 0.0), DT).all():
        released_after += 1
    assert released_after == pytest.approx(0.1 / DT, abs=1)


@pytest.mark.parametrize("wheels", [(), ("a", "a")])
def test_wheels_are_named_once(wheels: tuple[str, ...]) -> None:
    with pytest.raises(ConfigurationError, match="every wheel once"):
        BrakeAdapterConfiguration(wheels=wheels)
