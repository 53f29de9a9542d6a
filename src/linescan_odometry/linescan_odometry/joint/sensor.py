"""Method `joint` for one camera: displacement estimator and plausibility check."""

import math

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.joint.defects import without_defects
from linescan_odometry.joint.estimator import JointEstimator
from linescan_odometry.joint.fixed_pattern import FixedPattern
from linescan_odometry.measurements import Displacement, Unmeasured
from linescan_odometry.plausibility import Plausibility
from omni_platform.sensors import LineSensor
from omni_platform.signals import Lines

_ACCELERATION = 15.0  # m/s^2, standard deviation; a hard stop on a dry road has 10


class JointMethod:
    """Measures displacements by the maximum likelihood of whole batches."""

    def __init__(
        self,
        sensor: LineSensor,
        configuration: OdometryConfiguration,
        pattern: FixedPattern | None = None,
    ) -> None:
        """Create the estimator.

        Args:
            sensor: configuration of the camera.
            configuration: configuration of the odometry.
            pattern: fixed pattern from an earlier drive; None if there is none.
        """
        self._limit = configuration.maximum_acceleration
        change = _ACCELERATION / (sensor.line_rate**2 * sensor.pixel_pitch)
        self.estimator = JointEstimator(sensor.pixels, configuration.shift_limit(sensor), change)
        if pattern is not None:
            self.estimator.pattern = pattern
        self._last = math.nan

    def reset(self) -> None:
        """Discard the last displacement; the next line starts a new sequence."""
        self._last = math.nan

    def measure(self, lines: Lines, plausibility: Plausibility, stamp_ns: int) -> Displacement:
        """Measure a batch; see `sensor.Method`."""
        estimate = self.estimator.estimate(without_defects(lines), self._last)
        if estimate.reason:
            raise Unmeasured(estimate.reason, unmatched=True)
        if not plausibility.check(stamp_ns, np.array([estimate.value]))[0]:
            raise Unmeasured(
                f"not plausible: {estimate.value:.3g} px a line needs more than "
                f"{self._limit:g} m/s^2 since the last measurement"
            )
        self._last = estimate.value
        return Displacement(
            estimate.value, estimate.variance, estimate.coherence, 1.0, estimate.rest
        )
