"""Comparison of a camera's lines with an earlier line, for textures that never leave the view."""

import math

import numpy as np

from omni_core.kernels import declares, kernel
from omni_core.quantities import Float32Array
from omni_core.signals import Lines

_REACH = 0.5  # share of a line; larger shifts of a view are not compared
_LONGEST = 1.0  # s; limit on the time for which a line is stored
_LEAST_SHIFT = 8.0  # px; at smaller shifts, a fixed pattern looks like an oblique texture
_SEARCHED = 3  # px searched on each side of the expected shift, plus _SEARCHED_SHARE of the shift
_SEARCHED_SHARE = 0.01
_FEWEST = 16  # smallest number of pixels for a comparison
EXCESS = 0.35
"""Excess correlation that two successive comparisons do not reach by chance [1]."""


class Keyframe:
    """Stores an earlier line of one camera, and compares newer lines with this line."""

    def __init__(self, pixels: int) -> None:
        """Create the comparison for one camera, without a stored line.

        Args:
            pixels: number of pixels n of a line.
        """
        self._step = 4 if pixels > 512 else 2  # px; finer detail is noise
        self._gradient: Float32Array | None = None
        self._stamp_ns = 0
        self._shift = 0.0

    def reset(self) -> None:
        """Discard the stored line."""
        self._gradient = None

    def compare(
        self, stamp_ns: int, period_ns: float, lines: Lines | Float32Array, displacement: float
    ) -> tuple[float, float]:
        """Return the age of the stored line, and how well newer lines still match it.

        A stored line is replaced by a newer one if the shift between them is too large or the
        stored line is too old.

        Args:
            stamp_ns: stamp of the newest line [ns].
            period_ns: line period [ns].
            lines: consecutive lines, oldest first, shape (m + 1, n).
            displacement: mean displacement per line [px].

        Returns:
            Two numbers, which are 0 if the view has hardly shifted. The first is the age of the
            stored line [s]. The second is the smallest correlation of this line with three lines of
            the batch, divided by the correlation of neighboring lines [1].
        """
        span = len(lines) - 1
        pixels = lines.shape[1]
        self._shift += span * displacement
        gradient = self._gradient
        if (
            gradient is None
            or abs(self._shift) > _REACH * pixels
            or not 0.0 < 1e-9 * (stamp_ns - self._stamp_ns) < _LONGEST
        ):
            first = 0
            if abs(span * displacement) > _REACH * pixels:
                first = span - max(1, int(_REACH * pixels / abs(displacement)))
            gradient = self._remember(lines[first])
            self._stamp_ns = stamp_ns - round((span - first) * period_ns)
            self._shift = (span - first) * displacement
        # A periodic ground leaves the view and returns, whereas an oblique texture never leaves it.
        # To distinguish the two, the lines in between are compared too.
        near, far = _compare(lines, self._step, self._shift, displacement, EXCESS**2, gradient)
        persistence = max(0.0, far) / max(near, EXCESS)
        if persistence < EXCESS:
            self._gradient = None  # a periodic ground would match again later
        if abs(self._shift) < _LEAST_SHIFT:
            return 0.0, 0.0
        return 1e-9 * (stamp_ns - self._stamp_ns), persistence

    def _remember(self, line: Lines | Float32Array) -> Float32Array:
        gradient: Float32Array = np.empty((3, len(line) - 2 * self._step + 1), np.float32)
        _differentiate(line, self._step, gradient[0])
        self._gradient = gradient
        return gradient


@kernel
def _differentiate(line: Lines | Float32Array, step: int, gradient: Float32Array) -> None:
    """Write to `gradient`, for each position, the sum of the next `step` pixels minus the last."""
    ahead, behind = 0.0, 0.0
    for i in range(step):
        behind += line[i]
        ahead += line[i + step]
    gradient[0] = ahead - behind
    for i in range(1, gradient.shape[0]):
        middle = float(line[i + step - 1])
        behind += middle - line[i - 1]
        ahead += line[i + 2 * step - 1] - middle
        gradient[i] = ahead - behind


@declares(error_model="python", fastmath={"reassoc", "contract", "nsz"})
def _compare(
    lines: Lines | Float32Array,
    step: int,
    shift: float,
    displacement: float,
    abort_below: float,
    gradient: Float32Array,
) -> tuple[float, float]:
    """Return two correlations: of the two newest lines, and of newer lines with an earlier line.

    Instead of the lines themselves, their gradients are correlated.

    Args:
        lines: consecutive lines, oldest first, shape (m + 1, n).
        step: number of pixels in each sum of `_differentiate`.
        shift: shift of the newest line against the earlier line [px].
        displacement: displacement per line [px].
        abort_below: correlation below which the comparison is aborted.
        gradient: gradient of the earlier line in row 0, and working memory in rows 1 and 2, shape
            (3, length of a gradient).

    Returns:
        Correlation of the two newest lines, and the smallest correlation of three lines of the
        batch with the earlier line. Each correlation is the largest one near the expected shift.
    """
    span = len(lines) - 1
    backs = (1, 0, span // 5, span // 2)
    near, far = 0.0, 1.0
    for case in range(4):
        if case == 0:
            _differentiate(lines[span], step, gradient[1])
            _differentiate(lines[span - 1], step, gradient[2])
            old, new, expected = gradient[2], gradient[1], displacement
        else:
            if case > 1:
                _differentiate(lines[span - backs[case]], step, gradient[2])
            old, new = gradient[0], gradient[1 if case == 1 else 2]
            expected = shift - backs[case] * displacement
        reach = _SEARCHED + int(_SEARCHED_SHARE * abs(expected))
        best = -1.0
        for s in range(round(expected) - reach, round(expected) + reach + 1):
            count = len(new) - abs(s)
            if count < _FEWEST:
                continue
            x, y = new[max(0, -s) :][:count], old[max(0, s) :][:count]
            xx, yy, xy = np.float32(0), np.float32(0), np.float32(0)
            for i in range(count):
                xx += x[i] * x[i]
                yy += y[i] * y[i]
                xy += x[i] * y[i]
            norm = math.sqrt(float(xx) * float(yy))
            best = max(best, float(xy) / norm if norm > 0.0 else 0.0)
        if case == 0:
            near = best
        else:
            far = min(far, best)
            if far < abort_below:
                break
    return near, far
