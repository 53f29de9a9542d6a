"""Exposure times of frames from their arrival times, with detection of lost frames.

A camera takes frames at a constant rate, but the frames arrive with varying delays. The odometry
needs constant periods. It must also detect lost frames, because they change the time in which a
displacement occurs. Frame numbers from the camera driver reveal lost frames. Without frame numbers,
if a frame arrives more than half a period late, a frame before it is assumed to be lost. If the
next frame shows that the frame was only late, the clock is reset, and the lines before and after
the reset are not joined.
"""

_FOLLOWED = 0.05  # share of a frame's timing error by which its stamp is corrected
_DRIFT = 0.002  # share of a frame's timing error by which the period is corrected
_FURTHEST = 50.0  # timing error of a numbered frame above which the clock is reset [periods]
_WIDEST = 0.1  # limit on the relative deviation of the rate from the configured one [1]


class FrameClock:
    """Computes the stamps of frames from their times of arrival, and counts lost frames.

    Attributes:
        lost: number of lost frames so far.
        resets: number of resets of the clock so far.
    """

    def __init__(self, rate: float) -> None:
        """Create a clock that has received no frame.

        Args:
            rate: configured frame rate [1/s].
        """
        self._nominal_ns = 1e9 / rate
        self._period_ns = 1e9 / rate
        self._last_ns: float | None = None
        self._number: int | None = None
        self.lost = 0
        self.resets = 0

    @property
    def rate(self) -> float:
        """Frame rate measured from the times of arrival [1/s]."""
        return 1e9 / self._period_ns

    def take(self, arrival_ns: int, number: int | None = None) -> tuple[int, int]:
        """Return the stamp of a frame [ns] and the number of frames lost before it.

        If the clock is reset, this number is at least 1, so that the lines are not joined.

        Args:
            arrival_ns: stamp of the camera driver or, without such a stamp, time of arrival [ns].
            number: frame number from the camera driver; None if frames are not numbered.
        """
        before, self._number = self._number, number
        if self._last_ns is None:
            self._last_ns = float(arrival_ns)
            return arrival_ns, 0
        since = arrival_ns - self._last_ns
        if number is not None and before is not None and number > before:
            steps, furthest = number - before, _FURTHEST
        else:
            steps, furthest = max(1, round(since / self._period_ns)), 0.5
        error = since - steps * self._period_ns
        lost = steps - 1
        self.lost += lost
        if abs(error) > furthest * self._period_ns:
            # Arrivals and stamps disagree, for example because a late frame was taken for a lost
            # one. Reset the clock to the time of arrival. Stamps must not decrease.
            self.resets += 1
            self._last_ns = max(float(arrival_ns), self._last_ns + 1.0)
            return round(self._last_ns), max(lost, 1)
        self._last_ns += steps * self._period_ns + _FOLLOWED * error
        moved = self._period_ns + _DRIFT * error / steps
        self._period_ns = min(
            max(moved, self._nominal_ns * (1.0 - _WIDEST)), self._nominal_ns * (1.0 + _WIDEST)
        )
        return round(self._last_ns), lost
