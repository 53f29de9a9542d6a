"""The steady characteristic of the TMeasy tire: force over slip at a load and a friction.

See `tmeasy` for source and symbols. The kernels work on the positive side of one direction;
`TMeasy` wraps them for plots, fits and tests.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from omni_sim.tire.model import flat_together
from omni_sim.tire.tmeasy import TMeasyConfiguration, curve_coefficients

FloatArray = NDArray[np.float64]


class CurvePoint(NamedTuple):
    """A curve at one load and friction factor; slope and forces in [N], slips in [1]."""

    slope: float
    peak_slip: float
    peak_force: float
    slide_slip: float
    slide_force: float


@njit(cache=True, nogil=True, error_model="numpy")
def curve_at_load(coefficients: FloatArray, load: float, friction: float) -> CurvePoint:
    """Return ``(dF0, s_max, F_max, s_slide, F_slide)`` at a load, Eq. (3).

    The friction factor ``mu/mu_0`` scales forces and slips of peak and sliding, not the slope.

    Args:
        coefficients: from `curve_coefficients`, shape (10,).
        load: wheel load [N] from 0 to the largest permissible one.
        friction: ``mu/mu_0`` [1].
    """
    c = coefficients
    slope = (c[0] + c[1] * load) * load
    peak_force = (c[2] + c[3] * load) * load * friction
    slide_force = (c[4] + c[5] * load) * load * friction
    peak_slip = (c[6] + c[7] * load) * friction
    slide_slip = (c[8] + c[9] * load) * friction
    return CurvePoint(slope, peak_slip, peak_force, slide_slip, slide_force)


@njit(cache=True, nogil=True, error_model="numpy")
def adhesion_force(initial: float, bend: float, sigma: float) -> float:
    """Return the force [N] of the adhesion section, the rational first part of the curve.

    Args:
        initial: ``s_max dF0`` [N].
        bend: ``s_max dF0 / F_max - 2`` [1].
        sigma: slip over ``s_max`` [1], 0..1.
    """
    return initial * sigma / (1.0 + sigma * (sigma + bend))


@njit(cache=True, nogil=True, error_model="numpy")
def falling_force(peak_force: float, slide_force: float, sigma: float) -> float:
    """Return the force [N] between peak (``sigma = 0``) and full sliding (``sigma = 1``)."""
    return peak_force - (peak_force - slide_force) * sigma * sigma * (3.0 - 2.0 * sigma)


@njit(cache=True, nogil=True, error_model="numpy")
def steady_force(
    slope: float,
    peak_slip: float,
    peak_force: float,
    slide_slip: float,
    slide_force: float,
    slip: float,
) -> float:
    """Return the steady force [N] at ``slip >= 0`` [1] for a curve from `curve_at_load`."""
    if peak_force <= 0.0:
        return 0.0
    if slip >= slide_slip:
        return slide_force
    if slip > peak_slip:
        sigma = (slip - peak_slip) / (slide_slip - peak_slip)
        force: float = falling_force(peak_force, slide_force, sigma)
        return force
    initial = peak_slip * slope
    force = adhesion_force(initial, initial / peak_force - 2.0, slip / peak_slip)
    return force


@njit(cache=True, nogil=True, error_model="numpy")
def _steady_forces(
    coefficients: FloatArray,
    largest_load: float,
    slip: FloatArray,
    load: FloatArray,
    friction: FloatArray,
    force: FloatArray,
) -> None:
    for i in range(slip.size):
        clamped = min(max(load[i], 0.0), largest_load)
        slope, s_max, f_max, s_slide, f_slide = curve_at_load(coefficients, clamped, friction[i])
        magnitude = steady_force(slope, s_max, f_max, s_slide, f_slide, abs(slip[i]))
        force[i] = magnitude if slip[i] >= 0.0 else -magnitude


class TMeasy:
    """The steady characteristic of a tire, for plots, fits and tests.

    Attributes:
        configuration: the tire.
    """

    def __init__(self, configuration: TMeasyConfiguration) -> None:
        self.configuration = configuration
        loads = configuration.nominal_load_1, configuration.nominal_load_2
        self._coefficients = {
            "x": curve_coefficients(configuration.x, *loads),
            "y": curve_coefficients(configuration.y, *loads),
        }

    def overloaded(self, load: ArrayLike) -> NDArray[np.bool_]:
        """Tell where a load [N] lies beyond the model, so that it is clamped; any shape."""
        beyond: NDArray[np.bool_] = np.asarray(load) > self.configuration.nominal_load_2
        return beyond

    def curve(self, load: float, friction: float = 1.0, direction: str = "x") -> CurvePoint:
        """Return the five numbers of a direction at a load, Eq. (3).

        Args:
            load: wheel load [N], clamped to the model's range.
            friction: ``mu/mu_0`` [1].
            direction: ``x`` or ``y``.
        """
        clamped = min(max(load, 0.0), self.configuration.nominal_load_2)
        curve: CurvePoint = curve_at_load(self._coefficients[direction], clamped, friction)
        return curve

    def force(
        self,
        slip: ArrayLike,
        load: ArrayLike,
        friction: ArrayLike = 1.0,
        direction: str = "x",
    ) -> FloatArray:
        """Return the steady force, with the sign of the slip.

        Args:
            slip: [1], any sign.
            load: wheel load [N], clamped to the model's range.
            friction: ``mu/mu_0`` [1].
            direction: ``x`` or ``y``.

        Returns:
            Force [N] in the common shape of the arguments.
        """
        shape, flat = flat_together(slip, load, friction)
        force = np.empty(flat[0].size)
        _steady_forces(
            self._coefficients[direction], self.configuration.nominal_load_2, *flat, force
        )
        return force.reshape(shape)
