"""Sliding-mode law: a brake acts while the error of its wheel is negative, Eqs. (44)-(59).

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 3.4. The error of each wheel has three components: for the velocity across the line of
motion, for the rotation, and for the velocity along the motion. A component is negative if the
friction force of the braked wheel would reduce this motion. If the sum of the components is
negative, the wheel is braked. The functions use kinematics only and require no mass, load or
friction coefficient.

Symbols, all in the body frame: ``v_c`` velocity of the center of the wheels, ``Omega`` yaw rate,
``r_i`` wheel positions relative to this center, ``n_wi`` active directions, ``v_i`` velocities of
the wheel centers, ``f_hat_i`` unit friction forces, ``p`` unit vector across the velocity at the
start of braking.

Three definitions differ from their printed form. Eq. (51) contains the velocity ``v_i`` of the
wheel, although Eq. (49), from which it follows, contains the velocity ``v_c`` of the platform. With
``v_i`` a rotation would count as drift, so ``v_c`` is used. Eqs. (53), (54) contain a unit vector
along ``f x r``; the component here is the moment of a unit force, ``r x f``, and thus grows with
the lever arm. Eqs. (56), (57) contain a signed angle between ``n_wi`` and ``v_i``. If this angle
exceeds 90 deg, the weight is zero or negative, so ``s_par,i`` would be positive for half of all
directions, and the wheels that brake best would be released. As the sign of ``n_wi`` is a
convention, the unsigned angle between the velocity and the axis along ``n_wi`` is used.

If a wheel does not slide along its active direction (``n_wi . v_i = 0``), the direction of its
friction force is undefined; its ``f_hat_i`` and its error are then zero.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws.law import ASSIST, NO_HELP, Motion
from omni_brake_assist.weighting import ZERO, Weighting, psi, weighting_function
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import by_reference, kernel, lean
from omni_core.quantities import FloatArray


@by_reference
class Manifold(NamedTuple):
    """Constants of the error functions of N wheels.

    Attributes:
        r_x: wheel positions ``r_i``, x component [m], shape (N,).
        r_y: wheel positions ``r_i``, y component [m], shape (N,).
        n_x: active directions ``n_wi``, x component [1], shape (N,).
        n_y: active directions ``n_wi``, y component [1], shape (N,).
        lever: lever arm of the active directions, ``cross(r_i, n_wi)`` [m], shape (N,).
        weighting: number of the weighting, see `weighting.psi`.
        k: tuning constant of the weighting [1].
    """

    r_x: FloatArray
    r_y: FloatArray
    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    weighting: int
    k: int


@lean
def wheel_error(
    manifold: Manifold, i: int, v_x: float, v_y: float, omega: float, p_x: float, p_y: float
) -> tuple[float, float, float]:
    """Return the three components of the error of one wheel.

    Args:
        manifold: constants of the error functions.
        i: index of the wheel.
        v_x: velocity of the center of the wheels, x [m/s].
        v_y: velocity of the center of the wheels, y [m/s].
        omega: yaw rate [rad/s].
        p_x: x component of the unit vector ``p`` across the line of motion, in the present body
            frame [1]; zero without a line of motion.
        p_y: y component of ``p`` [1].

    Returns:
        ``s_perp,i``, ``s_omega,i``, ``s_par,i`` [m/s], see `ManifoldErrors`.
    """
    n_x, n_y = manifold.n_x[i], manifold.n_y[i]
    sliding = n_x * v_x + n_y * v_y + manifold.lever[i] * omega
    if sliding == 0.0:
        return 0.0, 0.0, 0.0
    force = -1.0 if sliding > 0.0 else 1.0  # Eq. (52): f_hat_i = force n_wi
    drift = p_x * v_x + p_y * v_y  # Eqs. (49), (51)
    s_perp = force * (n_x * p_x + n_y * p_y) * drift  # Eq. (50)
    s_omega = force * (manifold.lever[i] * omega)  # Eqs. (53), (54)
    speed = math.hypot(v_x, v_y)
    if manifold.weighting == ZERO or speed == 0.0:
        return s_perp, s_omega, 0.0  # if v_c is zero, no direction is parallel to it
    w_x = v_x - omega * manifold.r_y[i]  # Eq. (38)
    w_y = v_y + omega * manifold.r_x[i]
    cosine = abs(sliding) / max(math.hypot(w_x, w_y), 1e-300)
    weight = psi(manifold.weighting, manifold.k, math.acos(min(cosine, 1.0)))  # Eq. (56)
    e_x, e_y = v_x / speed, v_y / speed
    along = w_x * e_x + w_y * e_y
    return s_perp, s_omega, weight * (force * (n_x * e_x + n_y * e_y)) * along  # Eq. (57)


@kernel
def _errors(
    manifold: Manifold, twist: FloatArray, p_x: float, p_y: float, components: FloatArray
) -> None:
    for i in range(components.shape[1]):
        components[:, i] = wheel_error(manifold, i, twist[0], twist[1], twist[2], p_x, p_y)


@dataclasses.dataclass(frozen=True, eq=False)
class ManifoldErrors:
    """Components of the errors of N wheels [m/s], shape (N,) each.

    Attributes:
        perpendicular: component across the line of motion, ``s_perp,i`` of Eq. (50).
        angular: component of the rotation, ``s_omega,i`` of Eq. (54).
        parallel: component along the motion, ``s_par,i`` of Eq. (57).
    """

    perpendicular: FloatArray
    angular: FloatArray
    parallel: FloatArray

    @property
    def total(self) -> FloatArray:
        """Error ``s_i`` of each wheel, the sum of the components [m/s], shape (N,), Eq. (44)."""
        return self.perpendicular + self.angular + self.parallel


class SlidingManifold:
    """Error functions of the wheels of one platform.

    Args:
        geometry: positions and active directions of the N wheels.
        weighting: ``psi(delta)``, weight of the error component along the motion.

    Attributes:
        geometry: positions and active directions of the N wheels.
        constants: geometry and weighting in the form that the kernels use.
    """

    def __init__(self, geometry: PlatformGeometry, weighting: Weighting) -> None:
        self.geometry = geometry
        r_x, r_y = np.ascontiguousarray(geometry.position.T)
        n_x, n_y = np.ascontiguousarray(geometry.active.T)
        kind, k = weighting.kind, weighting.k
        self.constants = Manifold(r_x, r_y, n_x, n_y, geometry.lever, kind, k)

    def errors(self, twist: FloatArray, perpendicular: FloatArray | None) -> ManifoldErrors:
        """Return the errors of all wheels.

        Args:
            twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (3,).
            perpendicular: unit vector ``p`` in the present body frame [1], shape (2,); None, which
                gives ``s_perp = 0``, if there is no line of motion to keep.
        """
        p_x, p_y = (0.0, 0.0) if perpendicular is None else perpendicular.tolist()
        components = np.empty((3, len(self.constants.r_x)))
        _errors(self.constants, np.asarray(twist, dtype=np.float64), p_x, p_y, components)
        return ManifoldErrors(*components)


@lean
def step(manifold: Manifold, motion: Motion, error: FloatArray, enable: FloatArray) -> int:
    """Enable the brakes of wheels with a negative error; see `Law.step` for arguments."""
    outcome = NO_HELP
    for i in range(error.size):
        s_perp, s_omega, s_par = wheel_error(
            manifold, i, motion.v_x, motion.v_y, motion.yaw_rate, motion.across_x, motion.across_y
        )
        error[i] = s_perp + s_omega + s_par  # Eq. (44)
        enable[i] = 1.0 if error[i] < 0.0 else 0.0  # Eqs. (45), (46)
        if error[i] < 0.0:
            outcome = ASSIST
    return outcome


class SlidingMode:
    """The law `sliding_mode` with the interface `Law`, for use from Python.

    Attributes:
        manifold: error functions of the wheels.
    """

    def __init__(self, configuration: BrakeAssistConfiguration, geometry: PlatformGeometry) -> None:
        weighting = weighting_function(configuration.weighting, configuration.k)
        self.manifold = SlidingManifold(geometry, weighting)

    def step(self, motion: Motion, error: FloatArray, enable: FloatArray) -> int:
        """Enable the brakes of wheels with a negative error; implements `Law.step`."""
        return int(step(self.manifold.constants, motion, error, enable))
