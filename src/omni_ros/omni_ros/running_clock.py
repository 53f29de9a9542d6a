"""Clock for watchdogs that does not count the time during which the process did not run."""

import time
from collections.abc import Callable


class RunningClock:
    """Monotonic clock that advances by at most `longest` between two readings.

    If the operating system suspends a process, the messages of that time wait in the queues, and
    the watchdog timer may be due before they are received. With an ordinary monotonic clock, the
    time of the suspension would count as silence of the publishers. A watchdog reads this clock at
    each message and at each tick of its timer. While the process runs, two readings are at most one
    period of the timer apart; a longer interval therefore counts as one period.

    Args:
        longest: limit on the counted time between two readings [s]; the period of the watchdog
            timer.
        steady: function that returns a monotonic time [s].
    """

    def __init__(self, longest: float, steady: Callable[[], float] = time.monotonic) -> None:
        self._longest = longest
        self._steady = steady
        self._read = steady()
        self._time = 0.0

    def now(self) -> float:
        """Return the time for which the process has run since this clock was created [s]."""
        read = self._steady()
        self._time += min(read - self._read, self._longest)
        self._read = read
        return self._time
