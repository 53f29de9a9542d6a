"""Optical-flow sensors, which measure two components of the velocity at their position.

Such a sensor (PMW3901, PAA5160 of an OTOS, a mouse sensor) counts the displacement of the ground
along two axes, and the sensor driver publishes a velocity with a covariance. The velocity is
weighted by this covariance. A velocity is rejected if it is NaN, if it exceeds the speed limit of
the sensor, or if it differs from the last velocity by more than the acceleration limit permits.
"""

import math

import numpy as np

from linescan_odometry.measurements import UNMEASURED_VARIANCE, FlowReading
from omni_core.quantities import FloatArray
from omni_core.sensors import FlowSensor
from omni_core.signals import Flow

_DEVIATIONS = 6.0  # standard deviations by which the velocity may change due to noise alone


class FlowMonitor:
    """Checks whether the measurements of one flow sensor are valid and plausible."""

    def __init__(self, sensor: FlowSensor, maximum_acceleration: float) -> None:
        """Create the plausibility check for one flow sensor.

        Args:
            sensor: configuration of the flow sensor.
            maximum_acceleration: limit on the acceleration of the sensor [m/s^2]; 0 for no limit.
        """
        self._sensor = sensor
        self._acceleration = maximum_acceleration
        self._last: Flow | None = None

    def read(self, flow: Flow) -> FlowReading:
        """Return the reading for a measurement, marked as unmeasured if a check rejects it."""
        velocity = np.asarray(flow.velocity, np.float64)
        covariance = np.asarray(flow.covariance, np.float64)
        covariance = 0.5 * (covariance + covariance.T)
        if not covariance.any():
            covariance = self._sensor.deviation**2 * np.eye(2)
        fault = self._fault(velocity, covariance) or self._jump(flow.stamp_ns, velocity, covariance)
        if fault:
            return FlowReading.unmeasured(fault)
        self._last = Flow(flow.stamp_ns, velocity, covariance)
        return FlowReading(velocity, covariance, True)

    def _fault(self, velocity: FloatArray, covariance: FloatArray) -> str:
        if not (np.isfinite(velocity).all() and np.isfinite(covariance).all()):
            return "velocity or covariance is not finite"
        smallest, largest = np.linalg.eigvalsh(covariance)
        if largest >= UNMEASURED_VARIANCE:
            return "it reports no measurement"
        if smallest <= 0.0:
            return "its covariance must be positive definite"
        speed, limit = math.hypot(*velocity), self._sensor.maximum_speed
        if speed > limit > 0.0:
            return f"{speed:.3g} m/s exceeds its maximum_speed of {limit:g} m/s"
        return ""

    def _jump(self, stamp_ns: int, velocity: FloatArray, covariance: FloatArray) -> str:
        last = self._last
        # The stamps decrease if a recording is played again.
        if last is None or self._acceleration == 0.0 or stamp_ns <= last.stamp_ns:
            return ""
        elapsed = 1e-9 * (stamp_ns - last.stamp_ns)
        change = math.hypot(*(velocity - last.velocity))
        noise = math.sqrt(float(np.trace(covariance + last.covariance)))
        # The range grows with time, so a wrong last measurement blocks the sensor for a limited
        # time only.
        if change <= self._acceleration * elapsed + _DEVIATIONS * noise:
            return ""
        return f"it changes by {change:.3g} m/s within {1e3 * elapsed:.3g} ms"
