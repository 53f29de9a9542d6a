"""Tire forces of a roller along and across the roller's axis, for every tire model.

TMeasy has a curve for each of the two directions, which `combined_slip` combines. Every other model
has one curve that is used in all directions: the force is opposite to the slip.
"""

from typing import Any

from numba import types
from numba.extending import overload

from omni_platform.quantities import Pair
from omni_sim.tire.combined_slip import combined_curve, slip_norms
from omni_sim.tire.models.tmeasy import CurvePoint, TMeasyParameters, direction_coefficients
from omni_sim.tire.tire import TireConfiguration


def passive_parameters(tire: TireConfiguration) -> Any:
    """Return the constants of a tire's model for the direction across the roller's axis.

    Args:
        tire: tire of the rollers.
    """
    if tire.model != "tmeasy":
        return tire.kernel_parameters
    return TMeasyParameters(direction_coefficients(tire.tmeasy, "y"))


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
