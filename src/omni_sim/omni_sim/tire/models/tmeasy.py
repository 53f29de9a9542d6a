"""TMeasy as a tire model: its constants, its curve and its contact equation in kernels.

The model itself is described in `omni_sim.tire.tmeasy`. The wheel works with its longitudinal
curve. `tire.contact` would solve the contact equation as well, to 1e-13 and with the same verdicts,
but a step of the vehicle takes 10-15 % longer than with the pieces of this curve in closed form.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray
from omni_sim.tire.model import FitRecipe, Landmarks, TireModel
from omni_sim.tire.tmeasy import (
    CurvePoint,
    TMeasyConfiguration,
    adhesion_force,
    curve_at_load,
    curve_coefficients,
    direction_coefficients,
    falling_force,
    steady_force,
)

_TOLERANCE = 1e-13
_MAXIMUM_ITERATIONS = 60


class TMeasyParameters(NamedTuple):
    """Constants of the kernels; ``coefficients`` from `tmeasy.curve_coefficients`, shape (10,)."""

    coefficients: FloatArray


@lean
def _adhesion_root(
    demand: float, viscous: float, initial: float, bend: float, gain: float
) -> float:
    """Solve ``viscous sigma + gain F(sigma) = demand`` on the rising section, 0..1.

    Cleared of its denominator it is a cubic, whose first term matters little unless the wheel
    turns fast: Halley's rule, confined to the bracket, from the root without that term.
    """
    low, high = 0.0, 1.0
    square, linear = viscous * bend - demand, viscous - demand * bend + gain * initial
    root = math.sqrt(max(linear * linear + 4.0 * square * demand, 0.0))
    sigma = min(2.0 * demand / (linear + root), 1.0)
    for _ in range(_MAXIMUM_ITERATIONS):
        residual = ((viscous * sigma + square) * sigma + linear) * sigma - demand
        if abs(residual) <= _TOLERANCE * demand:
            break
        if residual > 0.0:
            high = sigma
        else:
            low = sigma
        curved = 3.0 * viscous * sigma + square
        slope = (curved + square) * sigma + linear
        step = sigma - residual * slope / (slope * slope - residual * curved)
        # Also catches NaN.
        if not low < step < high:
            step = 0.5 * (low + high)
        if step == sigma:
            break
        sigma = step
    return sigma


@lean
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


@lean
def contact(
    demand: float,
    damping: float,
    gain: float,
    speed: float,
    curve: CurvePoint,
    sliding: bool,
) -> tuple[float, float, bool]:
    """Solve the contact equation piece by piece; see `tire_model.contact_friction`."""
    slope, peak_slip, peak_force, slide_slip, slide_force = curve
    if peak_force <= 0.0:
        return 0.0, demand / damping, False
    viscous = damping * speed
    at_peak = viscous * peak_slip + gain * peak_force
    at_slide = viscous * slide_slip + gain * slide_force
    rise = viscous * (slide_slip - peak_slip)
    drop = gain * (peak_force - slide_force)

    adheres, slides = demand <= at_peak, demand >= at_slide
    low, high = 0.0, 1.0
    # Between peak and sliding the right-hand side dips if its slope, least in the middle, does.
    dips = rise < 1.5 * drop
    if dips and not (slides if sliding else adheres):  # else the state is kept
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
    if adheres and not (dips and sliding):
        initial = peak_slip * slope
        bend = initial / peak_force - 2.0
        sigma = _adhesion_root(demand, viscous * peak_slip, initial, bend, gain)
        return adhesion_force(initial, bend, sigma), sigma * peak_slip * speed, False
    if slides and not (dips and not sliding):
        return slide_force, (demand - gain * slide_force) / damping, True
    sigma = _falling_root(demand, at_peak, rise, drop, low, high)
    slip = peak_slip + sigma * (slide_slip - peak_slip)
    return falling_force(peak_force, slide_force, sigma), slip * speed, sigma > 0.5


@lean
def curve_at(parameters: TMeasyParameters, load: float, friction: float) -> CurvePoint:
    """Return the curve at a load [N] and a friction factor [1]."""
    curve: CurvePoint = curve_at_load(parameters.coefficients, load, friction)
    return curve


@lean
def force_at(curve: CurvePoint, slip: float) -> tuple[float, float]:
    """Return force [N] and its derivative [N] at ``slip >= 0`` [1]."""
    slope, peak_slip, peak_force, slide_slip, slide_force = curve
    force = steady_force(slope, peak_slip, peak_force, slide_slip, slide_force, slip)
    if peak_force <= 0.0 or slip >= slide_slip:
        return force, 0.0
    if slip > peak_slip:
        width = slide_slip - peak_slip
        sigma = (slip - peak_slip) / width
        return force, -6.0 * (peak_force - slide_force) * sigma * (1.0 - sigma) / width
    sigma = slip / peak_slip
    denominator = 1.0 + sigma * (sigma + peak_slip * slope / peak_force - 2.0)
    return force, slope * (1.0 - sigma * sigma) / (denominator * denominator)


_FITTED = (
    "slope_1",
    "slope_2",
    "peak_slip_1",
    "peak_slip_2",
    "peak_force_1",
    "peak_force_2",
    "slide_slip_1",
    "slide_slip_2",
    "slide_force_1",
    "slide_force_2",
)


def _parameters(configuration: TMeasyConfiguration) -> TMeasyParameters:
    return TMeasyParameters(direction_coefficients(configuration))


def _fitted_parameters(values: FloatArray, largest_load: float) -> TMeasyParameters:
    # The attributes of a TMeasyCurve without its checks: a fit on its way may break them.
    nominal: Any = SimpleNamespace(**dict(zip(_FITTED, values.tolist(), strict=True)))
    return TMeasyParameters(curve_coefficients(nominal, 0.5 * largest_load, largest_load))


def _start(seen: Landmarks) -> FloatArray:
    pair = np.ones(2)
    return np.concatenate((seen.slope, seen.peak_slip, seen.peak_force, 2.5 * pair, 0.9 * pair))


def _values(unknowns: FloatArray) -> FloatArray:
    """Sliding slips and forces are fitted as ratios to those of the peak, which orders them."""
    values = np.copy(unknowns)
    values[6:8] *= values[2:4]
    values[8:10] *= values[4:6]
    return values


def _mapping(values: FloatArray, largest_load: float) -> dict[str, Any]:
    curve = {key: float(value) for key, value in zip(_FITTED, values, strict=True)}
    return {
        "nominal_load_1": 0.5 * float(largest_load),
        "nominal_load_2": float(largest_load),
        "x": curve,
        "y": dict(curve),
    }


MODEL = TireModel(
    description="Rill's TMeasy with the parameters of Table 1",
    configuration=TMeasyConfiguration,
    parameters_type=TMeasyParameters,
    curve_type=CurvePoint,
    parameters=_parameters,
    largest_load=lambda configuration: configuration.nominal_load_2,
    curve_at=curve_at,
    force_at=force_at,
    contact=contact,
    fit=FitRecipe(
        keys=tuple(f"x.{key}" for key in _FITTED),
        lower=(1e-9,) * 6 + (1.01,) * 2 + (0.05,) * 2,
        upper=(np.inf,) * 8 + (1.0,) * 2,
        loads=2,
        start=_start,
        values=_values,
        scale=lambda values, _: np.abs(values),
        parameters=_fitted_parameters,
        mapping=_mapping,
    ),
)
