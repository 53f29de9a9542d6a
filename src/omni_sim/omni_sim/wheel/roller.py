"""The individual-roller omni-wheel of section 2.4.1: each roller is a small tire of its own.

Contact: the wheel's envelope is a circle, so its axis stays level, and the lowest roller carries
the wheel (`roller_geometry`). Rollers overlap: from ``(1 - overlap) pi/n`` on, the load passes
smoothly to the neighbour, half of it at ``pi/n``, so forces are continuous. A roller that
leaves the ground keeps its spin and loses its deflection.

Tire: Table 1's curve ``x`` acts along the roller's axis, where the single-roller wheel uses it,
so that the two wheels can be compared, and ``y`` along the roller's own rolling direction. The
slips of both directions are normalised, added as vectors, and give one force against the sliding
velocity (W. Hirschberg, G. Rill, H. Weinfurter, "Tire model TMeasy", Vehicle System Dynamics 45
(S), 2007). The denominator of Eqs. (1), (2), a tire's own ``r |Omega|``, becomes the speed with
which rubber passes through the contact, to which wheel and roller both add:
``V = |R omega u + h omega_r u_w| + v_num``.

Solution: along the unit vector ``q`` of the friction the contact is a single-roller wheel with
the levers and mobilities projected on ``q``, so each step is `drivetrain.wheel_step` itself,
repeated until ``q`` lies along the sliding that its force leaves (a few times; the last direction
is the first guess). The deflection has two components; the roller's spin is solved with it.

Neglected: that a roller's spin turns with the wheel, and roller bearings' friction.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from omni_sim.tire.roller import curve_in_direction
from omni_sim.wheel.drivetrain import wheel_step

Pair = tuple[float, float]

_MAXIMUM_ITERATIONS = 20
_TOLERANCE = 1e-16  # of the squared change of direction


@njit(cache=True, nogil=True, error_model="numpy")
def load_share(gamma: float, half_pitch: float, overlap: float) -> float:
    """Return the share of the wheel's load that the lowest roller carries, 0.5..1.

    Args:
        gamma: angle of that roller from its lowest position [rad], up to `half_pitch`.
        half_pitch: ``pi / n`` [rad].
        overlap: see `roller_configuration.RollerConfiguration`.
    """
    into = (abs(gamma) / half_pitch - 1.0) / (2.0 * overlap) + 0.5
    if into <= 0.0:
        return 1.0
    return 1.0 - into * into * (3.0 - 2.0 * into)


@njit(cache=True, nogil=True, error_model="numpy")
def roller_step(
    omega: float,
    inertia: float,
    brake: float,
    drive_stiffness: float,
    drive_speed: float,
    drive_limit: float,
    lever: Pair,
    spin: float,
    spin_inertia: float,
    spin_lever: float,
    deflection: Pair,
    hub: Pair,
    mobility: float,
    speed: float,
    active: Any,
    passive: Any,
    stiffness: float,
    damping: float,
    dt: float,
    sliding: bool,
    guess: Pair,
) -> tuple[Pair, Pair, float, float, float, bool, Pair, float, float]:
    """Advance a wheel and the roller on the ground by one step.

    Pairs are components along the roller's axis (active) and across it (passive).

    Args:
        omega: wheel speed [rad/s].
        inertia: of the wheel about its axis [kg m^2].
        brake: torque that the brake can exert [N m].
        drive_stiffness: of the clutch [N m s/rad], 0 when disengaged.
        drive_speed: commanded wheel speed [rad/s].
        drive_limit: largest torque of the clutch [N m].
        lever: ``r_D u`` in components [m].
        spin: of the roller [rad/s].
        spin_inertia: of the roller [kg m^2].
        spin_lever: speed of the roller's surface per spin, along the passive direction [m].
        deflection: ``e`` [m].
        hub: velocity of the contact as part of the vehicle at the end of the step if this roller
            made no force [m/s].
        mobility: by how much the force changes it, in any direction [m/s per N].
        speed: ``V`` [m/s].
        active: curve along the axis, from `tire_model.curve_at`.
        passive: curve across it.
        stiffness: ``c`` of the tire [N/m].
        damping: ``d`` of the tire [N s/m].
        dt: step [s].
        sliding: whether the patch slid in the step before.
        guess: of the direction of the friction, a unit vector.

    Returns:
        Force on the vehicle [N], deflection [m], roller spin [rad/s], wheel speed [rad/s], brake
        torque on the wheel [N m], sliding, direction of the friction, slip in it [1], the
        friction limit there [N].
    """
    effective = damping + stiffness * dt
    passive_mobility = dt * spin_lever * spin_lever / spin_inertia
    hub_p = hub[1] - spin_lever * spin
    q = guess
    for _ in range(_MAXIMUM_ITERATIONS):
        used = q
        curve, norms = curve_in_direction(active, passive, q)
        stretch = norms[0] * q[0] * q[0] + norms[1] * q[1] * q[1]
        force, _, new_omega, brake_torque, patch, now_sliding = wheel_step(
            omega,
            inertia,
            brake,
            drive_stiffness,
            drive_speed,
            drive_limit,
            lever[0] * q[0] + lever[1] * q[1],
            deflection[0] * q[0] + deflection[1] * q[1],
            hub[0] * q[0] + hub_p * q[1],
            mobility + passive_mobility * q[1] * q[1],
            speed * stretch,  # so that the curve is met at its normalised slip
            curve,
            stiffness,
            damping,
            dt,
            sliding,
        )
        # What a sticking patch would need at the wheel's new speed, divided component by
        # component by how force and sliding use it up, is the direction of both.
        size = abs(force)
        slid = effective * abs(patch) / stretch
        a = stiffness * deflection[0] - effective * (hub[0] - lever[0] * new_omega)
        p = stiffness * deflection[1] - effective * (hub_p - lever[1] * new_omega)
        a /= size * (1.0 + effective * mobility) + slid * norms[0] + 1e-300
        p /= size * (1.0 + effective * (mobility + passive_mobility)) + slid * norms[1] + 1e-300
        length = math.hypot(a, p)
        if length == 0.0:
            break
        q = (a / length, p / length)
        side = 1.0 if q[0] * used[0] + q[1] * used[1] >= 0.0 else -1.0
        change = (q[0] - side * used[0]) ** 2 + (q[1] - side * used[1]) ** 2
        if change <= _TOLERANCE:
            break
    forces = (force * used[0], force * used[1])
    share = dt / effective
    deflected = (
        deflection[0] + share * (forces[0] - stiffness * deflection[0]),
        deflection[1] + share * (forces[1] - stiffness * deflection[1]),
    )
    new_spin = spin - dt * spin_lever * forces[1] / spin_inertia
    return (
        forces,
        deflected,
        new_spin,
        new_omega,
        brake_torque,
        now_sliding,
        q,
        abs(patch) / (speed * stretch),
        curve.peak_force,
    )
