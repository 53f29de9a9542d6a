"""What goes into the brake assistant and what comes out, and every state it can be in."""

from __future__ import annotations

import dataclasses
import enum

from omni_platform.quantities import FloatArray
from omni_platform.signals import ImuReading, Twist, WheelSpeeds


class AssistState(enum.Enum):
    """What the assistant is doing. In every state but `ASSISTING` all brakes are on.

    The value is the word for messages and logs.
    """

    INACTIVE = "inactive"  # pedal up
    ASSISTING = "assisting"
    DEAD_RECKONING = "dead_reckoning"  # likewise, on IMU and wheels without the twist
    ALL_ERRORS_POSITIVE = "all_errors_positive"  # no brake would help: the rule of section 3.3
    BELOW_SPEED_THRESHOLD = "below_speed_threshold"
    DISABLED = "disabled"
    # Faults
    INVALID_DEMAND = "invalid_demand"
    NO_DEMAND = "no_demand"
    UNKNOWN_WHEEL = "unknown_wheel"
    SECOND_VOICE = "second_voice"  # two publishers where one alone may speak
    TIME_JUMP = "time_jump"
    NO_FEEDBACK = "no_feedback"
    STALE_FEEDBACK = "stale_feedback"
    NON_FINITE_FEEDBACK = "non_finite_feedback"
    LOW_CONFIDENCE = "low_confidence"
    IMPLAUSIBLE_FEEDBACK = "implausible_feedback"
    CONTRADICTED_FEEDBACK = "contradicted_feedback"
    NO_EFFECT = "no_effect"
    DEAD_BRAKE = "dead_brake"  # a wheel rolls free though its brake should act
    UNSTEADY = "unsteady"  # trust lost too often in one stop
    INTERNAL_ERROR = "internal_error"

    @property
    def is_fault(self) -> bool:
        """Whether something is wrong, as opposed to a state of normal operation."""
        return self not in _NORMAL_STATES

    @property
    def level(self) -> int:
        """Level for `/diagnostics`: 0 OK, 1 warning, 2 error.

        A bad feedback may pass by itself, so it is a warning; silence and the rest need somebody
        to act.
        """
        if not self.is_fault:
            return 0
        return 2 if self in _ERROR_STATES else 1


_NORMAL_STATES = frozenset(
    {
        AssistState.INACTIVE,
        AssistState.ASSISTING,
        AssistState.DEAD_RECKONING,
        AssistState.ALL_ERRORS_POSITIVE,
        AssistState.BELOW_SPEED_THRESHOLD,
        AssistState.DISABLED,
    }
)
_ERROR_STATES = frozenset(
    {
        AssistState.INVALID_DEMAND,
        AssistState.NO_DEMAND,
        AssistState.UNKNOWN_WHEEL,
        AssistState.SECOND_VOICE,
        AssistState.NO_FEEDBACK,
        AssistState.STALE_FEEDBACK,
        AssistState.NO_EFFECT,
        AssistState.DEAD_BRAKE,
        AssistState.INTERNAL_ERROR,
    }
)


@dataclasses.dataclass(frozen=True)
class Fault:
    """Something that keeps the assistant from trusting what it is told.

    Attributes:
        state: the kind, one for which `AssistState.is_fault` holds.
        reason: one line for people, with the value and the limit.
    """

    state: AssistState
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class BrakeDemand:
    """What the driver wants and what is known of the vehicle's motion.

    Attributes:
        stamp_ns: time of the demand [ns from the start of the run].
        pedal: driver's brake demand [1], 0 to 1.
        feedback: latest twist received, again with every demand until a newer one has come;
            None if there is none.
        wheels: latest speeds of the wheels received, likewise.
        imu: latest reading of the inertial sensor received, likewise.
    """

    stamp_ns: int
    pedal: float
    feedback: Twist | None
    wheels: WheelSpeeds | None = None
    imu: ImuReading | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Decision:
    """Which brakes may act.

    Attributes:
        stamp_ns: stamp of the demand that it answers [ns].
        enable: share of the brake pressure that passes, 0 lets the wheel roll free [1], shape (N,).
        error: ``s_i`` of Eq. (44), or the law's own [m/s], shape (N,); zeros while the pedal is
            up and where the feedback cannot be trusted.
        state: what the assistant is doing.
        reason: one line for people; in a fault it names the value and the limit.
        fault: what is wrong, also while `state` is INACTIVE or DISABLED and it does not matter
            yet; None if nothing is.
    """

    stamp_ns: int
    enable: FloatArray
    error: FloatArray
    state: AssistState
    reason: str
    fault: Fault | None = None
