"""The error functions of the wheels: the sliding manifold of Eqs. (44), (49)-(59).

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 3.4. For each wheel three components say whether its friction force would drain the
velocity across the original line of motion, the rotation, and the velocity along the motion;
a negative sum means that braking this wheel helps. Only kinematics enter: no mass, no load, no
friction coefficient.

Symbols, all in the body frame: ``v_c``, ``Omega`` velocity of the platform centre and yaw rate,
``r_i`` wheel positions, ``n_wi`` active directions, ``v_i`` velocities of the wheel centres,
``f_hat_i`` unit friction forces, ``p`` unit vector across the velocity at the start of braking.

A wheel that does not slide along its active direction (``n_wi . v_i = 0``) has no friction
force to direct: ``f_hat_i`` is zero there, and so is its error.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.weighting import Weighting, zero_weighting
from omni_platform.geometry import PlatformGeometry, cross

FloatArray = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class ManifoldErrors:
    """The components of the error functions of N wheels, each of shape (N,) in [m/s].

    Attributes:
        perpendicular: ``s_perp,i`` of Eq. (50).
        angular: ``s_omega,i`` of Eq. (54).
        parallel: ``s_par,i`` of Eq. (57).
    """

    perpendicular: FloatArray
    angular: FloatArray
    parallel: FloatArray

    @property
    def total(self) -> FloatArray:
        """``s_i`` [m/s], shape (N,), Eq. (44)."""
        return self.perpendicular + self.angular + self.parallel


class SlidingManifold:
    """Error functions of the wheels of one platform.

    Args:
        geometry: positions and active directions of the N wheels.
        weighting: ``psi(delta)`` of the parallel component.
    """

    def __init__(self, geometry: PlatformGeometry, weighting: Weighting) -> None:
        self.geometry = geometry
        self._weighting = weighting
        self._r_x, self._r_y = np.ascontiguousarray(geometry.position.T)
        self._n_x, self._n_y = np.ascontiguousarray(geometry.active.T)
        # n_w . (k x r) = cross(r, n_w): lever of the active direction about the centre [m].
        self._lever = cross(geometry.position, geometry.active)

    def sliding_velocities(self, twist: FloatArray) -> FloatArray:
        """Return ``n_wi . v_i`` [m/s], shape (N,), with ``v_i`` of Eq. (38).

        Args:
            twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (3,).
        """
        v_x, v_y, omega = twist.tolist()
        # Written out and not as a matrix product, whose rounding may depend on the library.
        projection: FloatArray = self._n_x * v_x + self._n_y * v_y + self._lever * omega
        return projection

    def force_directions(self, twist: FloatArray) -> FloatArray:
        """Return ``f_hat_i = -sign(n_wi . v_i) n_wi``, shape (N, 2), Eq. (52).

        Args:
            twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (3,).
        """
        sign = np.sign(self.sliding_velocities(twist))
        directions: FloatArray = -sign[:, np.newaxis] * self.geometry.active
        return directions

    def wheel_speed(self, twist: FloatArray) -> float:
        """Return the speed of the fastest wheel centre [m/s], Eq. (38).

        It is zero only when the whole vehicle stands: a spinning one has ``v_c = 0``.

        Args:
            twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (3,).
        """
        v_x, v_y, omega = twist.tolist()
        return math.sqrt(
            float(np.max((v_x - omega * self._r_y) ** 2 + (v_y + omega * self._r_x) ** 2))
        )

    def errors(self, twist: FloatArray, perpendicular: FloatArray | None) -> ManifoldErrors:
        """Return the error functions of all wheels.

        Args:
            twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (3,).
            perpendicular: unit vector ``p`` in the body frame of this moment [1], shape (2,); None
                where there was no line of motion to keep, which leaves ``s_perp = 0``.
        """
        v_x, v_y, omega = twist.tolist()
        projection = self.sliding_velocities(twist)
        force = -np.sign(projection)  # Eq. (52): f_hat_i = force_i n_wi
        if perpendicular is None:
            s_perp = np.zeros_like(force)
        else:
            p_x, p_y = perpendicular.tolist()
            drift = p_x * v_x + p_y * v_y  # Eqs. (49), (51)
            s_perp = force * (self._n_x * p_x + self._n_y * p_y) * drift  # Eq. (50)
        s_omega = force * (self._lever * omega)  # Eqs. (53), (54)
        s_par = self._parallel(v_x, v_y, omega, projection)
        return ManifoldErrors(s_perp, s_omega, s_par)

    def _parallel(self, v_x: float, v_y: float, omega: float, projection: FloatArray) -> FloatArray:
        """Return ``s_par,i = psi(delta_i) (f_hat_i . v_par,i)``, Eqs. (56), (57)."""
        speed = math.hypot(v_x, v_y)
        if self._weighting is zero_weighting or speed == 0.0:
            return np.zeros_like(projection)  # without v_c nothing is parallel to it
        w_x = v_x - omega * self._r_y  # Eq. (38)
        w_y = v_y + omega * self._r_x
        wheel_speed = np.hypot(w_x, w_y)
        # A wheel centre that rests gets cos(delta) = 0; its force is zero anyway.
        cosine = np.abs(projection) / np.maximum(wheel_speed, 1e-300)
        psi = self._weighting(np.arccos(np.minimum(cosine, 1.0)))  # Eq. (56)
        e_x, e_y = v_x / speed, v_y / speed
        along = w_x * e_x + w_y * e_y
        force_along = -np.sign(projection) * (self._n_x * e_x + self._n_y * e_y)
        s_par: FloatArray = psi * force_along * along  # Eq. (57)
        return s_par
