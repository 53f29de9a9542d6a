"""Counts the independent structures of the ground in a view.

Moving across its axis, a camera sees every slanted edge also shift along it. Over many structures
these pulls cancel; over the few stones of a cobbled road, or the ridges of bark, they do not. As
neighbouring pixels of one stone err alike, the residuals of the match do not show it. The number
of structures is that of independent values in the part of the lines that moves: the width of its
power spectrum ``2 (sum P)^2 / sum P^2``, with P from the products of consecutive lines, in which
noise has no part. Weighted by the frequency, between levels, where shading rules, and slopes, which
the refinement matches, it tells the grounds apart whose errors are larger than their residuals say.
"""

from __future__ import annotations

import numpy as np
import scipy  # whose fft is loaded by its first use: not where configurations are read

from linescan_odometry.matching.subpixel import kernel_sigma
from linescan_odometry.measurements import Lines

_PAIRS = 8
_SMOOTHED = 5  # frequencies
_MANY = 38.0  # structures, from which their pulls cancel
_PULL = 0.09  # of the velocity across the axis, along it, by a single structure


class StructureCounter:
    """Counts structures in the lines of one camera."""

    def __init__(self, pixels: int) -> None:
        """Prepare for lines of n pixels."""
        self._frequency = (2.0 * np.pi / pixels) * np.arange(pixels // 2 + 1, dtype=np.float32)
        self._weight = self._frequency * np.exp(-((kernel_sigma(pixels) * self._frequency) ** 2))

    def count(self, lines: Lines, displacement: float) -> float:
        """Return the number of structures.

        Args:
            lines: that follow each other, oldest first, two at least, shape (m + 1, n).
            displacement: from line to line [px].
        """
        seen = lines[-_PAIRS - 1 :].astype(np.float32)
        if abs(displacement) * len(lines) > len(self._frequency):  # half of a line
            seen -= lines.mean(axis=0, dtype=np.float32)  # what stands still in the view
        spectra = scipy.fft.rfft(seen, axis=1)
        product = np.einsum("ij,ij->j", spectra[1:], spectra[:-1].conj())
        power = (product * np.exp(-1j * displacement * self._frequency)).real
        power[0] = 0.0  # the level
        power = np.convolve(power, np.ones(_SMOOTHED), "same").clip(0.0) * self._weight
        square = float(power @ power)
        return 2.0 * float(power.sum()) ** 2 / square if square > 0.0 else 0.0


def pull(structures: float) -> float:
    """Return the share of the velocity across the axis that may be read along it (deviation)."""
    return _PULL * max(0.0, 1.0 - structures / _MANY)
