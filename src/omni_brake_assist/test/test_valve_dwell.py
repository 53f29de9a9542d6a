"""Valves that cannot switch at every step."""

from __future__ import annotations

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState, Decision, Fault
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core.geometry import WheelMount
from omni_core.quantities import FloatArray
from omni_core.signals import TwistSample

Wheels = dict[str, WheelMount]
PERIOD_NS = 10_000_000
LEFT, RIGHT = (5.0, 0.0, 0.3), (5.0, 0.0, -0.3)  # the wheels of the other side must brake
LEFT_ENABLE, RIGHT_ENABLE = np.array([0.0, 0.0, 1.0, 1.0]), np.array([1.0, 1.0, 0.0, 0.0])


class Drive:
    """Passes steps to an assistant that has received valid twists with the pedal up."""

    def __init__(self, wheels: Wheels, dwell: float) -> None:
        self.assist = BrakeAssist(
            BrakeAssistConfiguration(
                wheels=wheels,
                minimum_dwell_time=dwell,
                yaw_rate_noise=10.0,
                frozen_time=0.0,
                fault_detection=False,  # without wheel speeds
            )
        )
        self.stamp_ns = -PERIOD_NS
        for _ in range(3):
            self.step(LEFT, pedal=0.0)

    def step(self, twist: tuple[float, float, float] | None, pedal: float = 1.0) -> Decision:
        self.stamp_ns += PERIOD_NS
        feedback = None
        if twist is not None:
            feedback = TwistSample(self.stamp_ns, np.array(twist), 1e-6 * np.eye(3))
        return self.assist.update(BrakeDemand(self.stamp_ns, pedal, feedback))

    def run(self, twist: tuple[float, float, float], steps: int) -> FloatArray:
        return np.array([self.step(twist).enable for _ in range(steps)])


def test_valve_keeps_its_state_for_the_dwell_time(mecanum: Wheels) -> None:
    drive = Drive(mecanum, 0.05)
    # A valve that has been open for long may shut when the pedal is pressed.
    np.testing.assert_array_equal(drive.step(LEFT).enable, LEFT_ENABLE)
    # Those that were shut stay so; those that are open may shut, but then none would act.
    drive.step(RIGHT)
    enable = drive.run(RIGHT, 8)
    np.testing.assert_array_equal(enable[-1], RIGHT_ENABLE)
    assert np.all(enable.sum(axis=1) > 0.0)


def test_no_valve_shuts_sooner_whatever_the_errors(mecanum: Wheels) -> None:
    periods = 7
    drive = Drive(mecanum, periods * 0.01)
    random = np.random.default_rng(5)
    record, gaps = [np.ones(4)], 0
    for _ in range(400):
        twist = (5.0, random.uniform(-0.2, 0.2), random.uniform(-0.5, 0.5))
        decision = drive.step(twist)
        assert decision.state is AssistState.ASSISTING
        assert decision.enable.any()
        record.append(decision.enable)
    for wheel in np.array(record).T:
        change = np.diff(wheel)
        switched = np.flatnonzero(change)
        assert len(switched) > 20
        early = np.diff(switched) < periods
        assert np.all(change[switched[1:]][early] > 0.0)  # only to apply a brake
        gaps += int(early.sum())
    assert gaps < 10  # such gaps are rare


def test_without_dwell_time_enables_are_the_signs_of_the_errors(mecanum: Wheels) -> None:
    drive = Drive(mecanum, 0.0)
    for twist in (LEFT, RIGHT, LEFT, RIGHT):
        decision = drive.step(twist)
        np.testing.assert_array_equal(decision.enable, (decision.error < 0.0).astype(float))


@pytest.mark.parametrize("how", ["no feedback", "pedal up", "slow", "timeout", "invalid", "wheels"])
def test_all_brakes_on_does_not_wait(mecanum: Wheels, how: str) -> None:
    drive = Drive(mecanum, 0.2)
    np.testing.assert_array_equal(drive.step(LEFT).enable, LEFT_ENABLE)
    if how == "no feedback":
        drive.stamp_ns += 10 * PERIOD_NS
        decision = drive.step(None)
    elif how == "pedal up":
        decision = drive.step(LEFT, pedal=0.0)
    elif how == "slow":
        decision = drive.step((0.1, 0.0, 0.01))
    elif how == "timeout":
        decision = drive.assist.timeout(drive.stamp_ns, Fault(AssistState.NO_DEMAND, "silence"))
    elif how == "invalid":
        decision = drive.step(LEFT, pedal=2.0)
    else:
        drive.assist.check_wheel_names(["another"])
        decision = drive.step(LEFT)
    assert decision.state is not AssistState.ASSISTING
    np.testing.assert_array_equal(decision.enable, 1.0)


def test_a_brake_that_had_to_act_is_not_released_sooner(mecanum: Wheels) -> None:
    drive = Drive(mecanum, 0.1)
    drive.step(LEFT)
    drive.step(LEFT, pedal=2.0)  # all on; the twist stays valid, only the demand was not
    enables = drive.run(LEFT, 15)
    first = int(np.argmax(enables[:, 0] == 0.0))
    assert first == 9  # ten periods after the valve was opened
    np.testing.assert_array_equal(enables[first:], np.tile(LEFT_ENABLE, (15 - first, 1)))


def test_brakes_that_help_act_at_once_if_no_other_does(mecanum: Wheels) -> None:
    drive = Drive(mecanum, 0.1)
    drive.step(LEFT)
    drive.run(LEFT, 20)
    drive.step(RIGHT)
    # After a long time the right valves shut and the left ones open in the same step.
    np.testing.assert_array_equal(drive.step(RIGHT).enable, RIGHT_ENABLE)
    # All valves are held. A turn to the other side must wait, because brakes act.
    np.testing.assert_array_equal(drive.step(LEFT).enable, RIGHT_ENABLE)
