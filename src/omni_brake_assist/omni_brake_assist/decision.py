"""Input and output of the brake assistant."""

import dataclasses

from omni_brake_assist.conditions import AssistState
from omni_platform.quantities import FloatArray
from omni_platform.signals import ImuSample, TwistSample, WheelSample


@dataclasses.dataclass(frozen=True)
class Fault:
    """A fault of an input, with its description.

    Attributes:
        state: a state for which `AssistState.is_fault` holds.
        reason: one line for people, with the value and its limit.
    """

    state: AssistState
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class BrakeDemand:
    """Demand of the driver, with the latest measurements.

    Attributes:
        stamp_ns: time of the demand [ns from the start of the run].
        pedal: driver's brake demand [1], 0 to 1.
        feedback: latest twist received, repeated until a newer one is received; None before the
            first.
        wheels: latest wheel speeds received, None before the first.
        imu: latest reading of the inertial sensor received, None before the first.
    """

    stamp_ns: int
    pedal: float
    feedback: TwistSample | None
    wheels: WheelSample | None = None
    imu: ImuSample | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Decision:
    """Which brakes may act.

    Attributes:
        stamp_ns: stamp of the demand that it answers [ns].
        enable: share of the brake pressure that passes, 0 lets the wheel roll free [1], shape (N,).
        error: ``s_i`` of Eq. (44), or the error of another law [m/s], shape (N,); zeros while the
            pedal is up or the feedback is invalid.
        state: state of the assistant.
        reason: one line for people; in a fault it names the value and its limit.
        fault: fault of the input, also while `state` is INACTIVE or DISABLED and the fault has no
            effect yet; None if there is none.
    """

    stamp_ns: int
    enable: FloatArray
    error: FloatArray
    state: AssistState
    reason: str
    fault: Fault | None = None
