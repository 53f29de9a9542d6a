"""Test ratio and state of each source of a vehicle that drives straight ahead."""

import math

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist, BrakeAssistConfiguration, BrakeDemand
from omni_brake_assist.conditions import ERROR, WARNING, AssistState
from omni_brake_assist.decision import Decision
from omni_brake_assist.sources import (
    BRAKED,
    FUSED,
    ISOLATED,
    LOST,
    MISSING,
    REJECTED,
    Source,
    summary,
)
from omni_platform.geometry import WheelMount
from omni_platform.kinematics import PlatformKinematics
from omni_platform.signals import ImuSample, TwistSample, WheelSample

STEP_NS = 10_000_000


def drive(
    wheels: dict[str, WheelMount],
    *,
    gyro: float = 0.0,
    force: float = 0.0,
    twist: bool = True,
    imu_until: int = 150,
    wheels_until: int = 150,
    pedal: float = 0.0,
) -> dict[str, Source]:
    """Drive at 5 m/s for a second, then for half a second with the changes; return the sources.

    IMU readings and wheel speeds are received until the steps `imu_until` and `wheels_until`.
    """
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=wheels))
    value = np.array([5.0, 0.0, 0.0])
    speeds = PlatformKinematics(wheels).wheel_speeds(value)
    for step in range(150):
        stamp_ns, late = step * STEP_NS, step >= 100
        rate, speed = (gyro, speeds * (1.0 - pedal)) if late else (0.0, speeds)
        specific_force = np.array([force if late else 0.0, 0.0])
        assist.update(
            BrakeDemand(
                stamp_ns,
                pedal if late else 0.0,
                TwistSample(stamp_ns, value, 1e-6 * np.eye(3)) if twist or not late else None,
                WheelSample(stamp_ns, speed) if step < wheels_until else None,
                ImuSample(stamp_ns, rate, specific_force) if step < imu_until else None,
            )
        )
    return {source.name: source for source in assist.sources()}


def test_consistent_sources_are_fused(mecanum: dict[str, WheelMount]) -> None:
    found = drive(mecanum)
    assert list(found) == ["twist", "gyro", "accelerometer", *mecanum]
    assert {source.state for source in found.values()} == {FUSED}
    assert all(source.test_ratio < 0.1 for source in found.values())


def test_a_gyro_off_by_half_a_radian_per_second_is_not_fused(
    mecanum: dict[str, WheelMount],
) -> None:
    gyro = drive(mecanum, gyro=0.5)["gyro"]
    assert gyro.test_ratio > 1.0
    assert gyro.state in (REJECTED, ISOLATED)
    if gyro.state == REJECTED:
        assert "sigma" in gyro.words


def test_the_twist_is_judged_by_velocity_and_yaw_rate_together(
    mecanum: dict[str, WheelMount],
) -> None:
    found = drive(mecanum, gyro=0.02, force=0.2)
    parts = found["gyro"].test_ratio, found["accelerometer"].test_ratio
    assert min(parts) > 1e-6
    assert found["twist"].test_ratio == pytest.approx(sum(parts))


def test_a_missing_source_says_so(mecanum: dict[str, WheelMount]) -> None:
    assert drive(mecanum, twist=False)["twist"].words == "lost: no_feedback"
    gyro = drive(mecanum, imu_until=0)["gyro"]
    assert gyro.state == MISSING
    assert math.isnan(gyro.test_ratio)


@pytest.mark.parametrize(
    ("state", "level"),
    [(AssistState.ASSISTING, WARNING), (AssistState.NO_EFFECT, ERROR)],
)
def test_a_lost_imu_is_reported_with_a_warning(
    mecanum: dict[str, WheelMount], state: AssistState, level: int
) -> None:
    decision = Decision(0, np.ones(4), np.zeros(4), state, "reason")
    lost = drive(mecanum, imu_until=100)
    assert lost["gyro"].state == lost["accelerometer"].state == LOST
    assert summary(decision, [*lost.values()]) == (level, "reason; lost: gyro, accelerometer")
    for found in (drive(mecanum), drive(mecanum, imu_until=0)):
        assert summary(decision, [*found.values()]) == (state.level, "reason")


def test_other_lost_sources_are_reported_with_a_warning(mecanum: dict[str, WheelMount]) -> None:
    decision = Decision(0, np.ones(4), np.zeros(4), AssistState.INACTIVE, "reason")
    for lost, found in (
        ("twist", drive(mecanum, twist=False)),
        (", ".join(mecanum), drive(mecanum, wheels_until=100)),
        (", ".join(mecanum), drive(mecanum, wheels_until=0)),
        ("gyro", drive(mecanum, gyro=math.nan)),
    ):
        assert summary(decision, [*found.values()]) == (WARNING, f"reason; lost: {lost}")


@pytest.mark.parametrize("pedal", [0.0, 1.0])
def test_a_wheel_that_is_braked_measures_nothing(
    mecanum: dict[str, WheelMount], pedal: float
) -> None:
    states = {drive(mecanum, pedal=pedal)[name].state for name in mecanum}
    assert (BRAKED in states) == (pedal > 0.0)


def test_an_isolated_source_is_reported_with_a_warning() -> None:
    decision = Decision(0, np.ones(4), np.zeros(4), AssistState.ASSISTING, "reason")
    found = [Source("twist", 0.1, FUSED), Source("gyro", 3.0, ISOLATED)]
    assert summary(decision, found) == (WARNING, "reason; isolated: gyro")
