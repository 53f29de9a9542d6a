"""Newest inputs of the brake assistant, and pairing of the inputs of a step in lockstep."""

import dataclasses
from typing import Any, TypeVar

from omni_platform.signals import ImuSample, PedalSample, TwistSample, WheelSample

Sample = PedalSample | TwistSample | WheelSample | ImuSample
_S = TypeVar("_S")


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


class StepPairing:
    """Stores the newest sample of each input; pairs each pedal value with the twist of its step.

    The samples may arrive in any order. The stamp of a twist is the time of the newest camera line,
    which may be up to one line period earlier than the step. A twist therefore belongs to the first
    demand whose stamp is not earlier than the stamp of the twist. Wheel speeds and IMU readings
    have the stamp of their step. If the sampling period of the twist is longer than a step, a twist
    belongs to all steps within this period.

    Args:
        fault_detection: whether a demand waits for the wheel speeds of its step.
        imu: whether a demand also waits for the IMU reading of its step.
        twist_period_ns: time between two samples of the twist [ns], 0 if each step has its own
            twist.
    """

    def __init__(
        self, *, fault_detection: bool = False, imu: bool = False, twist_period_ns: int = 0
    ) -> None:
        self._twist_period_ns = twist_period_ns
        awaited: tuple[type[Any], ...] = (WheelSample, ImuSample) if imu else (WheelSample,)
        self._awaited = awaited if fault_detection else ()
        self._newest: dict[type[Any], Any] = {}
        self._answered_ns = -1  # stamp of the newest answered demand

    def newest(self, kind: type[_S]) -> _S | None:
        """Return the last received sample of a given type; None before the first sample."""
        return self._newest.get(kind)

    @property
    def newest_ns(self) -> int:
        """Largest stamp among the newest pedal, twist and IMU samples [ns]."""
        kinds = (PedalSample, TwistSample, ImuSample)
        samples = [self._newest[kind] for kind in kinds if kind in self._newest]
        return int(max(sample.stamp_ns for sample in samples))

    def take(self, sample: Sample) -> BrakeDemand | None:
        """Store a sample; return the demand of its step if all inputs of this step are now known.

        Each demand is returned once; in all other cases, the result is None.
        """
        self._newest[type(sample)] = sample
        pedal, twist = self.newest(PedalSample), self.newest(TwistSample)
        if pedal is None or twist is None:
            return None
        stamp_ns = pedal.stamp_ns
        if stamp_ns <= self._answered_ns or not self._is_of(twist.stamp_ns, stamp_ns):
            return None
        awaited = map(self.newest, self._awaited)
        if any(signal is None or signal.stamp_ns < stamp_ns for signal in awaited):
            return None
        self._answered_ns = stamp_ns
        return self._demand(pedal)

    def newest_demand(self) -> BrakeDemand | None:
        """Return a demand with the newest samples; None before the first pedal sample."""
        pedal = self.newest(PedalSample)
        return self._demand(pedal._replace(stamp_ns=self.newest_ns)) if pedal else None

    def _demand(self, pedal: PedalSample) -> BrakeDemand:
        twist, wheels = self.newest(TwistSample), self.newest(WheelSample)
        return BrakeDemand(*pedal, twist, wheels, self.newest(ImuSample))

    def _is_of(self, twist_ns: int, stamp_ns: int) -> bool:
        """Return whether a twist at `twist_ns` [ns] belongs to the demand at `stamp_ns` [ns]."""
        period_ns = self._twist_period_ns
        if period_ns == 0:
            return twist_ns > self._answered_ns
        return twist_ns // period_ns >= stamp_ns // period_ns
