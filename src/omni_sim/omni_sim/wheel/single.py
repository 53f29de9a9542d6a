"""The single-roller omni-wheel: a tire that acts along the active direction only, (18)-(22).

The contact patch hangs on the wheel by a spring and a damper, Eq. (4), whose deflection ``e`` is
a state. With the sliding velocity of the rim ``v_s = n_w . v_i - omega r_D (n_w . u_i)`` the
patch slides at ``v_p = v_s + e_dot``, and its friction is the steady characteristic at the slip
that the patch itself has, Eq. (20): ``s = |v_p| / V`` with ``V = r_D |omega| + v_num``. So

    c (e + dt e_dot) + d e_dot = -sign(v_p) F(|v_p| / V)

by the implicit Euler rule. With ``D = d + c dt`` and the force ``A = c e - D v_s`` that a
sticking patch would need, ``v_p = -sign(A) w`` where ``w >= 0`` solves ``|A| = D w + F(w / V)``.

The rim does not wait for the force: it gives way by ``v_s = v_free + m F`` within the step, where
``m`` [m/s per N] stands for the inertia of wheel and vehicle. That turns the equation into
``|A| = D w + kappa F(w / V)`` with ``kappa = 1 + D m`` and keeps a wheel's step stable
and passive for any stiffness and inertia. Because friction falls beyond its peak, two solutions
may exist near standstill; a patch then keeps the state, adhering or sliding, that it has
(`sliding`).
Each tire model solves this equation for its own curve (`tire_model.contact_friction`).
Departure from the dissertation: ``v_num`` may be tiny, so that a locked wheel sticks or slides
as Coulomb friction does and never creeps.
"""

from __future__ import annotations

from numba import njit

from omni_sim.tire.model import Curve, contact_friction

__all__ = ["Curve", "contact_friction", "tire_force"]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def tire_force(
    deflection: float,
    free_velocity: float,
    mobility: float,
    speed: float,
    curve: Curve,
    stiffness: float,
    damping: float,
    dt: float,
    sliding: bool,
) -> tuple[float, float, float, bool]:
    """Advance the first-order dynamics (4) of one contact patch by one step.

    Args:
        deflection: ``e`` along the active direction [m].
        free_velocity: sliding velocity of the rim at the end of the step if the tire made no
            force, ``v_free`` [m/s].
        mobility: ``m``, by how much the tire's force changes that velocity [m/s per N].
        speed: ``V = r_D |omega| + v_num`` [m/s].
        curve: of any tire model, from `tire_model.curve_at`.
        stiffness: ``c`` [N/m].
        damping: ``d`` [N s/m].
        dt: step [s].
        sliding: whether the patch slid in the step before.

    Returns:
        Force on the vehicle along the active direction [N], new deflection [m], sliding velocity
        of the patch ``v_p`` [m/s], whether it slides.
    """
    effective = damping + stiffness * dt
    trial = stiffness * deflection - effective * free_velocity
    magnitude, patch_speed, now_sliding = contact_friction(
        abs(trial),
        effective,
        1.0 + effective * mobility,
        speed,
        curve,
        sliding,
    )
    force = magnitude if trial >= 0.0 else -magnitude
    patch_velocity = -patch_speed if trial >= 0.0 else patch_speed
    # force = c e + D e_dot
    new_deflection = deflection + dt * (force - stiffness * deflection) / effective
    return force, new_deflection, patch_velocity, now_sliding
