"""Masses of the vehicle and the vertical loads of its wheels.

Body and load are separate rigid masses. The wheels are modeled as equal vertical springs under a
rigid chassis, so their loads are a linear function ``a + b x + c y`` of the wheel positions, the
load plane. The loads balance the weight and the moments, including the moments of inertial forces
at the height of the center of gravity. The resultant of the loads therefore acts at the zero-moment
point ``r_g - h v_dot / g``, where ``r_g`` is the position, ``h`` the height and ``v_dot`` the
acceleration of the center of gravity. Loads cannot be negative: wheels with a negative load in the
plane lift off, and the remaining wheels carry the weight. If the zero-moment point leaves the
support polygon, no such balance exists, and a real vehicle would tip over. The nearest edge of the
polygon then carries the vehicle, and `tipping` is reported, because the planar model is no longer
valid. The moment that masses at different heights exert under yaw acceleration (product of inertia)
is neglected.

Above the largest permissible load of the tire, the parabola of Eq. (3) has no physical meaning
(dissertation, section 2.3.1), so the dynamics use the force at this limit; `Overload` reports it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.kernels import lean
from omni_core.quantities import LARGEST_OFFSET, FloatArray, IntArray
from omni_sim.vehicle.lifted_wheels import stand_on_edge, stand_on_some, stand_on_triangle

MAXIMUM_WHEELS = 32
"""Limit on the number of wheels of a vehicle; `lifted_wheels` stores sets of wheels as bits."""


class MassConfiguration(Configuration):
    """A rigid mass on the platform, described in the body frame."""

    mass: float = parameter(unit="kg", minimum=0.0, maximum=1.0e5)
    """Mass"""
    x: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the center of gravity, forward of base_link"""
    y: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the center of gravity, left of base_link"""
    height: float = parameter(unit="m", minimum=0.0, maximum=20.0)
    """Height of the center of gravity above the ground"""
    yaw_inertia: float = parameter(0.0, unit="kg m^2", minimum=0.0, maximum=1.0e9)
    """Moment of inertia about the vertical axis through the mass's own center of gravity"""


class ForkConfiguration(Configuration):
    """Height of the load over time on a fork that lifts (Appendix A), interpolated linearly.

    A lift is slow, so the inertial force of the vertical motion is neglected, as is the change of
    pitch and roll inertia.
    """

    time: tuple[float, ...] = parameter((), unit="s", minimum=0.0, maximum=3600.0)
    """Times of the rows, in increasing order"""
    height: tuple[float, ...] = parameter((), unit="m", minimum=0.0, maximum=20.0)
    """Height of the load's center of gravity above the ground, which replaces `load.height`"""

    def check_consistency(self) -> None:
        """Check that the table is valid.

        Raises:
            ConfigurationError: the columns differ in length, or the times do not increase.
        """
        if len(self.time) != len(self.height):
            rows = f"has {len(self.height)} rows but must have {len(self.time)}, like time"
            raise ConfigurationError("height", rows)
        if np.any(np.diff(self.time) <= 0.0):
            raise ConfigurationError("time", "must increase from row to row")


@dataclasses.dataclass(frozen=True)
class MassProperties:
    """Mass, center of gravity and inertia of the vehicle with its load, for the planar dynamics.

    Attributes:
        mass: mass m [kg].
        center: ``r_g``, center of gravity in the body frame [m], shape (2,).
        height: height of the center of gravity above the ground [m].
        yaw_inertia: moment of inertia J about the vertical through the center of gravity [kg m^2].
    """

    mass: float
    center: FloatArray
    height: float
    yaw_inertia: float

    @classmethod
    def of(cls, *masses: MassConfiguration) -> MassProperties:
        """Return the properties of several masses together (parallel-axis theorem).

        The total mass must not be zero.
        """
        mass = np.array([part.mass for part in masses])
        position = np.array([[part.x, part.y] for part in masses])
        total = float(mass.sum())
        center = mass @ position / total
        offset = np.sum((position - center) ** 2, axis=1)
        inertia = sum(part.yaw_inertia for part in masses) + float(mass @ offset)
        height = float(mass @ np.array([part.height for part in masses])) / total
        return cls(total, center, height, inertia)


def support_polygon(position: FloatArray) -> IntArray:
    """Return the indices of the wheels on the convex hull, counter-clockwise.

    Args:
        position: wheel contacts [m], shape (N, 2).
    """
    order = np.lexsort((position[:, 1], position[:, 0]))
    points = position.tolist()
    chains = []
    for indices in (order.tolist(), order[::-1].tolist()):
        chain: list[int] = []
        for index in indices:
            while len(chain) >= 2:
                (a_x, a_y), (b_x, b_y), (c_x, c_y) = (points[i] for i in (*chain[-2:], index))
                if (b_x - a_x) * (c_y - b_y) - (b_y - a_y) * (c_x - b_x) > 0.0:
                    break
                chain.pop()
            chain.append(index)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1], dtype=np.int64)


def load_plane(position: FloatArray) -> FloatArray:
    """Return the matrix that gives the wheel loads for a zero-moment point.

    While no wheel lifts off, the load of wheel i is ``F_i = m g P_i . (1, z_x, z_y)``. ``P_i`` is
    row i of the matrix, and ``(z_x, z_y)`` the zero-moment point relative to the center of gravity.

    Args:
        position: wheel contacts relative to the center of gravity [m], shape (N, 2).

    Returns:
        Matrix with the rows ``P_i`` and with columns in [1], [1/m] and [1/m], shape (N, 3).
    """
    basis = np.column_stack((np.ones(len(position)), position))
    rows = np.linalg.solve(basis.T @ basis, basis.T).T
    return np.ascontiguousarray(rows, dtype=np.float64)


@lean
def wheel_loads(
    position: FloatArray,
    plane: FloatArray,
    hull: IntArray,
    weight: float,
    z_x: float,
    z_y: float,
    loads: FloatArray,
) -> bool:
    """Write the wheel loads for a zero-moment point, even if wheels lift off.

    Args:
        position: wheel contacts relative to the center of gravity [m], shape (N, 2).
        plane: matrix from `load_plane`.
        hull: indices from `support_polygon`.
        weight: weight of the vehicle, m g [N].
        z_x: x of the zero-moment point relative to the center of gravity [m].
        z_y: y of the zero-moment point relative to the center of gravity [m].
        loads: output, the wheel loads [N], shape (N,).

    Returns:
        Whether fewer than three wheels carry load, so that the vehicle would tip over.
    """
    n = position.shape[0]
    lifted = False
    for i in range(n):
        loads[i] = weight * (plane[i, 0] + plane[i, 1] * z_x + plane[i, 2] * z_y)
        lifted = lifted or loads[i] < 0.0
    if not lifted:
        return False
    if stand_on_edge(position, hull, weight, z_x, z_y, loads):
        return True
    carrying: int = stand_on_some(position, weight, z_x, z_y, loads)
    if carrying == 0:
        stand_on_triangle(position, hull, weight, z_x, z_y, loads)
    return 0 < carrying < 3


class Overload:
    """Records wheel loads above the largest load of the tire model during a run.

    Attributes:
        time: total time of overload since the start, summed over the wheels [s].
    """

    def __init__(
        self, wheel_names: Sequence[str], model: str, limit: float, physics_step: float
    ) -> None:
        """Create a monitor that has recorded no overload.

        Args:
            wheel_names: wheel names in the order of all wheel arrays.
            model: name of the tire model.
            limit: largest load for which the model is valid [N].
            physics_step: length of a step [s].
        """
        self.time = 0.0
        self._names, self._model, self._limit = tuple(wheel_names), model, limit
        self._step = physics_step
        self._largest = np.zeros(len(self._names))

    def update(self, load: FloatArray, overloaded_steps: int) -> bool:
        """Record the wheel loads at the end of a control period.

        Args:
            load: wheel loads at the end of the period [N], shape (N,).
            overloaded_steps: number of physics steps with overload since the start, summed over
                wheels.

        Returns:
            Whether a wheel was overloaded within the period.
        """
        self._largest = np.maximum(self._largest, load)
        before, self.time = self.time, overloaded_steps * self._step
        return self.time > before

    @property
    def largest_load(self) -> dict[str, float]:
        """Largest load of each overloaded wheel at the ends of the control periods [N], by name."""
        loads = zip(self._names, self._largest.tolist(), strict=True)
        return {name: load for name, load in loads if load > self._limit}

    def sentence(self) -> str:
        """Return a sentence that describes the overload."""
        wheels = ", ".join(f"{name} up to {load:.0f} N" for name, load in self.largest_load.items())
        return (
            f"overload: wheels carried more than the {self._limit:.0f} N that the tire model "
            f"{self._model} covers, for {self.time:.3g} s in total"
            f"{f' ({wheels})' if wheels else ''}; their forces were computed at "
            f"{self._limit:.0f} N"
        )
