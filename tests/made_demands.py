"""Demands of the brake assistant, fault-free and faulty, and an assistant that assists."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState, Decision
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core.geometry import WheelMount
from omni_core.signals import TwistSample

Wheels = dict[str, WheelMount]
PERIOD_NS = 10_000_000


def demand(step: int, *, pedal: float = 1.0, speed: float | None = None) -> BrakeDemand:
    """A valid demand of a step; the vehicle slows down by 5 m/s^2."""
    stamp_ns = step * PERIOD_NS
    twist = np.array([10.0 - 0.05 * step if speed is None else speed, 0.0, 0.3])
    return BrakeDemand(stamp_ns, pedal, TwistSample(stamp_ns, twist, 1e-5 * np.eye(3)))


def assisting(wheels: Wheels, **changes: Any) -> BrakeAssist:
    """An assistant that is assisting after enough valid twists; the next step is number 5."""
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=wheels, **changes))
    for step in range(5):
        decision = assist.update(demand(step))
    assert decision.state is AssistState.ASSISTING
    assert 0.0 in decision.enable
    return assist


def with_feedback(good: BrakeDemand, **changes: Any) -> BrakeDemand:
    assert good.feedback is not None
    return dataclasses.replace(good, feedback=good.feedback._replace(**changes))


def with_twist(*twist: Any) -> Callable[[BrakeDemand], BrakeDemand]:
    return lambda good: with_feedback(good, value=np.array(twist))


def with_variance(row: int, value: float) -> Callable[[BrakeDemand], BrakeDemand]:
    covariance = 1e-5 * np.eye(3)
    covariance[row, row] = value
    return lambda good: with_feedback(good, covariance=covariance)


def aged(age_ns: int) -> Callable[[BrakeDemand], BrakeDemand]:
    return lambda good: with_feedback(good, stamp_ns=good.stamp_ns - age_ns)


def require_all_on(decision: Decision, state: AssistState) -> None:
    assert decision.state is state
    np.testing.assert_array_equal(decision.enable, 1.0)
    assert np.all(np.isfinite(decision.error))
    assert decision.fault is not None
    assert decision.fault.state is state
    assert decision.state.level > 0
