"""Flat-field correction: estimates the fixed pattern while the ground moves, and removes it.

Uneven light, dirt, unequal pixels, a shadow of the vehicle: a fixed pattern matches itself at zero
displacement. The mean of lines at many different positions is its profile, and lines are divided by
it. Occluded pixels, such as stuck ones or those under mud, do not change with the others: they are
interpolated from their neighbors.

Only lines at new positions are used, otherwise the ground itself would enter the profile, above all
at rest. Whether the view has moved is decided by the *difference* of two lines, which contains no
fixed pattern: at rest it is noise without correlation of neighboring pixels, in motion it has the
correlation of the ground.

A mean over N positions still contains ``1 / N`` of the energy of their texture. So the profile is
used only where it is clearly larger, in its levels or in its gradients (small differences between
neighboring pixels have most weight in a sub-pixel match), and is reduced by the likely share of
texture. The lines of a camera without faults are not changed.

Dark and white references are applied first: the profile is estimated from lines without the dark
signal, divided by the white one. They contain no dirt, shadows and mud, which are estimated as
without references. Tables of an earlier drive are used from the first line on, and checked with the
positions of the current drive.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.measurements import LineBatchError, Lines
from omni_platform.kernels import njit
from omni_platform.quantities import FloatArray

Floats = NDArray[np.float32]

_REMEMBERED = 6  # places that a new one must differ from
_NEIGHBORS = 0.12  # correlation of neighboring pixels of a difference that is not only noise
_SIGMAS = 3.5  # of that correlation where there is only noise
_UNLIKE = 0.8  # energy of a difference over that of both lines, 1 if they share nothing
_DECORRELATED = 0.35  # of the largest structure of a difference
_GROWN = 2.0  # the structure of differences, when places before turn out to be near each other
_FEWEST_PLACES = 6  # before anything is corrected
_FAR_PLACES = 30  # that are not all near each other
_FEWEST_ACTIVE = 12  # before pixels are found to be blind
_QUICK_PLACES = 48  # until which every line is looked at, later some of each batch
_LINES_PER_BATCH = 4
_DECIDED_EVERY = 24  # places, beyond those
_CLEARLY = 3.0  # times what the texture of the places lets expect
_STRONGEST = 4.0  # gain
_BLIND = 0.45  # of the temporal deviation of the other pixels
_FADE = 32.0  # px beside a gap of blind pixels
_MOST_BLIND = 0.6  # share of a view; beyond, there is nothing to be saved

# Sums in any order. Such a kernel must not be in the cache itself if another one calls it (see
# `subpixel`): compiled with its caller alone.
_REORDER = {"reassoc", "contract", "nsz"}


class _Tables(NamedTuple):
    """Estimates for each of n pixels, see `FlatField`, and working memory.

    Attributes:
        seen: recent lines at different positions, shape (r, n).
        mean: mean of the lines, shape (n,).
        square: mean square of the lines, shape (n,).
        step: mean square of the differences of neighbors, shape (n - 1,).
        dark: dark signal of the references [gray levels], shape (n,).
        white: gain of the references [1], shape (n,).
        relative: working memory, shape (n,).
        difference: working memory, shape (n,).
    """

    seen: Floats
    mean: FloatArray
    square: FloatArray
    step: FloatArray
    dark: FloatArray
    white: FloatArray
    relative: Floats
    difference: Floats


class _Learned(NamedTuple):
    """Progress of the estimation.

    Attributes:
        places: number of positions in the tables.
        own: number of these that are not from loaded tables.
        structure: largest correlation of recent differences.
        anew: whether the estimation was restarted.
        taken: whether the newest line was used.
        undecided: whether to decide again what is corrected.
    """

    places: int
    own: int
    structure: float
    anew: bool = False
    taken: bool = False
    undecided: bool = False


class FlatField:
    """Estimates the profile of a camera from its lines, and corrects lines by it."""

    def __init__(self, pixels: int, places: int) -> None:
        """Start without a profile.

        Args:
            pixels: n of a line.
            places: number of positions in the moving mean of the profile; 0 for no correction.
        """
        self._pixels = pixels
        self._places = places
        self._seen = np.zeros((_REMEMBERED, pixels), np.float32)
        self._count = 0
        self._undecided = False
        self._structure = 0.0  # the largest of the differences of late
        self._mean = np.ones(pixels)
        self._square = np.ones(pixels)
        self._step = np.zeros(pixels - 1)  # mean square of the differences of neighbors
        self._dark: FloatArray = np.zeros(pixels)
        self._white: FloatArray = np.ones(pixels)  # gain of each pixel, of the references
        self._dead: NDArray[np.bool_] = np.zeros(pixels, np.bool_)  # by the references
        self._referenced = False
        self._own = 0  # places learned since tables were loaded
        self._gain: FloatArray | None = None
        self._whole_gain: FloatArray | None = None  # with that of the references, made when used
        self._blind: NDArray[np.bool_] = np.zeros(pixels, np.bool_)
        self._any_blind = False
        self._relative = np.empty(pixels, np.float32)  # working memory
        self._difference = np.empty(pixels, np.float32)

    @property
    def places(self) -> int:
        """Number of positions used so far."""
        return self._count

    @property
    def active(self) -> bool:
        """Whether the correction is enabled."""
        return self._places > 0

    @property
    def learning(self) -> bool:
        """Whether a correction of the fixed pattern is configured but not yet available."""
        return self.active and not self.settled

    @property
    def corrects(self) -> bool:
        """Whether lines are corrected already."""
        return self._gain is not None or self._referenced

    @property
    def settled(self) -> bool:
        """Whether the fixed pattern is estimated, even if there is none."""
        return self._own >= _FAR_PLACES

    @property
    def profile(self) -> FloatArray:
        """Estimated brightness of each pixel over the mean of the line [1], shape (n,)."""
        profile: FloatArray = self._mean / self._mean.mean()
        return profile

    @property
    def blind(self) -> NDArray[np.bool_]:
        """Whether each pixel is occluded, shape (n,)."""
        return self._blind | self._dead

    @property
    def references(self) -> tuple[FloatArray, FloatArray]:
        """Dark signal [gray levels] and gain [1] of each pixel by the references."""
        return self._dark, self._white

    def take_references(self, dark: Lines | None, white: Lines | None) -> None:
        """Make tables from lines of a covered camera and of an even white surface.

        Args:
            dark: lines without light, in gray levels, shape (m, n); None for no dark signal.
            white: lines of an evenly lit surface, shape (m, n); None for equal gains.

        Raises:
            LineBatchError: another number of pixels, or white is no brighter than dark.
        """
        for lines in (dark, white):
            if lines is not None and lines.shape[1:] != (self._pixels,):
                raise LineBatchError(
                    f"references have lines of {self._pixels} px, not of shape {lines.shape}"
                )
        self._dark = np.zeros(self._pixels) if dark is None else dark.mean(axis=0)
        self._white = np.ones(self._pixels)
        if white is not None:
            light = white.mean(axis=0) - self._dark
            if light.mean() <= 0.0:
                raise LineBatchError("the white reference is no brighter than the dark one")
            relative = light / light.mean()
            self._dead = relative < 1.0 / _STRONGEST
            self._white = 1.0 / np.maximum(relative, 1.0 / _STRONGEST)
        self._referenced = True
        self._count, self._own, self._structure = 0, 0, 0.0
        self._gain = self._whole_gain = None

    def save(self, path: Path) -> None:
        """Write references and learned tables to a file of numpy (.npz)."""
        np.savez(
            path, count=self._count, mean=self._mean, square=self._square, step=self._step,
            dark=self._dark, white=self._white, dead=self._dead, referenced=self._referenced,
            structure=self._structure,
        )  # fmt: skip

    def load(self, path: Path) -> None:
        """Read tables that `save` wrote.

        Raises:
            LineBatchError: they are invalid, or of a camera with another number of pixels.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                tables = dict(file)
            count, structure = int(tables["count"]), float(tables["structure"])
            referenced = bool(tables["referenced"])
            rows = [tables[name] for name in ("mean", "square", "dark", "white", "dead", "step")]
        except (OSError, ValueError, KeyError) as error:
            raise LineBatchError(f"{path} holds no tables of a camera: {error}") from None
        if len(rows[0]) != self._pixels:
            raise LineBatchError(
                f"{path} is of {len(rows[0])} px, this camera has {self._pixels} px"
            )
        self._mean, self._square, self._dark, self._white, self._dead, self._step = rows
        self._count, self._structure, self._referenced = count, structure, referenced
        self._own = 0
        self._undecided, self._whole_gain = True, None

    def apply(self, lines: Lines) -> Lines:
        """Update the profile with lines, oldest first, and return the corrected lines."""
        if self._places == 0:
            return self.correct(lines)
        every = 1 if self._count < _QUICK_PLACES else max(1, len(lines) // _LINES_PER_BATCH)
        self._learn(lines, every)
        return self.correct(lines)

    def learn(self, line: Lines) -> bool:
        """Use a line for the profile if it is at a new position.

        Args:
            line: as the camera delivered it, shape (n,).

        Returns:
            Whether it was taken.
        """
        return self._learn(line[None], 1)

    def _learn(self, lines: Lines, every: int) -> bool:
        """Update with every n-th line, oldest first; return whether the newest was used."""
        tables = _Tables(
            self._seen, self._mean, self._square, self._step, self._dark, self._white,
            self._relative, self._difference,
        )  # fmt: skip
        learned: _Learned = _learn(
            lines, every, tables, _Learned(self._count, self._own, self._structure), self._places
        )
        self._count, self._own, self._structure, anew, taken, undecided = learned
        if anew:
            self._gain = self._whole_gain = None
            self._blind = np.zeros(self._pixels, np.bool_)
        self._undecided = self._undecided or undecided
        return taken

    def correct(self, lines: Lines) -> Lines:
        """Return lines divided by the profile, as 16 bit; unchanged lines without a profile.

        A gain of 1 uses a quarter of the range, so that no gain saturates a pixel.

        Args:
            lines: m lines of n pixels, shape (m, n).
        """
        if self._undecided:
            self._decide()
        if not self.corrects:
            return lines
        if self._whole_gain is None:
            self._whole_gain = self._white if self._gain is None else self._white * self._gain
            self._any_blind = bool(self.blind.any())
        gain = self._whole_gain
        scale = 64.0 if lines.dtype == np.uint8 else 0.25
        corrected: Lines = np.empty(lines.shape, np.uint16)
        if self._any_blind:
            light = (lines - self._dark) * (scale * gain)
            _fill(light, self.blind)
            _round(light, np.zeros(self._pixels), np.ones(self._pixels), corrected)
        else:
            _round(lines, self._dark, scale * gain, corrected)
        return corrected

    def _decide(self) -> None:
        """Decide whether there is a profile, and which pixels are occluded."""
        self._undecided = False
        if self._count < _FEWEST_PLACES:
            return
        number = min(self._count, self._places)
        profile = self.profile
        spread = np.maximum(self._square - self._mean**2, 0.0) * number / (number - 1.0)
        steps = np.diff(profile)
        step_spread = np.maximum(self._step - np.diff(self._mean) ** 2, 0.0)
        texture, level = float(spread.mean()) / number, float(np.var(profile))
        edge, gradient = float(step_spread.mean()) / number, float(np.mean(steps**2))
        # Places near each other share their coarse structure, but hardly their gradients.
        certain = gradient > _CLEARLY * edge
        certain |= self._count >= _FAR_PLACES and level > _CLEARLY * texture
        if self._gain is None and not certain:
            return
        # The share of the profile that is no texture of the places.
        real = max(0.0, 1.0 - texture / max(level, 1e-12), 1.0 - edge / max(gradient, 1e-12))
        smooth = 1.0 + real * (profile - 1.0)
        self._gain = 1.0 / np.maximum(smooth, 1.0 / _STRONGEST)
        self._whole_gain = None
        if self._count >= _FEWEST_ACTIVE:
            activity = np.sqrt(spread) * self._gain
            blind = activity < _BLIND * float(np.median(activity))
            blind |= smooth < 1.0 / _STRONGEST
            if blind.mean() <= _MOST_BLIND:
                self._blind = blind


@njit(cache=True, error_model="numpy")
def _learn(lines: Lines, every: int, tables: _Tables, learned: _Learned, places: int) -> _Learned:
    """Update the tables with lines at new positions, oldest first.

    Args:
        lines: as the camera delivered them, shape (m, n).
        every: spacing of the used lines, the newest among them.
        tables: changed in place.
        learned: progress, changed in place.
        places: number of positions in the moving mean.
    """
    count, own, largest = learned.places, learned.own, learned.structure
    anew, taken, undecided = False, False, False
    relative = tables.relative
    pixels = len(relative)
    for row in range((len(lines) - 1) % every, len(lines), every):
        taken = False
        if _level(lines[row], tables.dark, tables.white, relative) <= 0.0:
            continue
        known = min(own, _REMEMBERED)
        least, greatest, likeness, energy = _structure(
            relative, tables.seen[:known], tables.difference
        )
        # Pixels of a ground finer than they are share nothing either, but no line is like another.
        unlike = known > 0 and energy > _UNLIKE
        if known > 0 and not unlike and likeness < max(_NEIGHBORS, _SIGMAS / math.sqrt(pixels)):
            continue
        if greatest > _GROWN * largest:
            # The places so far were near each other: their mean holds the ground.
            count, own, known, anew = 0, 0, 0, True
        largest = max(largest, greatest)
        if known > 0 and not unlike and least < _DECORRELATED * largest:
            continue
        tables.seen[own % _REMEMBERED] = relative
        count, own, taken = count + 1, own + 1, True
        largest *= 1.0 - 0.1 / _REMEMBERED
        _enter(relative, 1.0 / min(count, places), tables.mean, tables.square, tables.step)
        # A mean over many places changes little by one more.
        undecided |= count <= _QUICK_PLACES or count % _DECIDED_EVERY == 0
    return _Learned(count, own, largest, anew, taken, undecided)


@njit(error_model="numpy", fastmath=_REORDER)
def _level(line: Lines, dark: FloatArray, white: FloatArray, relative: Floats) -> float:
    """Write a line less its dark signal times the gains over its mean; return the mean."""
    pixels = line.shape[0]
    total = 0.0
    for i in range(pixels):
        total += (line[i] - dark[i]) * white[i]
    mean: float = total / pixels
    scale = 1.0 / mean if mean > 0.0 else 0.0
    for i in range(pixels):
        relative[i] = (line[i] - dark[i]) * white[i] * scale
    return mean


@njit(error_model="numpy", fastmath=_REORDER)
def _enter(
    relative: Floats, share: float, mean: FloatArray, square: FloatArray, step: FloatArray
) -> None:
    """Update the mean, the mean square and that of the differences with a line."""
    for i in range(relative.shape[0]):
        value = float(relative[i])
        mean[i] += share * (value - mean[i])
        square[i] += share * (value * value - square[i])
    before, behind = relative[:-1], relative[1:]
    for i in range(step.shape[0]):
        difference = float(behind[i] - before[i])
        step[i] += share * (difference * difference - step[i])


@njit(cache=True)
def _round(light: FloatArray | Lines, dark: FloatArray, gain: FloatArray, out: Lines) -> None:
    """Write lines less the dark signal times the gain, rounded to 16 bit."""
    for row in range(out.shape[0]):
        line, into = light[row], out[row]
        for i in range(out.shape[1]):
            value = np.rint((line[i] - dark[i]) * gain[i])
            into[i] = np.uint16(min(max(value, 0.0), 65535.0))


@njit(error_model="numpy", fastmath=_REORDER)
def _structure(line: Floats, seen: Floats, d: Floats) -> tuple[float, float, float, float]:
    """Compare a line with others by their differences, each of which `d` receives.

    Returns:
        The smallest and the largest mean product of neighboring pixels of a difference; this
        product over their mean square in the difference with the smallest one; the smallest energy
        of a difference over that of the two lines.
    """
    least, greatest, neighbors, energy = 1e30, 0.0, 1.0, 1.0
    pixels = line.shape[0]
    for row in range(seen.shape[0]):
        other = seen[row]
        own, own_square, its, its_square = 0.0, 0.0, 0.0, 0.0
        for i in range(pixels):  # both are near 1, where sums of squares lose nothing
            x, y = float(line[i]) - 1.0, float(other[i]) - 1.0
            d[i] = x - y
            own += x
            own_square += x * x
            its += y
            its_square += y * y
        square, product = 0.0, 0.0
        for i in range(pixels):
            square += float(d[i]) * float(d[i])
        before, behind = d[:-1], d[1:]
        for i in range(pixels - 1):
            product += float(before[i]) * float(behind[i])
        offset = (own - its) * (own - its) / pixels
        square -= offset
        product -= offset
        if product < least:
            least = product
            neighbors = product / square if square > 0.0 else 0.0
        greatest = max(greatest, product)
        both = own_square + its_square - (own * own + its * its) / pixels
        energy = min(energy, square / both if both > 0.0 else 0.0)
    return least / pixels, greatest / pixels, neighbors, energy


def _fill(light: FloatArray, blind: NDArray[np.bool_]) -> None:
    """Fade occluded pixels from their neighbors to the mean of the line.

    For short gaps this is interpolation. A step at the edge of a gap would be a fixed pattern that
    biases the match of a coarse ground.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], blind, [False])).astype(np.int8)))
    mean = light[:, ~blind].mean(axis=1, keepdims=True)
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        away = np.arange(1.0, end - first + 1.0)
        share = np.maximum(1.0 - away / min(_FADE, end - first + 1.0), 0.0)
        before = light[:, first - 1, None] - mean if first > 0 else 0.0
        after = light[:, end, None] - mean if end < len(blind) else 0.0
        light[:, first:end] = mean + before * share + after * share[::-1]
