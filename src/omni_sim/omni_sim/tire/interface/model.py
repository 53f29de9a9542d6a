"""Interface of tire models, which compute the force from slip, load and friction in kernels.

A model is one file in `tire.models` that defines ``MODEL``, a `TireModel`. It has one NamedTuple
for its constants and one for its curve at a given load. Kernels call `curve_at`, `force_at` and
`contact_friction` of this module. During compilation, numba selects the functions of a model by the
types of these tuples. The kernel of a vehicle is therefore compiled and cached once for each model,
and the selection takes no time in a step.

The force of every model is odd in the slip, rises from zero with a finite slope to a single peak,
and beyond it stays constant or falls. A friction factor ``mu/mu_0`` scales forces and slips of the
curve and preserves the slope at zero: ``F(s; mu) = mu F(s / mu; 1)``.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import ArrayLike

from omni_core.configuration import Configuration
from omni_core.quantities import FloatArray


class Curve(Protocol):
    """Properties of the force-slip curve of any tire model: slope and forces [N], slip [1]."""

    @property
    def slope(self) -> float:
        """Slope ``dF/ds`` of the force at zero slip [N]."""

    @property
    def peak_slip(self) -> float:
        """Smallest slip at which the force is largest [1]."""

    @property
    def peak_force(self) -> float:
        """Largest force [N]."""

    @property
    def slide_force(self) -> float:
        """Force at unlimited slip [N]."""


class Landmarks(NamedTuple):
    """Properties of measured curves at two loads, from which a fit starts; each has shape (2,).

    Attributes:
        load: half of the largest load in the data, and the largest load [N].
        slope: slope at zero slip [N].
        peak_force: largest force [N].
        peak_slip: slip at the largest force [1].
    """

    load: FloatArray
    slope: FloatArray
    peak_force: FloatArray
    peak_slip: FloatArray


@dataclasses.dataclass(frozen=True)
class FitRecipe:
    """Description of how a model is fitted to measured forces with P bounded unknowns.

    Attributes:
        keys: dotted keys of the P values in the model's configuration.
        lower: lower bounds of the unknowns, shape (P,).
        upper: upper bounds of the unknowns, shape (P,).
        loads: number of distinct loads that the fit requires.
        start: function that returns the initial unknowns, shape (P,), from `Landmarks`.
        parameters: function that returns the constants of the kernels. Its arguments are the values
            of `keys`, shape (P,), and the largest load in the data [N].
        mapping: function that returns the model's configuration as nested mappings; its arguments
            are those of `parameters`.
        values: function that converts unknowns, shape (P, ...), to the values of `keys`. An unknown
            may be the ratio of two values, so that one value stays below the other.
        scale: function that returns the typical magnitudes of the values, shape (P,), with which
            standard errors are compared; its arguments are those of `parameters`.
    """

    keys: tuple[str, ...]
    lower: Sequence[float]
    upper: Sequence[float]
    loads: int
    start: Callable[[Landmarks], FloatArray]
    parameters: Callable[[FloatArray, float], Any]
    mapping: Callable[[FloatArray, float], dict[str, Any]]
    values: Callable[[FloatArray], FloatArray] = np.copy
    scale: Callable[[FloatArray, float], FloatArray] = lambda values, _: np.abs(values)


@dataclasses.dataclass(frozen=True)
class TireModel:
    """A tire model: its configuration, and its functions for kernels and fits.

    Attributes:
        configuration: class of the parameters; each parameter has a default.
        parameters_type: class of the constants in kernels, a NamedTuple.
        curve_type: class of the curve at one load, a NamedTuple with the fields of `Curve`.
        parameters: function that returns the constants for a configuration.
        curve_at: kernel ``(constants, load [N], mu/mu_0) -> curve``.
        force_at: kernel ``(curve, slip >= 0) -> (F [N], dF/ds [N])``.
        contact: kernel with the arguments of `contact_friction`; `contact.solve_contact` is
            suitable for every model whose curve also has ``steepest_slip`` and ``steepest_fall``.
        fit: description of the fit to measurements.
    """

    configuration: type[Configuration]
    parameters_type: type
    curve_type: type
    parameters: Callable[[Any], Any]
    curve_at: Callable[[Any, float, float], Any]
    force_at: Callable[[Any, float], tuple[float, float]]
    contact: Callable[[float, float, float, float, Any, bool], tuple[float, float, bool]]
    fit: FitRecipe


def plain_mapping(*keys: str) -> Callable[[FloatArray, float], dict[str, Any]]:
    """Return a `FitRecipe.mapping` for a model with one number for each key.

    Args:
        *keys: names of the fitted parameters; the model also has the parameter ``largest_load``.
    """
    return lambda values, largest_load: {
        "largest_load": float(largest_load),
        **dict(zip(keys, values.tolist(), strict=True)),
    }


_MODEL_OF: dict[type, TireModel] = {}


def register(model: TireModel) -> TireModel:
    """Make a model usable in the functions of this module, such as `curve_at`, and return it."""
    _MODEL_OF[model.parameters_type] = _MODEL_OF[model.curve_type] = model
    return model


def curve_at(parameters: Any, load: float, friction: float) -> Any:
    """Return the curve of a model at a load and a friction factor; also callable in kernels.

    Args:
        parameters: constants of a model.
        load: wheel load [N], between 0 and the model's largest load.
        friction: friction factor ``mu/mu_0`` [1].
    """
    return _model_of(type(parameters)).curve_at(parameters, load, friction)


def _model_of(kind: type) -> TireModel:
    try:
        return _MODEL_OF[kind]
    except KeyError:
        raise TypeError(f"{kind!r} belongs to no tire model") from None


def force_at(curve: Any, slip: float) -> tuple[float, float]:
    """Return the force [N] and its slope dF/ds [N] at ``slip >= 0``; also callable in kernels."""
    return _model_of(type(curve)).force_at(curve, slip)


def contact_friction(
    demand: float, damping: float, gain: float, speed: float, curve: Any, sliding: bool
) -> tuple[float, float, bool]:
    """Solve ``demand = damping w + gain F(w / speed)`` for the sliding speed ``w``.

    Also callable in kernels; `wheel.single` derives the equation.

    Args:
        demand: ``|A|``, magnitude of the force that a sticking patch would need [N].
        damping: ``D = d + c dt``, damping of the tire plus stiffness times the length of a step [N
            s/m].
        gain: ``kappa = 1 + D m`` with the mobility ``m`` of wheel and vehicle [1].
        speed: ``V = r_D |omega| + v_num``, denominator of the slip [m/s].
        curve: curve from `curve_at`.
        sliding: whether the patch slid in the previous step.

    Returns:
        Force ``F`` [N], sliding speed ``w`` of the patch [m/s], and whether the patch slides now.
    """
    return _model_of(type(curve)).contact(demand, damping, gain, speed, curve, sliding)


def flat_together(*values: ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
    """Return the common shape of the arguments, and the broadcast arguments, flattened."""
    common = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in values))
    return common[0].shape, [np.ascontiguousarray(array).ravel() for array in common]


# The lambdas are needed because numba accepts only Python functions here, not kernels.
@overload(curve_at)
def _compile_curve_at(parameters, load, friction):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    kernel = _model_of(_type_of(parameters)).curve_at
    return lambda parameters, load, friction: kernel(parameters, load, friction)  # noqa: PLW0108


def _type_of(numba_type: types.Type) -> type:
    kind: type = getattr(numba_type, "instance_class", type(numba_type))
    return kind


@overload(force_at)
def _compile_force_at(curve, slip):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    kernel = _model_of(_type_of(curve)).force_at
    return lambda curve, slip: kernel(curve, slip)  # noqa: PLW0108


@overload(contact_friction)
def _compile_contact(demand, damping, gain, speed, curve, sliding):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    kernel = _model_of(_type_of(curve)).contact
    return lambda demand, damping, gain, speed, curve, sliding: kernel(  # noqa: PLW0108
        demand, damping, gain, speed, curve, sliding
    )
