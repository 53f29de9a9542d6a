"""Method `joint`: displacement of each batch of lines of one camera."""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint import candidates, spectra
from linescan_odometry.joint.fit import Fit, absorbed, assess, explained, scatter, spread, unequal_pixels
from linescan_odometry.joint.likelihood import Expansion, expand, observe, window, without
from linescan_odometry.matching.transforms import transform_size
from linescan_odometry.measurements import Displacement, Unmeasured
from linescan_odometry.plausibility import Plausibility
from omni_core.kernels import kernel
from omni_core.sensors import LineSensor
from omni_core.signals import Lines

_ACCELERATION = 15.0  # m/s^2, standard deviation; a hard stop on a dry road reaches 10
_MEMORY = 0.5  # s; time constant with which older batches lose weight in the pattern
_FEWEST = 6.0  # smallest number of independent moving features; a shadow's edge counts as up to 7
_TWO_MOTIONS = 0.25  # px; limit on `Fit.difference`; a larger difference indicates two motions
_LEAST_CONTRAST = -1.0  # gradient energy over noise; below it, wood may match another motion
_SHIFTED = 3 * candidates.APART  # px within a batch; beyond it, ground and pattern can be separated
_DARKEST = 0.1  # gray level that is added before the logarithm, relative to the mean gray level


class Estimate(NamedTuple):
    """Displacement estimated from a batch of lines, and the camera's fixed pattern.

    Attributes:
        value: mean displacement per line [px].
        variance: variance of the displacement [px^2].
        reason: reason why the displacement is invalid; empty for a valid displacement.
        rest: logarithm of the gray levels, minus the fixed pattern, shape (m, n). If the
            displacement was rejected before the fit, the pattern is not subtracted.
        coherence: coherence between neighboring lines [1]; 0 if the displacement was rejected
            before the fit.
        pattern: fixed pattern after this batch.
    """

    value: float
    variance: float
    reason: str
    rest: spectra.Floats
    coherence: float
    pattern: spectra.FixedPattern
    detail: spectra.Doubles


class _Camera(NamedTuple):
    """Constants of a camera.

    Attributes:
        taper: factor by which each pixel is multiplied before the transform, shape (n,).
        weight: weight of each frequency in the search for candidates, shape (F,).
        stated: precision of the prior of the fixed pattern, from the configured `non_uniformity`.
        spread: prior standard deviation of the change of the displacement from line to line [px].
        fading: share of their weight that older batches lose in the pattern, per line [1].
    """

    taper: spectra.Floats
    weight: spectra.Floats
    stated: float
    spread: float
    fading: float
    widest: float


class _View(NamedTuple):
    """A batch of lines in the frequency domain, with the candidates for its displacement.

    Attributes:
        recorded: gray levels, shape (m, n).
        logs: logarithm of the gray levels after the interpolation of defective pixels, shape
            (m, n).
        spectra: spectra of `logs`, shape (m, F).
        found: candidates for the displacement per line [px], shape (c,).
        usual: correlations after subtraction of the fixed pattern known before this batch.
        remainder: correlations after subtraction of the mean of `spectra`, or `usual` if the batch
            has few lines.
    """

    recorded: Lines
    logs: spectra.Floats
    spectra: spectra.Spectrum
    found: spectra.Doubles
    usual: candidates.Correlation
    remainder: candidates.Correlation


class JointEstimator:
    """Estimates the displacements of a camera's lines, and the fixed pattern of the camera.

    Attributes:
        pattern: present estimate of the camera's fixed pattern.
    """

    def __init__(
        self,
        sensor: LineSensor,
        limit: int,
        non_uniformity: float = LineSensor.non_uniformity,
        pattern: spectra.FixedPattern | None = None,
    ) -> None:
        """Create the estimator of one camera.

        Args:
            sensor: configuration of the camera.
            limit: limit on the shift between two compared lines [px].
            non_uniformity: standard deviation of the fixed pattern before the camera has moved,
                relative to the gray level [1].
            pattern: fixed pattern from an earlier run, or None.
        """
        self._limit = limit
        self._size = int(transform_size(2 * sensor.pixels))  # no shift wraps around
        bins = int(spectra.HIGHEST * self._size)
        taper = window(sensor.pixels)
        power = non_uniformity**2 * float((taper**2).sum())
        stated = 1.0 / power if power > 0.0 else math.inf
        weight = candidates.band_pass(self._size, bins)
        change = _ACCELERATION / (sensor.line_rate**2 * sensor.pixel_pitch)
        self._camera = _Camera(taper, weight, stated, change, 1.0 / (sensor.line_rate * _MEMORY), (1.0 / (sensor.line_rate * sensor.pixel_pitch)) ** 2)
        unknown = spectra.FixedPattern(np.zeros(bins, np.complex64), np.zeros(bins))
        self.pattern = unknown if pattern is None else pattern
        self._last = math.nan
        self._waiting, self._sd = math.nan, math.inf

    def reset(self) -> None:
        """Discard the last displacement; the next line starts a new sequence."""
        self._last = math.nan

    def measure(self, lines: Lines, plausibility: Plausibility, stamp_ns: int) -> Displacement:
        """Return the mean displacement per line in a batch.

        Args:
            lines: consecutive lines, oldest first, shape (m + 1, n).
            plausibility: check for displacements that are impossible for the platform.
            stamp_ns: time of exposure of the newest line [ns].

        Raises:
            Unmeasured: the lines do not determine a displacement.
        """
        estimate = self.estimate(lines)
        import linescan_odometry
        if hasattr(linescan_odometry, "LOG"):
            linescan_odometry.LOG.append((id(self), estimate.value, estimate.variance, estimate.reason, estimate.detail))
        before, self._waiting = self._waiting, math.nan
        if estimate.reason:
            raise Unmeasured(estimate.reason, unmatched=True)
        self._waiting = estimate.value
        own, self._sd = math.sqrt(estimate.variance), self._sd
        last_sd, self._sd = self._sd, own
        if estimate.detail[6] < _FEWEST and estimate.detail[5] > 0:
            reach = 4.0 * math.hypot(own, last_sd) + self._camera.spread * (len(lines) - 1)
            if not abs(estimate.value - before) <= reach:
                raise Unmeasured("unconfirmed: few features, and the batch before differs", unmatched=True)
        if not plausibility.check(stamp_ns, np.array([estimate.value]))[0]:
            raise Unmeasured(
                f"not plausible: {estimate.value:.3g} px per line needs more than "
                f"{plausibility.limit:g} m/s^2 since the last measurement"
            )
        self._last = estimate.value
        return Displacement(estimate.value, estimate.variance, estimate.coherence, estimate.rest)

    def estimate(self, lines: Lines) -> Estimate:
        """Return the displacement estimated from a batch of lines, oldest first, shape (m, n)."""
        m, n = lines.shape
        layout = candidates.Layout(m, n, self._size, self._limit)
        lines = lines.astype(np.uint16)  # the kernels are compiled for one depth
        levels = spectra.without_defects(lines).astype(np.float32)
        # The logarithm converts the unknown gain of a pixel to an offset. The added level limits
        # the noise of dark pixels, of which a few would otherwise determine the likelihood. It is
        # relative to the line's own mean, so that the gain of a line is an offset too.
        logs = np.log(levels + _DARKEST * levels.mean(axis=1, keepdims=True))
        estimate = _estimate(lines, logs, self._camera, self.pattern, layout, self._last)
        self.pattern = estimate.pattern
        return estimate


# One long kernel is faster than many short ones: after each of them, a thread waits for Python's
# global interpreter lock, which the thread of another camera may hold.
@kernel
def _estimate(
    lines: Lines,
    logs: spectra.Floats,
    camera: _Camera,
    pattern: spectra.FixedPattern,
    layout: candidates.Layout,
    last: float,
) -> Estimate:
    """Return the displacement estimated from a batch of lines.

    Args:
        lines: gray levels, shape (m, n).
        logs: logarithm of the gray levels with interpolated defective pixels, shape (m, n).
        camera: constants of the camera.
        pattern: fixed pattern before this batch.
        layout: sizes of the batch.
        last: displacement per line in the previous batch [px]; NaN without a previous batch.
    """
    transformed = spectra.spectra_of(logs, camera.taper, layout.size)
    known = spectra.shrink(pattern.information, pattern.precision)
    mean = transformed.sum(axis=0) / np.float32(layout.lines)
    usual = candidates.correlate(transformed, known)
    fine = spectra.limited(logs, layout.pixels // 32)
    details = spectra.spectra_of(fine, camera.taper, layout.size)
    varying = candidates.correlate(details, np.zeros_like(mean))
    found = candidates.find((usual, varying), layout, camera.weight, last)
    remainder = varying if layout.lines >= spectra.FEWEST_LINES else usual
    view = _View(lines, logs, transformed, found, usual, remainder)
    d, moves, flaw = _choose(view, camera, layout)
    ev = candidates.rate(remainder, layout, found)
    detail = np.zeros(12)
    detail[0] = ev.max()
    k = int(np.argmin(np.abs(found - d)))
    detail[1] = ev[k]
    detail[2] = candidates.colored(view.recorded, camera.taper, layout, True)
    detail[3] = candidates.turning(remainder, layout)
    detail[4] = candidates.coherent(candidates.against_noise(view.usual, layout), layout, d, 0)
    detail[5] = 1.0 if moves else 0.0
    far = np.abs(found - d) >= candidates.APART
    detail[10] = ev[far].max() if far.any() else 0.0
    gains = unequal_pixels(view.logs) * (camera.taper**2).sum()
    gains = max(gains, 1.0 / camera.stated)
    prior = 1.0 / (pattern.precision + 1.0 / max(gains, 1e-12))
    own = Fit(math.inf, math.inf, 0.0, 0.0, 0.0, 0.0)
    motion = np.array([d, 0.0])
    variance, value, batch, shown = math.inf, d, pattern, view.logs
    # Over a short distance, ground and pattern cannot be separated. The prior of the pattern then
    # determines the split.
    if not moves or layout.lines < spectra.FEWEST_LINES or abs(d) * (layout.lines - 1) < _SHIFTED:
        motion, shown, batch, here = _maximize(view, camera, pattern, layout, (d, known), prior)
        if np.isfinite(motion).all():
            value, own = motion[0], assess(shown, here)
            variance = own.variance
            if not moves and not math.isfinite(variance):
                variance = own.white  # at rest all lines are equal, so few features suffice
            share = explained(transformed - known, motion, layout)
            ground = 1.0 - absorbed(shown, pattern.precision, camera.taper, layout.size)
            detail[11] = share
            detail[9] = ground
            clean = max(share * ground, 1e-6)
            variance += ((abs(value) + math.sqrt(variance)) * (1.0 / clean - 1.0)) ** 2
    parted = moves and layout.lines >= spectra.FEWEST_LINES
    if parted:
        motion2, shown2, batch2, here = _maximize(view, camera, pattern, layout, (d, mean), 0.0 * prior)
        if np.isfinite(motion2).all():
            own2 = assess(shown2, here)
            variance2 = own2.variance + scatter(view.remainder, layout, motion2[0], (candidates.LIKELY, candidates.RATIO))
            parted = variance2 < variance
            if parted:
                motion, shown, batch, own, variance, value = motion2, shown2, batch2, own2, variance2, motion2[0]
        else:
            parted = False
    if not variance < camera.widest:
        detail[6], detail[7], detail[8] = variance, own.variance, own.white
        return Estimate(d, math.inf, flaw or "no maximum of the likelihood", shown, 0.0, pattern, detail)
    detail[6] = own.features
    detail[7], detail[8] = spread(fine, motion)
    d = value
    if moves and abs(d) * (layout.lines - 1) >= candidates.APART and detail[7] < _FEWEST:
        flaw = flaw or "dominated by few features"
    flaw = flaw or _flaw(own, variance, moves, abs(d) * (layout.lines - 1))
    if parted and not flaw:
        # The weight of earlier batches decays exponentially.
        kept = np.float32(max(1.0 - (layout.lines - 1) * camera.fading, 0.0))
        pattern = spectra.FixedPattern(
            pattern.information * kept + batch.information,
            pattern.precision * kept + batch.precision,
        )
    return Estimate(d, variance, flaw, shown, own.coherence, pattern, detail)


@kernel
def _choose(view: _View, camera: _Camera, layout: candidates.Layout) -> tuple[float, bool, str]:
    """Return the candidate for the displacement that explains the lines best.

    At rest, the lines minus the mean of all lines are white noise. The vehicle therefore counts as
    moving if a displacement explains these differences. A candidate near rest is nevertheless
    chosen if neighboring lines differ only by white noise and nothing shifts along the axis: slow
    motion across the axis changes the lines without shifting them.

    Args:
        view: the batch.
        camera: constants of the camera.
        layout: sizes of the batch.

    Returns:
        Displacement per line [px]; whether it is a motion and not rest; and the reason why it is
        invalid, which is empty for a valid displacement.
    """
    remainder, found = view.remainder, view.found
    evidence = candidates.rate(remainder, layout, found)
    best = int(np.argmax(evidence))
    # If the shift within the batch is below the smallest distance between two peaks, the candidate
    # counts as rest.
    static = np.flatnonzero(np.abs(found) * (layout.lines - 1) < candidates.APART)
    # Noise alone rarely exceeds half of the log-likelihood that a valid displacement requires.
    limit = candidates.RATIO * candidates.LIKELY
    moves = evidence[best] >= limit
    if len(static) > 0 and (not moves or candidates.turning(remainder, layout) < limit):
        c = found[static[int(np.argmax(evidence[static]))]]
        if candidates.colored(view.recorded, camera.taper, layout, True) < limit:
            own = candidates.coherent(candidates.against_noise(view.usual, layout), layout, c, 0)
            return c, False, "" if own > candidates.LIKELY else "low texture"
        if candidates.colored(view.recorded, camera.taper, layout, False) < limit:
            return c, True, ""
    if evidence[best] < candidates.LIKELY:
        return found[best], True, "low texture"
    best, ambiguous = candidates.decide(remainder, layout, found, evidence)
    return found[best], True, "ambiguous" if ambiguous else ""


@kernel
def _maximize(
    view: _View,
    camera: _Camera,
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
        rest = without(view.logs, pattern, camera.taper, layout.size)
        here = expand(rest, fixed, motion, layout.limit, camera.spread)
        motion = motion + here.step
        # The first pattern is estimated at the candidate, so at least two steps are needed. After a
        # step of less than one standard deviation, a further step would change little.
        small = number > 0 and here.step[0] ** 2 < here.inverse[0, 0]
        if small or not np.isfinite(motion).all():
            break
    return motion, rest, batch, here


@kernel
def _flaw(best: Fit, variance: float, moves: bool, shift: float) -> str:
    """Return the reason why a maximum of the likelihood is invalid; empty if it is valid.

    Args:
        best: fit at the maximum.
        variance: variance of its displacement [px^2].
        moves: whether the displacement is a motion instead of rest.
        shift: total displacement within the batch [px].
    """
    if not math.isfinite(variance):
        return "dominated by few features"
    if moves and best.difference > _TWO_MOTIONS:
        return "two motions"
    if not moves:
        return "low texture" if shift > candidates.APART else ""
    # After a smaller shift the estimated pattern still contains part of the ground texture.
    return "low texture" if shift > _SHIFTED and best.contrast < _LEAST_CONTRAST else ""
