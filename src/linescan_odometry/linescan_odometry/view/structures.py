"""Effective number of independent features of the ground in a view.

In motion across the axis every slanted edge also shifts along it. With many features these errors
cancel; with the few stones of a cobbled road, or the ridges of bark, they do not. As neighboring
pixels of one stone have the same error, the residuals of the match do not show it. The number of
features is that of independent values in the moving part of the lines: the width of its
power spectrum ``2 (sum P)^2 / sum P^2``, with P from the products of consecutive lines,
without noise. Weighted by the frequency, a compromise between levels, which contain shading, and
gradients, which the refinement uses, it identifies grounds whose errors exceed their residuals.
"""

from __future__ import annotations

import math

import numpy as np
import scipy  # whose fft is loaded by its first use: not where configurations are read
from numpy.typing import NDArray

from linescan_odometry.matching.subpixel import kernel_sigma
from linescan_odometry.matching.transforms import load_transforms
from linescan_odometry.measurements import Lines
from omni_platform.kernels import njit

_PAIRS = 8
_SMOOTHED = 5  # frequencies
_SIDE = _SMOOTHED // 2
_MANY = 38.0  # structures, from which their pulls cancel
_PULL = 0.06  # of the velocity across the axis, along it, by a single structure


class StructureCounter:
    """Estimates the number of independent features in the lines of one camera."""

    def __init__(self, pixels: int) -> None:
        """Prepare for lines of n pixels."""
        load_transforms()
        self._frequency = (2.0 * np.pi / pixels) * np.arange(pixels // 2 + 1, dtype=np.float32)
        self._weight = self._frequency * np.exp(-((kernel_sigma(pixels) * self._frequency) ** 2))

    def count(self, lines: Lines, displacement: float) -> float:
        """Return the effective number of independent features.

        Args:
            lines: that follow each other, oldest first, two at least, shape (m + 1, n).
            displacement: from line to line [px].
        """
        number: float = _count(lines, displacement, self._frequency, self._weight)
        return number


@njit(cache=True, error_model="numpy")
def _count(
    lines: Lines, displacement: float, frequency: NDArray[np.float32], weight: NDArray[np.float32]
) -> float:
    seen = lines[max(0, len(lines) - _PAIRS - 1) :].astype(np.float32)
    if abs(displacement) * len(lines) > len(frequency):  # half of a line
        still = np.zeros(lines.shape[1], np.float32)  # in the view
        for row in range(len(lines)):
            for i in range(len(still)):
                still[i] += np.float32(lines[row, i])
        seen -= still / np.float32(len(lines))
    spectra = scipy.fft.rfft(seen, seen.shape[1], 1)
    bins = len(frequency)
    product = np.zeros(bins, np.complex128)
    for row in range(len(spectra) - 1):
        old, new = spectra[row], spectra[row + 1]
        for k in range(bins):
            product[k] += new[k] * np.conj(old[k])
    power = np.zeros(bins + 2 * _SIDE)
    for k in range(1, bins):  # without the level
        angle = displacement * frequency[k]
        power[_SIDE + k] = product[k].real * math.cos(angle) + product[k].imag * math.sin(angle)
    total, square = 0.0, 0.0
    for k in range(bins):
        value = max(power[k : k + _SMOOTHED].sum(), 0.0) * weight[k]
        total += value
        square += value * value
    return 2.0 * total**2 / square if square > 0.0 else 0.0


def pull(structures: float) -> float:
    """Return the standard deviation of the velocity along the axis per velocity across it [1]."""
    return _PULL * max(0.0, 1.0 - structures / _MANY)
