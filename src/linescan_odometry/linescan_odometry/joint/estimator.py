"""Method `joint`: displacement of each batch of lines of one camera."""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint import candidates, spectra, static
from linescan_odometry.joint.details import limited
from linescan_odometry.joint.fit import UNFIT, Scaling, noise_of
from linescan_odometry.joint.likelihood import window
from linescan_odometry.joint.maximum import FEWEST, Camera, Solution, View, moving, slow
from linescan_odometry.joint.shadows import may_be_shadow, only_ground
from linescan_odometry.matching.transforms import transform_size
from linescan_odometry.measurements import Displacement, Unmeasured
from linescan_odometry.paths_across import CERTAIN, HARDEST_STOP
from linescan_odometry.plausibility import Plausibility
from omni_core.kernels import kernel
from omni_core.sensors import LineSensor
from omni_core.signals import Lines

_WIDEST = 1.0  # m/s; a velocity with a larger standard deviation is of no use to a vehicle
_MEMORY = 0.5  # s; time constant with which older batches lose weight
_HEAVE_SETTLING = 0.1  # s; slower changes of the scale, as of the load, look like a drift
_LEAST_ERROR = 1e-12  # variance of a change of the scale; keeps ratios finite for equal lines
_TWO_MOTIONS = 0.25  # px; limit on `Fit.difference`; a larger difference indicates two motions
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
        moves: whether the displacement is a motion and not rest.
        slope: the attribute `slope` of `Solution` [1].
        few: whether the displacement is based on so few features, or on so little evidence, that
            another batch must confirm it.
        scaling: change of the scale of the view.
        pattern: fixed pattern after this batch.
    """

    value: float
    variance: float
    reason: str
    rest: spectra.Floats
    coherence: float
    moves: bool
    slope: float
    few: bool
    scaling: Scaling
    pattern: spectra.FixedPattern


class Heave:
    """Measures how much the scale of a camera's view varies, because its height does.

    An ordinary lens shows the ground larger when it comes nearer, so the measured velocity changes
    by the same share as the scale. Within a batch, the change of the scale is measured:
    displacements grow along the line. The integral of the changes is the scale itself, except for
    slow changes and a constant. The prior variance of a change is its mean square in earlier
    batches (empirical Bayes); it is 0 while this mean square may be due to the errors alone.

    Attributes:
        variance: variance of the scale, relative to its mean [1]; 0 if it does not vary
            significantly.
    """

    def __init__(self, line_rate: float) -> None:
        """Create the measurement for a camera with a line rate [1/s]."""
        self._line_rate = line_rate
        self.variance, self._certain = 0.0, False
        # Sums over earlier batches: number, squared changes, their errors, ratios of the two, and
        # squared scales.
        self._weight = self._changes = self._errors = self._ratios = self._square = 0.0
        self.reset()

    @property
    def remark(self) -> str:
        """Description of the variation; empty if it may be due to errors with heavy tails."""
        percent = 100.0 * math.sqrt(self.variance) if self._certain else 0.0
        return f"heave: the scale of the view varies by {percent:.2g} %" if percent else ""

    def reset(self) -> None:
        """Discard the present scale; what is known of its variance remains."""
        self._scale = self._error = 0.0  # scale minus 1, and the variance of its error

    def add(self, scaling: Scaling, lines: int) -> None:
        """Add the change of the scale within a batch.

        Args:
            scaling: change of the scale from line to line.
            lines: number of line periods of the batch.
        """
        if not math.isfinite(scaling.variance):
            self.reset()
            return
        duration = lines / self._line_rate
        kept, settled = math.exp(-duration / _MEMORY), math.exp(-duration / _HEAVE_SETTLING)
        change, error = lines * scaling.change, lines**2 * scaling.variance
        self._weight = kept * self._weight + 1.0
        self._changes = kept * self._changes + change**2
        self._errors = kept * self._errors + error
        self._ratios = kept * self._ratios + change**2 / max(error, _LEAST_ERROR)
        limit, prior = spectra.SIGNIFICANT**2 * math.sqrt(self._weight), 0.0
        if self._changes > (1.0 + limit / self._weight) * self._errors:
            prior = (self._changes - self._errors) / self._weight
        # The errors of few segments have heavier tails than a normal distribution (Student's t).
        self._certain = self._ratios > self._weight + limit + spectra.SIGNIFICANT**2
        share = prior / (prior + error) if prior > 0.0 else 0.0
        change, error = share * change, share * error  # posterior mean and variance
        self._scale, self._error = self._scale + change, self._error + error
        self._square = kept * self._square + self._scale**2 + self._error
        self._scale, self._error = settled * self._scale, settled**2 * self._error
        self.variance = self._square / self._weight if prior > 0.0 else 0.0


class JointEstimator:
    """Estimates the displacements of a camera's lines, and the fixed pattern of the camera.

    Attributes:
        pattern: present estimate of the camera's fixed pattern.
        still: whether only white noise changed the lines of the last batch.
        heave: variation of the scale of the view.
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
        change = HARDEST_STOP / (sensor.line_rate**2 * sensor.pixel_pitch)
        fading = 1.0 / (sensor.line_rate * _MEMORY)
        widest = (_WIDEST / (sensor.line_rate * sensor.pixel_pitch)) ** 2
        self._camera = Camera(taper, weight, stated, change, fading, widest)
        unknown = spectra.FixedPattern(np.zeros(bins, np.complex64), np.zeros(bins))
        self.pattern = unknown if pattern is None else pattern
        self.heave = Heave(sensor.line_rate)
        self.reset()

    def reset(self) -> None:
        """Discard the last displacement; the next line starts a new sequence."""
        self._last = math.nan
        self.still = False
        self.heave.reset()
        self._before = math.nan, math.inf  # of the last batch, even if it was not confirmed

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
        self.still = not estimate.moves
        (last, uncertain), self._before = self._before, (math.nan, math.inf)
        if estimate.reason:
            raise Unmeasured(estimate.reason, unmatched=estimate.moves)
        change = self._camera.change * (len(lines) - 1)
        error = estimate.variance + self.heave.variance * estimate.value**2
        reach = change + CERTAIN * math.sqrt(error + uncertain)
        agrees = abs(estimate.value - last) < reach < math.inf
        confirmed = agrees or (math.isnan(last) and not estimate.few)
        if confirmed or estimate.moves:
            self._before = estimate.value, error
        if not confirmed:
            cause = "few features" if estimate.few else "a change of speed"
            reason = f"{cause}, which the last batch does not confirm"
            raise Unmeasured(reason, unmatched=estimate.moves)
        if not plausibility.check(stamp_ns, np.array([estimate.value]))[0]:
            raise Unmeasured(
                f"not plausible: {estimate.value:.3g} px per line needs more than "
                f"{plausibility.limit:g} m/s^2 since the last measurement"
            )
        self._last = estimate.value
        self.heave.add(estimate.scaling, len(lines) - 1)
        value, variance, scaling = estimate.value, estimate.variance, estimate.scaling
        if self.heave.variance > 0.0:
            variance += self.heave.variance * value**2
            if math.isfinite(scaling.variance):
                value -= scaling.change * scaling.place  # in the middle of the line
                variance += scaling.variance * scaling.place**2
        return Displacement(
            value,
            variance,
            estimate.coherence,
            estimate.rest,
            slope=estimate.slope,
            remark=self.heave.remark,
        )

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
    camera: Camera,
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
    transformed, details = spectra.spectra_of(logs, camera.taper, layout.size), limited(logs)
    known = spectra.shrink(pattern.information, pattern.precision)
    usual = candidates.correlate(transformed, known)
    changing = spectra.spectra_of(details, camera.taper, layout.size)
    remainder = candidates.correlate(changing, np.zeros_like(known))
    found = candidates.find((usual, remainder), layout, camera.weight, last)
    several = layout.lines >= spectra.FEWEST_LINES
    remainder = remainder if several else usual
    view = View(lines, logs, transformed, found, usual, details, remainder, noise_of(logs))
    d, moves, shifts, weak, flaw = _choose(view, camera, layout)
    start = np.array([d, 0.0])
    best = Solution(start, math.inf, 0.0, UNFIT, logs, pattern)
    other = best
    if not flaw and shifts and several:
        other = moving(view, camera, pattern, layout, (d, spectra.mean_of(transformed)))
    if not flaw and (not (shifts and several) or abs(d) * (layout.lines - 1) < _SHIFTED):
        best = slow(view, camera, pattern, layout, (d, known), other.variance)
    parted = other.variance < best.variance
    if parted:
        best = other
    if not flaw:
        flaw = _flaw(best, moves, view, camera, layout)
    if parted and not flaw:
        pattern = _remembered(pattern, best, layout, camera.fading)
    few = weak or best.fit.features < FEWEST
    return Estimate(
        best.motion[0],
        best.variance,
        flaw,
        best.rest,
        best.fit.coherence,
        moves,
        best.slope,
        few,
        best.fit.scaling,
        pattern,
    )


@kernel
def _remembered(
    pattern: spectra.FixedPattern, best: Solution, layout: candidates.Layout, fading: float
) -> spectra.FixedPattern:
    """Return the pattern of all batches; the weight of earlier batches decays exponentially.

    The pattern of a batch contains the mean of the ground over the batch. The texture power,
    estimated without this mean, is too small by its share, and so is the stated variance of the
    pattern. The following batches may still show the same mean, so this share of the batch is not
    independent of theirs either.

    Args:
        pattern: fixed pattern before the batch.
        best: displacement of the batch, and the pattern estimated from it.
        layout: sizes of the batch.
        fading: share of their weight that older batches lose, per line [1].
    """
    kappa = np.arange(layout.lines) - 0.5 * (layout.lines - 1)
    paths = best.motion[0] * kappa + best.motion[1] * 0.5 * kappa**2
    mean = spectra.mean_of(candidates.phases(paths, layout.size, len(pattern.precision)))
    weight = (np.float32(1.0) - mean.real**2 - mean.imag**2) ** 2
    kept = np.float32(max(1.0 - (layout.lines - 1) * fading, 0.0))
    information, precision = best.pattern
    return spectra.FixedPattern(
        pattern.information * kept + information * weight,
        pattern.precision * kept + precision * weight,
    )


@kernel
def _choose(
    view: View, camera: Camera, layout: candidates.Layout
) -> tuple[float, bool, bool, bool, str]:
    """Return the candidate for the displacement that explains the lines best.

    At rest, the lines minus the mean of all lines are white noise. The vehicle therefore counts as
    moving if a displacement explains these differences. A candidate near rest is nevertheless
    chosen if neighboring lines differ only by white noise and nothing shifts along the axis: slow
    motion across the axis changes the lines without shifting them. If even the slow changes are
    white noise, it counts as rest.

    Args:
        view: the batch.
        camera: constants of the camera.
        layout: sizes of the batch.

    Returns:
        Displacement per line [px]; whether it is a motion and not rest; whether the lines are known
        to shift along the axis; whether the evidence is so weak that another batch must confirm it;
        and the reason why the displacement is invalid, which is empty for a valid displacement.
    """
    remainder, found = view.remainder, view.found
    evidence = candidates.rate(remainder, layout, found)
    best = int(np.argmax(evidence))
    # If the shift within the batch is below the smallest distance between two peaks, the candidate
    # counts as rest.
    near = np.flatnonzero(np.abs(found) * (layout.lines - 1) < candidates.APART)
    # Noise alone rarely exceeds half of the log-likelihood that a valid displacement requires.
    limit = candidates.RATIO * candidates.LIKELY
    moves = evidence[best] >= limit
    changes = True
    if len(near) > 0 and (not moves or static.turning(remainder, layout) < limit):
        slowest = near[int(np.argmax(evidence[near]))]
        c, shifts = found[slowest], evidence[slowest] >= candidates.LIKELY
        changes = static.colored(view.recorded, camera.taper, layout, True) >= limit
        if not changes or static.colored(view.recorded, camera.taper, layout, False) < limit:
            visible = shifts or _visible(view, layout, c)
            return c, changes, changes and shifts, False, "" if visible else "low texture"
    elif not moves:
        changes = static.colored(view.recorded, camera.taper, layout, True) >= limit
    if not moves:
        return found[best], changes, True, True, "low texture"
    best = candidates.decide(remainder, layout, found, evidence)
    weak = evidence[best] < candidates.LIKELY
    several = candidates.ambiguous(found, evidence, best)
    if several:
        # The mean of the lines contains ground that moves slowly, the known pattern does not.
        several = candidates.ambiguous(found, candidates.rate(view.usual, layout, found), best)
    if several and layout.lines >= spectra.FEWEST_LINES:
        ground = only_ground(view, layout, evidence)
        best, several = (ground, False) if ground >= 0 else (best, several)
    return found[best], True, True, weak, "ambiguous" if several else ""


@kernel
def _visible(view: View, layout: candidates.Layout, displacement: float) -> bool:
    """Return whether texture moves with a displacement [px per line].

    It must be visible before and after the subtraction of the pattern, because the error of the
    pattern looks like texture in a view without any.
    """
    whole = candidates.correlate(view.spectra, np.zeros_like(view.spectra[0]))
    least = math.inf
    for lines in (view.usual, whole):
        seen = candidates.against_noise(lines, layout)
        least = min(least, candidates.coherent(seen, layout, displacement, 0))
    return least > candidates.LIKELY


@kernel
def _flaw(
    best: Solution, moves: bool, view: View, camera: Camera, layout: candidates.Layout
) -> str:
    """Return the reason why a displacement is invalid; empty if it is valid.

    Args:
        best: the displacement.
        moves: whether it is a motion instead of rest.
        view: the batch.
        camera: constants of the camera.
        layout: sizes of the batch.
    """
    shift = abs(best.motion[0]) * (len(view.logs) - 1)
    if not best.variance < camera.widest:
        return "uncertain"
    if not moves:
        return "low texture" if shift > candidates.APART else ""
    if best.fit.difference > _TWO_MOTIONS:
        return "two motions"
    if shift < candidates.APART:
        return ""
    few = best.fit.features < FEWEST
    if layout.lines >= spectra.FEWEST_LINES:
        few = may_be_shadow(best.motion, view, layout)
    return "dominated by few features" if few else ""
