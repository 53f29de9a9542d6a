"""The single-roller omni-wheel: a tyre that acts along the active direction only, (18)-(22).

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
Departure from the dissertation: ``v_num`` may be tiny, so that a locked wheel sticks or slides
as Coulomb friction does and never creeps.
"""

from __future__ import annotations

import math

from numba import njit

from omni_sim.characteristic import adhesion_force, falling_force

# (dF0, s_max, F_max, s_slide, F_slide)
Curve = tuple[float, float, float, float, float]

_TOLERANCE = 1e-13
_MAXIMUM_ITERATIONS = 60


@njit(cache=True, nogil=True, error_model="numpy")
def _adhesion_root(
    demand: float, viscous: float, initial: float, bend: float, gain: float
) -> float:
    """Solve ``viscous sigma + gain F(sigma) = demand`` on the rising section, 0..1.

    Newton's rule, confined to the bracket, on the equation cleared of its denominator.
    """
    low, high = 0.0, 1.0
    sigma = min(demand / (viscous + gain * initial), 1.0)
    for _ in range(_MAXIMUM_ITERATIONS):
        denominator = 1.0 + sigma * (sigma + bend)
        residual = (viscous * sigma - demand) * denominator + gain * initial * sigma
        if abs(residual) <= _TOLERANCE * demand:
            break
        if residual > 0.0:
            high = sigma
        else:
            low = sigma
        slope = (
            viscous * denominator
            + (viscous * sigma - demand) * (2.0 * sigma + bend)
            + gain * initial
        )
        step = sigma - residual / slope
        # Also catches NaN.
        if not low < step < high:
            step = 0.5 * (low + high)
        if step == sigma:
            break
        sigma = step
    return sigma


@njit(cache=True, nogil=True, error_model="numpy")
def _falling_root(
    demand: float, base: float, viscous: float, drop: float, low: float, high: float
) -> float:
    """Solve ``base + viscous sigma - drop sigma^2 (3 - 2 sigma) = demand`` where it rises."""
    sigma = 0.5 * (low + high)
    for _ in range(_MAXIMUM_ITERATIONS):
        residual = base + sigma * (viscous - drop * sigma * (3.0 - 2.0 * sigma)) - demand
        if abs(residual) <= _TOLERANCE * demand:
            break
        if residual > 0.0:
            high = sigma
        else:
            low = sigma
        step = sigma - residual / (viscous - 6.0 * drop * sigma * (1.0 - sigma))
        if not low < step < high:
            step = 0.5 * (low + high)
        if step == sigma:
            break
        sigma = step
    return sigma


@njit(cache=True, nogil=True, error_model="numpy")
def contact_friction(
    demand: float,
    damping: float,
    gain: float,
    speed: float,
    curve: Curve,
    sliding: bool,
) -> tuple[float, float, bool]:
    """Solve ``demand = damping w + gain F(w / speed)`` for the sliding speed of the patch.

    Args:
        demand: ``|A|`` [N].
        damping: ``D = d + c dt`` [N s/m].
        gain: ``kappa = 1 + D m`` [1].
        speed: ``V = r_D |omega| + v_num`` [m/s].
        curve: from `characteristic.curve_at_load`.
        sliding: whether the patch slid in the step before.

    Returns:
        ``F`` [N], ``w`` [m/s] and whether the patch slides now.
    """
    slope, peak_slip, peak_force, slide_slip, slide_force = curve
    if peak_force <= 0.0:
        return 0.0, demand / damping, False
    viscous = damping * speed
    at_peak = viscous * peak_slip + gain * peak_force
    at_slide = viscous * slide_slip + gain * slide_force
    rise = viscous * (slide_slip - peak_slip)
    drop = gain * (peak_force - slide_force)

    low, high = 0.0, 1.0
    # Between peak and sliding the right-hand side dips if its slope, least in the middle, does.
    dips = rise < 1.5 * drop
    if dips:
        half = 0.5 * math.sqrt(1.0 - rise / (1.5 * drop))
        crest, valley = 0.5 - half, 0.5 + half
        if sliding:
            lowest = at_peak + valley * (rise - drop * valley * (3.0 - 2.0 * valley))
            sliding = demand >= lowest
        else:
            highest = at_peak + crest * (rise - drop * crest * (3.0 - 2.0 * crest))
            sliding = demand > highest
        if sliding:
            low = valley
        else:
            high = crest
    if demand <= at_peak and not (dips and sliding):
        initial = peak_slip * slope
        bend = initial / peak_force - 2.0
        sigma = _adhesion_root(demand, viscous * peak_slip, initial, bend, gain)
        return adhesion_force(initial, bend, sigma), sigma * peak_slip * speed, False
    if demand >= at_slide and not (dips and not sliding):
        return slide_force, (demand - gain * slide_force) / damping, True
    sigma = _falling_root(demand, at_peak, rise, drop, low, high)
    slip = peak_slip + sigma * (slide_slip - peak_slip)
    return falling_force(peak_force, slide_force, sigma), slip * speed, sigma > 0.5


@njit(cache=True, nogil=True, error_model="numpy")
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
        free_velocity: sliding velocity of the rim at the end of the step if the tyre made no
            force, ``v_free`` [m/s].
        mobility: ``m``, by how much the tyre's force changes that velocity [m/s per N].
        speed: ``V = r_D |omega| + v_num`` [m/s].
        curve: from `characteristic.curve_at_load`.
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
