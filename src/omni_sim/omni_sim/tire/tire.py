"""Tire of a vehicle: a selectable force-slip model with a spring and a damper.

Eq. (4) of the dissertation defines the spring and the damper. `tire.interface.configuration` has
the parameters, and `Tire` evaluates the steady characteristic for plots, fits and tests.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.interface.model import Curve, curve_at, flat_together, force_at
from omni_sim.tire.models import kernel_parameters


@lean
def steady_forces(
    parameters: Any,
    largest_load: float,
    slip: FloatArray,
    load: FloatArray,
    friction: FloatArray,
    force: FloatArray,
) -> None:
    """Compute the steady forces [N] of any model, with the sign of the slip.

    Args:
        parameters: constants of a model.
        largest_load: load to which higher loads are limited [N].
        slip: slips [1], shape (n,).
        load: wheel loads [N], shape (n,).
        friction: friction factor ``mu/mu_0`` [1], shape (n,).
        force: output, the forces [N], shape (n,).
    """
    for i in range(slip.size):
        curve = curve_at(parameters, min(max(load[i], 0.0), largest_load), friction[i])
        magnitude = force_at(curve, abs(slip[i]))[0]
        force[i] = magnitude if slip[i] >= 0.0 else -magnitude


class Tire:
    """Steady force of a tire as a function of slip, load and friction, for any tire model.

    Attributes:
        configuration: parameters of the tire.
    """

    def __init__(self, configuration: TireConfiguration) -> None:
        self.configuration = configuration
        self._parameters = kernel_parameters(configuration)

    def curve(self, load: float, friction: float = 1.0) -> Curve:
        """Return slope [N], peak and sliding force [N] and peak slip [1] at a load.

        Args:
            load: wheel load [N], clipped between 0 and the model's largest load.
            friction: friction factor ``mu/mu_0`` [1].
        """
        clamped = min(max(float(load), 0.0), self.configuration.largest_load)
        curve: Curve = curve_at(self._parameters, clamped, float(friction))
        return curve

    def force(self, slip: ArrayLike, load: ArrayLike, friction: ArrayLike = 1.0) -> FloatArray:
        """Return the steady force, with the sign of the slip.

        Args:
            slip: slip of any sign [1].
            load: wheel load [N], clipped between 0 and the model's largest load.
            friction: friction factor ``mu/mu_0`` [1].

        Returns:
            Force [N] in the common shape of the arguments.
        """
        shape, (slips, loads, grounds) = flat_together(slip, load, friction)
        force, largest = np.empty(slips.size), self.configuration.largest_load
        steady_forces(self._parameters, largest, slips, loads, grounds, force)
        return force.reshape(shape)
