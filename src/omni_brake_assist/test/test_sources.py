"""Test ratio and state of each source of a vehicle that drives straight ahead."""

import math

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import ERROR, OK, WARNING, AssistState, Decision
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.sources import (
    BRAKED,
    FUSED,
    ISOLATED,
    LOST,
    MISSING,
    REFUSED,
    REJECTED,
    ReceivedRate,
    RejectionTimers,
    Source,
    summary,
)
from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_core.signals import ImuSample, TwistSample, WheelSample

STEP_NS = 10_000_000
ONES = np.ones(4)
NO_READING = "no plausible reading: check driver, wiring and unit"


def drive(
    wheels: dict[str, WheelMount],
    *,
    gyro: float = 0.0,
    force: float = 0.0,
    twist: float | None = 1.0,
    until: tuple[int, int] = (150, 150),
    pedal: float = 0.0,
    factor: FloatArray = ONES,
) -> dict[str, Source]:
    """Drive at 5 m/s for a second, then for half a second with the changes; return the sources.

    The twist is multiplied by `twist`, or lost if that is None, and the wheel speeds are multiplied
    by `factor`. IMU readings and wheel speeds are received until the steps `until`.
    """
    assist, timers = BrakeAssist(BrakeAssistConfiguration(wheels=wheels)), RejectionTimers()
    found: tuple[Source, ...] = ()
    value = np.array([5.0, 0.0, 0.0])
    reading = value * (1.0 if twist is None else twist)
    speeds = PlatformKinematics(wheels).wheel_speeds(value) * factor
    for step in range(150):
        stamp_ns, late = step * STEP_NS, step >= 100
        rate, speed = (gyro, speeds * (1.0 - pedal)) if late else (0.0, speeds)
        specific_force = np.array([force if late else 0.0, 0.0])
        assist.update(
            BrakeDemand(
                stamp_ns,
                pedal if late else 0.0,
                None
                if twist is None and late
                else TwistSample(stamp_ns, reading, 1e-6 * np.eye(3)),
                WheelSample(stamp_ns, speed) if step < until[1] else None,
                ImuSample(stamp_ns, rate, specific_force) if step < until[0] else None,
            )
        )
        found = timers.update(stamp_ns, assist.sources())
    return {source.name: source for source in found}


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
    assert drive(mecanum, twist=None)["twist"].words == "lost: no_feedback"
    gyro = drive(mecanum, until=(0, 150))["gyro"]
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
    lost = drive(mecanum, until=(100, 150))
    assert lost["gyro"].state == lost["accelerometer"].state == LOST
    words = f"reason; lost: gyro, accelerometer: {NO_READING}"
    assert summary(decision, [*lost.values()]) == (level, words)
    for found in (drive(mecanum), drive(mecanum, until=(0, 150))):
        assert summary(decision, [*found.values()]) == (state.level, "reason")


def test_other_lost_sources_are_reported_with_a_warning(mecanum: dict[str, WheelMount]) -> None:
    decision = Decision(0, np.ones(4), np.zeros(4), AssistState.INACTIVE, "reason")
    for lost, found in (
        ("twist (no_feedback)", drive(mecanum, twist=None)),
        (", ".join(mecanum), drive(mecanum, until=(150, 100))),
        (", ".join(mecanum), drive(mecanum, until=(150, 0))),
        ("gyro", drive(mecanum, gyro=math.nan)),
        ("front_left", drive(mecanum, factor=np.array([1.0, math.nan, 1.0, 1.0]))),
    ):
        words = f"reason; lost: {lost}: {NO_READING}"
        assert summary(decision, [*found.values()]) == (WARNING, words)


@pytest.mark.parametrize("pedal", [0.0, 1.0])
def test_a_wheel_that_is_braked_measures_nothing(
    mecanum: dict[str, WheelMount], pedal: float
) -> None:
    states = {drive(mecanum, pedal=pedal)[name].state for name in mecanum}
    assert (BRAKED in states) == (pedal > 0.0)


def test_an_isolated_source_is_reported_with_a_warning() -> None:
    decision = Decision(0, np.ones(4), np.zeros(4), AssistState.ASSISTING, "reason")
    found = [Source("twist", 0.1, FUSED), Source("gyro", 3.0, ISOLATED)]
    words = "reason; isolated: gyro: check unit, sign and mounting"
    assert summary(decision, found) == (WARNING, words)


@pytest.mark.parametrize(
    ("twist", "factor", "words"),
    [
        (3.6, 1.0, "twist 18.00, 0.00 m/s, 0.00 rad/s; wheels 5.00, "),
        (1.0, -1.0, "twist 5.00, 0.00 m/s, 0.00 rad/s; wheels -5.00, "),
    ],
)
def test_twist_and_wheels_that_disagree_in_a_drive_are_reported_with_their_values(
    mecanum: dict[str, WheelMount], twist: float, factor: float, words: str
) -> None:
    decision = Decision(0, np.ones(4), np.zeros(4), AssistState.INACTIVE, "reason")
    level, text = summary(
        decision, [*drive(mecanum, twist=twist, factor=np.array(factor)).values()]
    )
    assert level == WARNING
    assert text.startswith(f"reason; isolated: twist ({words}")
    assert text.endswith("check unit, sign and mounting")


@pytest.mark.parametrize(("twist", "state"), [(1.0, FUSED), (20.0, REFUSED)])
def test_a_twist_that_is_rejected_for_long_is_reported_with_a_warning(
    mecanum: dict[str, WheelMount], twist: float, state: str
) -> None:
    decision = Decision(0, np.ones(4), np.zeros(4), AssistState.INACTIVE, "reason")
    found = drive(mecanum, twist=twist)
    assert found["twist"].state == state
    assert summary(decision, [found["twist"]])[0] == (WARNING if state == REFUSED else OK)


def test_a_twist_in_another_frame_is_rejected_with_this_reason(
    mecanum: dict[str, WheelMount],
) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum))
    unusable = TwistSample(0, np.full(3, math.nan), 1e-6 * np.eye(3))  # as the node passes it on
    assist.check_twist_frame("the twist is given in 'otos'")
    assist.update(BrakeDemand(0, 0.0, unusable))
    assert assist.sources()[0].words == f"{REJECTED}: wrong_frame"
    assist.check_twist_frame("")
    assist.update(BrakeDemand(STEP_NS, 0.0, unusable._replace(stamp_ns=STEP_NS)))
    assert assist.sources()[0].words == f"{REJECTED}: non_finite_feedback"


def test_a_jump_of_the_stamps_is_no_long_rejection(mecanum: dict[str, WheelMount]) -> None:
    assist, timers = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum)), RejectionTimers()
    speeds = PlatformKinematics(mecanum).wheel_speeds(np.array([1.0, 0.0, 0.0]))
    states = []
    for step in range(150):
        stamp_ns = step * STEP_NS + (2_000_000_000 if step >= 110 else 0)
        twist = TwistSample(stamp_ns, np.array([1.0, 0.0, 0.0]), 1e-6 * np.eye(3))
        if step >= 100:  # an implausible speed is rejected
            twist = twist._replace(value=np.array([100.0, 0.0, 0.0]))
        assist.update(BrakeDemand(stamp_ns, 0.0, twist, WheelSample(stamp_ns, speeds), None))
        states.append(timers.update(stamp_ns, assist.sources())[0].state)
    assert REJECTED in states[100:110]
    assert REFUSED not in states


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
def test_the_rate_of_an_input_is_reported_whatever_its_jitter(rate: float) -> None:
    random, received = np.random.default_rng(1), ReceivedRate()
    assert received.words(0) == "no sample"
    stamps = (np.arange(5 * rate) + random.uniform(-0.3, 0.3, int(5 * rate))) * 1e9 / rate
    for stamp_ns in stamps.astype(int).tolist():
        received.update(stamp_ns)
    assert float(received.words(stamp_ns).removesuffix(" Hz")) == pytest.approx(rate, rel=0.02)
    assert received.words(stamp_ns + 2_000_000_000) == "0.5 Hz"


def test_a_malformed_imu_sample_is_reported_in_a_sentence(mecanum: dict[str, WheelMount]) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum))
    assist.update(BrakeDemand(0, 0.0, None, imu=ImuSample(0, 0.0, np.zeros(3))))
    gyro = assist.sources()[1]
    assert (gyro.name, gyro.state) == ("gyro", LOST)
    assert gyro.reason == "acceleration has shape (3,), must be (2,)"
    assist.update(BrakeDemand(10_000_000, 0.0, None, imu=ImuSample(10_000_000, 0.0, np.zeros(2))))
    assert assist.sources()[1].state == FUSED
