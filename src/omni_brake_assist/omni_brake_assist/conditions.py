"""Conditions that determine the state of the assistant, in the order of their precedence.

The first condition of the table that is true determines the state of the assistant. If it is one of
the last three conditions (REPLANNED, DEAD_RECKONING and ASSISTING), the assistant may release
brakes; otherwise all brakes are on. The kernels return the index of the condition in the table, and
`/diagnostics` shows the level and the reason of the condition. ``python -m
omni_brake_assist.conditions`` prints the table of states in the README of this package.
"""

import dataclasses
import enum
import re
from typing import NamedTuple

from omni_core.quantities import FloatArray


class AssistState(enum.Enum):
    """State of the assistant.

    The assistant releases brakes in the states `DEAD_RECKONING` and `ASSISTING`. In `FAILED_BRAKE`
    it releases brakes only if `allocation` controls on-off valves. In all other states, every brake
    is on.

    The value of a member is the name of the state in messages and logs.
    """

    DISABLED = "disabled"
    INACTIVE = "inactive"  # pedal up
    INVALID_DEMAND = "invalid_demand"
    NO_DEMAND = "no_demand"
    UNKNOWN_WHEEL = "unknown_wheel"
    WRONG_FRAME = "wrong_frame"  # the twist is given in another frame than the vehicle's
    SECOND_PUBLISHER = "second_publisher"  # two publishers on a topic that must have only one
    INTERNAL_ERROR = "internal_error"
    NO_EFFECT = "no_effect"
    STALE_FEEDBACK = "stale_feedback"
    TIME_JUMP = "time_jump"
    NO_FEEDBACK = "no_feedback"
    NON_FINITE_FEEDBACK = "non_finite_feedback"
    LOW_CONFIDENCE = "low_confidence"
    IMPLAUSIBLE_FEEDBACK = "implausible_feedback"
    CONTRADICTED_FEEDBACK = "contradicted_feedback"
    BELOW_SPEED_THRESHOLD = "below_speed_threshold"
    NO_RELEASE = "no_release"  # the control law releases all brakes or none
    FAILED_BRAKE = "failed_brake"  # a wheel rolls freely although its brake should act
    DEAD_RECKONING = "dead_reckoning"  # assisting with IMU and wheel speeds, without a valid twist
    ASSISTING = "assisting"

    @property
    def is_fault(self) -> bool:
        """Whether a fault causes this state; False for the states of normal operation."""
        return self.level > OK

    @property
    def level(self) -> int:
        """Level for `/diagnostics`: 0 OK, 1 warning, 2 error.

        Invalid feedback and jumps of stamps cause a warning, because valid values may follow
        without intervention. All other faults are errors, which require an operator.
        """
        return next(row.level for row in CONDITIONS if row.state is self)


OK, WARNING, ERROR = range(3)


@dataclasses.dataclass(frozen=True)
class Fault:
    """A fault of an input of the assistant, with a description.

    Attributes:
        state: state of the assistant that the fault causes.
        reason: description on one line, with the measured value and its limit.
    """

    state: AssistState
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class Decision:
    """Decision of the assistant in one step: the brake enables and their reason.

    Attributes:
        stamp_ns: stamp of the demand for which this decision was made [ns].
        enable: share of the brake pressure that passes [1], shape (N,); a wheel with 0 rolls
            freely.
        error: error of each wheel, as defined by the control law [m/s], shape (N,). With the law
            `sliding_mode`, it is ``s_i`` of Eq. (44) of the dissertation. It is zero while the
            pedal is up or the feedback is invalid.
        state: state of the assistant.
        reason: description on one line; for a fault, with the measured value and its limit.
        fault: fault of an input; None if all inputs are valid. A fault is reported even if it has
            no effect because `state` is INACTIVE or DISABLED.
    """

    stamp_ns: int
    enable: FloatArray
    error: FloatArray
    state: AssistState
    reason: str
    fault: Fault | None = None


class Condition(NamedTuple):
    """A row of the table of conditions.

    Attributes:
        state: state of the assistant while the condition holds.
        level: level for `/diagnostics`: OK, WARNING or ERROR.
        words: text of the reason, with the placeholders `value`, `limit`, `within` and `wheel`;
            empty if the code that detects the condition supplies the text.
    """

    state: AssistState
    level: int
    words: str = ""


_S = AssistState
_FAILED = "the brake of {wheel} does not act (check brake, valve and wiring)"
_NO_EFFECT = "braking has too little effect (check brakes and IMU)"
_DEVIATION = "standard deviation of the "
_MORE = ", more than {limit:.4g} "
_LATCHED = ": all brakes on until the pedal is released"
CONDITIONS: list[Condition] = []
"""All conditions in the order of their precedence; the number of a condition is its index."""


def _condition(state: AssistState, level: int, words: str = "") -> int:
    """Append a condition to `CONDITIONS`, and return its number."""
    CONDITIONS.append(Condition(state, level, words))
    return len(CONDITIONS) - 1


DISABLED = _condition(_S.DISABLED, OK, "assistant is switched off")
INACTIVE = _condition(_S.INACTIVE, OK, "pedal below {limit:g}")
INVALID_DEMAND = _condition(_S.INVALID_DEMAND, ERROR)
INVALID_STAMP = _condition(_S.INVALID_DEMAND, ERROR)
NO_DEMAND = _condition(_S.NO_DEMAND, ERROR)
UNKNOWN_WHEEL = _condition(_S.UNKNOWN_WHEEL, ERROR)
WRONG_FRAME = _condition(_S.WRONG_FRAME, ERROR)
SECOND_PUBLISHER = _condition(_S.SECOND_PUBLISHER, ERROR)
INTERNAL_ERROR = _condition(
    _S.INTERNAL_ERROR,
    ERROR,
    "control law returned an enable outside [0, 1] or an error that is not finite",
)
NO_EFFECT = _condition(_S.NO_EFFECT, ERROR, _NO_EFFECT + _LATCHED)
SILENCE = _condition(_S.STALE_FEEDBACK, ERROR)
DEMAND_BACK = _condition(
    _S.TIME_JUMP, WARNING, "the stamp of the demand decreased by {value:.4g} s"
)
DEMAND_LEAP = _condition(
    _S.TIME_JUMP,
    WARNING,
    "the stamp of the demand increased by {value:.4g} s, more than {limit:g} s",
)
NOTHING_YET = _condition(_S.NO_FEEDBACK, ERROR, "no feedback has been received yet")
ABSENT = _condition(_S.NO_FEEDBACK, ERROR, "no feedback has been received")
UNREADABLE = _condition(_S.NON_FINITE_FEEDBACK, WARNING)
TWIST_NOT_FINITE = _condition(
    _S.NON_FINITE_FEEDBACK, WARNING, "twist contains {value}, must be finite"
)
COVARIANCE_NOT_FINITE = _condition(
    _S.NON_FINITE_FEEDBACK, WARNING, "covariance contains {value}, must be finite"
)
STALE = _condition(_S.STALE_FEEDBACK, ERROR, "feedback is {value:.4g} s old, more than {limit:g} s")
AHEAD = _condition(
    _S.TIME_JUMP, WARNING, "feedback is {value:.4g} s ahead of the demand, more than {limit:g} s"
)
BACK = _condition(_S.TIME_JUMP, WARNING, "the stamp of the feedback decreased by {value:.4g} s")
UNKNOWN_VARIANCE = _condition(
    _S.LOW_CONFIDENCE, WARNING, "covariance of the feedback is unknown: a variance is not positive"
)
SPEED_DEVIATION = _condition(
    _S.LOW_CONFIDENCE, WARNING, _DEVIATION + "velocity is {value:.4g} m/s" + _MORE + "m/s"
)
YAW_RATE_DEVIATION = _condition(
    _S.LOW_CONFIDENCE, WARNING, _DEVIATION + "yaw rate is {value:.4g} rad/s" + _MORE + "rad/s"
)
TOO_FAST = _condition(_S.IMPLAUSIBLE_FEEDBACK, WARNING, "speed is {value:.4g} m/s" + _MORE + "m/s")
TURNS_TOO_FAST = _condition(
    _S.IMPLAUSIBLE_FEEDBACK, WARNING, "yaw rate is {value:.4g} rad/s" + _MORE + "rad/s"
)
SPEED_STEP = _condition(
    _S.IMPLAUSIBLE_FEEDBACK,
    WARNING,
    "change of velocity is {value:.4g} m/s within {within:.3g} s" + _MORE + "m/s",
)
YAW_RATE_STEP = _condition(
    _S.IMPLAUSIBLE_FEEDBACK,
    WARNING,
    "change of yaw rate is {value:.4g} rad/s within {within:.3g} s" + _MORE + "rad/s",
)
FROZEN = _condition(
    _S.IMPLAUSIBLE_FEEDBACK,
    WARNING,
    "time without any change while braking is {value:.4g} s" + _MORE + "s",
)
CONTRADICTED = _condition(
    _S.CONTRADICTED_FEEDBACK, WARNING, "twist, IMU and wheel speeds give no valid estimate"
)
SLOW = _condition(
    _S.BELOW_SPEED_THRESHOLD, OK, "speed of the fastest wheel center fell below {limit:g} m/s"
)
NO_RELEASE = _condition(
    _S.NO_RELEASE,
    OK,
    "control law would release every brake, for example because no error is negative, or too "
    "few wheel speeds are known",
)
FAILED_BRAKE = _condition(_S.FAILED_BRAKE, ERROR, _FAILED + _LATCHED)
REPLANNED = _condition(
    _S.FAILED_BRAKE,
    ERROR,
    _FAILED + ": until the pedal is released, allocation controls the valves of the others",
)
DEAD_RECKONING = _condition(
    _S.DEAD_RECKONING,
    OK,
    "motion estimated from IMU and wheel speeds: the control law distributes the braking",
)
ASSISTING = _condition(_S.ASSISTING, OK, "the control law distributes the braking")
GOOD = ASSISTING
"""Condition without a fault."""
INPUTS_VALID = GOOD, INTERNAL_ERROR
"""Conditions in which no input has a fault; in the last one, the control law fails."""


def states_table() -> str:
    """Return the table of conditions in the order of precedence, as Markdown.

    Consecutive conditions of one state, or with one reason, share a row.
    """
    rows: list[tuple[str, str, str]] = []
    for condition in CONDITIONS:
        state, level = f"`{condition.state.value}`", ("OK", "warning", "error")[condition.level]
        reason = re.sub(r"\{(\w+)[^}]*\}", r"*\1*", condition.words) or "named in the message"
        states, last, reasons = rows[-1] if rows else ("", "", "")
        if (level, reason) == (last, reasons):
            rows[-1] = (states if state in states else f"{states}, {state}", level, reason)
        elif (state, level) == (states, last):
            rows[-1] = (state, level, f"{reasons}; {reason}")
        else:
            rows.append((state, level, reason))
    head = "| state | level | reason |\n|---|---|---|\n"
    return head + "".join(f"| {' | '.join(row)} |\n" for row in rows)


if __name__ == "__main__":
    print(states_table(), end="")
