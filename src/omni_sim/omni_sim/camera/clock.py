"""Exact exposure times of the lines of a camera.

Line j is exposed at the time j / rate. Times are compared with control stamps [ns] as integers, so
no line is lost or duplicated at the border of two control periods.
"""

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from omni_platform.quantities import SECOND_NS


class LineClock:
    """Times of the lines of one camera.

    Attributes:
        period_ns: exact line period [ns].
    """

    def __init__(self, line_rate: float) -> None:
        """Create the clock of a camera.

        Args:
            line_rate: line rate, used with the exact value of the float [1/s].

        Raises:
            ValueError: the rate is not finite or not above zero.
        """
        if not (math.isfinite(line_rate) and line_rate > 0.0):
            raise ValueError(f"a line rate must be above 0 1/s, not {line_rate}")
        self.period_ns = Fraction(SECOND_NS) / Fraction(line_rate)

    def lines_in(self, after_ns: int, until_ns: int) -> tuple[int, int]:
        """Return the first line with ``after < time <= until``, and one past the last line.

        Args:
            after_ns: open end of the interval [ns]; -1 includes line 0.
            until_ns: closed end of the interval [ns].
        """
        return self._count_until(after_ns), self._count_until(until_ns)

    def stamp_ns(self, line: int) -> int:
        """Return the time of a line, rounded to whole nanoseconds [ns]."""
        return round(line * self.period_ns)

    def times_ns(self, first: int, end: int) -> NDArray[np.float64]:
        """Return the times of lines ``first <= j < end`` [ns], not rounded to integers."""
        period, divisor = self.period_ns.numerator, self.period_ns.denominator
        return np.array([line * period / divisor for line in range(first, end)], dtype=np.float64)

    def _count_until(self, stamp_ns: int) -> int:
        """Return the number of lines with ``time <= stamp``."""
        if stamp_ns < 0:
            return 0
        return stamp_ns * self.period_ns.denominator // self.period_ns.numerator + 1
