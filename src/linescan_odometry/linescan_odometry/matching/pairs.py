"""Displacement of each line from the previous one: search for the shift, then refinement."""

import dataclasses

import numpy as np

from linescan_odometry.matching.search import ShiftSearch
from linescan_odometry.matching.subpixel import SubpixelRefiner
from omni_platform.quantities import BoolArray, FloatArray
from omni_platform.signals import Lines


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
