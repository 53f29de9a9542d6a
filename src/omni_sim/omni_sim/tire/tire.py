"""Tire of a vehicle: a selectable force-slip model with a spring and a damper.

Eq. (4) of the dissertation defines the spring and the damper. `TireConfiguration` contains the
parameters common to all models, the name of the chosen model, and for each model a section with the
model's name and parameters. Only the section of the chosen model is used. `Tire` evaluates the
steady characteristic for plots, fits and tests.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omni_core.configuration import Configuration, parameter, section
from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.tire.interface.model import Curve, TireModel, curve_at, flat_together, force_at
from omni_sim.tire.models import MODELS

# One field for each model in the folder.
_KINDS = {"model": str, **{name: model.configuration for name, model in MODELS.items()}}
_ModelFields: Any = type(
    "_ModelFields",
    (Configuration,),
    {
        "__module__": __name__,
        "__doc__": "The parameters of every model.",
        "__annotations__": _KINDS,
        **{n: section(one.configuration, description=one.description) for n, one in MODELS.items()},
    },
)


class TireConfiguration(_ModelFields):
    """Parameters of a vehicle's tire, by default TMeasy with the values of Table 1.

    Sections of models that are not chosen are ignored.
    """

    model: str = parameter("tmeasy", choices=tuple(MODELS))
    """Tire model; its parameters are in the section of the same name"""
    stiffness: float = parameter(2.0e5, unit="N/m", minimum=1.0e3, maximum=1.0e8)
    """Stiffness c_x of the tire against horizontal deflection"""
    damping: float = parameter(5000.0, unit="N s/m", minimum=0.0, maximum=1.0e7)
    """Damping d_x of the horizontal deflection"""
    vertical_stiffness: float = parameter(1.0e6, unit="N/m", minimum=1.0e4, maximum=1.0e9)
    """Vertical stiffness c_z, which determines the dynamic rolling radius"""
    slip_speed: float = parameter(1.0e-6, unit="m/s", minimum=1.0e-9, maximum=0.1)
    """Speed v_num in the denominator of the slip, which keeps the slip of a locked wheel finite"""

    @property
    def tire_model(self) -> TireModel:
        """Tire model that the parameter `model` selects."""
        return MODELS[self.model]

    @property
    def model_parameters(self) -> Configuration:
        """Parameters of the selected model."""
        parameters: Configuration = getattr(self, self.model)
        return parameters

    @property
    def kernel_parameters(self) -> Any:
        """Constants of the chosen model for kernels, a NamedTuple of the model."""
        return self.tire_model.parameters(self.model_parameters)

    @property
    def largest_load(self) -> float:
        """Largest load for which the chosen model is valid [N]."""
        return float(self.tire_model.largest_load(self.model_parameters))


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
        self._parameters = configuration.kernel_parameters

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
