"""Solution of the contact equation of `wheel.single` for tire curves that fall beyond their peak.

The equation is ``R(s) = D V s + kappa F(s) = |A|`` for the slip ``s`` of the contact patch, with
the force ``F`` of the curve; `solve_contact` defines the other symbols. There is one solution if
``R`` increases everywhere. If the curve falls faster than the first term grows, ``R`` has a maximum
beyond the peak and a minimum at a larger slip. If ``|A|`` is between these two values, two stable
solutions exist, and the contact patch keeps its state (adhering or sliding).
"""

from typing import Any

from omni_core.kernels import lean
from omni_sim.tire.interface.model import force_at

TOLERANCE = 1e-13
"""Largest residual of a solution, relative to the demand."""
_MAXIMUM_ITERATIONS = 100
_TURN_ITERATIONS = 40


@lean
def solve_contact(
    demand: float, damping: float, gain: float, speed: float, curve: Any, sliding: bool
) -> tuple[float, float, bool]:
    """Solve the contact equation; for the result, see `tire.interface.model.contact_friction`.

    Args:
        demand: ``|A|``, magnitude of the force that a sticking patch would need [N].
        damping: ``D``, damping of the tire plus stiffness times the length of a step [N s/m].
        gain: ``kappa``, 1 plus damping times the mobility of the wheel within the step [1].
        speed: ``V``, denominator of the slip [m/s].
        curve: a curve with two more fields than `model.Curve`: ``steepest_slip`` [1], at which the
            force falls fastest beyond its peak, and ``steepest_fall`` [N], the value of ``-dF/ds``
            at this slip.
        sliding: whether the contact patch slid in the previous step.
    """
    if curve.peak_force <= 0.0:
        return 0.0, demand / damping, False
    viscous = damping * speed
    at_peak = viscous * curve.peak_slip + gain * curve.peak_force
    dips = viscous < gain * curve.steepest_fall
    low = 0.0
    # The force is not negative, so R exceeds the demand here.
    high = demand / viscous
    if dips and sliding:
        low = curve.steepest_slip
        if demand < viscous * low + gain * force_at(curve, low)[0]:
            far = 2.0 * low
            while viscous + gain * force_at(curve, far)[1] < 0.0:
                low = far
                far *= 2.0
            low = _turning_point(viscous, gain, curve, low, far)
            sliding = demand >= viscous * low + gain * force_at(curve, low)[0]
    if dips and not sliding and demand > at_peak:
        crest = _turning_point(viscous, gain, curve, curve.steepest_slip, curve.peak_slip)
        crest_force = force_at(curve, crest)[0]
        sliding = demand > viscous * crest + gain * crest_force
        low = curve.steepest_slip if sliding else curve.peak_slip
        if not sliding:
            high = crest
    elif demand <= at_peak and not (dips and sliding):
        sliding = False
        low, high = 0.0, curve.peak_slip
    elif not dips:
        low = curve.peak_slip
    if sliding or (not dips and demand > at_peak):
        start = (demand - gain * curve.slide_force) / viscous
    else:
        start = demand / (viscous + gain * curve.slope)
    slip, force = _root(demand, viscous, gain, curve, low, high, start)
    if not dips:
        sliding = slip > curve.steepest_slip
    return force, slip * speed, sliding


@lean
def _turning_point(viscous: float, gain: float, curve: Any, falling: float, rising: float) -> float:
    """Return the slip [1] at an extremum of ``R(s) = viscous s + gain F(s)``, by bisection.

    Args:
        viscous: damping times the denominator of the slip, ``D V`` [N].
        gain: factor of the tire force, ``kappa`` [1].
        curve: curve ``F`` of any tire model.
        falling: a slip at which ``R`` falls [1].
        rising: a slip at which ``R`` rises [1].
    """
    for _ in range(_TURN_ITERATIONS):
        middle = 0.5 * (falling + rising)
        if viscous + gain * force_at(curve, middle)[1] < 0.0:
            falling = middle
        else:
            rising = middle
    return rising


@lean
def _root(
    demand: float, viscous: float, gain: float, curve: Any, low: float, high: float, start: float
) -> tuple[float, float]:
    """Return slip ``s`` [1] and force ``F`` [N] for which ``viscous s + gain F(s) = demand``.

    The equation is solved by Newton's method within a bracket.

    Args:
        demand: magnitude of the force that a sticking patch would need, ``|A|`` [N].
        viscous: damping times the denominator of the slip, ``D V`` [N].
        gain: factor of the tire force, ``kappa`` [1].
        curve: curve ``F`` of any tire model.
        low: lower end of the bracket [1].
        high: upper end of the bracket [1].
        start: initial slip; if it is outside the bracket, the bracket's middle is used [1].
    """
    slip = start if low <= start < high else 0.5 * (low + high)
    force, gradient = force_at(curve, slip)
    for _ in range(_MAXIMUM_ITERATIONS):
        residual = viscous * slip + gain * force - demand
        if abs(residual) <= TOLERANCE * demand:
            break
        if residual > 0.0:
            high = slip
        else:
            low = slip
        step = slip - residual / (viscous + gain * gradient)
        # Also true for NaN.
        if not low < step < high:
            step = 0.5 * (low + high)
        if step == slip:
            break
        slip = step
        force, gradient = force_at(curve, slip)
    return slip, force
