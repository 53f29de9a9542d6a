"""Search for the placement of line cameras with the smallest mean twist error on a chassis.

The search is a differential evolution (R. Storn and K. Price, 1997) over the positions and headings
of the cameras, by SciPy. The Fisher information of a placement is the sum of the information of its
cameras. Cameras that do not fit increase the criterion by a penalty, which is larger than any
criterion of cameras that fit.

Many placements have nearly the same error. Therefore placements that are symmetric about an axis of
the vehicle, or under a rotation by 180 deg, are also searched. They are preferred unless an
asymmetric placement is better by more than one per cent. The result is rounded to values that can
be drilled and measured, and the neighbors of the rounded placement are searched again.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import optimize

from omni_core.quantities import FloatArray
from omni_tools.placement.error import Criterion
from omni_tools.placement.mounting_area import MountingArea

LATTICE = np.array([1e-3, 1e-3, math.radians(1.0)])
"""Steps to multiples of which x, y [m] and heading [rad] are rounded."""


# Relative increase of the criterion that is accepted in favor of a symmetric placement [1].
_EQUAL = 0.01
_POPULATION = 20  # number of placements in each generation, per free coordinate
_GENERATIONS = 1000  # limit on the number of generations
# The search ends if the standard deviation of the criterion over a generation is this share of its
# mean [1].
_SPREAD = 1e-6
# Number of steps of `LATTICE` by which a neighbor of the rounded placement may differ in each
# coordinate.
_NEIGHBORS = 3.0
_SINGULAR = 1e6  # replaces an infinite criterion, larger than that of any useful placement
_PENALTY = 1e9  # for each camera and pair of cameras that do not fit
_LEFT_RIGHT, _FRONT_BACK, _TURNED = (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)
_ITSELF = (1.0, 1.0, 1.0)


class _Unit(NamedTuple):
    """One camera, or two cameras that are symmetric to each other.

    Attributes:
        images: factors (1 or -1) of x, y and heading that map the first camera to each camera of
            the unit.
        free: whether x, y and heading are free; a fixed x or y is 0.
        heading: heading of the first camera if it is not free [rad].
    """

    images: tuple[tuple[float, float, float], ...] = (_ITSELF,)
    free: tuple[bool, bool, bool] = (True, True, True)
    heading: float = 0.0

    def poses(self, first: FloatArray) -> FloatArray:
        """Return the poses of the g cameras of the unit, shape (..., g, 3).

        Args:
            first: x, y [m] and heading [rad] of the first camera, shape (..., 3).
        """
        return np.asarray(first[..., None, :] * np.array(self.images))


class FoundPlacement(NamedTuple):
    """Best placement that a search has found.

    Attributes:
        poses: x, y [m] and heading [rad] of the cameras, after rounding, shape (N, 3).
        value: value of the criterion: E [m/s], or the condition number [1].
        rounding: relative increase of the criterion caused by rounding [1].
        symmetry: description of the symmetry; empty for an asymmetric placement.
    """

    poses: FloatArray
    value: float
    rounding: float
    symmetry: str


class NoRoomError(ValueError):
    """The cameras do not fit on the chassis, or fit only in singular placements."""


def search(
    criterion: Criterion,
    area: MountingArea,
    count: int,
    *,
    redundant: bool = False,
    population: int = _POPULATION,
    seed: int = 1,
    report: Callable[[float, str], None] = lambda _share, _words: None,
) -> FoundPlacement:
    """Return the placement with the lowest criterion that was found.

    Args:
        criterion: criterion to be minimized.
        area: area in which cameras can be mounted.
        count: number of cameras.
        redundant: whether to minimize the criterion after the failure of the most important camera,
            instead of the criterion of all cameras.
        population: number of placements in each generation, per free coordinate.
        seed: seed of the random initial placements.
        report: function that is called with the completed share (0 to 1) and a text.

    Raises:
        NoRoomError: no placement was found that fits and is not singular.
    """
    trial = _Search(criterion, area, redundant, population, seed)
    layouts = _layouts(count)
    found: list[tuple[float, str, tuple[_Unit, ...], FloatArray]] = []
    for index, (symmetry, units) in enumerate(layouts):
        report(index / len(layouts), f"{symmetry or 'free'} placements of {count} sensors")
        value, places = trial.minimize(units)
        if math.isfinite(value):
            found.append((value, symmetry, units, places))
    if not found:
        raise NoRoomError(f"there is no room for {count} sensors that could measure the twist")
    best = min(found, key=lambda entry: entry[0])
    symmetric = (entry for entry in found if entry[1])
    regular = min(symmetric, key=lambda entry: entry[0], default=best)
    chosen = regular if regular[0] <= best[0] * (1.0 + _EQUAL) else best
    value, symmetry, units, places = chosen
    rounded_value, rounded = trial.round(units, places)
    if not math.isfinite(rounded_value):
        raise NoRoomError(f"there is no room for {count} sensors on a grid of 1 mm and 1 deg")
    report(1.0, "")
    loss = max(rounded_value / value - 1.0, 0.0)
    return FoundPlacement(_all(units, rounded) + 0.0, rounded_value, loss, symmetry)


def _layouts(count: int) -> list[tuple[str, tuple[_Unit, ...]]]:
    """Return the arrangements of `count` cameras to search.

    An arrangement consists of a text that describes its symmetry, and of its units.
    """
    layouts: list[tuple[str, tuple[_Unit, ...]]] = [("", (_Unit(),) * count)]
    for words, image, free in (
        ("symmetric left to right", _LEFT_RIGHT, (True, False, False)),
        ("symmetric front to rear", _FRONT_BACK, (False, True, False)),
    ):
        # A camera that is its own mirror image is located on the axis of symmetry and oriented
        # along or across this axis.
        for single in range(count % 2, 3, 2):
            for headings in itertools.combinations_with_replacement((0.0, 0.5 * math.pi), single):
                own = tuple(_Unit(free=free, heading=heading) for heading in headings)
                pairs = (_Unit((_ITSELF, image)),) * ((count - single) // 2)
                layouts.append((words, (*pairs, *own)))
    if count % 2 == 0:
        layouts.append(("symmetric under a half turn", (_Unit((_ITSELF, _TURNED)),) * (count // 2)))
    return layouts


def _all(units: Sequence[_Unit], places: FloatArray) -> FloatArray:
    """Return the poses of the cameras of all units, shape (..., N, 3).

    Args:
        units: units of the placement.
        places: pose of the first camera of each unit, shape (..., units, 3).
    """
    poses = [unit.poses(places[..., i, :]) for i, unit in enumerate(units)]
    return np.concatenate(poses, axis=-2)


class _Search(NamedTuple):
    """Differential evolution for one chassis and criterion."""

    criterion: Criterion
    area: MountingArea
    redundant: bool
    population: int
    seed: int

    def minimize(self, units: tuple[_Unit, ...]) -> tuple[float, FloatArray]:
        """Return the lowest criterion and the pose of the first camera of each unit, (units, 3).

        The criterion is infinite if no placement fits.
        """
        start = np.array([(0.0, 0.0, unit.heading) for unit in units])
        reach = np.array([*self.area.reach, 0.5 * math.pi])
        return self._evolve(units, start, np.ones(3), reach)

    def round(self, units: tuple[_Unit, ...], places: FloatArray) -> tuple[float, FloatArray]:
        """Round a placement to `LATTICE`, and search for the best rounded placement near it.

        Args:
            units: units of the placement.
            places: pose of the first camera of each unit, shape (units, 3).

        Returns:
            Value of the criterion; rounded poses, shape (units, 3).
        """
        nearest = np.round(places / LATTICE) * LATTICE
        value, found = self._evolve(units, nearest, LATTICE, np.full(3, _NEIGHBORS), whole=True)
        return value, np.round(found / LATTICE) * LATTICE

    def _evolve(
        self,
        units: tuple[_Unit, ...],
        start: FloatArray,
        unit_step: FloatArray,
        steps: FloatArray,
        *,
        whole: bool = False,
    ) -> tuple[float, FloatArray]:
        """Return the lowest criterion around a placement, and the poses, shape (units, 3).

        Args:
            units: units of the placement.
            start: pose of the first camera of each unit, shape (units, 3).
            unit_step: step of x, y [m] and heading [rad], shape (3,).
            steps: limit on the number of steps of each free coordinate, shape (3,).
            whole: whether the numbers of steps are integers.
        """
        free = np.array([unit.free for unit in units])
        bound = np.broadcast_to(steps, free.shape)[free]

        def placed(numbers: FloatArray) -> FloatArray:
            moved = np.zeros((*numbers.shape[:-1], *free.shape))
            moved[..., free] = numbers
            return start + moved * unit_step

        found = optimize.differential_evolution(
            lambda numbers: self._value(_all(units, placed(numbers.T))),
            optimize.Bounds(-bound, bound),
            integrality=whole,
            popsize=self.population,
            maxiter=_GENERATIONS,
            tol=_SPREAD,
            mutation=(0.4, 0.9),
            recombination=0.9,
            rng=self.seed,
            polish=False,
            vectorized=True,
            updating="deferred",
        )
        return (float(found.fun) if found.fun < _SINGULAR else math.inf), placed(found.x)

    def _value(self, poses: FloatArray) -> FloatArray:
        """Return the criterion of placements with their penalties, shape (K,).

        Args:
            poses: x, y [m] and heading [rad] of the cameras, shape (K, N, 3).
        """
        misfits = np.sum(~self.area.fits(poses), axis=1)
        for i, j in itertools.combinations(range(poses.shape[1]), 2):
            misfits += ~self.area.apart(poses[:, i], poses[:, j])
        own = self.criterion.information(poses)
        total = own.sum(axis=1)
        evaluated = [total]
        if self.redundant:
            evaluated += [total - own[:, index] for index in range(own.shape[1])]
        values = np.max([self.criterion.value(each) for each in evaluated], axis=0)
        return np.asarray(np.minimum(values, _SINGULAR) + _PENALTY * misfits)
