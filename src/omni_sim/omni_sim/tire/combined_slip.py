"""Combined slip of the TMeasy tire: vector sum of longitudinal and lateral slip.

Source: the generalized slip in W. Hirschberg, G. Rill and H. Weinfurter, "Tire model TMeasy",
Vehicle System Dynamics 45(S), 2007, to which section 2.3.1 of the dissertation refers. The slips of
Eqs. (1), (2) are normalized by one factor for each direction and added as vectors,

    s = |(s_x / n_x, s_y / n_y)|,   q = (cos phi, sin phi) = (s_x / n_x, s_y / n_y) / s,

where ``s`` is the combined slip and ``phi`` its direction. One curve in the direction ``q`` gives
the force ``(F cos phi, F sin phi)``. The five numbers of this curve change smoothly with ``q`` from
the numbers of the longitudinal curve to the numbers of the lateral curve, so no further parameters
are needed. Along either axis, the result is exactly the curve of that axis. A friction factor
scales both curves and therefore the result.

Every other tire model has one curve that is used in all directions: the force is opposite to the
slip (`passive_parameters`, `curve_in_direction`).
"""

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import ArrayLike

from omni_core.kernels import lean
from omni_core.quantities import FloatArray, Pair
from omni_sim.tire.interface.configuration import TireConfiguration, TMeasyConfiguration
from omni_sim.tire.interface.model import flat_together
from omni_sim.tire.models import kernel_parameters, tmeasy
from omni_sim.tire.models.tmeasy import CurvePoint, TMeasyParameters


@lean
def slip_norms(x: CurvePoint, y: CurvePoint) -> Pair:
    """Return the factors ``n_x``, ``n_y`` that normalize the slips [1]; their sum is 2.

    Args:
        x: longitudinal curve.
        y: lateral curve.
    """
    if x.peak_force <= 0.0 or y.peak_force <= 0.0:
        return 1.0, 1.0
    peak = x.peak_slip + y.peak_slip
    knee_x, knee_y = x.peak_force / x.slope, y.peak_force / y.slope
    knee = knee_x + knee_y
    return x.peak_slip / peak + knee_x / knee, y.peak_slip / peak + knee_y / knee


@lean
def combined_curve(x: CurvePoint, y: CurvePoint, norms: Pair, q: Pair) -> CurvePoint:
    """Return the curve of force [N] over normalized slip [1] in a direction.

    Args:
        x: longitudinal curve.
        y: lateral curve.
        norms: normalizing factors from `slip_norms` [1].
        q: unit vector of the normalized slip [1].
    """
    c, s = abs(q[0]), abs(q[1])
    return tmeasy.curve_through(
        math.hypot(x.slope * norms[0] * c, y.slope * norms[1] * s),
        math.hypot(x.peak_slip / norms[0] * c, y.peak_slip / norms[1] * s),
        math.hypot(x.peak_force * c, y.peak_force * s),
        math.hypot(x.slide_slip / norms[0] * c, y.slide_slip / norms[1] * s),
        math.hypot(x.slide_force * c, y.slide_force * s),
    )


def combined_forces(
    tire: TMeasyConfiguration,
    slip_x: ArrayLike,
    slip_y: ArrayLike,
    load: ArrayLike,
    friction: ArrayLike = 1.0,
) -> FloatArray:
    """Return the steady forces of a tire under combined slip, with the signs of the slips.

    Args:
        tire: tire with the curves of both directions, as in Table 1.
        slip_x: longitudinal slip, Eq. (1) [1].
        slip_y: lateral slip, Eq. (2) [1].
        load: wheel load [N], clipped between 0 and the model's largest load.
        friction: friction factor ``mu/mu_0`` [1].

    Returns:
        Longitudinal and lateral forces [N]; their shape is the common shape of the arguments with
        an additional last axis of 2.
    """
    shape, flat = flat_together(slip_x, slip_y, load, friction)
    force = np.empty((flat[0].size, 2))
    x, y = (TMeasyParameters(tmeasy.direction_coefficients(tire, axis)) for axis in ("x", "y"))
    _combined_forces(x, y, tire.nominal_load_2, tuple(flat), force)
    return force.reshape((*shape, 2))


@lean
def _combined_forces(
    x: TMeasyParameters,
    y: TMeasyParameters,
    largest_load: float,
    contacts: tuple[FloatArray, ...],
    force: FloatArray,
) -> None:
    """Compute the steady forces of n wheels under combined slip.

    Args:
        x: constants of the longitudinal direction.
        y: constants of the lateral direction.
        largest_load: load to which higher loads are limited [N].
        contacts: longitudinal slip (1) [1], lateral slip (2) [1], wheel load [N] and ``mu/mu_0``
            [1], each of shape (n,).
        force: output, longitudinal and lateral forces [N], shape (n, 2).
    """
    slip_x, slip_y, load, friction = contacts
    for i in range(load.size):
        clamped = min(max(load[i], 0.0), largest_load)
        at_x = tmeasy.curve_at(x, clamped, friction[i])
        at_y = tmeasy.curve_at(y, clamped, friction[i])
        norms = slip_norms(at_x, at_y)
        along, across = slip_x[i] / norms[0], slip_y[i] / norms[1]
        slip, magnitude, q = math.hypot(along, across), 0.0, (0.0, 0.0)
        if slip > 0.0:
            q = along / slip, across / slip
            magnitude = tmeasy.force_at(combined_curve(at_x, at_y, norms, q), slip)[0]
        force[i] = magnitude * q[0], magnitude * q[1]


def passive_parameters(tire: TireConfiguration) -> Any:
    """Return the constants of a tire's model for the direction across the roller's axis.

    Args:
        tire: tire of the rollers.
    """
    if tire.model != "tmeasy":
        return kernel_parameters(tire)
    return TMeasyParameters(tmeasy.direction_coefficients(tire.tmeasy, "y"))


def curve_in_direction(active: Any, passive: Any, q: Pair) -> tuple[Any, Pair]:
    """Return the curve over normalized slip in a direction; also callable in kernels.

    Args:
        active: curve along the roller's axis, from `model.curve_at`.
        passive: curve across the roller's axis.
        q: unit vector of the normalized slip, active and passive component [1].

    Returns:
        Curve of the same model; factors that normalize the slips along both axes [1].
    """
    if isinstance(active, CurvePoint):
        norms = slip_norms(active, passive)
        return combined_curve(active, passive, norms, q), norms
    return active, (1.0, 1.0)


@overload(curve_in_direction)
def _compile_curve_in_direction(active, passive, q):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    if isinstance(active, types.BaseNamedTuple) and active.instance_class is CurvePoint:

        def combined(active, passive, q):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
            norms = slip_norms(active, passive)
            return combined_curve(active, passive, norms, q), norms

        return combined
    return lambda active, passive, q: (active, (1.0, 1.0))  # noqa: ARG005
