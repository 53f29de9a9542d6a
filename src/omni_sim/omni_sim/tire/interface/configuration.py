"""Parameters of a tire: those of each tire model, and those that all models have.

A tire model has a section here and a module of the same name in `tire.models`.
"""

import dataclasses

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter, section
from omni_core.quantities import FloatArray

MODELS = ("linear", "magic_formula", "tmeasy")
"""Names of the tire models."""

LOAD_RANGE = (1.0, 1.0e7)
"""Smallest and largest wheel load of a tire model [N]."""
LARGEST_FORCE = 1.0e8
"""Limit on the forces of a tire model [N]."""


class LinearConfiguration(Configuration):
    """Parameters of a linear tire, by default the tire of Table 1 at the first nominal load."""

    largest_load: float = parameter(6000.0, unit="N", minimum=LOAD_RANGE[0], maximum=LOAD_RANGE[1])
    """Largest permissible wheel load"""
    stiffness: float = parameter(50000.0 / 3000.0, above=0.0, maximum=1000.0)
    """Slope dF/ds at zero slip, divided by the wheel load"""
    friction: float = parameter(1.0, above=0.0, maximum=10.0)
    """Ratio of the largest force to the wheel load"""


SHAPE_RANGE = (1.05, 1.95)


CURVATURE_RANGE = (-20.0, 0.95)


class MagicFormulaConfiguration(Configuration):
    """Parameters of a Magic Formula tire, by default similar to the tire of Table 1."""

    largest_load: float = parameter(6000.0, unit="N", minimum=LOAD_RANGE[0], maximum=LOAD_RANGE[1])
    """Largest permissible wheel load"""
    friction: float = parameter(1.25, above=0.0, maximum=10.0)
    """Ratio of the largest force to the wheel load at small loads, a_2"""
    friction_gradient: float = parameter(-0.25 / 3000.0, unit="1/N", minimum=-0.01, maximum=0.01)
    """Increase of the ratio of largest force to wheel load per unit of load, a_1"""
    stiffness: float = parameter(62500.0 / 3000.0, above=0.0, maximum=1000.0)
    """Ratio of the slope dF/ds at zero slip to the wheel load at small loads, a_4"""
    stiffness_gradient: float = parameter(
        -12500.0 / 3000.0**2, unit="1/N", minimum=-1.0, maximum=1.0
    )
    """Increase of the ratio of slope to wheel load per unit of load, a_3"""
    shape: float = parameter(1.23, minimum=SHAPE_RANGE[0], maximum=SHAPE_RANGE[1])
    """Shape C; at unlimited slip, the force is its peak times sin(C 90 deg)"""
    curvature: float = parameter(-1.3, minimum=CURVATURE_RANGE[0], maximum=CURVATURE_RANGE[1])
    """Curvature E around the peak"""

    def check_consistency(self) -> None:
        """Check that forces and slopes stay positive and do not decrease with the load."""
        for name, value, gradient in (
            ("friction_gradient", self.friction, self.friction_gradient),
            ("stiffness_gradient", self.stiffness, self.stiffness_gradient),
        ):
            if value + 2.0 * gradient * self.largest_load < 0.0:
                raise ConfigurationError(
                    name,
                    f"{gradient:g} 1/N makes the tire's force decrease with the load below "
                    f"largest_load = "
                    f"{self.largest_load:g} N",
                )


class TMeasyCurve(Configuration):
    """Force versus slip in one direction at the two nominal loads; one half of Table 1."""

    slope_1: float = parameter(unit="N", above=0.0, maximum=1.0e10)
    """Slope dF/ds at zero slip and nominal load 1"""
    slope_2: float = parameter(unit="N", above=0.0, maximum=1.0e10)
    """Slope dF/ds at zero slip and nominal load 2"""
    peak_slip_1: float = parameter(above=0.0, maximum=10.0)
    """Slip at which the force is largest, at nominal load 1"""
    peak_slip_2: float = parameter(above=0.0, maximum=10.0)
    """Slip at which the force is largest, at nominal load 2"""
    peak_force_1: float = parameter(unit="N", above=0.0, maximum=LARGEST_FORCE)
    """Largest force at nominal load 1"""
    peak_force_2: float = parameter(unit="N", above=0.0, maximum=LARGEST_FORCE)
    """Largest force at nominal load 2"""
    slide_slip_1: float = parameter(above=0.0, maximum=100.0)
    """Slip at which full sliding begins, at nominal load 1"""
    slide_slip_2: float = parameter(above=0.0, maximum=100.0)
    """Slip at which full sliding begins, at nominal load 2"""
    slide_force_1: float = parameter(unit="N", above=0.0, maximum=LARGEST_FORCE)
    """Force of full sliding at nominal load 1"""
    slide_force_2: float = parameter(unit="N", above=0.0, maximum=LARGEST_FORCE)
    """Force of full sliding at nominal load 2"""

    def check_consistency(self) -> None:
        """Check that sliding begins beyond the peak, with at most the force of the peak."""
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


FITTED = tuple(field.name for field in dataclasses.fields(TMeasyCurve))


_TABLE_1 = {
    "x": (5e4, 7.5e4, 0.15, 0.18, 3000.0, 4500.0, 0.4, 0.5, 2800.0, 4200.0),
    "y": (4e4, 6e4, 0.21, 0.24, 2750.0, 4125.0, 0.6, 0.8, 2500.0, 3750.0),
}


def _table_1(direction: str) -> TMeasyCurve:
    return TMeasyCurve(**dict(zip(FITTED, _TABLE_1[direction], strict=True)))


class TMeasyConfiguration(Configuration):
    """Parameters of a TMeasy tire; the defaults are those of Table 1.

    The single-roller omni-wheel uses the curve ``x`` along its active direction. Individual rollers
    use the curve ``x`` along their axes and the curve ``y`` across their axes.
    """

    nominal_load_1: float = parameter(
        3000.0, unit="N", minimum=LOAD_RANGE[0], maximum=LOAD_RANGE[1]
    )
    """Nominal wheel load F_z1"""
    nominal_load_2: float = parameter(
        6000.0, unit="N", minimum=LOAD_RANGE[0], maximum=LOAD_RANGE[1]
    )
    """Largest permissible wheel load F_z2"""
    x: TMeasyCurve = section(lambda: _table_1("x"))
    """Longitudinal curve"""
    y: TMeasyCurve = section(lambda: _table_1("y"))
    """Lateral curve"""

    @property
    def largest_load(self) -> float:
        """Largest permissible wheel load [N]."""
        return self.nominal_load_2

    def check_consistency(self) -> None:
        """Check that the curves are valid at every load up to the largest one.

        Slopes, forces and slips must be positive. The peak must be before the sliding point and
        must not be below the sliding force.

        Raises:
            ConfigurationError: a curve is invalid; the message names the parameter.
        """
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
                        f"with this {word}_1, the parabola (3) becomes negative at small loads; "
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
                    "extrapolated to zero load, the slips must be positive, and "
                    "peak_slip must be below slide_slip",
                )


def curve_coefficients(curve: TMeasyCurve, load_1: float, load_2: float) -> FloatArray:
    """Return the load interpolation of a curve in the form that the kernels evaluate.

    Eq. (3) is the parabola ``a F_z + b F_z^2`` through the two nominal points and the origin.

    Args:
        curve: nominal values.
        load_1: first nominal load [N].
        load_2: second nominal load [N].

    Returns:
        Ten numbers, shape (10,): ``a`` [1] and ``b`` [1/N] of the slope, of the peak force and of
        the sliding force; value at zero load [1] and gradient [1/N] of the peak slip and of the
        sliding slip.
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


class TireConfiguration(Configuration):
    """Parameters of a vehicle's tire, by default TMeasy with the values of Table 1.

    Sections of models that are not chosen are ignored.
    """

    model: str = parameter("tmeasy", choices=MODELS)
    """Tire model; its parameters are in the section of the same name"""
    linear: LinearConfiguration = section(LinearConfiguration)
    """Proportional to slip and load, saturated at the friction limit"""
    magic_formula: MagicFormulaConfiguration = section(MagicFormulaConfiguration)
    """Pacejka's formula with load-dependent peak and stiffness"""
    tmeasy: TMeasyConfiguration = section(TMeasyConfiguration)
    """Rill's TMeasy with the parameters of Table 1"""
    stiffness: float = parameter(2.0e5, unit="N/m", minimum=1.0e3, maximum=1.0e8)
    """Stiffness c_x of the tire against horizontal deflection"""
    damping: float = parameter(5000.0, unit="N s/m", minimum=0.0, maximum=1.0e7)
    """Damping d_x of the horizontal deflection"""
    vertical_stiffness: float = parameter(1.0e6, unit="N/m", minimum=1.0e4, maximum=1.0e9)
    """Vertical stiffness c_z, which determines the dynamic rolling radius"""
    slip_speed: float = parameter(1.0e-6, unit="m/s", minimum=1.0e-9, maximum=0.1)
    """Speed v_num in the denominator of the slip, which keeps the slip of a locked wheel finite"""

    @property
    def model_parameters(
        self,
    ) -> LinearConfiguration | MagicFormulaConfiguration | TMeasyConfiguration:
        """Parameters of the selected model."""
        parameters: LinearConfiguration | MagicFormulaConfiguration | TMeasyConfiguration
        parameters = getattr(self, self.model)
        return parameters

    @property
    def largest_load(self) -> float:
        """Largest load for which the chosen model is valid [N]."""
        return self.model_parameters.largest_load
