"""Single-roller omni-wheel: a tire that acts only along the active direction, Eqs. (18)-(22).

The contact patch is connected to the wheel by a spring and a damper, Eq. (4), whose deflection
``e`` is a state. The rim slides with the velocity ``v_s = n_w . v_i - omega r_D (n_w . u_i)``,
where the wheel has the active direction ``n_w``, the velocity ``v_i`` of its center, the speed
``omega``, the rolling radius ``r_D`` and the rolling direction ``u_i``. The patch slides with ``v_p
= v_s + e_dot``. The friction of the patch is the steady characteristic ``F`` of the tire at the
slip of the patch, Eq. (20): ``s = |v_p| / V`` with ``V = r_D |omega| + v_num``. The implicit Euler
rule with the step ``dt``, the stiffness ``c`` and the damping ``d`` gives

    c (e + dt e_dot) + d e_dot = -sign(v_p) F(|v_p| / V).

Let ``D = d + c dt``. A sticking patch would need the force ``A = c e - D v_s``. The patch slides
with ``v_p = -sign(A) w``, where ``w >= 0`` solves ``|A| = D w + F(w / V)``.

The rim velocity changes with the force within the step, ``v_s = v_free + m F``, where ``m`` [m/s
per N] is the mobility of wheel and vehicle. The equation becomes ``|A| = D w + kappa F(w / V)``
with ``kappa = 1 + D m``. With this equation, the step of a wheel is stable and passive for any
stiffness and inertia. Because friction falls beyond its peak, two solutions may exist near
standstill. The patch then keeps its state, adhering or sliding (`sliding`). Each tire model solves
the equation for its own curve (`tire.interface.model`). Unlike in the dissertation,
``v_num`` may be very small. A locked wheel then sticks or slides as with Coulomb friction, but does
not creep.
"""

from typing import NamedTuple

from omni_core.kernels import lean_inline
from omni_sim.tire.interface.model import Curve, contact_friction


class TireConstants(NamedTuple):
    """Spring and damper of a tire, and the physics step.

    Attributes:
        stiffness: ``c``, horizontal stiffness of the tire [N/m].
        damping: ``d``, horizontal damping of the tire [N s/m].
        dt: physics step [s].
    """

    stiffness: float
    damping: float
    dt: float


class Patch(NamedTuple):
    """State of a tire's contact patch at the start of a step.

    Attributes:
        deflection: deflection ``e`` of the tire along the active direction [m].
        speed: ``V = r_D |omega| + v_num``, denominator of the slip [m/s].
        sliding: whether the patch slid in the previous step.
    """

    deflection: float
    speed: float
    sliding: bool


@lean_inline
def tire_force(
    tire: TireConstants, curve: Curve, patch: Patch, free_velocity: float, mobility: float
) -> tuple[float, float, float, bool]:
    """Advance the first-order dynamics (4) of one contact patch by one step.

    Args:
        tire: constants.
        curve: curve of any tire model, from `tire.interface.model.curve_at`.
        patch: patch at the start of the step.
        free_velocity: sliding velocity of the rim at the end of the step without the tire's
            force, ``v_free`` [m/s].
        mobility: ``m``, change of this velocity per force [m/s per N].

    Returns:
        Force on the vehicle along the active direction [N]; new deflection [m]; sliding velocity of
        the patch ``v_p`` [m/s]; whether the patch slides.
    """
    effective = tire.damping + tire.stiffness * tire.dt
    trial = tire.stiffness * patch.deflection - effective * free_velocity
    magnitude, patch_speed, sliding = contact_friction(
        abs(trial), effective, 1.0 + effective * mobility, patch.speed, curve, patch.sliding
    )
    force = magnitude if trial >= 0.0 else -magnitude
    patch_velocity = -patch_speed if trial >= 0.0 else patch_speed
    # force = c e + D e_dot
    step = tire.dt / effective * (force - tire.stiffness * patch.deflection)
    return force, patch.deflection + step, patch_velocity, sliding
