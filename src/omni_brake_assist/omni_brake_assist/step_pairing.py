"""Pairing of demands and feedback in lockstep."""

from omni_brake_assist.decision import BrakeDemand
from omni_platform.signals import ImuSample, TwistSample, WheelSample


class StepPairing:
    """Pairs each pedal value with the twist of its step, in any order of arrival.

    The newest camera line of a step may be up to one line period older than the step. A twist
    therefore belongs to the first demand whose stamp is not before that of the twist. Wheel speeds
    and IMU readings have the stamp of their step. If the twist is sampled more slowly than the
    steps, it belongs to all steps within its sampling period.

    Args:
        fault_detection: whether a demand waits for the wheel speeds of its step.
        imu: whether a demand waits for the IMU too.
        twist_period_ns: time between two samples of the twist [ns], 0 if each step has its own
            twist.
    """

    def __init__(
        self, *, fault_detection: bool = False, imu: bool = False, twist_period_ns: int = 0
    ) -> None:
        self._twist_period_ns = twist_period_ns
        self._awaits_wheels, self._awaits_imu = fault_detection, fault_detection and imu
        self._wheels: WheelSample | None = None
        self._imu: ImuSample | None = None
        self._pedal: tuple[int, float] | None = None  # stamp [ns], pedal
        self._feedback: TwistSample | None = None
        self._answered_ns = -1  # stamp of the newest answered demand

    def take_pedal(self, stamp_ns: int, pedal: float) -> None:
        """Store the driver's demand (0 to 1) of the step with this stamp [ns]."""
        self._pedal = stamp_ns, pedal

    def take_feedback(self, feedback: TwistSample) -> None:
        """Store a received body twist."""
        self._feedback = feedback

    def take_wheels(self, wheels: WheelSample) -> None:
        """Store received wheel speeds."""
        self._wheels = wheels

    def take_imu(self, imu: ImuSample) -> None:
        """Store a received reading of the IMU."""
        self._imu = imu

    def next_demand(self) -> BrakeDemand | None:
        """Return each demand once, when all inputs of its step are received, otherwise None."""
        if self._pedal is None or self._feedback is None:
            return None
        stamp_ns, pedal = self._pedal
        if stamp_ns <= self._answered_ns or not self._is_of(self._feedback.stamp_ns, stamp_ns):
            return None
        for awaited, signal in ((self._awaits_wheels, self._wheels), (self._awaits_imu, self._imu)):
            if awaited and (signal is None or signal.stamp_ns < stamp_ns):
                return None
        self._answered_ns = stamp_ns
        return BrakeDemand(stamp_ns, pedal, self._feedback, self._wheels, self._imu)

    def _is_of(self, twist_ns: int, stamp_ns: int) -> bool:
        """Return whether the demand at `stamp_ns` waits for the twist at `twist_ns` [ns]."""
        period_ns = self._twist_period_ns
        if period_ns == 0:
            return twist_ns > self._answered_ns
        return twist_ns // period_ns >= stamp_ns // period_ns
