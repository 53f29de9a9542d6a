"""When frames were taken, from when they arrived: evenly, and with those that are missing.

A camera takes frames at an even rate; a bus, a driver and a busy machine deliver them some time
later. The odometry needs even stamps, and must know of frames that were lost, for a displacement
over two periods is not one over one. A driver that counts its frames says so; else a frame that
comes more than half a period late counts as the next but one, unless the one after it shows that it
was only late: then time starts anew, and the lines before and after it do not join.
"""

from __future__ import annotations

_FOLLOWED = 0.05  # share of an arrival's distance from what was expected
_DRIFT = 0.002  # of the period, likewise
_FURTHEST = 50.0  # periods by which counted frames may be late or early
_WIDEST = 0.1  # share by which the rate may differ from the one that was told


class FrameClock:
    """Gives frames stamps.

    Attributes:
        lost: frames so far that were lost.
        anew: how often time had to start anew.
    """

    def __init__(self, rate: float) -> None:
        """Start before the first frame.

        Args:
            rate: frames per second as told.
        """
        self._told_ns = 1e9 / rate
        self._period_ns = 1e9 / rate
        self._last_ns: float | None = None
        self._number: int | None = None
        self.lost = 0
        self.anew = 0

    @property
    def rate(self) -> float:
        """Frames per second as they arrive [1/s]."""
        return 1e9 / self._period_ns

    def take(self, arrival_ns: int, number: int | None = None) -> tuple[int, int]:
        """Return the stamp of a frame and how many were lost before it.

        Args:
            arrival_ns: when it came, or its driver's stamp [ns].
            number: by which its driver counts frames; None where it does not.
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
            # Behind what the stamps say: the gap before was none. Stamps must not go back.
            self.anew += 1
            self._last_ns = max(float(arrival_ns), self._last_ns + 1.0)
            return round(self._last_ns), max(lost, 1)
        self._last_ns += steps * self._period_ns + _FOLLOWED * error
        moved = self._period_ns + _DRIFT * error / steps
        self._period_ns = min(
            max(moved, self._told_ns * (1.0 - _WIDEST)), self._told_ns * (1.0 + _WIDEST)
        )
        return round(self._last_ns), lost
