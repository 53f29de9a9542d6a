"""TMeasy tire: parameters, their dependence on the wheel load, and the curve that they define.

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 2.3.1 with Table 1 and Eqs. (1)-(4), after W. Hirschberg, G. Rill and H. Weinfurter,
"Tire model TMeasy", Vehicle System Dynamics 45(S), 2007.

The curve of each direction has five numbers: the slope ``dF0`` at zero slip [N], the slip ``s_max``
[1] and force ``F_max`` [N] of the peak, and the slip ``s_slide`` [1] and force ``F_slide`` [N] at
which full sliding begins. They depend on the wheel load: slope and forces by the parabola (3), and
the slips linearly, as in the source of the model. The dissertation interpolates all parameters by
the parabola. The slips would then vanish at zero load, and the initial slope of the curve of a
lightly loaded wheel would be smaller than the slope of the chord to the peak. At the nominal loads
both interpolations agree; at smaller loads the forces differ. Above the second nominal load the
parabola has no physical meaning, so the load is limited there and the caller reports the overload.
"""

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.tire.interface.configuration import FITTED, TMeasyConfiguration, curve_coefficients
from omni_sim.tire.interface.contact import TOLERANCE, solve_contact
from omni_sim.tire.interface.model import FitRecipe, Landmarks, TireModel

_MAXIMUM_ITERATIONS = 60


def direction_coefficients(tire: TMeasyConfiguration, direction: str = "x") -> FloatArray:
    """Return the `curve_coefficients` of a tire in the direction ``x`` or ``y``, shape (10,)."""
    curve = {"x": tire.x, "y": tire.y}[direction]
    return curve_coefficients(curve, tire.nominal_load_1, tire.nominal_load_2)


class CurvePoint(NamedTuple):
    """Force-slip curve at one load and friction factor; slope and forces in [N], slips in [1].

    ``steepest_slip`` is midway between peak and sliding, where the force falls fastest,
    and ``steepest_fall`` is the value of ``-dF/ds`` there; see `contact.solve_contact`.
    """

    slope: float
    peak_slip: float
    peak_force: float
    slide_slip: float
    slide_force: float
    steepest_slip: float
    steepest_fall: float


@lean
def curve_through(
    slope: float, peak_slip: float, peak_force: float, slide_slip: float, slide_force: float
) -> CurvePoint:
    """Return the curve that five numbers define: slope and forces [N], slips [1]."""
    fall = 1.5 * (peak_force - slide_force) / (slide_slip - peak_slip)
    middle = 0.5 * (peak_slip + slide_slip)
    return CurvePoint(slope, peak_slip, peak_force, slide_slip, slide_force, middle, fall)


class TMeasyParameters(NamedTuple):
    """Constants of a TMeasy tire in one direction for the kernels.

    Attributes:
        coefficients: load interpolation of the curve, from `curve_coefficients`, shape (10,).
    """

    coefficients: FloatArray


@lean
def curve_at(parameters: TMeasyParameters, load: float, friction: float) -> CurvePoint:
    """Return the curve at a load, Eq. (3).

    The friction factor ``mu/mu_0`` scales forces and slips of peak and sliding, but not the slope.

    Args:
        parameters: constants of a direction.
        load: wheel load [N] between 0 and the largest permissible load.
        friction: friction factor ``mu/mu_0`` [1].
    """
    c = parameters.coefficients
    return curve_through(
        (c[0] + c[1] * load) * load,
        (c[6] + c[7] * load) * friction,
        (c[2] + c[3] * load) * load * friction,
        (c[8] + c[9] * load) * friction,
        (c[4] + c[5] * load) * load * friction,
    )


@lean
def force_at(curve: CurvePoint, slip: float) -> tuple[float, float]:
    """Return force [N] and its derivative [N] at ``slip >= 0`` [1].

    The curve is a rational function up to the peak, then a cubic up to sliding, then constant.
    """
    peak_slip, peak_force = curve.peak_slip, curve.peak_force
    if peak_force <= 0.0:
        return 0.0, 0.0
    if slip >= curve.slide_slip:
        return curve.slide_force, 0.0
    if slip > peak_slip:
        width, drop = curve.slide_slip - peak_slip, peak_force - curve.slide_force
        sigma = (slip - peak_slip) / width
        force = peak_force - drop * sigma * sigma * (3.0 - 2.0 * sigma)
        return force, -6.0 * drop * sigma * (1.0 - sigma) / width
    sigma, initial = slip / peak_slip, peak_slip * curve.slope
    denominator = 1.0 + sigma * (sigma + initial / peak_force - 2.0)
    gradient = curve.slope * (1.0 - sigma * sigma) / (denominator * denominator)
    return initial * sigma / denominator, gradient


@lean
def contact(
    demand: float, damping: float, gain: float, speed: float, curve: CurvePoint, sliding: bool
) -> tuple[float, float, bool]:
    """Solve the contact equation; arguments and result as in `model.contact_friction`.

    Up to the peak, the equation is a cubic in ``sigma``, the slip divided by that of the peak.
    Each iteration needs a single division. A simulated stop takes about a tenth less time than
    with `solve_contact`.
    """
    viscous = damping * speed * curve.peak_slip
    dips = viscous < gain * curve.steepest_fall * curve.peak_slip
    if curve.peak_force <= 0.0 or demand > viscous + gain * curve.peak_force or (dips and sliding):
        return solve_contact(demand, damping, gain, speed, curve, sliding)
    initial = curve.peak_slip * curve.slope
    bend = initial / curve.peak_force - 2.0
    square, linear = viscous * bend - demand, viscous - demand * bend + gain * initial
    low, high = 0.0, 1.0
    # The root without the cubic term.
    sigma = 2.0 * demand / (linear + math.sqrt(max(linear**2 + 4.0 * square * demand, 0.0)))
    for _ in range(_MAXIMUM_ITERATIONS):
        if not low <= sigma <= high:  # also true for NaN
            sigma = 0.5 * (low + high)
        residual = ((viscous * sigma + square) * sigma + linear) * sigma - demand
        if abs(residual) <= TOLERANCE * demand:
            break
        low, high = (low, sigma) if residual > 0.0 else (sigma, high)
        # Halley's method
        curved = 3.0 * viscous * sigma + square
        slope = (curved + square) * sigma + linear
        step = residual * slope / (slope * slope - residual * curved)
        if sigma - step == sigma:
            break
        sigma -= step
    return initial * sigma / (1.0 + sigma * (sigma + bend)), sigma * curve.peak_slip * speed, False


def curve_of(
    tire: TMeasyConfiguration, load: float, friction: float = 1.0, direction: str = "x"
) -> CurvePoint:
    """Return the curve of a tire in one direction at a load, Eq. (3).

    Args:
        tire: tire with the curves of both directions, as in Table 1.
        load: wheel load [N], clipped between 0 and the model's largest load.
        friction: friction factor ``mu/mu_0`` [1].
        direction: ``x`` or ``y``.
    """
    parameters = TMeasyParameters(direction_coefficients(tire, direction))
    return curve_at(parameters, min(max(load, 0.0), tire.nominal_load_2), friction)


def _parameters(configuration: TMeasyConfiguration) -> TMeasyParameters:
    return TMeasyParameters(direction_coefficients(configuration))


def _fitted_parameters(values: FloatArray, largest_load: float) -> TMeasyParameters:
    # This has the attributes of a TMeasyCurve but not its checks, which an unfinished fit may fail.
    nominal: Any = SimpleNamespace(**dict(zip(FITTED, values.tolist(), strict=True)))
    return TMeasyParameters(curve_coefficients(nominal, 0.5 * largest_load, largest_load))


def _start(seen: Landmarks) -> FloatArray:
    pair = np.ones(2)
    return np.concatenate((seen.slope, seen.peak_slip, seen.peak_force, 2.5 * pair, 0.9 * pair))


def _values(unknowns: FloatArray) -> FloatArray:
    """Return the parameters of a curve for the unknowns of a fit, in the order of `FITTED`.

    The unknowns are the parameters, except that slip and force of full sliding are given as ratios
    to slip and force of the peak.
    """
    values = np.copy(unknowns)
    values[6:8] *= values[2:4]
    values[8:10] *= values[4:6]
    return values


def _mapping(values: FloatArray, largest_load: float) -> dict[str, Any]:
    curve = {key: float(value) for key, value in zip(FITTED, values, strict=True)}
    return {
        "nominal_load_1": 0.5 * float(largest_load),
        "nominal_load_2": float(largest_load),
        "x": curve,
        "y": dict(curve),
    }


MODEL = TireModel(
    configuration=TMeasyConfiguration,
    parameters_type=TMeasyParameters,
    curve_type=CurvePoint,
    parameters=_parameters,
    curve_at=curve_at,
    force_at=force_at,
    contact=contact,
    fit=FitRecipe(
        keys=tuple(f"x.{key}" for key in FITTED),
        lower=(1e-9,) * 6 + (1.01,) * 2 + (0.05,) * 2,
        upper=(np.inf,) * 8 + (1.0,) * 2,
        loads=2,
        start=_start,
        values=_values,
        parameters=_fitted_parameters,
        mapping=_mapping,
    ),
)
