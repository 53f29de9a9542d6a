"""Pairing of demands and feedback in lockstep."""

from omni_brake_assist.decision import BrakeDemand
from omni_platform.signals import ImuSample, TwistSample, WheelSample


class StepPairing:
    """Pairs each pedal value with the twist of its step, in any order of arrival.

    The newest line of a step may be up to a line period older than the step, so a twist belongs to
    the first demand that is not older than the twist. Wheel speeds and IMU readings have the stamp
    of their step. A twist that is sampled more slowly than the steps belongs to all steps within
    its period.

    Args:
        fault_detection: whether a demand waits for the wheel speeds of its step.
        imu: whether a demand waits for the IMU too.
        twist_period_ns: time between two samples of the twist [ns], 0 if every step has its own.
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
        self._answered_ns = -1  # stamp of the newest demand that was answered

    def take_pedal(self, stamp_ns: int, pedal: float) -> None:
        """Take the driver's demand (0..1) of a step [ns]."""
        self._pedal = stamp_ns, pedal

    def take_feedback(self, feedback: TwistSample) -> None:
        """Take a body twist."""
        self._feedback = feedback

    def take_wheels(self, wheels: WheelSample) -> None:
        """Take the speeds of the wheels."""
        self._wheels = wheels

    def take_imu(self, imu: ImuSample) -> None:
        """Take a reading of the IMU."""
        self._imu = imu

    def next_demand(self) -> BrakeDemand | None:
        """Return the demand that can be answered now, once; None while something is missing."""
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
        """Return whether a twist is the one that a demand waits for, by their stamps [ns]."""
        period_ns = self._twist_period_ns
        if period_ns == 0:
            return twist_ns > self._answered_ns
        return twist_ns // period_ns >= stamp_ns // period_ns
