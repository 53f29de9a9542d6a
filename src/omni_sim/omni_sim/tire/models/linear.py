"""Linear tire: force proportional to slip and load, up to a limit proportional to load.

The force at a slip ``s`` and a load ``F_z`` is ``F(s) = min(stiffness s, friction mu/mu_0) F_z``,
with the two parameters of `LinearConfiguration` and the friction factor ``mu/mu_0`` of the ground.
The force does not fall beyond the peak, so the contact patch slides if and only if the force is at
its limit. A comparison with this simplest tire model shows the effects of the falling part and
of the load dependence of the other models.
"""

from typing import NamedTuple

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.tire.interface.configuration import LinearConfiguration
from omni_sim.tire.interface.model import FitRecipe, Landmarks, TireModel, plain_mapping


class LinearParameters(NamedTuple):
    """Constants of the kernels: slope at zero slip and largest force, each divided by the load."""

    stiffness: float
    friction: float


class LinearCurve(NamedTuple):
    """Force-slip curve of the linear tire at one load; see `model.Curve`."""

    slope: float
    peak_slip: float
    peak_force: float
    slide_force: float


@lean
def curve_at(parameters: LinearParameters, load: float, friction: float) -> LinearCurve:
    """Return the curve at a load [N] and a friction factor [1]."""
    slope = parameters.stiffness * load
    peak_force = parameters.friction * friction * load
    peak_slip = parameters.friction * friction / parameters.stiffness
    return LinearCurve(slope, peak_slip, peak_force, peak_force)


@lean
def force_at(curve: LinearCurve, slip: float) -> tuple[float, float]:
    """Return force [N] and its derivative [N] at ``slip >= 0`` [1]."""
    if slip < curve.peak_slip:
        return curve.slope * slip, curve.slope
    return curve.peak_force, 0.0


@lean
def contact(
    demand: float, damping: float, gain: float, speed: float, curve: LinearCurve, _sliding: bool
) -> tuple[float, float, bool]:
    """Solve the contact equation in closed form.

    Arguments and result are those of `tire.interface.model.contact_friction`.
    """
    if curve.peak_force <= 0.0:
        return 0.0, demand / damping, False
    slip = demand / (damping * speed + gain * curve.slope)
    if slip < curve.peak_slip:
        return curve.slope * slip, slip * speed, False
    return curve.peak_force, (demand - gain * curve.peak_force) / damping, True


def _parameters(configuration: LinearConfiguration) -> LinearParameters:
    return LinearParameters(configuration.stiffness, configuration.friction)


def _start(seen: Landmarks) -> FloatArray:
    return np.array([np.mean(seen.slope / seen.load), np.mean(seen.peak_force / seen.load)])


MODEL = TireModel(
    configuration=LinearConfiguration,
    parameters_type=LinearParameters,
    curve_type=LinearCurve,
    parameters=_parameters,
    curve_at=curve_at,
    force_at=force_at,
    contact=contact,
    fit=FitRecipe(
        keys=("stiffness", "friction"),
        lower=(0.0, 0.0),
        upper=(np.inf, np.inf),
        loads=1,
        start=_start,
        parameters=lambda values, _: LinearParameters(*(float(value) for value in values)),
        mapping=plain_mapping("stiffness", "friction"),
    ),
)
