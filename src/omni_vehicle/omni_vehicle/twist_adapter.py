"""Covariance of a body twist whose source gives it in part, or not at all.

A component with a positive variance in the message is passed on as it is. For any other component
the source gives no variance, and the configured standard deviation takes its place. Without a
variance, a value that has always been exactly zero is no evidence of a measurement: the source may
never set the component. It counts as unmeasured until it differs from zero.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, did_you_mean, parameter
from omni_core.quantities import FloatArray
from omni_core.signals import UNMEASURED_VARIANCE

COMPONENTS = ("linear.x", "linear.y", "angular.z")
"""Components of a planar twist, as in its message."""


class CovarianceConfiguration(Configuration):
    """Standard deviations of the received body twist, and components without a measurement."""

    deviation: tuple[float, ...] = parameter((), minimum=0.0, maximum=1000.0)
    """Standard deviations of linear.x, linear.y [m/s] and angular.z [rad/s], for components to
    which the source gives no variance above 0. Such a component counts as unmeasured until its
    value differs from 0, unless all components are 0"""
    replace_covariance: bool = parameter(False)
    """Whether `deviation` also replaces the variances and covariances that the source gives"""
    unmeasured: tuple[str, ...] = parameter(())
    """Components that the source does not measure, such as angular.z; they are published as 0 with
    a variance of 1e6"""

    def check_consistency(self) -> None:
        """Check that the standard deviations and the names of components are valid."""
        if self.deviation and (len(self.deviation) != 3 or min(self.deviation) <= 0.0):
            raise ConfigurationError("deviation", "must be three numbers above 0")
        if self.replace_covariance and not self.deviation:
            raise ConfigurationError("replace_covariance", "needs the parameter deviation")
        for name in self.unmeasured:
            if name not in COMPONENTS:
                raise ConfigurationError(
                    "unmeasured",
                    f"{name!r} is none of {', '.join(COMPONENTS)}{did_you_mean(name, COMPONENTS)}",
                )


class CompletedTwist(NamedTuple):
    """A body twist with a complete covariance.

    Attributes:
        value: (v_x, v_y, yaw rate) [m/s, m/s, rad/s], shape (3,).
        covariance: covariance of `value`, in the squares of its units, shape (3, 3).
        problem: reason why the twist cannot be used; empty for a usable twist.
        unset: components that count as unmeasured because they have always been 0.
    """

    value: FloatArray
    covariance: FloatArray
    problem: str
    unset: tuple[str, ...]


class CovarianceCompletion:
    """Completes the covariance of the twists of one source."""

    def __init__(self, configuration: CovarianceConfiguration) -> None:
        self._replace = configuration.replace_covariance
        self._unmeasured = np.array([name in configuration.unmeasured for name in COMPONENTS])
        self._deviation = np.array(configuration.deviation or np.zeros(3))
        self._has_moved = np.zeros(3, bool)  # whether a component has ever differed from 0

    def complete(self, value: FloatArray, covariance: FloatArray) -> CompletedTwist:
        """Return a received twist with a complete covariance.

        Args:
            value: (v_x, v_y, yaw rate) [m/s, m/s, rad/s], shape (3,).
            covariance: covariance in the message, in the squares of the units of `value`, shape
                (3, 3); an unknown variance is 0, negative or NaN.
        """
        value, covariance = value.copy(), covariance.copy()
        variance = np.diagonal(covariance)
        self._has_moved |= np.isfinite(value) & (value != 0.0)
        filled = np.square(self._deviation)
        replaced = (filled > 0.0) & (~(variance > 0.0) | self._replace)
        unset = replaced & ~self._has_moved & ~self._unmeasured & self._has_moved.any()
        unset &= filled < UNMEASURED_VARIANCE
        unmeasured = self._unmeasured | unset
        filled = np.where(unmeasured, UNMEASURED_VARIANCE, filled)
        changed = replaced | unmeasured
        value[unmeasured] = 0.0
        covariance[changed, :] = 0.0
        covariance[:, changed] = 0.0
        covariance[changed, changed] = filled[changed]
        names = tuple(name for name, is_unset in zip(COMPONENTS, unset, strict=True) if is_unset)
        return CompletedTwist(value, covariance, _problem(value, covariance), names)


def _problem(value: FloatArray, covariance: FloatArray) -> str:
    """Return which element of a twist cannot be used, and the remedy; empty if all can be used."""
    for i, name in enumerate(COMPONENTS):
        variance = float(covariance[i, i])
        remedy = f"if the source does not measure it, add {name} to the parameter unmeasured"
        if not math.isfinite(value[i]):
            return f"{name} is {value[i]:g}, must be finite; {remedy}"
        if not variance > 0.0 or math.isinf(variance):
            return (
                f"the variance of {name} is {variance:g}, must be a number above 0: set the "
                f"parameter deviation; {remedy}"
            )
    for i, j in itertools.combinations(range(3), 2):
        largest = math.sqrt(covariance[i, i] * covariance[j, j])
        for element in (covariance[i, j], covariance[j, i]):
            if not abs(element) < largest:
                return (
                    f"the covariance of {COMPONENTS[i]} and {COMPONENTS[j]} is {element:g}, must "
                    f"be below {largest:g}, the product of the standard deviations: correct the "
                    "source, or set the parameters deviation and replace_covariance"
                )
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        return (
            f"the covariance of {', '.join(COMPONENTS)} is not positive definite: correct the "
            "source, or set the parameters deviation and replace_covariance"
        )
    return ""
