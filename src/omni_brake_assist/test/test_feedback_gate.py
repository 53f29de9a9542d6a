"""Gate of the feedback: accepted twists, and recovery after a rejected one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from made_demands import (
    PERIOD_NS,
    Wheels,
    aged,
    assisting,
    demand,
    require_all_on,
    with_feedback,
    with_twist,
    with_variance,
)

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.fail_safe import Others, drop_frozen, make_limits
from omni_core.signals import TwistSample


@pytest.mark.parametrize(
    "twist", [(9.8, 0.0, 0.3), (9.75, 0.2, 0.3), (9.75, 0.0, 0.9), (9.3, 0.0, 0.3)]
)
def test_changes_that_brakes_and_noise_may_cause_are_accepted(
    mecanum: Wheels, twist: tuple[float, float, float]
) -> None:
    decision = assisting(mecanum).update(with_twist(*twist)(demand(5)))
    assert decision.fault is None


def test_an_assistant_that_starts_while_the_driver_brakes_reports_no_time_jump(
    mecanum: Wheels,
) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum))
    decades = 10**11  # steps since the epoch, as in the stamps of a vehicle
    require_all_on(assist.update(demand(decades, speed=5.0)), AssistState.NO_FEEDBACK)


@pytest.mark.parametrize("deviation", [1e-6, 1e-3, 1e-2, 0.19])
def test_good_optical_feedback_is_confident_enough(mecanum: Wheels, deviation: float) -> None:
    good = with_feedback(demand(5), covariance=deviation**2 * np.eye(3))
    assert assisting(mecanum).update(good).fault is None


def test_confidence_looks_at_the_worst_direction(mecanum: Wheels) -> None:
    # Each axis alone is within 0.2 m/s, the diagonal is not: sqrt(0.03 + 0.03) = 0.245.
    covariance = np.array([[0.03, 0.03, 0.0], [0.03, 0.03, 0.0], [0.0, 0.0, 1e-5]])
    decision = assisting(mecanum).update(with_feedback(demand(5), covariance=covariance))
    require_all_on(decision, AssistState.LOW_CONFIDENCE)
    assert "0.2449 m/s" in decision.reason


def test_fast_turning_is_no_acceleration(mecanum: Wheels) -> None:
    """A constant velocity in the world at 8 rad/s changes by 80 m/s^2 in the body frame."""
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, speed_noise=0.0))
    for step in range(50):
        heading = 8.0 * step * 0.01
        twist = np.array([10.0 * math.cos(heading), -10.0 * math.sin(heading), 8.0])
        good = TwistSample(step * PERIOD_NS, twist, 1e-6 * np.eye(3))
        decision = assist.update(BrakeDemand(step * PERIOD_NS, 0.0, good))
        if step >= 2:
            assert decision.fault is None


def test_brakes_are_released_after_the_first_valid_twists(mecanum: Wheels) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, recovery_count=4))
    for step in range(3):
        decision = assist.update(demand(step))
        require_all_on(decision, AssistState.NO_FEEDBACK)
        assert f"{step + 1} of 4 valid" in decision.reason
    assert assist.update(demand(3)).state is AssistState.ASSISTING


def test_one_bad_feedback_starts_recovery_again(mecanum: Wheels) -> None:
    assist = assisting(mecanum)
    assist.update(with_variance(0, 1e6)(demand(5)))
    assist.update(demand(6))
    assist.update(demand(7))
    assist.update(with_twist(math.nan, 0.0, 0.0)(demand(8)))
    states = [assist.update(demand(step)).state for step in (9, 10, 11)]
    assert states == [*[AssistState.NON_FINITE_FEEDBACK] * 2, AssistState.ASSISTING]


def test_a_repeated_twist_does_not_count_for_recovery(mecanum: Wheels) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum))
    good = demand(0).feedback
    for step in range(5):
        decision = assist.update(BrakeDemand(step * PERIOD_NS, 1.0, good))
        require_all_on(decision, AssistState.NO_FEEDBACK)
        assert "1 of 3" in decision.reason


def test_feedback_may_be_repeated_while_it_is_fresh(mecanum: Wheels) -> None:
    assist = assisting(mecanum)
    last = demand(4).feedback
    for step in range(5, 10):
        decision = assist.update(BrakeDemand(step * PERIOD_NS, 1.0, last))
        assert decision.state is AssistState.ASSISTING
    decision = assist.update(BrakeDemand(10 * PERIOD_NS, 1.0, last))
    require_all_on(decision, AssistState.STALE_FEEDBACK)


def test_feedback_a_line_period_older_than_the_demand_is_good(mecanum: Wheels) -> None:
    assist = assisting(mecanum)
    assert assist.update(aged(400_000)(demand(5))).state is AssistState.ASSISTING


@pytest.mark.safety(
    "brakes released when they should act",
    "the twist is stuck, without an IMU",
    "input gate: a value that does not change while braking is rejected",
    within=0.22,
)
def test_twist_that_never_changes_while_braking_is_implausible(
    mecanum: Wheels, within: float
) -> None:
    assist = assisting(mecanum, frozen_time=0.2)
    states = [assist.update(demand(step, speed=9.5)).state for step in range(5, 30)]
    # Step 5 is the first with this twist; 0.2 s later it is still accepted.
    assert states[:21] == [AssistState.ASSISTING] * 21
    assert states[21:] == [AssistState.IMPLAUSIBLE_FEEDBACK] * 4
    assert within * 1e9 >= 22 * PERIOD_NS
    later = [assist.update(demand(step, speed=12.0 - 0.1 * step)).state for step in range(30, 33)]
    assert later[-1] is AssistState.ASSISTING


@pytest.mark.parametrize(
    ("pedal", "speed", "changes"),
    [
        (1.0, 9.5, {"frozen_time": 0.0, "fault_detection": False}),  # switched off
        (0.0, 9.5, {}),  # rolling steadily
        (1.0, 0.0, {}),  # standing
    ],
)
def test_constant_twist_is_accepted_where_nothing_must_change(
    mecanum: Wheels, pedal: float, speed: float, changes: dict[str, float]
) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, **changes))  # type: ignore[arg-type]
    for step in range(100):
        stamp_ns = step * PERIOD_NS
        twist = np.array([speed, 0.0, 0.0])
        still = BrakeDemand(stamp_ns, pedal, TwistSample(stamp_ns, twist, 1e-5 * np.eye(3)))
        decision = assist.update(still)
    assert decision.fault is None


def test_time_without_change_counts_from_the_pedal(mecanum: Wheels) -> None:
    """A vehicle that rolled steadily for a second is not treated as frozen when braking starts."""
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, frozen_time=0.2))
    for step in range(100):
        assist.update(demand(step, pedal=0.0, speed=10.0))
    for step in range(100, 105):  # the brakes act after a delay
        assert assist.update(demand(step, speed=10.0)).fault is None


def test_outlier_is_not_what_the_next_feedback_is_compared_with(mecanum: Wheels) -> None:
    assist = assisting(mecanum)
    assist.update(with_twist(3.0, 0.0, 0.3)(demand(5)))
    assert "1 of 3" in assist.update(demand(6)).reason


def test_lasting_step_is_accepted_in_the_end(mecanum: Wheels) -> None:
    """If the last accepted twist was wrong, correct twists must be accepted after some time."""
    assist = assisting(mecanum)
    states = [assist.update(demand(step, speed=2.0 - 0.01 * step)).state for step in range(5, 45)]
    assert states[0] is AssistState.IMPLAUSIBLE_FEEDBACK
    assert states[-1] is AssistState.ASSISTING


def test_after_a_long_gap_nothing_is_left_to_compare_with(mecanum: Wheels) -> None:
    # The body may have turned by any angle meanwhile: 9.8 m/s forward may have become sideways.
    assist = assisting(mecanum, maximum_acceleration=10.0)
    for step in range(5, 35):
        assist.update(dataclasses.replace(demand(step), feedback=None))
    sideways = with_twist(0.0, -9.0, 0.3)
    reason = assist.update(sideways(demand(35))).reason
    assert reason.startswith("1 of 3 valid twists since: no feedback")
    assist.update(sideways(demand(36)))
    assert assist.update(sideways(demand(37))).state is AssistState.ASSISTING


@pytest.mark.parametrize(
    ("first", "change", "missing"), [(2.0, 0.0, True), (2.0, 1e-3, False), (0.0, 0.0, False)]
)
def test_a_reading_that_never_changes_is_missing(
    mecanum: Wheels, first: float, change: float, missing: bool
) -> None:
    """A locked wheel may read 0 for the whole stop."""
    limits = make_limits(BrakeAssistConfiguration(wheels=mecanum), 1.0)
    others, found = Others(np.zeros(1), np.zeros(1), np.zeros(1, np.int64)), []
    for k in range(40):
        others.values[0] = first + k * change
        drop_frozen(limits, others, (k - 1) * PERIOD_NS, k * PERIOD_NS)
        found.append(others.values[0])
    frozen = np.isnan(found)
    assert not np.any(frozen[: round(limits.frozen_time * 1e9 / PERIOD_NS)])
    assert bool(frozen[-1]) is missing


def test_a_reading_is_newly_stuck_once(mecanum: Wheels) -> None:
    """The second reading becomes stuck in the step in which the first one recovers."""
    limits = make_limits(BrakeAssistConfiguration(wheels=mecanum), 1.0)
    others = Others(np.zeros(3), np.zeros(3), np.zeros(3, np.int64))
    stuck, missing = [], []
    for k in range(60):
        others.values[:] = 2.0 if k < 30 else 3.0 + 1e-3 * k, 2.0 + 1e-3 * min(k, 9), np.nan
        stuck.append(drop_frozen(limits, others, (k - 1) * PERIOD_NS, k * PERIOD_NS))
        missing.append(np.isnan(others.values[:2]))
    assert [k for k, new in enumerate(stuck) if new] == [21, 30]
    assert np.array_equal(np.flatnonzero(np.array(missing)[:, 0]), np.arange(21, 30))
    assert np.array_equal(np.flatnonzero(np.array(missing)[:, 1]), np.arange(30, 60))
