"""Search for the placement of line cameras with the smallest mean twist error on a chassis.

The search is an exchange algorithm of optimal experimental design. The Fisher information of a
placement is the sum of the information of its cameras. For each camera in turn, every position and
heading of a coarse grid is tried while all other cameras are fixed, until the error no longer
decreases. The best of several random starts is refined with decreasing steps. Obstacles need no
penalty term, because positions that do not fit are excluded.

Many placements have nearly the same error. Therefore placements that are symmetric about an axis of
the vehicle, or under a rotation by 180 deg, are also searched. They are preferred unless an
asymmetric placement is better by more than one per cent. The result is rounded to values that can
be drilled and measured, and the neighbors of the rounded placement are tried again.
"""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from omni_core.quantities import BoolArray, FloatArray
from omni_tools.placement.error import Criterion
from omni_tools.placement.mounting_area import MountingArea

LATTICE = np.array([1e-3, 1e-3, math.radians(1.0)])
"""Steps to multiples of which x, y [m] and heading [rad] are rounded."""


class Effort(NamedTuple):
    """Parameters of the search that determine its accuracy and duration.

    Attributes:
        equal: relative increase of the criterion that is accepted in favor of a symmetric placement
            [1].
        across: number of coarse grid positions over the width of the chassis.
        headings: number of headings of the coarse grid within 180 deg.
        fewer: factor on `across` and `headings` if the failure of each camera is also evaluated,
            which takes longer [1].
        finest: step of the last refinement [m].
        gain: minimum relative decrease of the criterion that counts as an improvement [1].
        sweeps: limit on the number of sweeps over the cameras.
        starts: number of random initial placements for each symmetry.
        refined: number of best results on the coarse grid that are refined.
    """

    equal: float = 0.01
    across: int = 28
    headings: int = 12
    fewer: float = 0.6
    finest: float = 5e-5
    gain: float = 1e-7
    sweeps: int = 40
    starts: int = 6
    refined: int = 2


_USUAL = Effort()
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
    effort: Effort = _USUAL,
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
        effort: effort of the search.
        seed: seed of the random initial placements.
        report: function that is called with the completed share (0 to 1) and a text.

    Raises:
        NoRoomError: no placement was found that fits and is not singular.
    """
    trial = _Search(criterion, area, redundant, effort)
    layouts = _layouts(count)
    generator = np.random.default_rng(seed)
    found: list[tuple[float, str, tuple[_Unit, ...], FloatArray]] = []
    for index, (symmetry, units) in enumerate(layouts):
        report(index / len(layouts), f"{symmetry or 'free'} placements of {count} sensors")
        refined = [trial.refine(units, best) for best in trial.exchange(units, generator)]
        if refined:
            value, places = min(refined, key=lambda entry: entry[0])
            found.append((value, symmetry, units, places))
    if not found:
        raise NoRoomError(f"there is no room for {count} sensors that could measure the twist")
    value, symmetry, units, places = min(found, key=lambda entry: entry[0])
    # Continue from the best placement without its symmetry, which can only reduce the error.
    free = (_Unit(),) * count
    loose_value, loose = trial.refine(free, _all(units, places))
    symmetric = (entry for entry in found if entry[1])
    regular = min(symmetric, key=lambda entry: entry[0], default=None)
    unrounded = min(value, loose_value)
    if regular is not None and regular[0] <= unrounded * (1.0 + effort.equal):
        unrounded, symmetry, units, places = regular
    elif loose_value < value:
        symmetry, units, places = "", free, loose
    rounded_value, rounded = trial.round(units, places)
    if not math.isfinite(rounded_value):
        raise NoRoomError(f"there is no room for {count} sensors on a grid of 1 mm and 1 deg")
    report(1.0, "")
    loss = max(rounded_value / unrounded - 1.0, 0.0)
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
    """Return the poses of the cameras of all units, shape (N, 3).

    Args:
        units: units of the placement.
        places: pose of the first camera of each unit, shape (units, 3).
    """
    poses = [unit.poses(place) for unit, place in zip(units, places, strict=True)]
    return np.concatenate([np.empty((0, 3)), *poses])


class _Search:
    """Exchange algorithm and refinement for one chassis and criterion."""

    def __init__(
        self, criterion: Criterion, area: MountingArea, redundant: bool, effort: Effort
    ) -> None:
        self._effort = effort
        self._criterion = criterion
        self._area = area
        self._redundant = redundant
        fewer = effort.fewer if redundant else 1.0
        longer = max(area.reach)
        self._spacing = 2.0 * longer / round(fewer * effort.across)
        self._headings = 2 * round(0.5 * fewer * effort.headings)
        self._candidates = functools.cache(self._make_candidates)

    def exchange(
        self, units: tuple[_Unit, ...], generator: np.random.Generator
    ) -> list[FloatArray]:
        """Return the best results of the exchange algorithm on the coarse grid, best first.

        A result is the pose of the first camera of each unit, shape (units, 3).
        """
        sets = [self._candidates(unit) for unit in units]
        if not all(len(places) for places, _ in sets):
            return []
        ends: dict[float, FloatArray] = {}
        for _ in range(self._effort.starts):
            current = np.array([places[generator.integers(len(places))] for places, _ in sets])
            value = math.inf
            for sweep in range(self._effort.sweeps):
                before = value
                for i, (places, own) in enumerate(sets):
                    trial, chosen = self._best(units, current, i, places, own)
                    if trial < value * (1.0 - self._effort.gain) or sweep == 0:
                        value, current[i] = trial, chosen
                if not value < before and sweep > 0:
                    break
            if math.isfinite(value) and self._possible(units, current):
                ends[round(value, 9)] = current
        return [ends[value] for value in sorted(ends)[: self._effort.refined]]

    def refine(self, units: tuple[_Unit, ...], places: FloatArray) -> tuple[float, FloatArray]:
        """Improve a placement by moves with decreasing steps.

        Args:
            units: units of the placement.
            places: pose of the first camera of each unit, shape (units, 3).

        Returns:
            Value of the criterion; improved poses, shape (units, 3).
        """
        current = places.copy()
        step = self._spacing
        turn = math.pi / self._headings / step  # step of the heading per step of the position
        value = self._walk(units, current, math.inf, np.zeros(3), 0)
        while step > self._effort.finest:
            value = self._walk(units, current, value, step * np.array([1.0, 1.0, turn]), 2)
            step *= 0.5
        return value, current

    def round(self, units: tuple[_Unit, ...], places: FloatArray) -> tuple[float, FloatArray]:
        """Round a placement to `LATTICE`, and search for the best rounded placement near it.

        Arguments and results are those of `refine`.
        """
        current = np.round(places / LATTICE) * LATTICE
        value = self._walk(units, current, math.inf, LATTICE, 3)
        return value, np.round(current / LATTICE) * LATTICE

    def _walk(
        self,
        units: tuple[_Unit, ...],
        current: FloatArray,
        value: float,
        step: FloatArray,
        reach: int,
    ) -> float:
        """Move one unit after another to its best neighbor until no move is an improvement.

        Args:
            units: units of the placement.
            current: pose of the first camera of each unit, shape (units, 3), changed in place.
            value: criterion of these poses. If it is infinite, for example because some of the
                poses are invalid, the first move of each unit need not be an improvement.
            step: step of x, y [m] and heading [rad], shape (3,).
            reach: number of steps by which a neighbor may differ in each coordinate.

        Returns:
            Criterion of the changed poses; infinite if a unit has no valid pose.
        """
        forced = not math.isfinite(value)
        for _ in range(self._effort.sweeps):
            before = value
            for i, unit in enumerate(units):
                around = current[i] + _cloud(unit.free, reach) * step
                around = around[self._fits(unit, around)]
                if len(around) == 0:
                    return math.inf
                own = self._criterion.information(unit.poses(around))
                trial, chosen = self._best(units, current, i, around, own)
                if trial < value * (1.0 - self._effort.gain) or forced:
                    value, current[i] = trial, chosen
            if not value < before:
                break
            forced = False
        return value if self._possible(units, current) else math.inf

    def _best(
        self,
        units: tuple[_Unit, ...],
        current: FloatArray,
        index: int,
        places: FloatArray,
        own: FloatArray,
    ) -> tuple[float, FloatArray]:
        """Return the lowest criterion over the given poses of one unit, and the best pose.

        Args:
            units: units of the placement.
            current: x, y [m] and heading [rad] of the first camera of each unit, shape (units, 3).
            index: index of the unit to place.
            places: x, y [m] and heading [rad] to try, shape (K, 3).
            own: information of each of the unit's g cameras at these poses, shape (K, g, M, 6).
        """
        rest = [i for i in range(len(units)) if i != index]
        poses, others = units[index].poses(places), _all([units[i] for i in rest], current[rest])
        free = np.ones(len(places), np.bool_)
        for other in others:
            free &= np.all(self._area.apart(poses, other), axis=-1)
        if not np.any(free):
            return math.inf, places[0]
        places, own = places[free], own[free]
        information = self._criterion.information(others)
        total = own.sum(axis=1) + information.sum(axis=0)
        evaluated = [total]
        if self._redundant:
            evaluated = [total - one for one in information]
            evaluated += [total - own[:, g] for g in range(own.shape[1])]
        values = np.max([self._criterion.value(each) for each in evaluated], axis=0)
        best = int(np.argmin(values))
        return float(values[best]), places[best]

    def _make_candidates(self, unit: _Unit) -> tuple[FloatArray, FloatArray]:
        """Return the K poses of the coarse grid at which a unit fits, and their information.

        Returns:
            Poses of the first camera, shape (K, 3); information matrices, shape (K, g, M, 6).
        """
        reach = self._area.reach
        turns = np.arange(self._headings) * math.pi / self._headings
        axes = [_grid(limit, self._spacing) for limit in reach] + [turns]
        for axis, may in enumerate(unit.free):
            if not may:
                axes[axis] = np.array([unit.heading if axis == 2 else 0.0])
        mesh = np.meshgrid(*axes, indexing="ij")
        places = np.stack(mesh, axis=-1).reshape(-1, 3)
        places = places[self._fits(unit, places)]
        return places, self._criterion.information(unit.poses(places))

    def _fits(self, unit: _Unit, places: FloatArray) -> BoolArray:
        poses = unit.poses(places)
        fit: BoolArray = np.all(self._area.fits(poses), axis=-1)
        if len(unit.images) > 1:
            fit &= self._area.apart(poses[..., 0, :], poses[..., 1, :])
        return fit

    def _possible(self, units: tuple[_Unit, ...], places: FloatArray) -> bool:
        poses = _all(units, places)
        return all(
            bool(np.all(self._area.apart(poses[:i], poses[i]))) for i in range(1, len(poses))
        )


@functools.cache
def _cloud(free: tuple[bool, bool, bool], reach: int) -> FloatArray:
    """Return all combinations of up to `reach` steps in both directions of each coordinate.

    Args:
        free: whether x, y and heading are free; other coordinates have no steps.
        reach: limit on the number of steps.

    Returns:
        Numbers of steps, shape (K, 3).
    """
    steps = np.arange(-reach, reach + 1.0)
    axes = [steps if may else np.zeros(1) for may in free]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _grid(limit: float, spacing: float) -> FloatArray:
    """Return the multiples of `spacing` from ``-limit`` to ``limit`` [m]."""
    count = math.floor(limit / spacing)
    return spacing * np.arange(-count, count + 1.0)
