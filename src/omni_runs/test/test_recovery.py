"""States of the assistant after a sensor fault of 0.3 s: they end, or are latched."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from omni_brake_assist.conditions import CONDITIONS, AssistState
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentLibrary
from omni_sim.sensor_configuration import CHANNELS, FaultConfiguration

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")
RESUMES = "assistance does not resume after a fault of 0.3 s"
GATE = "the input gate opens after `recovery_count` valid twists"
LAWS = {
    "sliding_mode": ("brake_assist.law=sliding_mode",),
    "allocation": ("brake_assist.law=allocation", "vehicle.brake.kind=proportional"),
}
ONSETS, DURATION = (0.2, 0.3, 0.5), 0.3  # after the pedal is pressed [s]; of the fault [s]
BLIND = "imu.enabled=false"


def stop(
    law: str,
    onset: float,
    channels: tuple[str, ...],
    kind: str,
    size: float,
    *changes: str,
    duration: float = DURATION,
) -> list[tuple[float, AssistState]]:
    """Return the states from a fault of the first axis of channels on, with times after its end.

    Args:
        law: law of the assistant.
        onset: time from pressing the pedal to the fault [s].
        channels: faulty channels.
        kind: kind of the fault.
        size: amplitude of the fault in the units of the channels.
        changes: further changes of the experiment.
        duration: duration of the fault [s].
    """
    own = (*WITHOUT_CAMERAS, *LAWS[law], "brake_assist.fault_detection=true", *changes)
    base = LIBRARY.load("straight_line", "assisted", own)
    time = base.maneuver.brake_time + onset
    axis = 0 if kind == "offset" else -1
    one = FaultConfiguration(channel="twist", kind=kind, axis=axis, time=time, duration=duration)
    one = dataclasses.replace(one, amplitude=size)
    faults = {name: dataclasses.replace(one, channel=name) for name in channels}
    run = run_fast_loop(dataclasses.replace(base, faults=faults))
    since = np.round(1e-9 * run.stamp_ns - time - duration, 6)
    return [
        (float(since[k]), CONDITIONS[run.condition[k]].state)
        for k in np.flatnonzero(since >= -duration)
    ]


def end_of(state: AssistState, states: list[tuple[float, AssistState]]) -> float:
    """Return how long after the end of the fault a state has ended and assistance resumes [s]."""
    assert state in {now for _, now in states}
    last = max(time for time, now in states if now is state)
    after, following = next((time, now) for time, now in states if time > last)
    assert following is AssistState.ASSISTING
    return after


@pytest.mark.safety(
    RESUMES,
    "`dead_reckoning`: no twist, or its velocity is wrong",
    "fault isolation: the twist is used again if it fits to IMU and wheel speeds",
    within=0.3,
)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("onset", ONSETS)
@pytest.mark.parametrize(("kind", "size"), [("drop_out", 0.0), ("offset", 0.5), ("offset", 5.0)])
def test_dead_reckoning_ends(law: str, onset: float, kind: str, size: float, within: float) -> None:
    states = stop(law, onset, ("twist",), kind, size)
    assert end_of(AssistState.DEAD_RECKONING, states) <= within


@pytest.mark.safety(RESUMES, "`non_finite_feedback`: no twist, without an IMU", GATE, within=0.03)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("onset", ONSETS)
def test_a_twist_that_returns_is_used(law: str, onset: float, within: float) -> None:
    states = stop(law, onset, ("twist",), "drop_out", 0.0, BLIND)
    assert end_of(AssistState.NON_FINITE_FEEDBACK, states) <= within


@pytest.mark.safety(
    RESUMES, "`implausible_feedback`: the twist reads 0, without an IMU", GATE, within=0.3
)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("onset", ONSETS)
def test_a_twist_that_is_plausible_again_is_used(law: str, onset: float, within: float) -> None:
    states = stop(law, onset, ("twist",), "zero", 0.0, BLIND)
    assert end_of(AssistState.IMPLAUSIBLE_FEEDBACK, states) <= within


@pytest.mark.safety(
    RESUMES,
    "`no_release`: no wheel speeds, with the law `allocation`",
    "the law receives the next wheel speeds",
    within=0.02,
)
@pytest.mark.parametrize("onset", ONSETS)
def test_wheel_speeds_that_return_are_used(onset: float, within: float) -> None:
    states = stop("allocation", onset, ("encoder",), "drop_out", 0.0)
    assert end_of(AssistState.NO_RELEASE, states) <= within


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("channels", [("accelerometer",), ("accelerometer", "gyro")])
def test_without_an_imu_a_healthy_twist_is_used(law: str, channels: tuple[str, ...]) -> None:
    states = {state for _, state in stop(law, 0.2, channels, "drop_out", 0.0, duration=10.0)}
    assert AssistState.ASSISTING in states
    assert not states & {AssistState.CONTRADICTED_FEEDBACK, AssistState.DEAD_RECKONING}


@pytest.mark.safety(
    RESUMES,
    "`contradicted_feedback`: neither twist nor IMU",
    "all brakes are on until the pedal is released",
    within="the whole stop",
)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("onset", ONSETS)
def test_without_an_estimate_all_brakes_are_on_for_the_whole_stop(law: str, onset: float) -> None:
    states = stop(law, onset, CHANNELS[:3], "drop_out", 0.0)
    assert {state for time, state in states if time >= 0.03} == {AssistState.CONTRADICTED_FEEDBACK}
