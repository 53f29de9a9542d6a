"""Input and output of the brake assistant."""

import dataclasses

from omni_brake_assist.conditions import AssistState
from omni_platform.quantities import FloatArray
from omni_platform.signals import ImuSample, TwistSample, WheelSample


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
class BrakeDemand:
    """Brake demand of the driver, with the latest measurements.

    Attributes:
        stamp_ns: time of the demand [ns from the start of the run].
        pedal: driver's brake demand [1], 0 to 1.
        feedback: latest received twist, repeated until a newer twist is received; None before the
            first twist.
        wheels: latest received wheel speeds; None before the first message.
        imu: latest received IMU reading; None before the first message.
    """

    stamp_ns: int
    pedal: float
    feedback: TwistSample | None
    wheels: WheelSample | None = None
    imu: ImuSample | None = None


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
