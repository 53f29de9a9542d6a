"""Measurements of the sensors, and the twist that the odometry estimates from them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_core.quantities import Float32Array, FloatArray
from omni_core.signals import Lines

UNMEASURED_VARIANCE = 1e6
"""Variance that marks a velocity as unmeasured, (1 km/s)^2 [m^2/s^2]."""


class Decay(NamedTuple):
    """Texture that lines have in common with earlier lines, each averaged over a stretch of time.

    Attributes:
        age: time between the earlier and the newer lines [s].
        duration: time over which the lines are averaged [s].
        least: power that they have in common, relative to the power of the texture in them [1], if
            as little as possible of this power is a fixed pattern.
        most: the same, if as much as possible is a fixed pattern.
        variance: variance of `most` due to noise and to the finite number of features [1]; infinite
            without a comparison.
        shifted: whether the view has shifted along the axis in between; otherwise, a fixed pattern
            counts as texture that remains.
        blur: largest blur along the axis that the spectrum of the common texture allows [px];
            infinite if it is unknown.
    """

    age: float
    duration: float
    least: float
    most: float
    variance: float
    shifted: bool
    blur: float = math.inf


class Displacement(NamedTuple):
    """Displacement that was estimated from the lines of a batch.

    Attributes:
        value: mean displacement per line, along the camera's +axis [px].
        variance: variance of the mean displacement [px^2].
        correlation: coherence of neighboring lines (method `joint`) or mean correlation of the line
            pairs (method `pairs`), up to 1.
        rest: logarithm of the gray levels, minus the camera's fixed pattern (method `joint`), or
            the gray levels (method `pairs`), shape (m + 1, n).
        share: share of the line pairs that were used, 0 to 1.
        slope: standard deviation of the unknown slope of the texture against the direction across
            the axis [1]; motion across the axis falsifies the displacement by it.
        remark: description of a defect that leaves the lines usable; empty without a defect.
    """

    value: float
    variance: float
    correlation: float
    rest: Lines | Float32Array
    share: float = 1.0
    slope: float = 0.0
    remark: str = ""


@dataclasses.dataclass(frozen=True)
class SensorReading:
    """Measurement of one line camera: mean velocity along the camera's axis over a batch.

    Attributes:
        velocity: velocity of the camera's position along its axis [m/s], 0 if not measured.
        variance: variance of the velocity [m^2/s^2], `UNMEASURED_VARIANCE` if not measured.
        correlation: coherence of neighboring lines (method `joint`) or mean correlation of the line
            pairs (method `pairs`), up to 1.
        inlier_share: share of the line pairs that were used, 0 to 1.
        measured: whether velocity and variance are valid.
        reason: reason why velocity and variance are invalid; empty if they are valid.
        static_time: time for which the view of the camera has not changed [s]; 0 if the view
            changed in this batch.
        remark: description of a defect that leaves the lines usable; empty without a defect.
        unmatched: whether the lines change but do not match, or their displacement
            contradicts the motion.
        slope: standard deviation of the unknown slope of the texture against the direction across
            the axis [1]; the odometry adds its effect to the variance.
        decays: loss of texture within the batch, and since an earlier batch.
        replaced: whether the view is constant, but was another one shortly before.
        oblique: whether the variance contains the effect of an oblique texture.
    """

    velocity: float
    variance: float
    correlation: float
    inlier_share: float
    measured: bool
    reason: str = ""
    static_time: float = 0.0
    remark: str = ""
    unmatched: bool = False
    slope: float = 0.0
    decays: tuple[Decay, ...] = ()
    replaced: bool = False
    oblique: bool = False

    @classmethod
    def unmeasured(
        cls, reason: str, correlation: float = 0.0, inlier_share: float = 0.0
    ) -> SensorReading:
        """Return a reading that is marked as unmeasured, with the reason."""
        return cls(0.0, UNMEASURED_VARIANCE, correlation, inlier_share, False, reason)

    def rejected(self, reason: str) -> SensorReading:
        """Return this reading marked as unmeasured, because the view contradicts the motion."""
        nothing = SensorReading.unmeasured(reason, self.correlation)
        return dataclasses.replace(nothing, unmatched=True)


@dataclasses.dataclass(frozen=True, eq=False)
class FlowReading:
    """Measurement of one optical-flow sensor: velocity along two axes.

    Attributes:
        velocity: velocity along the sensor's axis and to the left of it [m/s], shape (2,); 0 if not
            measured.
        covariance: covariance of the velocity [m^2/s^2], shape (2, 2); if not measured, the
            identity times `UNMEASURED_VARIANCE`.
        measured: whether velocity and covariance are valid.
        reason: reason why velocity and covariance are invalid; empty if they are valid.
    """

    velocity: FloatArray
    covariance: FloatArray
    measured: bool
    reason: str = ""

    @classmethod
    def unmeasured(cls, reason: str) -> FlowReading:
        """Return a reading that is marked as unmeasured, with the reason."""
        return cls(np.zeros(2), UNMEASURED_VARIANCE * np.eye(2), False, reason)

    def in_words(self) -> str:
        """Return the velocity as text, or the reason why it was not measured."""
        x, y = self.velocity
        return self.reason or f"{x:.3f} m/s along its axis, {y:.3f} m/s to the left of it"


class Unmeasured(Exception):  # noqa: N818 - not an error: a view may be blank
    """A batch yields no velocity; the exception contains an unmeasured reading with the reason."""

    def __init__(self, reason: str, inlier_share: float = 0.0, *, unmatched: bool = False) -> None:
        """Create an unmeasured reading with the reason, and store it in the exception.

        Args:
            reason: reason why no velocity was measured.
            inlier_share: share of the line pairs that could be used, 0 to 1.
            unmatched: whether the lines change but do not match.
        """
        super().__init__(reason)
        reading = SensorReading.unmeasured(reason, inlier_share=inlier_share)
        self.reading = dataclasses.replace(reading, unmatched=unmatched)


@dataclasses.dataclass(frozen=True)
class TwistEstimate:
    """Twist of the platform at a stamp.

    Attributes:
        stamp_ns: exposure time of the newest line that was used [ns].
        twist: (v_x [m/s], v_y [m/s], yaw rate [rad/s]) of base_link in its own axes, mean over the
            lines of the batches, shape (3,); zero if not measured.
        covariance: covariance of the twist in the squares of its units, shape (3, 3); if not
            measured, the identity times `UNMEASURED_VARIANCE`.
        measured: whether enough sensors had a valid measurement.
        readings: reading of each camera, keyed by name, in the order of the configuration.
        assumed: whether the kinematic constraint was used. If it was used while the vehicle skids,
            the twist has an error that the covariance does not include.
        skid: description of how the sensors contradict the kinematic constraint; empty if they
            agree with it or if the constraint was used.
        inflation: factor by which the covariance was increased to explain the residuals [1]; 1 if
            the readings are consistent.
        flows: reading of each flow sensor, keyed by name, in the order of the configuration.
    """

    stamp_ns: int
    twist: FloatArray
    covariance: FloatArray
    measured: bool
    readings: Mapping[str, SensorReading]
    assumed: bool = False
    skid: str = ""
    inflation: float = 1.0
    flows: Mapping[str, FlowReading] = dataclasses.field(default_factory=dict)

    @property
    def reason(self) -> str:
        """Text that states which sensors did not measure and why, and any skid; may be empty."""
        each: dict[str, SensorReading | FlowReading] = {**self.readings, **self.flows}
        reasons = [f"{name}: {r.reason}" for name, r in each.items() if not r.measured]
        return "; ".join(reasons + ([self.skid] if self.skid else []))
