"""The Magic Formula with load-dependent peak and stiffness.

Source: E. Bakker, H. B. Pacejka and L. Lidner, "A new tire model with an application in vehicle
dynamics studies", SAE 890087, 1989. The force as a function of slip is

    F = D sin(C atan(x - E (x - atan x))),  x = B s

The peak is ``D = mu(F_z) F_z`` with ``mu = a_1 F_z + a_2``. The slope at zero slip is the parabola
``B C D = (a_3 F_z + a_4) F_z``. Slip is dimensionless and loads are in [N]. The original formula
uses per cent and [kN]. Its slope ``(a_3 F_z + a_4) F_z exp(-a_5 F_z)`` is approximated by the
parabola at small loads. The shape ``C`` and the curvature ``E`` do not depend on the load, so the
values of ``x`` at the peak and at the steepest fall are constants. Shifts of the origin are
omitted, so that a freely rolling wheel has no force.

A friction factor scales ``D``. Since ``B C D`` is preserved, ``B`` scales inversely, and the slips
scale like ``D``.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.tire.interface.configuration import (
    CURVATURE_RANGE,
    SHAPE_RANGE,
    MagicFormulaConfiguration,
)
from omni_sim.tire.interface.contact import solve_contact
from omni_sim.tire.interface.model import FitRecipe, Landmarks, TireModel, plain_mapping

_KEYS = ("friction", "friction_gradient", "stiffness", "stiffness_gradient", "shape", "curvature")


class MagicFormulaParameters(NamedTuple):
    """Constants of the kernels: a_1 to a_4, C, E, and properties of the curve ``y(x)``.

    This curve is the force divided by its peak, ``y = F / D``, over the scaled slip ``x = B s``.
    ``peak`` is the ``x`` of the peak. ``steepest`` is the ``x`` beyond the peak at which the curve
    falls most steeply, and ``fall`` is ``-dy/dx`` there. ``slide`` is ``y`` at unlimited slip.
    """

    friction: float
    friction_gradient: float
    stiffness: float
    stiffness_gradient: float
    shape: float
    curvature: float
    peak: float
    steepest: float
    fall: float
    slide: float


class MagicFormulaCurve(NamedTuple):
    """Magic Formula curve at one load; see `model.Curve` and `contact.solve_contact`.

    ``scale`` is B [1], ``shape`` C and ``curvature`` E.
    """

    slope: float
    peak_slip: float
    peak_force: float
    slide_force: float
    steepest_slip: float
    steepest_fall: float
    scale: float
    shape: float
    curvature: float


@lean
def unit_curve(shape: float, curvature: float, x: float) -> tuple[float, float]:
    """Return the force divided by its peak, ``F / D``, and the derivative of this ratio [1].

    Args:
        shape: shape C [1].
        curvature: curvature E [1].
        x: scaled slip ``B s`` [1], with respect to which the derivative is taken.
    """
    bend = math.atan(x)
    inner = x - curvature * (x - bend)
    angle = shape * math.atan(inner)
    inner_gradient = 1.0 - curvature * (x * x / (1.0 + x * x))
    return math.sin(angle), math.cos(angle) * shape * inner_gradient / (1.0 + inner * inner)


@lean
def curve_at(parameters: MagicFormulaParameters, load: float, friction: float) -> MagicFormulaCurve:
    """Return the curve at a load [N] and a friction factor [1]."""
    p = parameters
    peak_force = (p.friction + p.friction_gradient * load) * load * friction
    slope = (p.stiffness + p.stiffness_gradient * load) * load
    # The load is canceled in B, which would otherwise be 0 / 0 for an unloaded wheel.
    scale = (p.stiffness + p.stiffness_gradient * load) / (
        p.shape * (p.friction + p.friction_gradient * load) * friction
    )
    peak, slide = p.peak / scale, p.slide * peak_force
    steepest, fall = p.steepest / scale, p.fall * scale * peak_force
    return MagicFormulaCurve(
        slope, peak, peak_force, slide, steepest, fall, scale, p.shape, p.curvature
    )


@lean
def force_at(curve: MagicFormulaCurve, slip: float) -> tuple[float, float]:
    """Return force [N] and its derivative [N] at ``slip >= 0`` [1]."""
    if curve.peak_force <= 0.0:
        return 0.0, 0.0
    height, gradient = unit_curve(curve.shape, curve.curvature, curve.scale * slip)
    return curve.peak_force * height, curve.peak_force * curve.scale * gradient


def constants(*given: float) -> MagicFormulaParameters:
    """Return the constants of the kernels for the parameters of the formula.

    Args:
        *given: a_2 [1], a_1 [1/N], a_4 [1], a_3 [1/N], C [1] and E [1], in the order of `_KEYS`.
    """
    shape, curvature = given[4:]
    # The sine has its peak where its argument is a right angle.
    peak = _solve(curvature, math.tan(0.5 * math.pi / shape))

    def fall(logarithm: float) -> float:
        return -float(unit_curve(shape, curvature, math.exp(logarithm))[1])

    # Beyond the peak the slope has a single minimum: golden-section search on log x.
    low, high = math.log(peak), math.log(peak) + 12.0
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(80):
        left, right = high - ratio * (high - low), low + ratio * (high - low)
        if fall(left) > fall(right):
            high = right
        else:
            low = left
    steepest = 0.5 * (low + high)
    slide = math.sin(0.5 * math.pi * shape)
    found = peak, math.exp(steepest), fall(steepest), slide
    return MagicFormulaParameters._make((*given, *found))


def _solve(curvature: float, place: float) -> float:
    """Return the ``x`` at which ``x - E (x - atan x)`` equals `place` [1], with E = `curvature`."""
    low, high = 0.0, 1.0
    while high - curvature * (high - math.atan(high)) < place:
        high *= 2.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle - curvature * (middle - math.atan(middle)) < place:
            low = middle
        else:
            high = middle
    return high


def _parameters(configuration: MagicFormulaConfiguration) -> MagicFormulaParameters:
    return constants(*(getattr(configuration, key) for key in _KEYS))


def _start(seen: Landmarks) -> FloatArray:
    values = []
    for share in (seen.peak_force / seen.load, seen.slope / seen.load):
        gradient = (share[1] - share[0]) / (seen.load[1] - seen.load[0])
        values += [max(share[0] - gradient * seen.load[0], 0.1 * share[0]), gradient]
    # Curvature with which the peak is at its measured slip, for a shape in the middle of the range.
    shape = 1.4
    x = seen.slope[1] / (shape * seen.peak_force[1]) * seen.peak_slip[1]
    curvature = (x - math.tan(0.5 * math.pi / shape)) / (x - math.atan(x))
    return np.array([*values, shape, np.clip(curvature, -10.0, 0.9)])


def _scale(values: FloatArray, largest_load: float) -> FloatArray:
    friction, stiffness = values[0], values[2]
    return np.array(
        [friction, friction / largest_load, stiffness, stiffness / largest_load, 1.0, 2.0]
    )


MODEL = TireModel(
    configuration=MagicFormulaConfiguration,
    parameters_type=MagicFormulaParameters,
    curve_type=MagicFormulaCurve,
    parameters=_parameters,
    curve_at=curve_at,
    force_at=force_at,
    contact=solve_contact,
    fit=FitRecipe(
        keys=_KEYS,
        lower=(1e-3, -np.inf, 1e-3, -np.inf, SHAPE_RANGE[0], CURVATURE_RANGE[0]),
        upper=(np.inf, np.inf, np.inf, np.inf, SHAPE_RANGE[1], CURVATURE_RANGE[1]),
        loads=2,
        start=_start,
        scale=_scale,
        parameters=lambda values, _: constants(*(float(value) for value in values)),
        mapping=plain_mapping(*_KEYS),
    ),
)
