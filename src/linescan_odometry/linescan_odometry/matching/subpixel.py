"""Sub-pixel refinement of a shift by Gauss-Newton steps on smoothed lines, with its variance.

Around the integer shift s, each of the two lines is resampled by one FIR filter. The filter smooths
with a Gaussian, shifts by half of the fraction f (the older line forward, the newer one backward)
and, in a second version, differentiates. Both lines thus pass through equal filters, which avoids a
bias toward integer shifts. Means and contrasts are equalized, so a change of brightness has no
effect. Let ``e_i = old(i + s + f/2) - new(i - f/2)`` be the difference of the filtered lines, p the
filtered derivative of the new line, q that of the old line, and ``g = (p + q) / 2 = de/df``. A step
is

    f <- f - sum(e g) / sum(p q).

The noise of one line is independent of that of the other, so ``sum(p q)`` is the gradient energy of
the texture alone, whereas ``sum(g^2)`` would include the noise. The variance of f is computed at
the last step. With white e, it would be the Cramer-Rao bound times the loss due to smoothing. But e
is correlated along the line, because of the filter and, in sideways motion, because of texture that
enters and leaves. Therefore e g is summed over blocks longer than this correlation: ``var f =
sum_blocks(sum e g)^2 / sum(p q)^2``. In a mean over pairs, the errors of each block are first
summed over the pairs (cluster-robust variance), for two reasons. The noise of a line cancels in the
pairs before and after it. A strip of ground that enters or leaves causes correlated errors in
several pairs.

The width of the Gaussian is a compromise. A wide Gaussian loses the information of fine texture. A
narrow Gaussian is undersampled, which biases displacements toward integer shifts; `./omni study
accuracy` reports this bias as `locking`.
"""

import math

import numpy as np

from omni_core.kernels import declares, kernel
from omni_core.quantities import Float32Array, FloatArray, IntArray
from omni_core.signals import Lines

_RADIUS = 4  # px; radius of the FIR filter, 4.1 sigma at the largest shift
_TAPS = 2 * _RADIUS + 1
_STEPS = 2
_FEWEST_TERMS = 16  # smallest overlap [px]
_BLOCKS = 16  # limit on the parts of an overlap, so that each is longer than the error correlation
_SHORTEST_BLOCK = 4  # px
_FARTHEST = 1.0  # px; if the fraction exceeds this, the integer shift was not at a peak

# The sums below may be reordered for speed. A kernel that permits this must not be cached if
# another kernel calls it. The code inlined into the caller may be rounded differently before and
# after the compiled code is read from the cache, so repeated runs would not be bit-identical.
# Therefore only the callers of these kernels are cached.
_REORDER = {"reassoc", "contract", "nsz"}


def kernel_sigma(pixels: int) -> float:
    """Return the standard deviation of the smoothing kernel [px] for lines of n pixels."""
    return 0.85 if pixels > 335 else 0.8


class SubpixelRefiner:
    """Refines the integer shifts of consecutive lines."""

    def __init__(self, pixels: int) -> None:
        """Create a refiner for lines with this number of pixels."""
        self._sigma = kernel_sigma(pixels)

    def refine(self, lines: Lines, shift: IntArray) -> tuple[FloatArray, FloatArray]:
        """Refine the shift of each line relative to the previous one.

        Args:
            lines: m + 1 lines of n pixels, oldest first, shape (m + 1, n).
            shift: integer shifts [px], shape (m,).

        Returns:
            Displacements, shift plus fraction [px], shape (m,); and, for each displacement, the
            independent errors that the parts of the overlap contribute [px], shape (m, parts). The
            sum of their squares is the variance of the displacement. The errors are infinite if the
            lines have no gradient, or if the refinement moved away from the peak by a pixel.
        """
        displacement, errors = np.empty(len(shift)), np.empty((len(shift), _BLOCKS))
        _refine(lines, shift, self._sigma, displacement, errors)
        return displacement, errors


@kernel
def _refine(
    lines: Lines, shift: IntArray, sigma: float, displacement: FloatArray, errors: FloatArray
) -> None:
    """Refine the shift of every pair by Gauss-Newton steps.

    Args:
        lines: m + 1 lines of n pixels, oldest first, shape (m + 1, n).
        shift: integer shifts [px], shape (m,).
        sigma: standard deviation of the smoothing kernel [px].
        displacement: output, shift plus fraction [px], shape (m,).
        errors: output, error due to each part of the overlap [px], shape (m, parts).
    """
    pixels = lines.shape[1]
    both = np.empty((2, pixels), np.float32)
    filtered, filters = np.empty((4, pixels), np.float32), np.empty((4, _TAPS), np.float32)
    for pair in range(len(shift)):
        s = shift[pair]
        overlap = pixels - abs(s)
        count = overlap - 2 * _RADIUS
        displacement[pair], errors[pair] = s, math.inf
        _equalize(lines[pair + 1, max(0, -s) :][:overlap], both[0])
        _equalize(lines[pair, max(0, s) :][:overlap], both[1])
        fraction = 0.0
        for _ in range(_STEPS if count >= _FEWEST_TERMS else 0):
            _make_filters(fraction, sigma, filters)
            _filter(both, filters, filtered[:, :count])
            step = _step(filtered[:, :count], errors[pair])
            fraction += step
            if not abs(fraction) <= _FARTHEST:
                break
            displacement[pair] = s + fraction
        if not abs(fraction) <= _FARTHEST:
            displacement[pair], errors[pair] = s, math.inf


@declares(cache=False, fastmath=_REORDER)
def _equalize(part: Lines, out: Float32Array) -> None:
    """Write part of a line to `out`, scaled to mean 0 and variance 1; zeros if it is constant."""
    mean, squares = part.mean(), 0.0
    for i in range(len(part)):
        squares += (part[i] - mean) ** 2
    scale = math.sqrt(len(part) / squares) if squares > 0.0 else 0.0
    for i in range(len(part)):
        out[i] = np.float32(scale * (part[i] - mean))


@kernel
def _make_filters(fraction: float, sigma: float, filters: Float32Array) -> None:
    """Write the smoothing filter and the derivative filter of each line to `filters`.

    Args:
        fraction: fraction f of the shift [px].
        sigma: standard deviation of the smoothing kernel [px].
        filters: output, weights of both filters of the new line, then of the old line, shape
            (4, taps).
    """
    for side in range(2):
        offset = fraction * (side - 0.5)
        for k in range(_TAPS):
            u = (k - _RADIUS - offset) / sigma
            weight = math.exp(-0.5 * u * u) / (sigma * math.sqrt(2.0 * math.pi))
            filters[2 * side, k], filters[2 * side + 1, k] = weight, weight * u / sigma


@declares(cache=False, fastmath=_REORDER)
def _filter(both: Float32Array, filters: Float32Array, filtered: Float32Array) -> None:
    """Apply two filters to each of two lines, and write the results to `filtered`.

    Args:
        both: new and old line, shape (2, at least N + taps - 1).
        filters: filters from `_make_filters`, shape (4, taps).
        filtered: output, the filtered lines in the order of the filters, shape (4, N).
    """
    for which in range(4):
        weight, own, out = filters[which], both[which // 2], filtered[which]
        for i in range(len(out)):
            total = np.float32(0)
            for k in range(_TAPS):
                total += weight[k] * own[i + k]
            out[i] = total


@declares(cache=False, fastmath=_REORDER)
def _step(filtered: Float32Array, errors: FloatArray) -> float:
    """Return a Gauss-Newton step [px], and write its error due to each part to `errors`.

    The step is infinite if the lines have no gradient.

    Args:
        filtered: result of `_filter`: new line, its derivative, old line, its derivative,
            shape (4, N).
        errors: output, error of the step due to each part of the overlap [px], shape (parts,).
    """
    new, new_slope, old, old_slope = filtered
    count = filtered.shape[1]
    parts = min(_BLOCKS, count // _SHORTEST_BLOCK)
    sums = np.zeros((4, _BLOCKS))
    for part in range(parts):
        s_e, s_g, s_eg, s_pq = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
        for i in range(part * count // parts, (part + 1) * count // parts):
            e, g = old[i] - new[i], np.float32(0.5) * (new_slope[i] + old_slope[i])
            s_e += e
            s_g += g
            s_eg += e * g
            s_pq += new_slope[i] * old_slope[i]
        sums[0, part], sums[1, part], sums[2, part], sums[3, part] = s_e, s_g, s_eg, s_pq
    rest = sums[2] - sums[0].sum() / count * sums[1]
    energy = sums[3].sum()
    if not energy > 0.0:
        return math.inf
    step: float = -rest.sum() / energy
    errors[:] = (rest + step * sums[3]) / energy * math.sqrt(parts / (parts - 1.0))
    return step
