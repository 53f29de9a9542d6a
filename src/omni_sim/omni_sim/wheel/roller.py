"""Omni-wheel with individual rollers, in which each roller is a small tire.

Tables and equations have the numbers of the dissertation, which describes this wheel in section
2.4.1.

Contact: the envelope of the wheel is a circle, so the wheel's axis keeps its height, and the lowest
roller carries the wheel (`roller_geometry`). The contacts of neighboring rollers overlap: in a
wheel of n rollers, as soon as a roller is ``(1 - overlap) pi/n`` beyond its lowest position, its
load passes smoothly to the next roller. At ``pi/n`` each of the two carries half of the load, so
forces are continuous. A roller that leaves the ground keeps its spin and loses its deflection.

Tire: the curve ``x`` of Table 1 acts along the roller's axis, as in the single-roller wheel, so
that the two wheels can be compared. The curve ``y`` acts along the roller's own rolling direction.
The slips of both directions are normalized and added as vectors. The sum determines one force
against the sliding velocity (W. Hirschberg, G. Rill, H. Weinfurter, "Tire model TMeasy", Vehicle
System Dynamics 45 (S), 2007). The denominator of Eqs. (1), (2), which is ``r |Omega|`` for an
ordinary tire, becomes the speed of the rubber through the contact, to which wheel and roller
contribute:

    V = |R omega u + h omega_r u_w| + v_num,

with the wheel's rolling radius ``R``, speed ``omega`` and rolling direction ``u``, the roller's
radius ``h`` at the contact, spin ``omega_r`` and rolling direction ``u_w``, and a small constant
``v_num``.

Solution: along the unit vector ``q`` of the friction, the contact is a single-roller wheel whose
levers and mobilities are projected on ``q``. Each step therefore calls `drivetrain.wheel_step` a
few times until ``q`` agrees with the direction of the remaining sliding. The initial value of ``q``
is the direction in the last step. The deflection has two components, and the equations of these
components and of the spin of the roller are solved together.

The model neglects the change of a roller's angular momentum as its axis rotates with the wheel.
"""

import math
from typing import Any, NamedTuple

from omni_core.kernels import lean
from omni_core.quantities import Pair
from omni_sim.tire.combined_slip import curve_in_direction
from omni_sim.wheel.drivetrain import Drive, Hub, Spin, wheel_step
from omni_sim.wheel.single import Patch, TireConstants

_MAXIMUM_ITERATIONS = 20
_TOLERANCE = 1e-16  # squared change of direction below which the iteration ends


@lean
def load_share(gamma: float, half_pitch: float, overlap: float) -> float:
    """Return the share of the wheel's load that the lowest roller carries, 0.5 to 1.

    Args:
        gamma: wheel angle from the lowest position of this roller [rad], at most `half_pitch` in
            magnitude.
        half_pitch: half the angle between two rollers, ``pi / n`` [rad].
        overlap: overlap of neighboring rollers, `RollerConfiguration.overlap` [1].
    """
    into = (abs(gamma) / half_pitch - 1.0) / (2.0 * overlap) + 0.5
    if into <= 0.0:
        return 1.0
    return 1.0 - into * into * (3.0 - 2.0 * into)


class RollerPatch(NamedTuple):
    """Contact patch of a roller at the start of a step.

    Attributes:
        deflection: deflection ``e`` of the tread along the roller's axis and across it [m].
        speed: speed ``V`` of the rubber through the contact [m/s].
        sliding: whether the patch slid in the previous step.
        direction: unit vector of the friction in the previous step, along the roller's axis and
            across it [1]; the iteration begins with this vector.
    """

    deflection: Pair
    speed: float
    sliding: bool
    direction: Pair


class RollerHub(NamedTuple):
    """Constants that relate the force on a roller to the motion of roller, wheel and vehicle.

    Attributes:
        lever: rolling radius times rolling direction of the wheel, ``r_D u``, in components along
            the roller's axis and across it [m].
        velocity: velocity that the vehicle would have at the contact point at the end of the step
            without the force of this roller, along the roller's axis and across it [m/s].
        mobility: change of this velocity per force, in any direction [m/s per N].
        spin: spin of the roller after the dry friction of this step, but without the force of the
            ground [rad/s].
        inertia: moment of inertia of the roller [kg m^2].
        spin_lever: surface speed of the roller across its axis, divided by its spin [m].
    """

    lever: Pair
    velocity: Pair
    mobility: float
    spin: float
    inertia: float
    spin_lever: float


class RollerStep(NamedTuple):
    """State of a wheel and its roller on the ground after a step.

    Attributes:
        force: force on the vehicle along the roller's axis and across it [N].
        deflection: deflection of the tread along the axis and across it [m].
        spin: spin of the roller [rad/s].
        speed: speed of the wheel [rad/s].
        brake: torque of the brake on the wheel [N m].
        sliding: whether the patch slides.
        direction: unit vector of the friction, along the roller's axis and across it [1].
        slip: slip in the direction of the friction [1].
        limit: limit on the friction in this direction [N].
    """

    force: Pair
    deflection: Pair
    spin: float
    speed: float
    brake: float
    sliding: bool
    direction: Pair
    slip: float
    limit: float


@lean
def roller_step(
    tire: TireConstants,
    curves: tuple[Any, Any],
    patch: RollerPatch,
    hub: RollerHub,
    wheel: Spin,
    drive: Drive,
) -> RollerStep:
    """Advance a wheel and the roller on the ground by one step.

    Args:
        tire: constants of the roller's tread.
        curves: curves along the roller's axis and across it, from `tire.interface.model.curve_at`.
        patch: patch of the roller at the start of the step.
        hub: relation of force and motion.
        wheel: spin of the wheel at the start of the step.
        drive: drive of the wheel.
    """
    lever, deflection = hub.lever, patch.deflection
    effective = tire.damping + tire.stiffness * tire.dt
    passive_mobility = tire.dt * hub.spin_lever * hub.spin_lever / hub.inertia
    hub_a, hub_p = hub.velocity[0], hub.velocity[1] - hub.spin_lever * hub.spin
    q = patch.direction
    for _ in range(_MAXIMUM_ITERATIONS):
        used = q
        curve, norms = curve_in_direction(curves[0], curves[1], q)
        stretch = norms[0] * q[0] * q[0] + norms[1] * q[1] * q[1]
        bent = deflection[0] * q[0] + deflection[1] * q[1]
        # The speed is scaled so that the slip of the curve is the normalized slip.
        along = Patch(bent, patch.speed * stretch, patch.sliding)
        mobility = hub.mobility + passive_mobility * q[1] * q[1]
        pulled = Hub(lever[0] * q[0] + lever[1] * q[1], hub_a * q[0] + hub_p * q[1], mobility)
        after = wheel_step(tire, curve, along, pulled, wheel, drive)
        # Friction and sliding have the direction q. In each component, the force that a sticking
        # patch would need at the wheel's new speed is q times the effect of friction and sliding.
        size = abs(after.force)
        slid = effective * abs(after.patch_velocity) / stretch
        a = tire.stiffness * deflection[0] - effective * (hub_a - lever[0] * after.speed)
        p = tire.stiffness * deflection[1] - effective * (hub_p - lever[1] * after.speed)
        a /= size * (1.0 + effective * hub.mobility) + slid * norms[0] + 1e-300
        p /= size * (1.0 + effective * (hub.mobility + passive_mobility)) + slid * norms[1] + 1e-300
        length = math.hypot(a, p)
        if length == 0.0:
            break
        q = (a / length, p / length)
        side = 1.0 if q[0] * used[0] + q[1] * used[1] >= 0.0 else -1.0
        change = (q[0] - side * used[0]) ** 2 + (q[1] - side * used[1]) ** 2
        if change <= _TOLERANCE:
            break
    force = (after.force * used[0], after.force * used[1])
    bends = _deflected(tire, deflection, force, effective)
    spin = hub.spin - tire.dt * hub.spin_lever * force[1] / hub.inertia
    slip = abs(after.patch_velocity) / (patch.speed * stretch)
    return RollerStep(
        force, bends, spin, after.speed, after.brake, after.sliding, q, slip, curve.peak_force
    )


@lean
def _deflected(tire: TireConstants, deflection: Pair, force: Pair, effective: float) -> Pair:
    """Return the deflection of a tread after a step in which a force acts [m].

    All pairs are components along the roller's axis and across it.

    Args:
        tire: constants of the tread.
        deflection: deflection at the start of the step [m].
        force: force on the vehicle [N].
        effective: damping of the tread plus its stiffness times the length of a step [N s/m].
    """
    share = tire.dt / effective
    return (
        deflection[0] + share * (force[0] - tire.stiffness * deflection[0]),
        deflection[1] + share * (force[1] - tire.stiffness * deflection[1]),
    )
