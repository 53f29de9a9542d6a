"""Comparison of a camera's lines with earlier lines, to measure how much of the texture remains.

Groups of successive lines are aligned by the displacement and averaged. Neighboring groups of a
batch are compared with each other, and its newest half with that of an earlier batch, the keyframe.
The even and the odd lines of a group show the same texture with independent noise, so the product
of their means contains the power of the texture alone. The gradients of the means are compared,
because gradients determine the displacement.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint.candidates import APART, COMPARED, bands
from linescan_odometry.joint.spectra import SIGNIFICANT
from linescan_odometry.matching.transforms import transform_size
from linescan_odometry.measurements import Decay
from omni_core.kernels import declares, kernel
from omni_core.quantities import Float32Array, FloatArray
from omni_core.signals import Lines

UNSHIFTED = 2.0
"""Shift below which a view seems constant, and a fixed pattern counts as remaining texture [px]."""

_REACH = 0.5  # share of a line; larger shifts of a view are not compared
_SPREAD = 0.25  # share of a line; limit on the shift between the lines of a group
_LONGEST = 1.0  # s; limit on the age of a keyframe
_LEFT = 0.35  # share of the texture; if less remains, the keyframe is replaced
_SEARCHED = 3  # px searched on each side of the expected shift, plus _SEARCHED_SHARE of the shift
_SEARCHED_SHARE = 0.01
# Limit on a gradient, relative to the mean magnitude: edges of shadows and of dirt exceed it.
_LIMIT = 2.0
# Number of independent gradients of white noise per step between the compared pixels: the squared
# autocorrelation of the noise after `_differentiate` has the sum 2/3 step.
_INDEPENDENT = 1.5
_FEWEST = 16  # smallest number of pixels for a comparison
# Lengths of neighboring groups, as shares of a batch: long groups show the loss of faint texture,
# and short ones that of texture that leaves the view within a few lines.
_SHARES = (1 / 8, 1 / 2)

_summing = declares(error_model="python", fastmath={"reassoc", "contract", "nsz"})


class Group(NamedTuple):
    """Mean of aligned lines.

    Attributes:
        gradients: gradients of the means of all, of even and of odd lines, shape (3, p).
        first: pixel of the newest line at which the gradients begin.
        power: power that even and odd lines have in common.
        noise: power of the noise in the gradient of the mean of all lines.
        spread: ratio of the number of independent values of the texture to that of white noise; it
            is small if few features contain most of the power.
    """

    gradients: Float32Array
    first: int
    power: float
    noise: float
    spread: float


class Keyframe:
    """Stores earlier lines of one camera, and compares newer lines with them."""

    def __init__(self, pixels: int) -> None:
        """Create the comparison for one camera, without a keyframe.

        Args:
            pixels: number of pixels n of a line.
        """
        self._step = _step_of(pixels)
        self._group: Group | None = None
        self._stamp_ns = 0
        self._shift = 0.0

    def reset(self) -> None:
        """Discard the keyframe."""
        self._group = None

    def compare(
        self, stamp_ns: int, period_ns: float, lines: Lines | Float32Array, displacement: float
    ) -> tuple[Decay, ...]:
        """Return how much texture remains within the batch, and since the keyframe.

        The keyframe is replaced by the newest half of the batch if the shift between them is too
        large, if it is too old, or if its texture has left the view.

        Args:
            stamp_ns: stamp of the newest line [ns].
            period_ns: line period [ns].
            lines: consecutive lines, oldest first, shape (m + 1, n).
            displacement: mean displacement per line [px].
        """
        pixels, period, step = lines.shape[1], 1e-9 * period_ns, self._step
        self._shift += (len(lines) - 1) * displacement
        most = int(_SPREAD * pixels / max(abs(displacement), _SPREAD))
        counts = [min(max(int(share * len(lines)), 2), most) for share in _SHARES]
        if counts[0] < 2 or len(lines) < 4:
            self.reset()
            return ()
        lines = lines.astype(np.float32, copy=False)
        decays = [_within(lines, count, displacement, period, step) for count in counts]
        newest, duration = _average(lines, counts[-1], displacement, step), counts[-1] * period
        age, group = 1e-9 * (stamp_ns - self._stamp_ns), self._group
        if not 0.0 < age < _LONGEST or abs(self._shift) > _REACH * pixels:
            group = None
        if group:
            reach = _SEARCHED + int(_SEARCHED_SHARE * abs(self._shift))
            since = _compare(newest, group, (self._shift, reach), step)
            decay = _decay(since, age, duration)
            if decay.least > _LEFT:
                decay = decay._replace(blur=_blur(newest, group, since.shift, step))
            decays.append(decay)
        if not group or decays[-1].most < _LEFT:
            self._group, self._stamp_ns, self._shift = newest, stamp_ns, 0.0
        return tuple(decays)


@_summing
def _average(lines: Float32Array, count: int, displacement: float, step: int) -> Group:
    """Return the mean of the newest lines, aligned with the newest one.

    Args:
        lines: consecutive lines, oldest first, shape (k, n).
        count: number of lines that are averaged, at least 2.
        displacement: displacement per line [px].
        step: number of pixels in each of the two sums whose difference is a gradient.
    """
    last, farthest = len(lines) - 1, round((count - 1) * displacement)
    first = max(0, -farthest)
    means = np.zeros((2, lines.shape[1] - abs(farthest)), np.float32)
    for back in range(count):
        mean, begin = means[back % 2], first + round(back * displacement)
        seen = lines[last - back, begin : begin + len(mean)]
        for i in range(len(mean)):
            mean[i] += seen[i]
    size = max(means.shape[1] - 2 * step + 1, 1)
    mean_even, mean_odd = means[0], means[1]
    mean_even /= np.float32((count + 1) // 2)
    mean_odd /= np.float32(count // 2)
    gradients = np.zeros((3, size), np.float32)
    whole, even, odd = gradients[0], gradients[1], gradients[2]
    _differentiate(mean_even, step, even)
    _differentiate(mean_odd, step, odd)
    half, zero = np.float32(0.5), np.float32(0.0)
    power, noise, second, fourth = zero, zero, zero, zero
    for i in range(size):
        whole[i] = half * (even[i] + odd[i])
        square, error = whole[i] * whole[i], half * (even[i] - odd[i])
        power += even[i] * odd[i]
        noise += error * error
        second += square
        fourth += square * square
    kurtosis = size * fourth / max(second**2, 1e-30)  # 3 for a Gaussian distribution
    return Group(gradients, first, power / size, noise / size, min(3.0 / max(kurtosis, 1.0), 1.0))


@_summing
def _differentiate(line: Float32Array, step: int, gradient: Float32Array) -> None:
    """Write to `gradient`, for each position, the sum of the next `step` pixels minus the last."""
    if len(line) < 2 * step:
        return
    gradient[:] = 0.0
    for place in range(step):  # loops along the line can be vectorized, unlike running sums
        ahead, behind = line[place + step :], line[place:]
        for i in range(len(gradient)):
            gradient[i] += ahead[i] - behind[i]
    total = np.float32(0.0)
    for i in range(len(gradient)):
        total += abs(gradient[i])
    limit = np.float32(_LIMIT * total / len(gradient))
    for i in range(len(gradient)):
        gradient[i] = min(max(gradient[i], -limit), limit)


def _step_of(pixels: int) -> int:
    """Return the distance of the compared pixels of a line [px]; finer detail is noise."""
    return 4 if pixels > 512 else 2


def kept(new: Lines, old: Lines, reach: int) -> tuple[float, float]:
    """Return the share of the texture of a constant view that an older line shows, and its error.

    The texture is relative to the mean gray level. The result is the largest regression coefficient
    of the gradients of the older line on those of the new ones [1], and its standard deviation,
    which is infinite if the new lines show no texture.

    Args:
        new: two consecutive lines of a constant view, shape (2, n).
        old: older line, shape (n,).
        reach: largest shift between the older line and the new ones [px].
    """
    step = _step_of(len(old))
    gradients = np.zeros((3, max(len(old) - 2 * step + 1, 1)), np.float32)
    for line, gradient in zip((*new, old), gradients, strict=True):
        _differentiate(line / np.float32(max(line.mean(), 1.0)), step, gradient)
    one, other, before = gradients
    reach = min(reach, len(one) // 4)
    texture, inner = float(one @ other), one[reach : len(one) - reach]
    if not texture > 0.0:
        return 0.0, math.inf
    share = float(np.correlate(before, inner).max()) / texture * len(one) / len(inner)
    # Noise changes both the product and the texture.
    power = float(before @ before) + share**2 * float(other @ other)
    error = math.sqrt(power * float(one @ one) * step / (_INDEPENDENT * len(one))) / texture
    return share, error


class _Common(NamedTuple):
    """What two groups have in common.

    Attributes:
        product: power in common.
        texture: least possible geometric mean of the powers of their textures.
        whole: largest possible geometric mean of these powers.
        variance: variance of `product`; infinite without a comparison.
        shifted: whether the view has shifted between the groups.
        shift: shift at which they have most in common [px].
    """

    product: float
    texture: float
    whole: float
    variance: float
    shifted: bool
    shift: int


@kernel
def _within(
    lines: Float32Array, count: int, displacement: float, period: float, step: int
) -> Decay:
    """Return how much texture remains from one group of lines to the next, mean over a batch.

    Args:
        lines: consecutive lines, oldest first, shape (k, n).
        count: number of lines in a group.
        displacement: displacement per line [px].
        period: line period [s].
        step: number of pixels in each of the two sums whose difference is a gradient.
    """
    product, texture, whole, variance, shifted = 0.0, 0.0, 0.0, 0.0, False
    for end in range(len(lines), 2 * count - 1, -2 * count):
        new = _average(lines[:end], count, displacement, step)
        old = _average(lines[: end - count], count, displacement, step)
        one = _compare(new, old, (count * displacement, 0), step)
        product += one.product
        texture += one.texture
        whole += one.whole
        variance += one.variance
        shifted = one.shifted
    common = _Common(product, texture, whole, variance, shifted, 0)
    return _decay(common, count * period, count * period)


@kernel
def _decay(common: _Common, age: float, duration: float) -> Decay:
    """Return what groups of a duration have in common, relative to their texture."""
    least, most = common.product / common.whole, common.product / common.texture
    variance = common.variance / common.texture**2
    return Decay(age, duration, least, most, variance, common.shifted, math.inf)


@kernel
def _compare(new: Group, old: Group, expected: tuple[float, int], step: int) -> _Common:
    """Return what two groups of lines have in common.

    Args:
        new: newer group.
        old: older group.
        expected: shift between them, and limit on the error of this shift [px].
        step: number of pixels in each of the two sums whose difference is a gradient.
    """
    shift, reach = round(expected[0]), expected[1]
    shifted, most, number, found = abs(expected[0]) >= APART, -math.inf, 0, shift
    for s in range(shift - reach, shift + reach + 1):
        product, count = _product(new, 0, old, 0, s)
        if count >= _FEWEST and product > most:
            most, number, found = product, count, s
    # What even and odd lines have in common without the shift is a fixed pattern, or texture of low
    # frequency. Either way, the kept share is between two bounds.
    pattern = 0.0
    if abs(expected[0]) > UNSHIFTED:
        pattern = 0.5 * (_product(new, 1, old, 2, 0)[0] + _product(new, 2, old, 1, 0)[0])
    texture = _mean_power(new, old, max(pattern, 0.0))
    whole = _mean_power(new, old, min(pattern, 0.0))
    if number == 0 or not texture > 0.0:
        return _Common(1.0, 1.0, 1.0, math.inf, shifted, found)
    independent = _INDEPENDENT * number / step
    one, other = new.noise / texture, old.noise / texture
    mixed, kept = one + other + one * other, most / texture
    denominator = one + one**2 + other + other**2 + (mixed if pattern != 0.0 else 0.0)
    variance = (mixed + kept**2 * denominator) / independent
    variance += 1.0 / (independent * min(new.spread, old.spread))
    return _Common(most, texture, whole, variance * texture**2, shifted, found)


def _blur(new: Group, old: Group, shift: int, step: int) -> float:
    """Return the largest blur along the line that the common texture of two groups allows [px].

    A moving average over b pixels multiplies the power at the frequency f by ``sinc(f b)^2``, which
    is at most ``1 / (pi f b)^2``. The power of natural texture does not increase with frequency, so
    no blur is larger than the one that explains the power at a frequency relative to the largest
    power at lower frequencies.

    Args:
        new: newer group.
        old: older group.
        shift: shift between them [px].
        step: number of pixels in each of the two sums whose difference is a gradient.
    """
    by = new.first + shift - old.first
    first, end = max(0, -by), min(new.gradients.shape[1], old.gradients.shape[1] - by)
    if end - first < _FEWEST:
        return math.inf
    ahead, behind = new.gradients[0, first:end], old.gradients[0, first + by : end + by]
    size = int(transform_size(2 * len(ahead)))
    edges, white, center = _bands(size, step)
    one, other = np.fft.rfft(np.stack((ahead, behind)), size)[:, : edges[-1]]
    common = np.add.reduceat((one * other.conj()).real, edges[:-1])
    whole = np.add.reduceat(0.5 * (np.abs(one) ** 2 + np.abs(other) ** 2), edges[:-1])
    scale = 1.0 / (len(ahead) * white)
    power, noise = scale * common, 0.5 * (new.noise + old.noise) / (2 * step)
    certain = power - SIGNIFICANT * np.sqrt(4.0 * noise * scale * whole / np.diff(edges))
    most = np.maximum(np.maximum.accumulate(power), 0.0)
    blur = np.sqrt(most / np.maximum(certain, 1e-30)) / (np.pi * center)
    return float(np.min(blur, where=certain > 0.0, initial=math.inf))


@cache
def _bands(size: int, step: int) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Return the frequency bands of a transform, and what `_differentiate` changes in them.

    Args:
        size: size of the transform [px].
        step: number of pixels in each of the two sums whose difference is a gradient.

    Returns:
        Edges of the bands [bins], shape (B + 1,); in each band, the sum of the power of the
        gradients of white noise with the variance 1, and the center [cycles per pixel], shape (B,).
    """
    edges = bands(size)
    edges = edges[edges <= COMPARED * size]
    f = np.pi * np.arange(1, edges[-1]) / size
    power = np.append(0.0, 4.0 * np.sin(step * f) ** 4 / np.sin(f) ** 2)
    center = np.sqrt(edges[:-1] * edges[1:]) / size
    return edges, np.add.reduceat(power, edges[:-1]), center


@kernel
def _mean_power(new: Group, old: Group, pattern: float) -> float:
    """Return the geometric mean of the powers of two textures, given that of a fixed pattern."""
    return math.sqrt(max(new.power - pattern, 0.0) * max(old.power - pattern, 0.0))


@_summing
def _product(new: Group, one: int, old: Group, other: int, shift: int) -> tuple[float, int]:
    """Return the mean product of gradients of two groups, and the number of its terms.

    Args:
        new: newer group.
        one: index in its `gradients`.
        old: older group.
        other: index in its `gradients`.
        shift: shift between them [px].
    """
    by, ahead, behind = new.first + shift - old.first, new.gradients[one], old.gradients[other]
    first, end = max(0, -by), min(len(ahead), len(behind) - by)
    if end <= first:
        return 0.0, 0
    x, y, total = ahead[first:end], behind[first + by : end + by], np.float32(0.0)
    for i in range(len(x)):
        total += x[i] * y[i]
    return float(total) / len(x), len(x)
