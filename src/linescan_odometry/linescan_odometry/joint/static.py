"""Tests of a view that hardly changes: what changes in it, and which share of it is ground.

A view is static if the vehicle is at rest, or if the camera sees only its own fixed pattern: dirt
on the window over a ground without visible texture. Both give the same lines. They are separated
by what is known of dirt: it absorbs light, so it darkens pixels and brightens none. The texture of
the ground does both. In slow motion, the share of the ground also follows from the changes of the
lines, because the ground moves and the pattern does not.

In shapes, m is the number of lines, n the number of pixels per line, and F the number of spatial
frequencies.
"""

import math

import numpy as np

from linescan_odometry.joint import candidates, spectra
from linescan_odometry.joint.candidates import COMPARED, Correlation, Layout
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum
from omni_core.kernels import kernel, linked
from omni_core.signals import Lines

_SLOW = 3  # half periods per batch of the slow changes of a pixel
# Half periods per batch of the fast changes. They have an eighth of the power of the slow ones if
# the change of a pixel is a random walk, and more if the ground shifts by several details.
_FAST = 8
# Variance of the larger one of a standard normal variable and 0, as of noise that only brightens.
_HALF = 0.5 - 0.5 / math.pi
_TOO_FAST = 0.5  # power of fast changes over that of slow changes, between these two cases


@kernel
def turning(rest: Correlation, layout: Layout) -> float:
    """Return the log-likelihood ratio of any motion along the axis versus none [nats].

    Motion along the axis turns the phases of the correlations between lines; motion across the axis
    only reduces the correlations. In the first hypothesis, the phase at each frequency is free. The
    result is the largest ratio at any line spacing.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
    """
    largest, count = 0.0, int(COMPARED * layout.size)
    power = rest.power[:count] ** 2
    for which in range(candidates.SPACINGS):
        # For noise alone, the squared coherence of N pairs is 1 / N on average.
        noise = np.float32(1.0 / max(layout.lines - candidates.spacings(layout.lines)[which], 2))
        value = rest.lagged[which, :count]
        square = value.real**2 + value.imag**2 - noise * power
        gain = np.sqrt(np.maximum(square / (1.0 - noise), 0.0)).astype(np.float32)
        free = candidates.ratio(rest, layout, gain, 1.0, which)
        largest = max(largest, free - candidates.coherent(rest, layout, 0.0, which))
    return largest


@kernel
def colored(lines: Lines, taper: Floats, layout: Layout, slowly: bool) -> float:
    """Return the log-likelihood ratio of colored versus white changes of the lines [nats].

    The changes contain no fixed pattern. At rest, they contain only noise, which is white. If the
    ground moves, they also contain its texture, which is colored because the optics attenuate high
    frequencies. The log-likelihood ratio follows from the spectral flatness: the geometric mean of
    a spectrum divided by its arithmetic mean.

    Args:
        lines: gray levels, shape (m, n), without interpolated pixels, because interpolation colors
            the noise. Their logarithm would amplify the noise of dark pixels.
        taper: factor of each pixel before the transform, shape (n,).
        layout: sizes of the batch.
        slowly: whether the slow changes within the batch are tested, or the differences of
            neighboring lines.
    """
    levels = lines.astype(np.float32)
    for k in range(len(levels)):
        line = levels[k]
        # The gain of a line, for example under mains light, would color its differences.
        line /= np.float32(max(spectra.sum_of(line) / layout.pixels, 1.0))
    if slowly:
        modes = min(_SLOW, layout.lines - 1)
        changes, number = _projected(levels, modes), float(modes)
    else:
        # The differences are a moving average of order 1: N of them count as 2 N / 3 independent
        # ones.
        changes, number = levels[1:] - levels[:-1], (layout.lines - 1) / 1.5
    whole = spectra.power_of(spectra.spectra_of(changes, taper, layout.size))
    number *= (taper**2).sum() / layout.size
    edges, total, logarithm = candidates.bands(layout.size), 0.0, 0.0
    for b in range(len(edges) - 1):
        i, j = edges[b], edges[b + 1]
        power = max(spectra.sum_of(whole[i:j]), 1e-9)
        total += power
        logarithm += (j - i) * math.log(power / (j - i))
    count = edges[-1] - edges[0]
    # For white noise, the estimated power of each band except one adds half a nat on average.
    return float(number * (count * math.log(total / count) - logarithm) - 0.5 * (len(edges) - 2))


@kernel
def _projected(lines: Floats, count: int) -> Floats:
    """Return the lines, weighted with cosines of 1 to `count` half periods per batch and summed.

    The weights are orthonormal. The argument `lines` has the shape (m, n), and the result has the
    shape (count, n). Spectra are given and returned as their real and imaginary parts.
    """
    m = len(lines)
    sums = np.zeros((count, lines.shape[1]), np.float32)
    for j in range(count):
        total = sums[j]
        for k in range(m):
            angle = math.pi * (j + 1) * (k + 0.5) / m
            weight, own = np.float32(math.sqrt(2.0 / m) * math.cos(angle)), lines[k]
            for i in range(len(own)):
                total[i] += weight * own[i]
    return sums


@kernel
def _energy(spectrum: Floats) -> float:
    """Return the energy of spectra, given as their real and imaginary parts, shape (m, 2 F)."""
    energy: float = spectra.sum_of((spectrum * spectrum).ravel())
    return energy


@linked
@kernel
def explained(lines: Spectrum, motion: Doubles, layout: Layout) -> tuple[float, float]:
    """Return bounds on the share of the slow changes that a displacement explains [1].

    Let the mean line be the sum of a ground of power G and a fixed pattern of power B. The pattern
    reduces a slow displacement that is estimated from the whole lines by the factor G / (G + B),
    and the estimate explains the same share of the changes. The bounds are 0 and 1 if nothing
    changes significantly, and 0 and 0 if the lines change too fast for a slow displacement.

    Args:
        lines: spectra of the lines without the known pattern, shape (m, F).
        motion: displacement per line in the middle of the batch [px] and its change from line to
            line [px], shape (2,).
        layout: sizes of the batch.
    """
    m, use = layout.lines, int(COMPARED * layout.size)
    kappa = np.arange(m) - 0.5 * (m - 1)
    turn = candidates.phases(motion[0] * kappa + 0.5 * motion[1] * kappa**2, layout.size, use)
    seen = np.ascontiguousarray(lines[:, :use])
    seen[:, 0] = 0.0
    slow = min(_SLOW, m - 1)
    number = max(slow, min(_FAST, m // 2))
    changes = _projected(seen.view(np.float32), number)
    shifted = _projected((seen * turn).view(np.float32), slow)
    before, fast, after = _energy(changes[:slow]), _energy(changes[slow:]), _energy(shifted)
    total = _energy((seen - spectra.mean_of(seen)).view(np.float32))
    noise = (total - before - fast) / max(m - 1 - number, 1)  # of each mode
    chance = spectra.SIGNIFICANT * noise * math.sqrt(2.0 * slow / use)
    whole = before - slow * noise
    if whole <= chance:
        return 0.0, 1.0
    if fast - (number - slow) * noise > _TOO_FAST * whole + chance:
        return 0.0, 0.0
    least, most = (before - after - chance) / whole, (before - after + chance) / whole
    return float(max(least, 0.0)), float(min(max(most, 0.0), 1.0))


@linked
@kernel
def ground_share(
    lines: Floats, fixed: Doubles, unknown: Doubles, taper: Floats, layout: Layout, noise: float
) -> float:
    """Return the share of the mean line's power that is ground and not dirt [1].

    Dirt darkens pixels, and the texture of the ground darkens and brightens them equally. Both are
    relative to the middle of the shortest interval that contains half of the pixels (the shorth),
    because even a window of which half is dirty hardly changes this interval. Noise and unequal
    pixels also do both, so their expected power is subtracted. The share is 0 if nothing brightens
    the pixels significantly more than they do: then no ground is visible.

    Args:
        lines: logarithm of the gray levels, minus the fixed pattern, shape (m, n).
        fixed: expected power of unequal pixels that were not subtracted, shape (F,).
        unknown: largest power of dirt that was not subtracted, shape (F,).
        taper: factor of each pixel before the transform, shape (n,).
        layout: sizes of the batch.
        noise: variance of the noise of a pixel, from `noise_of`.
    """
    mean = spectra.mean_of(lines)
    ordered, half = np.sort(mean), layout.pixels // 2
    shortest = int(np.argmin(ordered[half:] - ordered[: layout.pixels - half]))
    middle = ordered[shortest + half // 2]
    parts = np.empty((3, layout.pixels), np.float32)
    for i in range(layout.pixels):
        parts[0, i] = min(mean[i], middle)
        parts[1, i] = max(mean[i], middle)
        parts[2, i] = mean[i]
    # The mean of each line was subtracted, so the first band does not follow the model.
    first, use = candidates.bands(layout.size)[1], int(COMPARED * layout.size)
    seen = spectra.spectra_of(parts, taper, layout.size)[:, first:use]
    power = seen.real**2 + seen.imag**2
    even = fixed[first:use] + noise * (taper**2).sum() / layout.lines
    whole = np.maximum(spectra.smoothed(power[2].astype(np.float64)), 1e-12)
    weight = np.maximum(1.0 - even / whole, 0.0)
    dark = (weight * (power[0] - _HALF * even)).sum()
    bright = (weight * (power[1] - _HALF * even)).sum()
    # The power of noise at one frequency has a standard deviation equal to its mean.
    if bright <= spectra.SIGNIFICANT * _HALF * math.sqrt(((weight * even) ** 2).sum()):
        return 0.0
    dirt = max(dark - bright, 0.0) / (max(dark, 0.0) + bright)
    most = np.minimum(power[2], unknown[first:use])
    return float(1.0 - min(dirt, (weight * most).sum() / (weight * power[2]).sum()))
