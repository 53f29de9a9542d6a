"""Largest deceleration that the wheels of a vehicle can produce, by convex optimization.

Wheel ``i`` exerts a force only along its active direction, ``f_i n_wi`` with ``|f_i| <= P(N_i)``,
where ``N_i`` is its load and ``P`` the peak of its tire's curve. The loads are affine in the forces
(`omni_sim.vehicle.loads`) and ``P`` is concave, so the admissible forces are a convex set. Tangents
of ``P`` enclose this set in a polyhedron, over which a linear program finds the largest
deceleration. The dual solution is an upper bound for all forces. The primal forces, scaled down
until they obey the true ``P``, are feasible.

The result is a bound although wheel spin and slip are neglected: only the forces of the ground act
on the body, regardless of wheel speed, and the peak force is assumed to act at once. Loads follow
the acceleration without lag; `bounds` accounts for the lag. If a wheel lifts off, the loads no
longer form a plane, and only weight and moments must balance. Therefore the program is also solved
for stops in which the plane would give wheel ``j`` a negative load. If the vehicle could tip over,
the only condition is that the sum of the loads is the weight.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from omni_core.geometry import cross
from omni_core.kinematics import PlatformKinematics, require_omni_wheels
from omni_core.quantities import GRAVITY, BoolArray, FloatArray
from omni_sim.masses import support_polygon
from omni_sim.tire.interface.model import curve_at
from omni_sim.tire.models import kernel_parameters
from omni_sim.vehicle import configuration, loads

_TANGENTS = 97
_FIRST = 16  # the first program has every 16th tangent; further tangents are added as needed
# Vertical offset of the tangents, which covers the error of the load grid [N]. An omitted tangent
# may be violated by up to this value.
_FORCE_ERROR = 1e-3
# Cosine of the angle between active direction and motion below which the motion does not drive a
# wheel [1].
_STANDING = 1e-9

PLANE, BALANCE, SUM = range(3)
"""Load models: loads in a plane; balance of weight and moments; balance of weight alone."""


class Deceleration(NamedTuple):
    """Largest deceleration of a vehicle along a direction, and the forces that cause it.

    Attributes:
        bound: upper bound of the deceleration for all admissible forces, from the dual program
            [m/s^2].
        feasible: deceleration with forces that obey the friction limit [m/s^2].
        force: forces of the primal solution [N], which may slightly exceed the friction limit,
            shape (N,).
        load: wheel loads under these forces [N], shape (N,).
    """

    bound: float
    feasible: float
    force: FloatArray
    load: FloatArray


class Case(NamedTuple):
    """Conditions under which the largest deceleration is computed.

    Attributes:
        friction: friction factor of the ground under each wheel [1], shape (N,).
        straight: whether the forces together must have no yaw moment and no lateral component, and
            no wheel may drive the vehicle.
        torque: limit on the torque of every brake [N m], or of each brake, shape (N,).
        lag: share of the acceleration that does not yet affect the loads [1].
        standing: whether a locked wheel may exert a force although the vehicle does not move along
            the wheel's active direction.
        heading: whether the forces together must have no yaw moment.
        pushes: whether a wheel may drive the vehicle although the stop is straight.
    """

    friction: FloatArray
    straight: bool
    torque: float | FloatArray = math.inf
    lag: float = 0.0
    standing: bool = True
    heading: bool = False
    pushes: bool = False


class LimitVehicle:
    """Properties of a vehicle on which its largest deceleration depends.

    Attributes:
        masses: mass, center and inertia of body and load together.
        position: position of the wheels in the body frame [m], shape (N, 2).
        active: active directions [1], shape (N, 2).
        lever: lever of the active directions about the center of gravity [m], shape (N,).
        rim_lever: lever of the force of each wheel about the wheel's axis [m], shape (N,).
        grip: factor on the friction between each wheel and the ground [1], shape (N,).
        strongest_peak: largest peak force of the tire at any load on ground with the friction
            factor 1 [N].
    """

    def __init__(self, vehicle: configuration.VehicleConfiguration) -> None:
        require_omni_wheels(vehicle.wheels, "the limit of a straight stop")
        geometry = PlatformKinematics(vehicle.wheels).geometry
        self.masses = vehicle.masses
        self.position = geometry.position
        self.active = geometry.active
        self._passive = geometry.passive
        self._arm = geometry.position - self.masses.center
        self.lever = cross(self._arm, geometry.active)
        self._passive_lever = cross(self._arm, geometry.passive)
        tire = vehicle.tire
        radius = geometry.radius - tire.largest_load / tire.vertical_stiffness
        rim = np.abs(np.sum(geometry.active * geometry.rolling, axis=1))
        self.rim_lever = radius * rim
        self.grip = vehicle.by_wheel("friction")
        losses = vehicle.passive_losses
        # Rolling resistance grows with the load. Its share at the largest load keeps the set of
        # forces convex.
        self._loss = losses.constant_share + losses.growing_share * tire.largest_load
        self._weight = self.masses.mass * GRAVITY
        self._tire = tire
        self._plane = loads.load_plane(self._arm)
        self._hull = self._arm[support_polygon(self._arm)]
        self._edge = np.roll(self._hull, -1, axis=0) - self._hull
        self._slope, self._offset = self._tangents()
        self.strongest_peak = float(self._offset[-1])
        # Tangents that programs have needed so far, for each wheel, shape (N, T).
        self._chosen = np.zeros((len(self.active), len(self._slope)), dtype=np.bool_)
        self._chosen[:, ::_FIRST] = self._chosen[:, -1] = True

    def peak(self, load: FloatArray) -> FloatArray:
        """Return the peak force ``P`` [N] at M loads [N] for the friction factor 1, shape (M,)."""
        clamped = np.clip(load, 0.0, self._tire.largest_load)
        constants = kernel_parameters(self._tire)
        return np.array([curve_at(constants, float(one), 1.0).peak_force for one in clamped])

    def _tangents(self) -> tuple[FloatArray, FloatArray]:
        """Return slopes [1] and offsets [N] of T tangents that bound ``P`` from above."""
        fine = np.linspace(0.0, self._tire.largest_load, 16 * (_TANGENTS - 1) + 1)
        peak = self.peak(fine)
        slope = np.maximum(np.gradient(peak, fine)[8::16], 0.0)
        slope = np.append(slope, 0.0)
        # Smallest offset for which the line is above the curve, even if the curve is not concave.
        offset = np.max(peak[:, None] - slope * fine[:, None], axis=0) + _FORCE_ERROR
        return slope, offset

    def _loads(self, model: int, lag: float) -> tuple[FloatArray, FloatArray]:
        """Return matrix and right-hand side of the equations between wheel forces and wheel loads.

        The unknowns are the forces along the active directions, the forces along the passive
        directions, and the loads [N], shape (3 N,).

        Args:
            model: PLANE, BALANCE or SUM.
            lag: share of the acceleration that does not yet affect the loads [1].
        """
        wheels = len(self.active)
        z = self._zero_moment_point(lag)
        if model == PLANE:
            rows = np.hstack((-self._weight * self._plane[:, 1:] @ z, np.eye(wheels)))
            return rows, self._weight * self._plane[:, 0]
        weight = np.repeat((0.0, 1.0), (2 * wheels, wheels))
        moments = np.hstack((-self._weight * z, self._arm.T))
        rows = np.vstack((weight, moments))[: 1 if model == SUM else 3]
        return rows, np.append(self._weight, np.zeros(len(rows) - 1))

    def _zero_moment_point(self, lag: float = 0.0) -> FloatArray:
        """Return the shift of the zero-moment point per force of a wheel [m/N], shape (2, 2 N).

        The first N columns belong to the active directions, the last N columns to the passive
        directions.
        """
        directions = np.vstack((self.active, self._passive)).T
        return -(1.0 - lag) * self.masses.height / self._weight * directions

    def strongest(self, direction: FloatArray, case: Case) -> Deceleration | None:
        """Return the largest deceleration along a direction; None if no admissible forces exist.

        Args:
            direction: direction of motion in the body frame, unit vector, shape (2,).
            case: conditions of the stop.
        """
        if not case.straight:
            solutions = [self._solve(direction, case, *kind) for kind in self._kinds(case.friction)]
            return max(
                (found for found in solutions if found is not None),
                key=lambda found: found.bound,
                default=None,
            )
        # A straight stop shifts the loads only along its own direction. Check whether all wheels
        # then remain on the ground.
        for model in (SUM, BALANCE):
            found = self._solve(direction, case, model)
            if found is None:
                return None
            z = self.masses.height / GRAVITY * found.bound * direction
            hull_sides, wheel_loads = cross(self._edge, z - self._hull), self._plane @ [1.0, *z]
            if np.min(hull_sides if model == SUM else wheel_loads) <= 0.0:
                return found
        return self._solve(direction, case, PLANE)

    def at_least(
        self, direction: FloatArray, case: Case, iterations: int = 16, nearly: float = 1.02
    ) -> float:
        """Return a lower estimate of `strongest` [m/s^2] for a stop that may include rotation.

        Every wheel exerts its largest force against the direction. The loads are computed by
        iteration. Forces that slightly exceed the friction limit are then scaled down to it. If
        they exceed it by more, a wheel is about to lift off, and the linear program is solved
        instead. The result is 0 if this program has no solution.

        Args:
            direction: direction of motion in the body frame, unit vector, shape (2,).
            case: conditions of the stop.
            iterations: number of iterations of the loads.
            nearly: largest ratio of force to friction limit that is corrected by scaling [1].
        """
        along = self.active @ direction
        torque = case.torque / self.rim_lever
        z_of_force = self._zero_moment_point()[:, : len(along)]
        load, excess = self._weight * self._plane[:, 0], math.inf
        for _ in range(iterations):
            bearable = case.friction * self.peak(load)
            force = -np.sign(along) * np.minimum(bearable, torque)
            carried = self._weight * self._plane @ np.append(1.0, z_of_force @ force)
            load = 0.5 * (load + carried)  # damped, because the iteration may oscillate
        if np.min(carried) > 0.0:
            bearable = case.friction * self.peak(carried)
            excess = max(1.0, float(np.max(np.abs(force) / np.maximum(bearable, 1e-9))))
        if excess > nearly:  # some wheel is about to lift off
            found = self._solve(direction, case, *self._kinds(case.friction)[0])
            return 0.0 if found is None else found.bound
        return float(-along @ force / self.masses.mass / excess)

    def _kinds(self, friction: FloatArray) -> list[tuple[int, int | None]]:
        """Return the load models for which the program is solved.

        Each model is paired with the index of a wheel that lifts off; None if no wheel lifts off.
        """
        reach = self.masses.height / GRAVITY * self.any_load_bound(friction)
        sides = cross(self._edge, -self._hull) / np.linalg.norm(self._edge, axis=1)
        if reach >= np.min(sides):
            return [(SUM, None)]
        stays = self._plane[:, 0] > reach * np.hypot(self._plane[:, 1], self._plane[:, 2])
        return [(PLANE, None), *((BALANCE, int(j)) for j in np.flatnonzero(~stays))]

    def rebound(self, direction: FloatArray, deceleration: float) -> float:
        """Return the distance by which the elastic tires push a stopped vehicle back [m].

        Args:
            direction: direction of the motion, unit vector, shape (2,).
            deceleration: deceleration along the direction at the end of the stop [m/s^2].
        """
        force = self.masses.mass * deceleration * direction
        stiffness = self._tire.stiffness * self.active.T @ self.active
        return float(np.linalg.norm(np.linalg.solve(stiffness, force)))

    def any_load_bound(self, friction: FloatArray) -> float:
        """Return an upper bound of the deceleration for all possible load distributions [m/s^2].

        Args:
            friction: friction factor of the ground under each braked wheel [1], at least one.
        """
        mean = float(np.max(friction)) * self.peak(np.array([self._weight / len(friction)]))
        return float(len(friction) * mean[0] / self.masses.mass) + GRAVITY * self._loss

    def _solve(
        self, direction: FloatArray, case: Case, model: int, lifted: int | None = None
    ) -> Deceleration | None:
        """Solve the linear program with one model of the loads.

        Args:
            direction: direction of the motion in the body frame [1], shape (2,).
            case: friction, torque and constraints.
            model: PLANE, BALANCE or SUM.
            lifted: index of a wheel whose load in the plane model would be negative; None for no
                wheel.
        """
        wheels = len(self.active)
        along, passive_along = self.active @ direction, self._passive @ direction
        low, high = self._allowed(along, case)
        rows_eq, right_eq = self._loads(model, case.lag)
        if case.straight or case.heading:
            moment = np.concatenate((self.lever, self._passive_lever, np.zeros(wheels)))
            rows_eq, right_eq = np.vstack((rows_eq, moment)), np.append(right_eq, 0.0)
        if case.straight:
            across = np.array([-direction[1], direction[0]])
            lateral = (self.active @ across, self._passive @ across, np.zeros(wheels))
            rows_eq = np.vstack((rows_eq, np.concatenate(lateral)))
            right_eq = np.append(right_eq, 0.0)
        fixed = self._fixed_rows(lifted)
        lost = math.inf if self._loss > 0.0 else 0.0
        lower = np.concatenate((low, np.full(wheels, -lost), np.zeros(wheels)))
        upper = np.concatenate((high, np.full(wheels, lost), np.full(wheels, math.inf)))
        bounds = np.column_stack((lower, upper))
        cost = np.concatenate((along, passive_along, np.zeros(wheels))) / self.masses.mass
        from scipy.optimize import linprog  # slow import, not needed while nodes start

        while True:
            rows, right = self._friction_rows(case.friction, self._chosen)
            rows, right = np.vstack((rows, fixed[0])), np.append(right, fixed[1])
            found = linprog(cost, rows, right, rows_eq, right_eq, bounds)
            if found.x is None:
                return None
            force, load = found.x[:wheels], found.x[2 * wheels :]
            lines = self._slope * load[:, None] + self._offset
            needed = np.argmin(lines, axis=1)
            excess = np.abs(force) > case.friction * np.min(lines, axis=1) + _FORCE_ERROR
            new = excess & ~self._chosen[np.arange(wheels), needed]
            if not np.any(new):
                break
            self._chosen[np.flatnonzero(new), needed[new]] = True
        low, high = np.where(np.isfinite(bounds), bounds, 0.0).T
        dual = right @ found.ineqlin.marginals + right_eq @ found.eqlin.marginals
        dual += low @ found.lower.marginals + high @ found.upper.marginals
        bound = max(-float(dual), -float(found.fun))
        # The forces at rest are admissible, and the admissible set is convex. Therefore the forces
        # divided by the largest excess are admissible too.
        # The tangents allow a wheel without load a force up to their smallest offset.
        peak = np.maximum(case.friction * self.peak(load), np.min(self._offset))
        share = float(np.max(np.abs(force) / peak))
        return Deceleration(bound, -float(found.fun) / max(1.0, share), force, load)

    def _allowed(self, along: FloatArray, case: Case) -> tuple[FloatArray, FloatArray]:
        """Return the least and largest force of each wheel by friction and torque [N], shape (N,).

        Args:
            along: component of each wheel's direction along the motion [1], shape (N,).
            case: friction, torque and constraints.
        """
        cap = np.minimum(case.friction * self.strongest_peak, case.torque / self.rim_lever)
        low, high = -cap, cap.copy()
        if case.straight and not case.pushes:
            dragged = np.abs(along) > _STANDING
            high[(along > 0.0) & dragged] = 0.0
            low[(along < 0.0) & dragged] = 0.0
            if not case.standing:
                low[~dragged] = high[~dragged] = 0.0
        return low, high

    def _friction_rows(
        self, friction: FloatArray, chosen: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return rows and right-hand sides of ``|f_i| <= mu_i (slope N_i + offset)``.

        Args:
            friction: friction factor mu_i under each wheel [1], shape (N,).
            chosen: whether each tangent is used for each wheel, shape (N, number of tangents).

        Returns:
            Coefficients of the unknowns of `_loads`, shape (R, 3 N); right-hand sides, shape (R,).
        """
        wheels = len(friction)
        wheel, line = np.nonzero(chosen)
        count = np.arange(len(wheel))
        rows = np.zeros((2, len(wheel), 3 * wheels))
        rows[0, count, wheel], rows[1, count, wheel] = 1.0, -1.0
        rows[:, count, 2 * wheels + wheel] = -friction[wheel] * self._slope[line]
        return rows.reshape(-1, 3 * wheels), np.tile(friction[wheel] * self._offset[line], 2)

    def _fixed_rows(self, lifted: int | None) -> tuple[FloatArray, FloatArray]:
        """Return the inequalities for passive losses and for a wheel that lifts off.

        The result has the form of `_friction_rows`.
        """
        wheels = len(self.active)
        rows, right = np.zeros((0, 3 * wheels)), np.zeros(0)
        if self._loss > 0.0:
            one = np.eye(wheels)
            losses = [[0.0 * one, side * one, -self._loss * one] for side in (1.0, -1.0)]
            rows, right = np.block(losses), np.zeros(2 * wheels)
        if lifted is not None:
            pull = np.zeros(3 * wheels)
            pull[: 2 * wheels] = self._plane[lifted, 1:] @ self._zero_moment_point()
            rows, right = np.vstack((rows, pull)), np.append(right, -self._plane[lifted, 0])
        return rows, right

    def largest(self, case: Case, tolerance: float) -> float:
        """Return an upper bound of the deceleration over all headings [m/s^2].

        Args:
            case: conditions of the stop; the motion need not be straight.
            tolerance: limit on the relative excess of the bound [1].
        """

        def support(angle: float) -> float:
            found = self.strongest(np.array([math.cos(angle), math.sin(angle)]), case)
            return 0.0 if found is None else found.bound

        return farthest(support, tolerance)


def farthest(support: Callable[[float], float], tolerance: float) -> float:
    """Return an upper bound of the largest distance of a convex set from the origin.

    Between two directions, no point is farther than the intersection of the two support lines. The
    interval with the farthest intersection is halved until the bound is within the tolerance.

    Args:
        support: function that returns the largest component of the set along a direction [rad], at
            least 0.
        tolerance: limit on the relative excess of the bound [1].
    """
    angles = np.linspace(-math.pi, math.pi, 9).tolist()
    heights = [support(angle) for angle in angles[:-1]]
    ends = list(zip(angles, [*heights, heights[0]], strict=True))
    intervals = list(pairwise(ends))
    best = max(heights)
    while True:
        worst = max(intervals, key=_corner)
        bound = _corner(worst)
        if bound <= best * (1.0 + tolerance) or best <= 0.0:
            return bound
        intervals.remove(worst)
        angle = 0.5 * (worst[0][0] + worst[1][0])
        middle = (angle, support(angle))
        best = max(best, middle[1])
        intervals += [(worst[0], middle), (middle, worst[1])]


def _corner(interval: tuple[tuple[float, float], tuple[float, float]]) -> float:
    """Return an upper bound of the distance from the origin for points between two directions.

    The points are on the inner side of the support line of each direction.

    Args:
        interval: direction [rad] and distance from the origin of each of the two support lines.
    """
    (start, one), (end, other) = interval
    cos = math.cos(end - start)
    across = (other - one * cos) / math.sin(end - start)
    # If the lines meet outside the interval, the farthest point is in one of the two directions.
    if across <= 0.0 or one <= other * cos:
        return max(one, other)
    return math.hypot(one, across)
