"""Flat-field correction: takes out what stands still in the lines while the ground moves.

Uneven light and vignetting stay where they are on every line. A search for
the shift between lines then finds them at zero: a shading of 30 % hides coarse textures. The mean
of lines of many different places is the profile of the optics; lines are divided by it.

Only places that share nothing with those before may enter, or the ground itself would be taken
for a profile, at rest above all. Whether a line shows another place cannot be told from its
displacement, which is just what may be locked at zero. It is told from the *differences* of
neighbouring groups of pixels, in which a smooth profile hardly shows: no shift may match them.

A mean over N places still holds a share of ``1 / sqrt(N)`` of their texture, which stands still
like a profile and pulls displacements towards zero all the more as it has steep gradients. So the
profile is a polynomial, whose degree grows with ``sqrt(N)``: shading and vignetting are corrected,
narrow dirt on the optics is not.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.matching.pearson import PearsonSearch
from linescan_odometry.measurements import Lines

_GROUPS = 128  # of pixels that are compared: their noise is less than that of pixels
_SAME_PLACE = 0.5  # correlation of the differences from which on two lines show the same place
_REMEMBERED = 8  # places that a new one must differ from
_FEWEST_PLACES = 20  # before anything is corrected
_HIGHEST_DEGREE = 24
_STRONGEST = 4.0  # gain


class FlatField:
    """Learns the profile of one camera's optics from its lines, and corrects lines by it."""

    def __init__(self, pixels: int, places: int) -> None:
        """Start without a profile.

        Args:
            pixels: n of a line.
            places: number of places that the profile is the mean over, forgetting older ones;
                0 for no correction.
        """
        self._group = max(1, pixels // _GROUPS)
        self._groups = pixels // self._group
        self._places = places
        self._search = PearsonSearch(self._groups - 1, (self._groups - 1) // 2)
        self._seen: deque[NDArray[np.uint16]] = deque(maxlen=_REMEMBERED)
        self._count = 0
        self._mean = np.ones(pixels)
        place = np.linspace(-1.0, 1.0, pixels)
        degree = min(_HIGHEST_DEGREE, pixels // 8)
        # Orthonormal polynomials by rising degree, shape (n, degree + 1).
        self._basis = np.linalg.qr(np.polynomial.legendre.legvander(place, degree))[0]

    @property
    def places(self) -> int:
        """Number of places learnt so far."""
        return self._count

    @property
    def profile(self) -> NDArray[np.float64]:
        """Brightness of each pixel over the mean of the line, learnt so far [1], shape (n,)."""
        terms = 1 + int(2.0 * math.sqrt(self._count))
        basis = self._basis[:, :terms]
        smooth: NDArray[np.float64] = basis @ (basis.T @ self._mean)
        smooth /= smooth.mean()
        return smooth

    def apply(self, lines: Lines) -> Lines:
        """Learn from the newest of some lines, and return them over the profile."""
        if self._places == 0:
            return lines
        self.learn(lines[-1])
        return self.correct(lines)

    def learn(self, line: Lines) -> bool:
        """Take a line into the profile if it shows another place than those before.

        Args:
            line: as the camera delivered it, shape (n,).

        Returns:
            Whether it was taken.
        """
        mean = float(line.mean())
        if mean == 0.0 or not self._is_elsewhere(line, mean):
            return False
        self._count += 1
        share = 1.0 / min(self._count, self._places)
        self._mean += share * (line / mean - self._mean)
        return True

    def correct(self, lines: Lines) -> Lines:
        """Return lines over the profile, as 16 bit; the lines themselves before it is known.

        One quarter of the range is used at a gain of 1, so that no gain saturates a pixel.

        Args:
            lines: m lines of n pixels, shape (m, n).
        """
        if self._count < _FEWEST_PLACES:
            return lines
        gain = 1.0 / np.maximum(self.profile, 1.0 / _STRONGEST)
        scale = 64.0 if lines.dtype == np.uint8 else 0.25
        corrected: Lines = np.rint(lines * (scale * gain)).astype(np.uint16)
        return corrected

    def _is_elsewhere(self, line: Lines, mean: float) -> bool:
        groups = line[: self._groups * self._group].reshape(self._groups, self._group)
        differences = np.diff(groups.mean(axis=1)) * (8000.0 / mean)
        new = np.clip(np.rint(differences) + 32768.0, 0.0, 65535.0).astype(np.uint16)
        shift, similarity = np.empty(1, np.int64), np.empty(1)
        for old in self._seen:
            self._search.match(np.stack((old, new)), shift, similarity)
            if similarity[0] >= _SAME_PLACE:
                return False
        self._seen.append(new)
        return True
