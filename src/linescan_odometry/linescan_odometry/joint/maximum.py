"""Displacement at a maximum of the likelihood, with a known or with an estimated fixed pattern."""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint import candidates, spectra, static
from linescan_odometry.joint.fit import UNFIT, Fit, assess, scatter, unequal_pixels
from linescan_odometry.joint.likelihood import Expansion, expand, observe, without
from omni_core.kernels import kernel
from omni_core.signals import Lines

SLOPE = 0.3
"""Standard deviation of an unknown slope of the texture [1], from floors of bricks and tiles."""

FEWEST = 6.0
"""Smallest number of independent features of a displacement that needs no confirmation.

A bar of shadow moves with two edges, each of which is up to three of the 24 segments of a line
long.
"""

# Gradient energy over noise. Below it, an oblique texture such as wood is not noticed by its
# persistence. The slope of joints and grain is then unknown.
_LEAST_CONTRAST = 0.1
# Standard deviation of a learned pattern, relative to the pattern [1]. Where dirt absorbs light,
# the mean of the logarithm also depends on the contrast of the ground.
_INEXACT = 0.03


class Camera(NamedTuple):
    """Constants of a camera.

    Attributes:
        taper: factor by which each pixel is multiplied before the transform, shape (n,).
        weight: weight of each frequency in the search for candidates, shape (F,).
        stated: precision of the prior of the fixed pattern, from the configured `non_uniformity`.
        change: prior standard deviation of the change of the displacement from line to line [px].
        fading: share of their weight that older batches lose in the pattern, per line [1].
        widest: largest variance of a valid displacement per line [px^2].
    """

    taper: spectra.Floats
    weight: spectra.Floats
    stated: float
    change: float
    fading: float
    widest: float


class View(NamedTuple):
    """A batch of lines in the frequency domain, with the candidates for its displacement.

    Attributes:
        recorded: gray levels, shape (m, n).
        logs: logarithm of the gray levels after the interpolation of defective pixels, shape
            (m, n).
        spectra: spectra of `logs`, shape (m, F).
        found: candidates for the displacement per line [px], shape (c,).
        usual: correlations after subtraction of the fixed pattern known before this batch.
        details: limited details of the lines, shape (m, n).
        remainder: correlations of `details`, or `usual` if the batch has few lines.
        noise: variance of the noise of a pixel in `logs`.
    """

    recorded: Lines
    logs: spectra.Floats
    spectra: spectra.Spectrum
    found: spectra.Doubles
    usual: candidates.Correlation
    details: spectra.Floats
    remainder: candidates.Correlation
    noise: float


class Solution(NamedTuple):
    """Displacement at a maximum of the likelihood.

    Attributes:
        motion: displacement per line in the middle of the batch [px] and its change from line to
            line [px], shape (2,).
        variance: variance of the displacement [px^2]; infinite without a maximum.
        slope: standard deviation of the unknown slope of the texture against the direction across
            the axis [1]; 0 if the texture is so clear that an oblique one would be noticed.
        fit: further properties at this maximum.
        rest: logarithm of the gray levels, minus the fixed pattern, shape (m, n).
        pattern: pattern estimated from this batch alone, if it can be separated.
    """

    motion: spectra.Doubles
    variance: float
    slope: float
    fit: Fit
    rest: spectra.Floats
    pattern: spectra.FixedPattern


@kernel
def slow(
    view: View,
    camera: Camera,
    pattern: spectra.FixedPattern,
    layout: candidates.Layout,
    start: tuple[float, spectra.Spectrum],
    limit: float,
) -> Solution:
    """Return the displacement near a candidate, from lines that still contain an unknown pattern.

    Over a short distance, and with few lines, ground and pattern cannot be separated. An unknown
    pattern reduces the displacement. The variance therefore includes the displacement that the
    lines would show if only a share of the mean line were ground: the share of the slow changes
    that is certainly explained, or the share that does not look like dirt.

    Args:
        view: the batch.
        camera: constants of the camera.
        pattern: fixed pattern before this batch.
        layout: sizes of the batch.
        start: displacement per line of the candidate [px], and the pattern that is subtracted.
        limit: variance above which the displacement is of no use [px^2]; as soon as it is exceeded,
            the remaining properties are not computed.
    """
    unequal = unequal_pixels(view.logs, view.noise) * (camera.taper**2).sum()
    gains = max(unequal, 1.0 / camera.stated)
    known = start[1].real.astype(np.float64) ** 2 + start[1].imag.astype(np.float64) ** 2
    power = spectra.smoothed(known)
    inexact = _INEXACT**2 * power
    prior = 1.0 / (pattern.precision + 1.0 / np.maximum(gains + power, 1e-12)) + inexact
    dirt = 1.0 / np.maximum(pattern.precision, 1e-12) + inexact
    motion, rest, batch, here = _maximize(view, camera, pattern, layout, start, prior)
    share = 1.0 if np.isfinite(motion).all() else 0.0
    if share > 0.0 and layout.lines >= spectra.FEWEST_LINES:
        least, most = static.explained(view.spectra - start[1], motion, layout)
        share = max(least, most)
        if _hidden(motion[0], share) ** 2 <= limit:
            ground = static.ground_share(rest, prior, dirt, camera.taper, layout, view.noise)
            share = max(least, most * ground)
    if share <= 0.0 or _hidden(motion[0], share) ** 2 > limit:
        return Solution(motion, math.inf, 0.0, UNFIT, rest, batch)
    fit = assess(here, layout.pixels, view.noise)
    # At rest all lines are equal, so few features suffice.
    variance = fit.variance if math.isfinite(fit.variance) else fit.white
    variance += _hidden(abs(motion[0]) + math.sqrt(variance), share) ** 2
    return Solution(motion, variance, 0.0, fit, rest, batch)


@kernel
def _hidden(displacement: float, share: float) -> float:
    """Return by how much a pattern reduces a displacement if only this share is ground [px]."""
    return displacement * (1.0 / share - 1.0) if share > 0.0 else math.inf


@kernel
def moving(
    view: View,
    camera: Camera,
    pattern: spectra.FixedPattern,
    layout: candidates.Layout,
    start: tuple[float, spectra.Spectrum],
) -> Solution:
    """Return the displacement near a candidate, and the pattern, which are estimated together.

    Args:
        view: the batch.
        camera: constants of the camera.
        pattern: fixed pattern before this batch.
        layout: sizes of the batch.
        start: displacement per line of the candidate [px], and the pattern that is subtracted
            first.
    """
    none = np.zeros(len(pattern.precision))
    motion, rest, batch, here = _maximize(view, camera, pattern, layout, start, none)
    if not np.isfinite(motion).all():
        return Solution(motion, math.inf, 0.0, UNFIT, rest, batch)
    fit = assess(here, layout.pixels, view.noise)
    rivals = scatter(view.remainder, layout, motion[0], (candidates.LIKELY, candidates.RATIO))
    clear = fit.contrast >= _LEAST_CONTRAST and fit.features >= FEWEST
    slope = 0.0 if clear else SLOPE
    return Solution(motion, fit.variance + rivals, slope, fit, rest, batch)


@kernel
def _maximize(
    view: View,
    camera: Camera,
    learned: spectra.FixedPattern,
    layout: candidates.Layout,
    start: tuple[float, spectra.Spectrum],
    fixed: spectra.Doubles,
) -> tuple[spectra.Doubles, spectra.Floats, spectra.FixedPattern, Expansion]:
    """Return the maximum of the likelihood near a candidate, found by Newton's method.

    Args:
        view: the batch.
        camera: constants of the camera.
        learned: fixed pattern before this batch.
        layout: sizes of the batch.
        start: displacement per line of the candidate [px], and the pattern that is removed first.
        fixed: variance of the pattern, shape (F,). If it is 0, ground and pattern can be separated,
            and the pattern is estimated anew in each step; otherwise the first pattern is kept.

    Returns:
        Displacement per line in the middle of the batch [px] and its change from line to line [px],
        shape (2,), not finite if there is no maximum; logarithm of the gray levels, minus the fixed
        pattern, shape (m, n); pattern estimated from this batch alone, if it can be separated; and
        the expansion of the log-likelihood at the start of the last step.
    """
    motion, kappa = np.array([start[0], 0.0]), np.arange(layout.lines) - 0.5 * (layout.lines - 1)
    pattern, batch, parted = start[1], learned, not fixed.any()
    # Steps are limited to 1 px, so they do not lead to another peak.
    for number in range(candidates.APART):
        if parted:
            paths = motion[0] * kappa + motion[1] * 0.5 * kappa**2
            batch = observe(view.spectra, pattern, paths, layout.size)
            together = learned.information + batch.information
            pattern = spectra.shrink(together, learned.precision + batch.precision)
        if parted or number == 0:
            rest = without(view.logs, pattern, camera.taper, layout.size)
        here = expand(rest, fixed, motion, layout.limit, camera.change)
        motion = motion + here.step
        # The first pattern is estimated at the candidate, so at least two steps are needed. After a
        # step of less than one standard deviation, a further step would change little.
        small = number > 0 and here.step[0] ** 2 < here.inverse[0, 0]
        if small or not np.isfinite(motion).all():
            break
    return motion, rest, batch, here
