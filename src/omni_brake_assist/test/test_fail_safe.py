"""Every cause of a fail-safe state: all brakes on, state, reason with value and limit, recovery."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from made_demands import (
    PERIOD_NS,
    Wheels,
    aged,
    assisting,
    demand,
    require_all_on,
    with_twist,
    with_variance,
)
from reference_equations import force_directions

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState, Fault
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core.geometry import cross
from omni_core.signals import TwistSample

MS = 1_000_000
NAN, INF = math.nan, math.inf
S = AssistState
FAULTS: list[tuple[str, Callable[[BrakeDemand], BrakeDemand], AssistState, str]] = [
    ("none", lambda g: dataclasses.replace(g, feedback=None), S.NO_FEEDBACK, "no feedback"),
    ("stale", aged(51 * MS), S.STALE_FEEDBACK, "0.051 s old, more than 0.05 s"),
    ("future", aged(-51 * MS), S.TIME_JUMP, "0.051 s ahead of the demand, more than 0.05 s"),
    ("older", aged(30 * MS), S.TIME_JUMP, "the stamp of the feedback decreased by 0.02 s"),
    ("nan", with_twist(9.7, NAN, 0.3), S.NON_FINITE_FEEDBACK, "twist contains nan"),
    ("inf", with_twist(INF, 0.0, 0.3), S.NON_FINITE_FEEDBACK, "twist contains inf"),
    ("nan variance", with_variance(2, NAN), S.NON_FINITE_FEEDBACK, "covariance contains nan"),
    ("shape", with_twist(9.7, 0.0), S.NON_FINITE_FEEDBACK, "twist has shape (2,), must be (3,)"),
    ("text", with_twist("a", "b", "c"), S.NON_FINITE_FEEDBACK, "twist must contain real numbers"),
    ("blind", with_variance(0, 1e6), S.LOW_CONFIDENCE, "velocity is 1000 m/s, more than 0.2"),
    ("blind y", with_variance(1, 0.05), S.LOW_CONFIDENCE, "0.2236 m/s, more than 0.2 m/s"),
    ("blind yaw", with_variance(2, 1e6), S.LOW_CONFIDENCE, "yaw rate is 1000 rad/s, more than"),
    ("unknown", with_variance(0, -1.0), S.LOW_CONFIDENCE, "a variance is not positive"),
    ("fast", with_twist(0.0, 60.1, 0.3), S.IMPLAUSIBLE_FEEDBACK, "speed is 60.1 m/s, more than 60"),
    ("huge", with_twist(1e200, 1e200, 0), S.IMPLAUSIBLE_FEEDBACK, "speed is"),
    ("spin", with_twist(9.7, 0.0, -10.1), S.IMPLAUSIBLE_FEEDBACK, "yaw rate is 10.1 rad/s"),
    # 0.7 m/s sideways, and the body has turned by 0.003 rad under 9.8 m/s.
    ("jump", with_twist(9.8, 0.7, 0.3), S.IMPLAUSIBLE_FEEDBACK, "change of velocity is 0.7294 m/s"),
    ("yaw jump", with_twist(9.8, 0.0, 1.3), S.IMPLAUSIBLE_FEEDBACK, "change of yaw rate is 1 rad"),
    ("pedal nan", lambda g: dataclasses.replace(g, pedal=NAN), S.INVALID_DEMAND, "pedal is nan"),
    ("pedal high", lambda g: dataclasses.replace(g, pedal=1.1), S.INVALID_DEMAND, "1.1, must be 0"),
    ("pedal low", lambda g: dataclasses.replace(g, pedal=-0.1), S.INVALID_DEMAND, "-0.1, must be"),
]


@pytest.mark.safety(
    "brakes released when they should act",
    "a twist that is NaN, late, from the future or too fast, that jumps, or has a large variance; "
    "a pedal without a value",
    "input gate: all brakes are on until `recovery_count` valid twists have arrived",
    within=0.01,
)
@pytest.mark.parametrize(
    ("spoil", "state", "reason"), [row[1:] for row in FAULTS], ids=[row[0] for row in FAULTS]
)
def test_a_fault_puts_all_brakes_on_until_it_ends(
    mecanum: Wheels,
    spoil: Callable[[BrakeDemand], BrakeDemand],
    state: AssistState,
    reason: str,
    within: float,
) -> None:
    assist = assisting(mecanum)
    bad = assist.update(spoil(demand(5)))
    assert within * 1e9 >= PERIOD_NS  # it is the first decision after the fault
    require_all_on(bad, state)
    assert reason in bad.reason
    states = [assist.update(demand(step)).state for step in range(6, 12)]
    if state is AssistState.INVALID_DEMAND:
        assert states == [AssistState.ASSISTING] * 6  # the feedback was never rejected
    else:
        assert states == [state] * 2 + [AssistState.ASSISTING] * 4


@pytest.mark.parametrize(
    ("stamp_ns", "reason"),
    [
        (3 * PERIOD_NS, "the stamp of the demand decreased by 0.01 s"),
        (40 * PERIOD_NS, "the stamp of the demand increased by 0.36 s, more than 0.25 s"),
        (2**62, "the stamp of the demand increased by 4.612e"),
        (-(2**62), "the stamp of the demand decreased by"),
    ],
)
def test_time_that_jumps_has_all_brakes_on_and_goes_on_from_there(
    mecanum: Wheels, stamp_ns: int, reason: str
) -> None:
    assist = assisting(mecanum)
    states = []
    for step in range(5):
        now = stamp_ns + step * PERIOD_NS
        good = TwistSample(now, demand(5 + step).feedback.value, 1e-5 * np.eye(3))  # type: ignore[union-attr]
        decision = assist.update(BrakeDemand(now, 1.0, good))
        states.append(decision.state)
        if step == 0:
            require_all_on(decision, AssistState.TIME_JUMP)
            assert reason in decision.reason
    assert states == [*[AssistState.TIME_JUMP] * 3, *[AssistState.ASSISTING] * 2]


def test_same_stamp_twice_is_no_jump(mecanum: Wheels) -> None:
    assist = assisting(mecanum)
    first, second = assist.update(demand(5)), assist.update(demand(5))
    assert second.state is AssistState.ASSISTING
    np.testing.assert_array_equal(first.error, second.error)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda names: names[1:], "missing rear_left"),
        (lambda names: [*names[:3], "rear_rite"], "unknown rear_rite; missing rear_right"),
        (lambda names: [*names, names[0]], "repeated rear_left"),
        (lambda _: [], "missing rear_left, front_left, front_right, rear_right"),
    ],
)
def test_other_wheels_than_configured_have_all_brakes_on(
    mecanum: Wheels, change: Callable[[list[str]], list[str]], problem: str
) -> None:
    assist = assisting(mecanum)
    assert assist.check_wheel_names(change(list(mecanum))) is not None
    decision = assist.update(demand(5))
    require_all_on(decision, AssistState.UNKNOWN_WHEEL)
    assert problem in decision.reason
    assert assist.check_wheel_names(reversed(list(mecanum))) is None  # order is free
    assert assist.update(demand(6)).state is AssistState.ASSISTING


def test_other_joints_of_the_vehicle_are_ignored(mecanum: Wheels) -> None:
    assist = assisting(mecanum)
    names = ["arm_1_joint", *reversed(list(mecanum)), "gripper_joint", "arm_1_joint"]
    assert assist.check_wheel_names(names) is None
    assert assist.update(demand(5)).state is AssistState.ASSISTING


@pytest.mark.parametrize("state", [AssistState.NO_DEMAND, AssistState.STALE_FEEDBACK])
def test_missing_twists_put_all_brakes_on_and_restart_recovery(
    mecanum: Wheels, state: AssistState
) -> None:
    assist = assisting(mecanum)
    decision = assist.timeout(5 * PERIOD_NS, Fault(state, "no pedal for 0.2 s, more than 0.1 s"))
    require_all_on(decision, state)
    assert decision.stamp_ns == 5 * PERIOD_NS
    assert "no pedal for 0.2 s" in decision.reason
    states = [assist.update(demand(step)).state for step in (6, 7, 8)]
    assert states == [state, state, AssistState.ASSISTING]


def test_without_a_valid_twist_at_the_pedal_the_first_valid_one_sets_the_line(
    mecanum: Wheels,
) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, weighting="zero"))
    for step, (v_x, v_y) in enumerate([(5.0, 0.0), (5.0, 0.1), (5.0, 0.2), (5.0, 0.2)]):
        twist = np.array([v_x, v_y, 0.0])
        good = TwistSample(step * PERIOD_NS, twist, 1e-5 * np.eye(3))
        decision = assist.update(BrakeDemand(step * PERIOD_NS, 1.0, good))
        np.testing.assert_allclose(decision.error, 0.0, atol=1e-12)
    assert decision.fault is None


def test_heading_is_carried_across_a_short_fault(mecanum: Wheels) -> None:
    """During 0.1 s without messages at 1 rad/s, the line must not rotate with the body."""
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, weighting="zero"))
    drift = []
    for step in range(40):
        heading, stamp_ns = 1.0 * step * 0.01, step * PERIOD_NS
        twist = np.array([5.0 * math.cos(heading), -5.0 * math.sin(heading), 1.0])
        good = None if 15 <= step < 25 else TwistSample(stamp_ns, twist, 1e-5 * np.eye(3))
        decision = assist.update(BrakeDemand(stamp_ns, 0.0 if step < 5 else 1.0, good))
        if decision.fault is None and step >= 5:
            forces = force_directions(assist.geometry, twist)
            moment = cross(assist.geometry.position, forces) * twist[2]
            drift.append(np.max(np.abs(decision.error - moment)))
    assert len(drift) == 40 - 5 - 10 - 2
    assert max(drift) < 1e-9


def test_line_is_taken_anew_after_a_gap_too_long_to_know_the_heading(mecanum: Wheels) -> None:
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, weighting="zero"))
    for step in range(60):
        stamp_ns = step * PERIOD_NS
        twist = np.array([5.0, 0.0 if step < 10 else 1.0, 0.0])
        good = None if 10 <= step < 50 else TwistSample(stamp_ns, twist, 1e-5 * np.eye(3))
        decision = assist.update(BrakeDemand(stamp_ns, 1.0, good))
    assert decision.fault is None
    np.testing.assert_allclose(decision.error, 0.0, atol=1e-12)


def test_fault_while_the_pedal_is_up_or_the_assistant_off_is_reported(mecanum: Wheels) -> None:
    for changes, pedal, state in (
        ({}, 0.0, AssistState.INACTIVE),
        ({"enabled": False}, 1.0, AssistState.DISABLED),
    ):
        assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, **changes))  # type: ignore[arg-type]
        decision = assist.update(BrakeDemand(0, pedal, None))
        assert decision.state is state
        assert decision.fault is not None
        assert decision.fault.state is AssistState.NO_FEEDBACK
        np.testing.assert_array_equal(decision.enable, 1.0)


def test_unreadable_pedal_starts_braking(mecanum: Wheels) -> None:
    # A full braking request: the line of this moment is stored and kept.
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, weighting="zero"))
    for step in range(6):
        stamp_ns, v_y = step * PERIOD_NS, 0.0 if step < 5 else 0.2
        good = TwistSample(stamp_ns, np.array([5.0, v_y, 0.0]), 1e-5 * np.eye(3))
        pedal = {4: NAN, 5: 1.0}.get(step, 0.0)
        decision = assist.update(BrakeDemand(stamp_ns, pedal, good))
    assert decision.state is AssistState.ASSISTING
    assert np.max(np.abs(decision.error)) == pytest.approx(0.2 * math.sqrt(0.5))


# Any input

numbers = st.one_of(
    st.floats(), st.floats(-20.0, 20.0), st.sampled_from([NAN, INF, -INF, 1e308, -1e308, 5e-324])
)
garbage = st.one_of(
    st.none(),
    st.text(max_size=3),
    st.integers(),
    st.floats(),
    st.lists(numbers, max_size=4),
    st.just(np.zeros((3, 3))),
    st.just(np.array(["a", "b", "c"])),
    st.just(np.array([1j, 0, 0])),
)
twists = st.one_of(st.lists(numbers, min_size=3, max_size=3).map(np.array), garbage)
covariances = st.one_of(
    st.just(1e-6 * np.eye(3)),
    st.lists(numbers, min_size=9, max_size=9).map(lambda v: np.array(v).reshape(3, 3)),
    garbage,
)
stamps = st.one_of(
    st.integers(0, 200 * MS), st.integers(), st.integers(-(2**70), 2**70), st.floats(), st.none()
)
feedbacks = st.one_of(st.none(), garbage, st.builds(TwistSample, stamps, twists, covariances))
demands = st.one_of(
    garbage,
    st.builds(BrakeDemand, stamps, st.one_of(st.just(1.0), numbers, garbage), feedbacks),
)


def at_rest(stamp_ns: int) -> BrakeDemand:
    """Return a valid demand of a vehicle at rest; later twists of 5 m/s are then implausible."""
    return BrakeDemand(0, 1.0, TwistSample(stamp_ns, np.zeros(3), 1e-6 * np.eye(3)))


@settings(max_examples=300)
@given(stream=st.lists(demands, max_size=12), enabled=st.booleans())
@example(stream=[at_rest(0)], enabled=True)
@example(stream=[at_rest(50 * MS)] * 3, enabled=True)
def test_any_input_has_a_decision_and_good_data_recover(
    mecanum: Wheels, stream: list[Any], enabled: bool
) -> None:
    configuration = BrakeAssistConfiguration(wheels=mecanum, enabled=enabled)
    assist = BrakeAssist(configuration)
    for item in stream:
        with np.errstate(all="raise"):
            decision = assist.update(item)
        assert decision.enable.shape == decision.error.shape == (4,)
        assert set(decision.enable.tolist()) <= {0.0, 1.0}
        assert np.any(decision.enable == 1.0)
        assert np.all(np.isfinite(decision.error))
        assert decision.reason
        if not enabled or decision.state is not AssistState.ASSISTING:
            np.testing.assert_array_equal(decision.enable, 1.0)
    # The last valid twist may be as far ahead of the demands as a stamp may be, and any change is
    # possible only after the longest step.
    rejected = configuration.feedback_timeout + configuration.maximum_time_step
    for step in range(round(rejected * 1e9) // PERIOD_NS + 1 + configuration.recovery_count):
        decision = assist.update(demand(step))
    assert decision.fault is None


@settings(max_examples=300)
@given(
    stream=st.lists(
        st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), max_size=30
    ),
    kind=st.sampled_from(["zero", "cosine", "enhanced"]),
)
def test_some_brake_is_always_on(
    mecanum: Wheels, stream: list[tuple[float, float, float]], kind: str
) -> None:
    """The first condition of section 3.3 for a strictly dissipative system."""
    assist = BrakeAssist(
        BrakeAssistConfiguration(
            wheels=mecanum, weighting=kind, speed_noise=5.0, yaw_rate_noise=5.0
        )
    )
    for step, twist in enumerate(stream):
        good = TwistSample(step * PERIOD_NS, np.array(twist), 1e-6 * np.eye(3))
        decision = assist.update(BrakeDemand(step * PERIOD_NS, 1.0, good))
        assert np.any(decision.enable == 1.0)
        if decision.state is AssistState.ASSISTING:
            np.testing.assert_array_equal(decision.enable == 1.0, decision.error < 0.0)


@pytest.mark.safety(
    "brakes released when they should act",
    "an error in the program of the assistant",
    "all brakes are on",
    within="the same step",
)
def test_a_failing_program_puts_all_brakes_on(
    mecanum: Wheels, monkeypatch: pytest.MonkeyPatch
) -> None:
    assist = assisting(mecanum)

    def fail(*_: object) -> None:
        raise ZeroDivisionError("by accident")

    with monkeypatch.context() as patch:
        patch.setattr("omni_brake_assist.assist_step.assist_step", fail)
        decision = assist.update(demand(5))
    require_all_on(decision, AssistState.INTERNAL_ERROR)
    assert "ZeroDivisionError: by accident" in decision.reason
    states = [assist.update(demand(step)).state for step in (6, 7, 8)]
    assert states == [*[AssistState.INTERNAL_ERROR] * 2, AssistState.ASSISTING]
