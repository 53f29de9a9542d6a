"""Full search for the integer shift between consecutive lines, by metrics chosen by name.

A search compares each line with the one before it at every shift up to the limit. At a shift s
only the overlapping part counts: pixel i of the newer line against pixel i + s of the older one,
``n - |s|`` pixels in all. A positive shift means that the sensor moved along its +axis, so that
ground features moved towards smaller pixel indices (sections 4.3.2 and 4.4).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.measurements import Lines
from linescan_odometry.pearson import PearsonSearch


class ShiftSearch(Protocol):
    """Finds integer shifts between the consecutive rows of an array of lines."""

    def match(
        self, lines: Lines, shift: NDArray[np.int64], similarity: NDArray[np.float64]
    ) -> None:
        """Compare every line with the one before it.

        Args:
            lines: m + 1 lines of n pixels, oldest first, C-contiguous, shape (m + 1, n).
            shift: receives the best shift of each pair [px], shape (m,).
            similarity: receives the similarity at that shift, larger is better and 1 is a
                perfect match, shape (m,); -1 where no shift is defined (a constant line).
        """


METRICS: Mapping[str, Callable[[int, int], ShiftSearch]] = {
    "pearson": PearsonSearch,  # Eq. (81)
}
"""Searches by the name of their metric; each is made for n pixels and a shift limit [px]."""
