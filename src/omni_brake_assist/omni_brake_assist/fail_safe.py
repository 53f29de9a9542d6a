"""Whether the feedback can be trusted; where it cannot, all brakes are on.

Trust is earned by a number of good feedbacks in a row, at the start and after every fault, and
lost by a single bad one. A feedback is good if it is there, finite, fresh, confident and
physically plausible after the last good one. What is bad never becomes the one to compare with;
as the permitted change grows with time, the comparison can never lock out good data for long.
"""

from __future__ import annotations

import dataclasses
import math
import operator
from typing import Any

import numpy as np

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.decision import AssistState, Fault, Feedback

_NANOSECONDS = 1_000_000_000


@dataclasses.dataclass(frozen=True)
class TwistSample:
    """A twist that passed every check: [ns], [m/s], [m/s], [rad/s], in the body frame."""

    stamp_ns: int
    v_x: float
    v_y: float
    yaw_rate: float


class FeedbackMonitor:
    """Judges one feedback after the other and remembers whether they deserve trust.

    Args:
        limits: what a feedback must be like.
        reach: distance of the farthest wheel from the centre [m].
    """

    def __init__(self, limits: BrakeAssistConfiguration, reach: float) -> None:
        self._limits = limits
        self._reach = reach
        self._maximum_step_ns = round(limits.maximum_time_step * _NANOSECONDS)
        self._timeout_ns = round(limits.feedback_timeout * _NANOSECONDS)
        self._now_ns: int | None = None
        self._last: TwistSample | None = None
        self._unchanged_since_ns = 0
        self._good = 0
        self._cause: Fault | None = Fault(
            AssistState.NO_FEEDBACK, "no feedback has been received yet"
        )

    @property
    def fault(self) -> Fault | None:
        """Why the feedback cannot be trusted; None if it can."""
        if self._cause is None or self._good == 0:
            return self._cause
        progress = f"{self._good} of {self._limits.recovery_count} good feedbacks since"
        return Fault(self._cause.state, f"{progress}: {self._cause.reason}")

    def distrust(self, fault: Fault) -> None:
        """Withdraw trust for a cause; recovery starts from nothing."""
        self._cause = fault
        self._good = 0

    def judge(self, now_ns: int, feedback: Feedback | None, *, braking: bool) -> TwistSample | None:
        """Examine what has been received at the time of a demand.

        Args:
            now_ns: stamp of the demand [ns].
            feedback: latest feedback, which may be the same as last time.
            braking: whether the driver brakes, so that the twist must change.

        Returns:
            The feedback if it is good, else None. Good is not trusted: see `fault`.
        """
        problem = self._clock_problem(now_ns)
        if problem is not None:
            self._last = None
        elif feedback is None:
            problem = Fault(AssistState.NO_FEEDBACK, "no feedback has been received")
        else:
            outcome = self._examine(now_ns, feedback, braking)
            if isinstance(outcome, TwistSample):
                self._accept(outcome, braking)
                return outcome
            problem = outcome
        self.distrust(problem)
        return None

    def _clock_problem(self, now_ns: int) -> Fault | None:
        previous, self._now_ns = self._now_ns, now_ns
        if previous is None:
            return None
        step = now_ns - previous
        if step < 0:
            return Fault(AssistState.TIME_JUMP, f"demand went back by {_seconds(-step)}")
        if step > self._maximum_step_ns:
            limit = self._limits.maximum_time_step
            return Fault(
                AssistState.TIME_JUMP,
                f"demand leapt by {_seconds(step)}, more than {limit:g} s",
            )
        return None

    def _accept(self, sample: TwistSample, braking: bool) -> None:
        last = self._last
        if last is not None and sample.stamp_ns == last.stamp_ns:
            return  # nothing new
        if not braking or last is None or _twist(sample) != _twist(last):
            self._unchanged_since_ns = sample.stamp_ns
        self._last = sample
        if self._cause is not None:
            self._good += 1
            if self._good >= self._limits.recovery_count:
                self._cause = None

    def _examine(self, now_ns: int, feedback: Feedback, braking: bool) -> TwistSample | Fault:
        try:
            stamp_ns = checked_stamp(feedback.stamp_ns)
            v_x, v_y, yaw_rate = _finite(feedback.twist, (3,), "twist")
            covariance = _finite(feedback.covariance, (3, 3), "covariance")
        except ValueError as error:
            return Fault(AssistState.NON_FINITE_FEEDBACK, str(error))
        sample = TwistSample(stamp_ns, v_x, v_y, yaw_rate)
        return (
            self._age_problem(now_ns, stamp_ns)
            or self._confidence_problem(covariance)
            or self._size_problem(sample)
            or self._change_problem(sample, braking)
            or sample
        )

    def _age_problem(self, now_ns: int, stamp_ns: int) -> Fault | None:
        age = now_ns - stamp_ns
        limit = f"{self._limits.feedback_timeout:g} s"
        if age > self._timeout_ns:
            return Fault(
                AssistState.STALE_FEEDBACK, f"feedback is {_seconds(age)} old, more than {limit}"
            )
        if age < -self._timeout_ns:
            return Fault(
                AssistState.TIME_JUMP,
                f"feedback is {_seconds(-age)} ahead of the demand, more than {limit}",
            )
        if self._last is not None and stamp_ns < self._last.stamp_ns:
            back = _seconds(self._last.stamp_ns - stamp_ns)
            return Fault(AssistState.TIME_JUMP, f"feedback went back by {back}")
        return None

    def _confidence_problem(self, covariance: list[float]) -> Fault | None:
        xx, xy, _, yx, yy, _, _, _, ww = covariance
        # ROS messages say "unknown" by a covariance of zeros; a negative one means it as well.
        if min(xx, yy, ww) <= 0.0:
            return Fault(AssistState.LOW_CONFIDENCE, "feedback has no positive variance: unknown")
        # Largest eigenvalue of the linear part: the worst direction, whichever way the axes lie.
        worst = xx / 2 + yy / 2 + math.hypot(xx / 2 - yy / 2, xy / 2 + yx / 2)
        limits = self._limits
        return _excess(
            AssistState.LOW_CONFIDENCE,
            "standard deviation of the velocity",
            math.sqrt(worst),
            limits.maximum_speed_deviation,
            "m/s",
        ) or _excess(
            AssistState.LOW_CONFIDENCE,
            "standard deviation of the yaw rate",
            math.sqrt(ww),
            limits.maximum_yaw_rate_deviation,
            "rad/s",
        )

    def _size_problem(self, sample: TwistSample) -> Fault | None:
        kind, limits = AssistState.IMPLAUSIBLE_FEEDBACK, self._limits
        speed = math.hypot(sample.v_x, sample.v_y)
        return _excess(kind, "speed", speed, limits.maximum_speed, "m/s") or _excess(
            kind, "yaw rate", abs(sample.yaw_rate), limits.maximum_yaw_rate, "rad/s"
        )

    def _change_problem(self, sample: TwistSample, braking: bool) -> Fault | None:
        last, limits, kind = self._last, self._limits, AssistState.IMPLAUSIBLE_FEEDBACK
        if last is None or sample.stamp_ns - last.stamp_ns > self._maximum_step_ns:
            return None  # too long ago to say anything
        dt = (sample.stamp_ns - last.stamp_ns) / _NANOSECONDS
        # The body axes have turned since: compare in those of the new sample, or the centripetal
        # change of a turning vehicle would look like an acceleration.
        angle = (last.yaw_rate + sample.yaw_rate) / 2 * dt
        c, s = math.cos(angle), math.sin(angle)
        step = math.hypot(
            sample.v_x - (c * last.v_x + s * last.v_y),
            sample.v_y - (c * last.v_y - s * last.v_x),
        )
        yaw_step = abs(sample.yaw_rate - last.yaw_rate)
        speed_limit = limits.speed_noise + limits.maximum_acceleration * dt
        yaw_limit = limits.yaw_rate_noise + limits.maximum_yaw_acceleration * dt
        within = f" within {dt:.3g} s"
        return (
            _excess(kind, "change of velocity", step, speed_limit, "m/s", within)
            or _excess(kind, "change of yaw rate", yaw_step, yaw_limit, "rad/s", within)
            or (self._frozen_problem(sample, last) if braking else None)
        )

    def _frozen_problem(self, sample: TwistSample, last: TwistSample) -> Fault | None:
        limit = self._limits.frozen_time
        speed = math.hypot(sample.v_x, sample.v_y) + abs(sample.yaw_rate) * self._reach
        if limit == 0.0 or speed < self._limits.speed_threshold or _twist(sample) != _twist(last):
            return None
        frozen = (sample.stamp_ns - self._unchanged_since_ns) / _NANOSECONDS
        return _excess(
            AssistState.IMPLAUSIBLE_FEEDBACK,
            "time without any change while braking",
            frozen,
            limit,
            "s",
        )


def checked_stamp(value: Any) -> int:
    """Return a stamp [ns] as an int.

    Raises:
        ValueError: it is not a whole number of 64 bits.
    """
    try:
        stamp = operator.index(value)
    except TypeError:
        raise ValueError(f"stamp is {type(value).__name__}, must be a whole number") from None
    if not -(2**63) <= stamp < 2**63:
        raise ValueError("stamp does not fit into 64 bits")
    return stamp


def _finite(value: Any, shape: tuple[int, ...], name: str) -> list[float]:
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} is not made of real numbers")
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, must be {shape}")
    numbers: list[float] = array.astype(np.float64).ravel().tolist()
    for number in numbers:
        if not math.isfinite(number):
            raise ValueError(f"{name} holds {number}, must be finite")
    return numbers


def _twist(sample: TwistSample) -> tuple[float, float, float]:
    return sample.v_x, sample.v_y, sample.yaw_rate


def _excess(
    state: AssistState, quantity: str, value: float, limit: float, unit: str, within: str = ""
) -> Fault | None:
    if value <= limit:
        return None
    return Fault(state, f"{quantity} is {value:.4g} {unit}{within}, more than {limit:.4g} {unit}")


def _seconds(duration_ns: int) -> str:
    return f"{duration_ns / _NANOSECONDS:.4g} s"
