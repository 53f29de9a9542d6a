"""Least-squares fit of a tire model to measured forces.

The unknowns of the model's `FitRecipe` minimize the sum of squared force differences. With n rows,
P unknowns and the Jacobian ``J`` at the minimum, the covariance of the unknowns is ``s^2 (J^T
J)^-1``, where ``s^2`` is the sum of squares divided by ``n - P``. The standard errors of the values
follow by linear propagation. They are valid if the residuals are independent, of equal variance,
and small enough for linear propagation. An unknown that ends at a bound counts as fixed.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from omni_core.configuration import ConfigurationError, WorkError, from_mapping
from omni_core.quantities import BoolArray, FloatArray
from omni_runs.figures import style
from omni_runs.figures.units import readable_unit, unit_of
from omni_sim.tire.interface.configuration import LARGEST_FORCE, LOAD_RANGE, TireConfiguration
from omni_sim.tire.interface.model import FitRecipe, Landmarks
from omni_sim.tire.models import MODELS
from omni_sim.tire.tire import Tire, steady_forces
from omni_tools.tires.data import TireData, TireDataError

# The slip at the peak is the least certain initial value, so a search starts from each of these
# multiples of it.
_PEAK_GUESSES = (1.0, 0.6, 1.7)
_RANGES = {"load": LOAD_RANGE, "force": (1.0e-3, LARGEST_FORCE)}
"""Permitted range of the largest magnitude in each column of the data [N], keyed by column."""


class TireFit(NamedTuple):
    """A tire model fitted to measured forces, with P fitted values.

    Attributes:
        tire: tire with the fitted model; stiffness and damping are not determined by steady data.
        keys: dotted keys of the fitted values in the configuration of the model.
        values: fitted values in the units of their keys, shape (P,).
        standard_errors: standard errors of `values`, shape (P,).
        at_bound: whether each unknown ended at a bound of the search, shape (P,); its standard
            error is then undefined.
        residual: standard deviation of the force residuals with n - P degrees of freedom [N].
        mapping: the fitted values, nested as in the tire's configuration.
    """

    tire: TireConfiguration
    keys: tuple[str, ...]
    values: FloatArray
    standard_errors: FloatArray
    at_bound: BoolArray
    residual: float
    mapping: dict[str, Any]

    def unit(self, key: str) -> str:
        """Return the unit of a parameter of the model with this dotted key."""
        return unit_of(MODELS[self.tire.model].configuration, key)


def fit_tire(data: TireData, model: str) -> TireFit:
    """Fit a tire model to measured forces.

    Args:
        data: measured forces.
        model: one of `MODELS`.

    Raises:
        TireDataError: the data are too few or too similar to each other.
        WorkError: the data do not determine the model; the message states what is missing.
    """
    recipe = MODELS[model].fit
    largest_load = float(np.max(data.load)) if data.load.size else 0.0
    _require_excitation(data, model, recipe)
    found = _search(data, recipe, largest_load)
    residual = float(np.sqrt(2.0 * found.cost / (data.slip.size - len(recipe.keys))))
    _require_description(data, model, residual)
    at_bound = _at_bound(found.x, recipe)
    errors = _standard_errors(found.x, found.jac, at_bound, residual, recipe, largest_load)
    values = recipe.values(found.x)
    mapping = {"model": model, model: recipe.mapping(values, largest_load)}
    try:
        tire = from_mapping(TireConfiguration, mapping)
    except ConfigurationError as error:
        raise WorkError(f"the fit is not a valid tire of this model: {error}") from None
    _require_peak(data, tire)
    return TireFit(tire, recipe.keys, values, errors, at_bound, residual, mapping)


def _require_excitation(data: TireData, model: str, recipe: FitRecipe, spread: float = 0.2) -> None:
    """Check that the data are within their ranges and suffice for a fit.

    There must be enough rows, and loads that differ enough if the model depends on the load.

    Args:
        data: measured forces.
        model: name of the tire model.
        recipe: unknowns of the model.
        spread: required difference between the loads, relative to the largest load [1].

    Raises:
        TireDataError: the data do not suffice.
    """
    needed = 2 * len(recipe.keys)
    if data.slip.size < needed:
        raise TireDataError(
            f"{data.slip.size} rows are too few: {model} has {len(recipe.keys)} parameters and "
            f"needs at least {needed} rows"
        )
    if np.sum(data.slip * data.force) <= 0.0:
        raise TireDataError(
            "the force does not grow with the slip; it must have the sign of the slip"
        )
    for name, (least, most) in _RANGES.items():
        largest = float(np.max(np.abs(getattr(data, name))))
        if not least <= largest <= most:
            raise TireDataError(
                f"the largest {name} is {largest:g} N, must be {least:g} to {most:g} N"
            )
    low, high = float(np.min(data.load)), float(np.max(data.load))
    if recipe.loads > 1 and high - low < spread * high:
        raise TireDataError(
            f"loads from {low:g} to {high:g} N are too similar: {model} depends on it and "
            f"needs loads that differ by at least {spread:.0%} of the largest"
        )


def _search(data: TireData, recipe: FitRecipe, largest_load: float) -> Any:
    """Return SciPy's result for the best of several searches with different initial values."""
    # Imported here, because only fits need this slow import.
    from scipy.optimize import least_squares

    force = np.empty_like(data.force)
    ones = np.ones_like(data.force)
    size = float(np.max(np.abs(data.force)))

    def differences(unknowns: FloatArray) -> FloatArray:
        parameters = recipe.parameters(recipe.values(unknowns), largest_load)
        steady_forces(parameters, largest_load, data.slip, data.load, ones, force)
        return (force - data.force) / size

    seen = _landmarks(data, largest_load)
    lower, upper = np.array(recipe.lower), np.array(recipe.upper)

    def from_peak(guess: float) -> Any:
        start = recipe.start(seen._replace(peak_slip=guess * seen.peak_slip))
        inside = np.clip(start, lower + 1e-6 * np.abs(start), upper - 1e-6 * np.abs(start))
        scale = np.maximum(np.abs(recipe.scale(inside, largest_load)), 1e-12)
        limits = {"bounds": (lower, upper), "x_scale": scale, "max_nfev": 400}
        tolerances = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-12)
        return least_squares(differences, inside, jac="3-point", **limits, **tolerances)

    best = min(map(from_peak, _PEAK_GUESSES), key=lambda found: float(found.cost))
    best.cost *= size**2
    best.jac *= size
    return best


def _landmarks(data: TireData, largest_load: float) -> Landmarks:
    """Return slope and peak of the force curves at two loads: the largest load, and half of it.

    Slope and peak are estimated from the data with smaller loads and from the data with larger
    loads. They are then interpolated or extrapolated to the two loads.

    Args:
        data: measured forces.
        largest_load: largest load in the data [N].
    """
    middle = 0.5 * (float(np.min(data.load)) + float(np.max(data.load)))
    heavy = data.load >= middle
    halves = [half for half in (~heavy, heavy) if np.count_nonzero(half) >= 3]
    seen = np.array([_slope_and_peak(data, half) for half in halves])
    load = np.array([0.5 * largest_load, largest_load])
    at = np.array([np.interp(load, seen[:, 0], column) for column in seen[:, 1:].T])
    if len(seen) > 1:  # extrapolate linearly beyond the two mean loads
        gradient = (seen[1, 1:] - seen[0, 1:]) / (seen[1, 0] - seen[0, 0])
        line = seen[0, 1:, np.newaxis] + gradient[:, np.newaxis] * (load - seen[0, 0])
        at = np.maximum(line, 0.3 * at)
    return Landmarks(load, at[0] * load, at[1] * load, at[2])


def _slope_and_peak(data: TireData, rows: BoolArray) -> tuple[float, float, float, float]:
    """Return mean load [N], slope and peak of force / load [1], and slip at the peak [1]."""
    slip, share = np.abs(data.slip[rows]), np.abs(data.force[rows]) / data.load[rows]
    order = np.argsort(slip, kind="stable")
    bins = np.array_split(order, min(30, max(3, len(order) // 3)))
    place = np.array([np.median(slip[b]) for b in bins])
    height = np.array([np.median(share[b]) for b in bins])
    peak = float(np.max(height))
    peak_slip = max(float(place[np.argmax(height >= 0.97 * peak)]), 1e-6)
    small = (share < 0.6 * peak) & (slip <= peak_slip)
    square = float(np.sum(slip[small] ** 2))
    slope = float(np.sum(share[small] * slip[small])) / square if square > 0.0 else 0.0
    slope = max(slope, 1.2 * peak / peak_slip)
    return float(np.mean(data.load[rows])), slope, max(peak, 1e-9), peak_slip


def _require_description(data: TireData, model: str, residual: float, largest: float = 0.5) -> None:
    """Raise `WorkError` if the residual [N] exceeds the share `largest` of the RMS force."""
    size = float(np.sqrt(np.mean(data.force**2)))
    if residual > largest * size:
        raise WorkError(
            f"{model} does not describe the data: the differences of {residual:.3g} N are more "
            f"than {largest:.0%} of the force of {size:.3g} N (root mean squares)"
        )


def _require_peak(data: TireData, configuration: TireConfiguration) -> None:
    """Raise `WorkError` if the slip at the peak of the fit exceeds the measured slips."""
    heavy = data.load >= 0.5 * (np.min(data.load) + np.max(data.load))
    peak = Tire(configuration).curve(float(np.mean(data.load[heavy]))).peak_slip
    largest = float(np.max(np.abs(data.slip[heavy])))
    if peak > largest:
        raise WorkError(
            f"the slip reaches {largest:.3g} and the largest force seems to be at {peak:.3g}: "
            "measure beyond the peak"
        )


def _at_bound(unknowns: FloatArray, recipe: FitRecipe) -> BoolArray:
    lower, upper = np.array(recipe.lower), np.array(recipe.upper)
    margin = 1e-4 * np.maximum(np.abs(unknowns), 1e-9)
    return np.asarray((unknowns - lower < margin) | (upper - unknowns < margin))


def _standard_errors(
    unknowns: FloatArray,
    jacobian: FloatArray,
    at_bound: BoolArray,
    residual: float,
    recipe: FitRecipe,
    largest_load: float,
    largest_error: float = 0.5,
) -> FloatArray:
    """Return the standard errors of the values, shape (P,).

    Raises:
        WorkError: an error exceeds `largest_error` times the magnitude of its value.
    """
    free = np.flatnonzero(~at_bound)
    size = np.maximum(np.abs(recipe.scale(unknowns, largest_load))[free], 1e-300)
    _, singular, directions = np.linalg.svd(jacobian[:, free] * size, full_matrices=False)
    spread = directions.T / np.maximum(singular, 1e-12 * singular[0]) * residual
    covariance = (spread @ spread.T) * np.outer(size, size)
    # Derivatives of the values with respect to the unknowns.
    gradient = np.empty((len(unknowns), len(free)))
    for column, (k, step) in enumerate(zip(free, 1e-6 * size, strict=True)):
        shift = np.zeros_like(unknowns)
        shift[k] = step
        ahead, behind = recipe.values(unknowns + shift), recipe.values(unknowns - shift)
        gradient[:, column] = (ahead - behind) / (2.0 * step)
    errors = np.sqrt(np.einsum("ij,jk,ik->i", gradient, covariance, gradient))
    sizes = recipe.scale(recipe.values(unknowns), largest_load)
    vague = errors > largest_error * np.abs(sizes)
    if np.any(vague):
        keys = ", ".join(itertools.compress(recipe.keys, vague))
        raise WorkError(
            f"the data do not determine {keys}: measure from small slips to well beyond the peak, "
            "at every load, or use a model with fewer parameters"
        )
    return np.asarray(errors, dtype=np.float64)


def fit_figure(data: TireData, fit: TireFit, title: str, curves: int = 4) -> Figure:
    """Draw the measured forces with the fitted curves, and the residuals below.

    Each point has the color of the curve at the nearest load.

    Args:
        data: measured forces.
        fit: fit of the data.
        title: title of the figure.
        curves: limit on the number of loads for which a curve is drawn.
    """
    unit, factor = readable_unit("N", data.force)
    y = (f"Force F [{unit}]", "Data - model [N]")
    figure, ((upper,), (lower,)) = style.panels(
        title, 2, size=(9.0, 6.6), x="Slip s [1]", y=y, sharex=True, height_ratios=(3.0, 1.0)
    )
    tire = Tire(fit.tire)
    loads = np.unique(data.load)
    if len(loads) > curves:
        loads = np.quantile(data.load, (np.arange(curves) + 0.5) / curves)
    nearest = np.argmin(np.abs(data.load[:, np.newaxis] - loads), axis=1)
    slip = np.linspace(min(0.0, float(np.min(data.slip))), max(0.0, float(np.max(data.slip))), 800)
    left = data.force - tire.force(data.slip, data.load)
    dot = {"marker": "o", "linestyle": "none", "markersize": 3.0, "alpha": 0.55}
    for index, load in enumerate(loads):
        color, rows = style.wheel_color(index), nearest == index
        upper.plot(data.slip[rows], factor * data.force[rows], color=color, **dot)
        lower.plot(data.slip[rows], left[rows], color=color, **dot)
        label = f"$F_z$ = {factor * load:.3g} {unit}"
        upper.plot(slip, factor * tire.force(slip, load), color=color, label=label)
    lower.axhline(0.0, color=style.BLACK, linewidth=1.0)
    upper.legend(loc="lower right")
    return figure
