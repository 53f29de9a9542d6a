"""The TMeasy tire: its parameters, how they depend on the wheel load, and the curve they span.

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 2.3.1 with Table 1 and Eqs. (1)-(4), after W. Hirschberg, G. Rill and H. Weinfurter,
"Tire model TMeasy", Vehicle System Dynamics 45(S), 2007.

A direction of the tire is five numbers: the slope ``dF0`` at zero slip [N], the slip ``s_max`` [1]
and force ``F_max`` [N] of the peak, and the slip ``s_slide`` [1] and force ``F_slide`` [N] where
sliding begins. They depend on the wheel load: slope and forces by the parabola (3), the slips
linearly, as in the source of the model. The dissertation's "all parameters are interpolated
similarly" is not followed there: a parabola through the origin would let the slips vanish with the
load, and make the curve of a light wheel begin flatter than the chord to its own peak. At the
nominal loads both agree; at 1 kN the forces differ by up to 26 %. Above the second nominal load the
parabola has no physical meaning, so the load is clamped there and the caller reports the overload.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from omni_platform.configuration import Configuration, ConfigurationError, parameter, section
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class TMeasyCurve(Configuration):
    """Force over slip in one direction at the two nominal loads, a half of Table 1."""

    slope_1: float = parameter(
        description="Slope dF/ds at zero slip and nominal load 1", unit="N", above=0.0
    )
    slope_2: float = parameter(
        description="Slope dF/ds at zero slip and nominal load 2", unit="N", above=0.0
    )
    peak_slip_1: float = parameter(
        description="Slip of the largest force at nominal load 1", above=0.0
    )
    peak_slip_2: float = parameter(
        description="Slip of the largest force at nominal load 2", above=0.0
    )
    peak_force_1: float = parameter(
        description="Largest force at nominal load 1", unit="N", above=0.0
    )
    peak_force_2: float = parameter(
        description="Largest force at nominal load 2", unit="N", above=0.0
    )
    slide_slip_1: float = parameter(
        description="Slip where sliding begins at nominal load 1", above=0.0
    )
    slide_slip_2: float = parameter(
        description="Slip where sliding begins at nominal load 2", above=0.0
    )
    slide_force_1: float = parameter(
        description="Force of full sliding at nominal load 1", unit="N", above=0.0
    )
    slide_force_2: float = parameter(
        description="Force of full sliding at nominal load 2", unit="N", above=0.0
    )

    def check_consistency(self) -> None:
        """Refuse a peak beyond the sliding point or below its force."""
        for load, peak_slip, slide_slip, peak_force, slide_force in (
            (1, self.peak_slip_1, self.slide_slip_1, self.peak_force_1, self.slide_force_1),
            (2, self.peak_slip_2, self.slide_slip_2, self.peak_force_2, self.slide_force_2),
        ):
            if slide_slip <= peak_slip:
                raise ConfigurationError(
                    f"slide_slip_{load}",
                    f"{slide_slip:g} must be above peak_slip_{load} = {peak_slip:g}",
                )
            if slide_force > peak_force:
                raise ConfigurationError(
                    f"slide_force_{load}",
                    f"{slide_force:g} N must be at most peak_force_{load} = {peak_force:g} N",
                )


def _table_1_x() -> TMeasyCurve:
    return TMeasyCurve(
        slope_1=50000.0,
        slope_2=75000.0,
        peak_slip_1=0.15,
        peak_slip_2=0.18,
        peak_force_1=3000.0,
        peak_force_2=4500.0,
        slide_slip_1=0.4,
        slide_slip_2=0.5,
        slide_force_1=2800.0,
        slide_force_2=4200.0,
    )


def _table_1_y() -> TMeasyCurve:
    return TMeasyCurve(
        slope_1=40000.0,
        slope_2=60000.0,
        peak_slip_1=0.21,
        peak_slip_2=0.24,
        peak_force_1=2750.0,
        peak_force_2=4125.0,
        slide_slip_1=0.6,
        slide_slip_2=0.8,
        slide_force_1=2500.0,
        slide_force_2=3750.0,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class TMeasyConfiguration(Configuration):
    """A tire; the defaults are Table 1.

    The single-roller omni-wheel uses direction ``x`` along its active direction; ``y`` belongs
    to the rollers of the individual-roller wheel.
    """

    nominal_load_1: float = parameter(
        3000.0, description="Nominal wheel load F_z1", unit="N", above=0.0
    )
    nominal_load_2: float = parameter(
        6000.0, description="Largest permissible wheel load F_z2", unit="N", above=0.0
    )
    x: TMeasyCurve = section(_table_1_x, description="Longitudinal curve")
    y: TMeasyCurve = section(_table_1_y, description="Lateral curve")

    def check_consistency(self) -> None:
        """Refuse curves that turn negative or cross between zero load and the largest."""
        if self.nominal_load_2 <= self.nominal_load_1:
            raise ConfigurationError(
                "nominal_load_2",
                f"{self.nominal_load_2:g} N must be above nominal_load_1 = "
                f"{self.nominal_load_1:g} N",
            )
        for name, curve in (("x", self.x), ("y", self.y)):
            c = curve_coefficients(curve, self.nominal_load_1, self.nominal_load_2)
            for word, linear in (("slope", c[0]), ("peak_force", c[2]), ("slide_force", c[4])):
                if linear <= 0.0:
                    raise ConfigurationError(
                        f"{name}.{word}_2",
                        f"with {word}_1 the parabola (3) turns negative at small loads; "
                        f"make {word}_2 smaller",
                    )
            if c[4] > c[2]:
                raise ConfigurationError(
                    f"{name}.slide_force_1",
                    "the parabola (3) makes the sliding force exceed the peak at small loads",
                )
            if not 0.0 < c[6] < c[8]:
                raise ConfigurationError(
                    f"{name}.peak_slip_1",
                    "interpolated to zero load the slips must be positive and "
                    "peak_slip below slide_slip",
                )


def direction_coefficients(tire: TMeasyConfiguration, direction: str = "x") -> FloatArray:
    """Return `curve_coefficients` of a direction of a tire, ``x`` or ``y``."""
    curve = {"x": tire.x, "y": tire.y}[direction]
    return curve_coefficients(curve, tire.nominal_load_1, tire.nominal_load_2)


def curve_coefficients(curve: TMeasyCurve, load_1: float, load_2: float) -> FloatArray:
    """Return the load interpolation of a curve in the form that the kernels evaluate.

    Eq. (3) is the parabola ``a F_z + b F_z^2`` through the two nominal points and the origin.

    Args:
        curve: nominal values.
        load_1: first nominal load [N].
        load_2: second nominal load [N].

    Returns:
        ``(a, b)`` [1], [1/N] of slope, peak force and sliding force, then value at zero load [1]
        and gradient [1/N] of peak slip and sliding slip; shape (10,).
    """
    coefficients = []
    for value_1, value_2 in (
        (curve.slope_1, curve.slope_2),
        (curve.peak_force_1, curve.peak_force_2),
        (curve.slide_force_1, curve.slide_force_2),
    ):
        span = load_2 - load_1
        coefficients += [
            (value_1 * load_2 / load_1 - value_2 * load_1 / load_2) / span,
            (value_2 / load_2 - value_1 / load_1) / span,
        ]
    for slip_1, slip_2 in (
        (curve.peak_slip_1, curve.peak_slip_2),
        (curve.slide_slip_1, curve.slide_slip_2),
    ):
        gradient = (slip_2 - slip_1) / (load_2 - load_1)
        coefficients += [slip_1 - gradient * load_1, gradient]
    return np.array(coefficients)


class CurvePoint(NamedTuple):
    """A curve at one load and friction factor; slope and forces in [N], slips in [1]."""

    slope: float
    peak_slip: float
    peak_force: float
    slide_slip: float
    slide_force: float


@lean
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


@lean
def adhesion_force(initial: float, bend: float, sigma: float) -> float:
    """Return the force [N] of the adhesion section, the rational first part of the curve.

    Args:
        initial: ``s_max dF0`` [N].
        bend: ``s_max dF0 / F_max - 2`` [1].
        sigma: slip over ``s_max`` [1], 0..1.
    """
    return initial * sigma / (1.0 + sigma * (sigma + bend))


@lean
def falling_force(peak_force: float, slide_force: float, sigma: float) -> float:
    """Return the force [N] between peak (``sigma = 0``) and full sliding (``sigma = 1``)."""
    return peak_force - (peak_force - slide_force) * sigma * sigma * (3.0 - 2.0 * sigma)


@lean
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


def curve_of(
    tire: TMeasyConfiguration, load: float, friction: float = 1.0, direction: str = "x"
) -> CurvePoint:
    """Return the five numbers of a direction of a tire at a load, Eq. (3).

    Args:
        tire: with both directions, as in Table 1.
        load: wheel load [N], clamped to the model's range.
        friction: ``mu/mu_0`` [1].
        direction: ``x`` or ``y``.
    """
    clamped = min(max(load, 0.0), tire.nominal_load_2)
    curve: CurvePoint = curve_at_load(direction_coefficients(tire, direction), clamped, friction)
    return curve
