"""Heave: changes of the height of a camera above the ground, seen in the scale of its view.

An ordinary lens shows the ground larger when it comes nearer, so the measured velocity changes by
the same share as the scale. Within a batch, the change of the scale is measured: displacements grow
along the line. The integral of the changes is the scale itself, except for slow changes and a
constant. The prior variance of a change is its mean square in earlier batches (empirical Bayes); it
is 0 while this mean square may be due to the errors alone.
"""

import math

from linescan_odometry.joint.fit import Scaling
from linescan_odometry.joint.spectra import SIGNIFICANT

_SETTLING = 0.1  # s; slower changes of the scale, as of the load, look like a drift
_MEMORY = 0.5  # s; time constant with which earlier scales lose weight
_LEAST_ERROR = 1e-12  # variance of a change of the scale; keeps ratios finite for equal lines


class Heave:
    """Measures how much the scale of a camera's view varies.

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
        kept, settled = math.exp(-duration / _MEMORY), math.exp(-duration / _SETTLING)
        change, error = lines * scaling.change, lines**2 * scaling.variance
        self._weight = kept * self._weight + 1.0
        self._changes = kept * self._changes + change**2
        self._errors = kept * self._errors + error
        self._ratios = kept * self._ratios + change**2 / max(error, _LEAST_ERROR)
        limit, prior = SIGNIFICANT**2 * math.sqrt(self._weight), 0.0
        if self._changes > (1.0 + limit / self._weight) * self._errors:
            prior = (self._changes - self._errors) / self._weight
        # The errors of few segments have heavier tails than a normal distribution (Student's t).
        self._certain = self._ratios > self._weight + limit + SIGNIFICANT**2
        share = prior / (prior + error) if prior > 0.0 else 0.0
        change, error = share * change, share * error  # posterior mean and variance
        self._scale, self._error = self._scale + change, self._error + error
        self._square = kept * self._square + self._scale**2 + self._error
        self._scale, self._error = settled * self._scale, settled**2 * self._error
        self.variance = self._square / self._weight if prior > 0.0 else 0.0
