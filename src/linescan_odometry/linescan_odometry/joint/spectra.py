"""Spectra of lines, without the camera's defective pixels, and its fixed pattern in them.

The optics blur every detail of the ground over several pixels. If a pixel differs from its
neighbors both in the mean of a batch and in each line, it is defective, or a speck of dirt covers
it. Such pixels are interpolated. At rest, some sharp features of the ground may also be
interpolated; the test of rest therefore uses the recorded pixels.

The fixed pattern consists of dirt, unequal pixels, shading and mud, which change every line in the
same way. For a given displacement, the posterior of the pattern is Gaussian at every frequency.
Earlier batches and the present one are weighted by their information. The prior variance is the
power of the estimated pattern (empirical Bayes), so a camera without dirt loses little information.
Before candidates for the displacement are compared, the posterior mean of the pattern is subtracted
from the lines. This mean is shrunk toward zero at frequencies where it consists mostly of errors.

In shapes, m is the number of lines, n the number of pixels per line, and F the number of spatial
frequencies.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import kernel, linked, njit
from omni_core.signals import Lines

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Spectrum = NDArray[np.complex64]

HIGHEST = 0.3  # cycles per pixel; the optics attenuate higher frequencies, which are also aliased
_SMOOTHED = 4  # bins on each side over which a power spectrum is averaged
SIGNIFICANT = 3.0  # standard deviations; larger deviations are not attributed to chance

FEWEST_LINES = 8
"""Minimum number of lines for the estimation of a fixed pattern."""

# Smallest difference of a defective pixel from its neighbors, as a multiple of the median of all
# pixels that differ [1]: about 6 standard deviations.
_OUTSTANDING = 9.0

fast = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
"""Decorator for kernels in which the compiler may contract operations, for speed."""
summing = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"})
"""Decorator for kernels in which the compiler may also reorder the terms of a sum."""


class FixedPattern(NamedTuple):
    """Estimated fixed pattern of a camera: spectrum of the logarithm of the pixel gains.

    Attributes:
        information: precision times mean of the spectrum at each frequency, shape (F,).
        precision: precision of this mean at each frequency, 0 without information, shape (F,).
    """

    information: Spectrum
    precision: Doubles

    def deviation(self, pixels: int) -> float:
        """Return the standard deviation of the pixel gains, relative to their mean [1].

        The argument `pixels` is the number of pixels of a line.
        """
        power = np.abs(shrink(self.information, self.precision)) ** 2
        size = len(power) / HIGHEST
        return math.sqrt(2.0 * float(power.sum()) / (pixels * size))  # by Parseval's theorem


def without_defects(lines: Lines) -> Lines:
    """Return the lines with interpolated defective pixels; without defects, the lines themselves.

    Args:
        lines: consecutive lines, shape (m, n).
    """
    if len(lines) < FEWEST_LINES:
        return lines
    defective = _defects(lines)
    if len(defective) == 0:
        return lines
    sound = np.setdiff1d(np.arange(lines.shape[1]), defective, assume_unique=True)
    after = np.searchsorted(sound, defective).clip(1, len(sound) - 1)
    left, right = sound[after - 1], sound[after]
    share = ((defective - left) / (right - left)).clip(0.0, 1.0).astype(np.float32)
    repaired: Lines = lines.copy()
    between = (1.0 - share) * lines[:, left] + share * lines[:, right]
    repaired[:, defective] = np.rint(between).astype(lines.dtype)
    return repaired


@kernel
def _defects(lines: Lines) -> NDArray[np.int64]:
    """Return the indices of the defective pixels, shape (d,), in lines of shape (m, n).

    A defective pixel differs from the median of the pixels within 2 px. The difference is large in
    the mean over all lines, and has the same sign in this mean and in every line.
    """
    n = lines.shape[1]
    mean = mean_of(lines.astype(np.float32))
    excess = np.empty(n, np.float32)
    for i in range(n):
        a, b = mean[max(i - 2, 0)], mean[max(i - 1, 0)]
        c, d = mean[min(i + 1, n - 1)], mean[min(i + 2, n - 1)]
        low, high = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))
        excess[i] = mean[i] - min(max(mean[i], min(low, high)), max(low, high))
    deviation = np.abs(excess)
    # On the slopes of a smooth ground, most pixels are between their neighbors.
    apart = deviation[deviation > 0.0]
    limit = max(_OUTSTANDING * np.median(apart), 1.0) if len(apart) > 0 else 1.0
    defective = deviation > limit
    for pixel in np.flatnonzero(defective):
        for line in lines:
            value, beyond = line[pixel], 0  # neighbors from which the pixel differs
            for j in range(pixel - 2, pixel + 3):
                near = line[min(max(j, 0), n - 1)]
                beyond += value > near if excess[pixel] > 0.0 else value < near
            if beyond < 3:  # of five pixels, so the median does not differ
                defective[pixel] = False
                break
    found: NDArray[np.int64] = np.flatnonzero(defective)
    return found


@linked
@kernel
def spectra_of(logs: Floats, taper: Floats, size: int) -> Spectrum:
    """Return the spectra of the logarithm of lines.

    Args:
        logs: logarithm of the gray levels, shape (m, n).
        taper: factor by which each pixel is multiplied before the transform, shape (n,).
        size: length to which the tapered lines are padded with zeros [px].

    Returns:
        Spectra at the F frequencies up to `HIGHEST`, shape (m, F).
    """
    padded = np.zeros((len(logs), size), np.float32)
    for k in range(len(logs)):
        row, own = padded[k], logs[k]
        mean = np.float32(sum_of(own) / len(own))
        for i in range(len(own)):
            row[i] = (own[i] - mean) * taper[i]
    spectra: Any = np.fft.rfft(padded, size, 1)
    result = np.empty((len(logs), int(HIGHEST * size)), np.complex64)
    for k in range(len(logs)):
        low, every = result[k], spectra[k]
        for f in range(len(low)):
            low[f] = every[f]
    return result


@kernel
def power_of(lines: Spectrum) -> Floats:
    """Return the sum of the powers of lines with spectra of shape (m, F), shape (F,)."""
    power = np.zeros(lines.shape[1], np.float32)
    for k in range(len(lines)):
        row = lines[k]
        for f in range(len(power)):
            power[f] += row[f].real * row[f].real + row[f].imag * row[f].imag
    return power


@kernel
def mean_of(lines: NDArray[Any]) -> NDArray[Any]:
    """Return the mean of lines or spectra, shape (m, n), as an array of shape (n,).

    It takes a quarter of the time of a sum over the first axis, which is not vectorized.
    """
    mean: NDArray[Any] = np.zeros_like(lines[0])
    for k in range(len(lines)):
        mean += lines[k]
    mean /= np.float32(len(lines))
    return mean


@summing
def sum_of(values: Floats) -> float:
    """Return the sum of the elements of `values`."""
    result = np.float32(0.0)
    for i in range(len(values)):
        result += values[i]
    return float(result)


@linked
@kernel
def shrink(information: Spectrum, precision: Doubles) -> Spectrum:
    """Return the posterior mean of a pattern, whose prior variance is its power, shape (F,).

    The power is that of the estimated pattern minus that of its error (empirical Bayes). If the
    power is not significant, the pattern is assumed to be 0: a pattern that absorbs part of the
    ground texture would bias slow displacements away from 0.

    Args:
        information: precision times mean, shape (F,).
        precision: precision at each frequency, 0 without information, shape (F,).
    """
    mean, excess = np.zeros(len(precision), np.complex64), np.zeros(len(precision))
    for f in range(len(precision)):
        if precision[f] > 0.0:
            mean[f] = information[f] / np.float32(precision[f])
            excess[f] = mean[f].real ** 2 + mean[f].imag ** 2 - 1.0 / precision[f]
    gain = np.maximum(smoothed(excess), 0.0) * precision
    shrunk: Spectrum = mean * (gain / (gain + 1.0)).astype(np.float32)
    return shrunk


@fast
def smoothed(values: Doubles) -> Doubles:
    """Return the values of a spectrum, averaged over neighboring frequencies, shape (F,)."""
    count = len(values)
    total = np.zeros(count + 1)
    for i in range(count):
        total[i + 1] = total[i] + values[i]
    mean = np.empty(count)
    for i in range(count):
        first, last = max(0, i - _SMOOTHED), min(count, i + _SMOOTHED + 1)
        mean[i] = (total[last] - total[first]) / (2 * _SMOOTHED + 1)
    return mean
