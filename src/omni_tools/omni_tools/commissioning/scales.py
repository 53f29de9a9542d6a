"""Scale errors that explain the measured motions of a commissioning drive.

Each source measures a motion up to a factor: a wheel its angle, the twist sensor its displacement,
the gyro its rotation. The logarithm of measured/predicted is a sum of the errors that act on this
measurement. Errors with the same column have the same effect on all measurements: the drive cannot
distinguish them. Every set of up to four errors is fitted by least squares; a set explains the
drive if its residuals are within the `Tolerances`, and if no smaller part of it does.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from omni_core.quantities import BoolArray, FloatArray


class Tolerances(NamedTuple):
    """Tolerances within which measured and predicted motions agree, relative to the predicted [1].

    Attributes:
        entry: one wheel in one motion, relative to the root mean square of all wheels.
        wheel: one wheel in all motions compared with the mean of the others, and all wheels in
            one motion compared with the mean of the other motions.
        scale: all wheels in all motions, twist sensor and gyro.
    """

    entry: float = 0.06
    wheel: float = 0.03
    scale: float = 0.05


ALLOWED = Tolerances()

MISTAKE, SLIP, MARGIN = 5, 3, 3
"""Cost of a mistake, cost of a slip of the rollers, and largest difference between the costs of
explanations that are named together. Rollers of real vehicles slip, so a slip costs less. With this
margin, a slip and the one mistake that has the same effect are named together, but not two
mistakes."""

_MOST = 4
"""Largest number of scale errors in an explanation: two slips, and two mistakes."""

_SLIP = 1.4
"""Largest ratio of the turn of a wheel with slipping rollers to the turn without slip [1]; public
reports of real vehicles contain 1.05 to 1.3."""

_PLACE = 2.0
"""Largest factor of an error of a wheel's distance from the center [1]; with larger factors, a sign
is wrong."""

_SMALLEST = 1e-6
"""Ratio that stands for a measurement of 0 [1]."""


class Scale(NamedTuple):
    """A scale error that may act on the measurements of a drive.

    Attributes:
        kind: what has the error.
        wheel: index of the wheel; -1 if the error does not concern a single wheel.
        column: share of the error in each measurement, shape (3 N + 4,): angles of the wheels by
            motion and wheel, displacement of the twist sensor by motion, rotation of the gyro.
        cost: `MISTAKE` or `SLIP`.
        least: smallest error [logarithm of the factor].
        low: lower limit on the error [logarithm of the factor].
        high: upper limit on the error [logarithm of the factor].
    """

    kind: str
    wheel: int
    column: FloatArray
    cost: int = MISTAKE
    least: float = ALLOWED.wheel
    low: float = -math.inf
    high: float = math.inf


class Explanation(NamedTuple):
    """Scale errors that explain a drive.

    Attributes:
        cost: sum of the costs of the errors.
        residual: largest residual, as a share of its tolerance [1].
        errors: the errors, each with its factor [1].
    """

    cost: int
    residual: float
    errors: tuple[tuple[Scale, float], ...]


def possible_errors(count: int, shared: bool, rolls_forward: bool) -> list[Scale]:
    """Return the scale errors that may act on a drive.

    Args:
        count: number of wheels, N.
        shared: whether the distances of both straight motions are one measurement.
        rolls_forward: whether rollers turn, and can slip, while the vehicle moves forward.
    """

    def column(rows: str, wheels: Sequence[int], twist: str = "", gyro: bool = False) -> FloatArray:
        angles = np.zeros((3, count))
        for row in rows:
            angles["flt".index(row), wheels] = 1.0
        return np.array([*angles.ravel(), *(row in twist for row in "flt"), gyro], np.float64)

    every, wide, most = range(count), ALLOWED.scale, math.log(_PLACE)
    errors = [Scale("wheel", i, column("flt", [i])) for i in every]
    errors += [
        Scale("place", i, column("t", [i]), MISTAKE, ALLOWED.entry, -most, most) for i in every
    ]
    errors += [
        Scale(f"slip {row}", -1, column(row, every), SLIP, low=0.0, high=math.log(_SLIP))
        for row in ("flt" if rolls_forward else "lt")
    ]
    errors += [Scale("distance", -1, column("fl", every, twist="fl"))] * shared
    return [
        *errors,
        Scale("radius", -1, column("flt", every), least=wide),
        Scale("lever", -1, column("t", every), low=-most, high=most),
        Scale("stated f", -1, column("f", every, twist="f")),
        Scale("stated l", -1, column("l", every, twist="l")),
        Scale("stated t", -1, column("t", every, twist="t", gyro=True)),
        *(
            Scale(f"twist {rows}", -1, column("", (), twist=rows), least=wide)
            for rows in ("fl", "f", "l", "t")
        ),
        Scale("gyro", -1, column("", (), gyro=True), least=wide),
    ]


def explanations(
    predicted: FloatArray,
    angle: FloatArray,
    ratios: FloatArray,
    errors: Sequence[Scale],
    budget: int,
) -> list[Explanation]:
    """Return the sets of scale errors that explain a drive, none of which contains another one.

    Args:
        predicted: predicted angle of each wheel in each motion [rad], shape (3, N).
        angle: measured angles [rad], shape (3, N).
        ratios: measured/predicted displacement of the twist sensor in each motion, and rotation of
            the gyro [1], shape (4,); NaN if it was not measured.
        errors: the scale errors that may act.
        budget: largest cost of a set.
    """
    size = mean_size(predicted)
    if not np.all(turns_alike(predicted, angle, size)):
        return []
    share = np.abs(predicted) / size
    used = share > ALLOWED.entry
    measured = np.isfinite(ratios)
    logarithm = np.zeros(predicted.shape)
    logarithm[used] = np.log(np.maximum(np.abs(angle[used] / predicted[used]), _SMALLEST))
    values = np.concatenate((logarithm.ravel(), np.log(np.maximum(ratios[measured], _SMALLEST))))
    rows = np.concatenate((np.ones(predicted.size, bool), measured))
    errors = [one for one in errors if np.any(one.column[rows])]
    tests = _tests(share * used, int(np.sum(measured)))
    scaled, target = tests @ np.array([one.column[rows] for one in errors]).T, tests @ values
    found: list[Explanation] = []
    explained: list[set[int]] = []
    for count in range(_MOST + 1):
        budget = min([budget, *(one.cost + MARGIN for one in found)])
        for subset, size_of in _fits(scaled, target, errors, count, budget):
            if any(one <= set(subset) for one in explained):
                continue
            explained.append(set(subset))
            factors = np.exp(size_of).tolist()
            chosen = tuple((errors[k], f) for k, f in zip(subset, factors, strict=True))
            left = np.max(np.abs(target - scaled[:, subset] @ size_of))
            found.append(Explanation(sum(errors[k].cost for k in subset), float(left), chosen))
    return found


def mean_size(predicted: FloatArray) -> FloatArray:
    """Return the root mean square of the wheel angles in each motion [rad], shape (3, 1)."""
    return np.asarray(np.sqrt(np.mean(predicted**2, axis=1, keepdims=True)))


def turns_alike(predicted: FloatArray, angle: FloatArray, size: FloatArray) -> BoolArray:
    """Return whether a scale error may explain the directions of each wheel, shape (K,).

    In each motion, the wheel turns in the predicted direction, or rests if it should; or it never
    turns, which is a scale of 0.

    Args:
        predicted: predicted angle of K wheels in each motion [rad], shape (3, K).
        angle: measured angles [rad], shape (3, K).
        size: `mean_size` of all wheels [rad], shape (3, 1).
    """
    moved = np.maximum(np.linalg.norm(angle, axis=0), _SMALLEST)
    own = angle * np.linalg.norm(predicted, axis=0) / moved  # without the scale of the wheel
    rests = np.abs(own - predicted) <= ALLOWED.entry * size
    turns = np.abs(predicted) > ALLOWED.entry * size
    idle = np.max(np.abs(angle) / size, axis=0) < _SMALLEST
    return np.asarray(np.all(np.where(turns, angle * predicted > 0.0, rests), axis=0) | idle)


def _tests(share: FloatArray, sensors: int) -> FloatArray:
    """Return linear combinations of the measurements, each divided by its tolerance.

    Args:
        share: size of each predicted angle relative to the other wheels [1], shape (3, N).
        sensors: number of measurements after the angles.
    """
    motions, count = share.shape
    weight = share**2
    common = (weight / np.sum(weight)).ravel()
    combinations = [common / ALLOWED.scale]
    for axis, number in ((0, motions), (1, count)):
        for index in range(number):
            part = np.zeros(share.shape, np.bool_)
            part[(index, slice(None)) if axis == 0 else (slice(None), index)] = True
            means = (weight * one / max(np.sum(weight * one), 1e-9) for one in (part, ~part))
            combinations.append(np.subtract(*means).ravel() / ALLOWED.wheel)
    angles = [*combinations, *np.diag(share.ravel()) / ALLOWED.entry]
    return np.asarray(scipy.linalg.block_diag(angles, np.eye(sensors) / ALLOWED.scale))


def _fits(
    scaled: FloatArray, target: FloatArray, errors: Sequence[Scale], count: int, budget: int
) -> list[tuple[list[int], FloatArray]]:
    """Return the sets of `count` errors that pass all tests, each with its fitted errors.

    Args:
        scaled: effect of each error on each test [1], shape (tests, errors).
        target: measured value of each test [1], shape (tests,).
        errors: the errors.
        count: number of errors in a set.
        budget: largest cost of a set.
    """
    if not count:
        return [([], np.zeros(0))] * bool(np.max(np.abs(target)) <= 1.0)
    cost = np.array([one.cost for one in errors])
    subsets = np.array(list(itertools.combinations(range(len(errors)), count)))
    subsets = subsets[np.sum(cost[subsets], axis=1) <= budget]
    if not len(subsets):
        return []
    gram = scaled.T @ scaled
    left = gram[subsets[:, :, None], subsets[:, None, :]] + 1e-9 * np.eye(count)
    right = (scaled.T @ target)[subsets]
    size = np.linalg.solve(left, right[..., None])[..., 0]
    rest = target - np.einsum("tsk,sk->st", scaled[:, subsets], size)
    least, low, high = (
        np.array([getattr(one, name) for one in errors])[subsets]
        for name in ("least", "low", "high")
    )
    good = np.max(np.abs(rest), axis=1, initial=0.0) <= 1.0
    good &= np.all((np.abs(size) >= least) & (size >= low) & (size <= high), axis=1)
    return [(subsets[k].tolist(), size[k]) for k in np.flatnonzero(good)]
