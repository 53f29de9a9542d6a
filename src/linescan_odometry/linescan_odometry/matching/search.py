"""Displacement of each line from the previous one: full search for the shift, then refinement.

A search compares each line with the previous one at each shift up to the limit. At shift s only the
overlapping part is used: pixel i of the newer line is compared with pixel i + s of the older one,
``n - |s|`` pixels in all. A positive shift means that the sensor moved along its +axis, so that
ground features moved toward smaller pixel indices. Sections 4.3.2 and 4.4 of the dissertation
describe the search.
"""

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

import numpy as np

from linescan_odometry.matching.direct import DirectSearch
from linescan_odometry.matching.pearson import PearsonSearch
from linescan_odometry.matching.subpixel import SubpixelRefiner
from omni_core.quantities import BoolArray, FloatArray, IntArray
from omni_core.signals import Lines


class ShiftSearch(Protocol):
    """Finds integer shifts between the consecutive rows of an array of lines."""

    def match(self, lines: Lines, shift: IntArray, similarity: FloatArray) -> None:
        """Find the shift of each line relative to the previous one.

        Args:
            lines: m + 1 lines of n pixels, oldest first, C-contiguous, shape (m + 1, n).
            shift: output, best shift of each pair [px], shape (m,).
            similarity: output, Pearson's correlation at that shift, shape (m,); -1 if a line is
                constant. Searches with other metrics return it too, so that one threshold suffices.
        """

    def reset(self) -> None:
        """Discard all lines; the next line starts a new sequence."""


METRICS: Mapping[str, Callable[[int], ShiftSearch]] = {
    "pearson": PearsonSearch,  # Eq. (81)
    "euclidean": partial(DirectSearch, "euclidean"),  # Eq. (79)
    "squared_euclidean": partial(DirectSearch, "squared_euclidean"),
    "manhattan": partial(DirectSearch, "manhattan"),  # Eq. (80)
    "spearman": partial(DirectSearch, "spearman"),
    "cosine": partial(DirectSearch, "cosine"),  # Eq. (83)
}
"""Constructor of the full search for each metric; its argument is the limit on the shift [px]."""


def make_search(metric: str, limit: int, window: int = 0, prior_weight: float = 0.0) -> ShiftSearch:
    """Return a search for integer shifts.

    Args:
        metric: one of `METRICS`.
        limit: limit on the shift [px].
        window: half width of the search range around the last displacement [px]; 0 to search all
            shifts always.
        prior_weight: relative increase of the distance at a shift that differs from the last
            displacement by `limit` [1].
    """
    if window > 0 or prior_weight > 0.0:
        return DirectSearch(metric, limit, window, prior_weight)
    return METRICS[metric](limit)


@dataclasses.dataclass(frozen=True)
class PairDisplacements:
    """Displacements of consecutive lines; pair i compares line i + 1 with line i.

    Attributes:
        displacement: motion of the sensor along its +axis [px], shape (m,).
        errors: errors that the parts of the overlap contribute to each displacement [px], shape (m,
            parts). These errors are independent, and the sum of their squares is the variance of
            the displacement.
        similarity: correlation at the peak [1], shape (m,).
        usable: whether the peak of each pair is high enough, shape (m,).
    """

    displacement: FloatArray
    errors: FloatArray
    similarity: FloatArray
    usable: BoolArray


class PairMatcher:
    """Measures the displacements of consecutive lines."""

    def __init__(
        self, search: ShiftSearch, refiner: SubpixelRefiner, minimum_correlation: float
    ) -> None:
        """Create a matcher from its two stages.

        Args:
            search: stage that finds the integer shifts.
            refiner: stage that finds the fractions of the shifts.
            minimum_correlation: minimum correlation of a usable pair [1].
        """
        self._search = search
        self._refiner = refiner
        self._minimum_correlation = minimum_correlation

    def reset(self) -> None:
        """Discard all lines; the next line starts a new sequence."""
        self._search.reset()

    def match(self, lines: Lines) -> PairDisplacements:
        """Return the displacement of each line from the previous one.

        Args:
            lines: m + 1 lines, oldest first, C-contiguous, shape (m + 1, pixels).
        """
        pairs = len(lines) - 1
        shift = np.empty(pairs, np.int64)
        similarity = np.empty(pairs)
        self._search.match(lines, shift, similarity)  # Eq. (81)
        displacement, errors = self._refiner.refine(lines, shift)
        usable = (similarity >= self._minimum_correlation) & np.isfinite(errors[:, 0])
        return PairDisplacements(displacement, errors, similarity, usable)
