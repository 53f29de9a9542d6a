"""Optical-flow sensors, which measure two components of the velocity at their position.

Such a sensor (PMW3901, PAA5160 of an OTOS, a mouse sensor) counts the displacement of the ground
along two axes; its driver publishes a velocity with a covariance. The velocity is weighted by this
covariance. It is rejected if it is NaN, above the largest speed of the sensor, or if it differs
from the last one by more than the largest acceleration permits.
"""

import math
from collections.abc import Mapping

import numpy as np

from linescan_odometry.measurements import UNMEASURED_VARIANCE, FlowReading
from omni_platform.quantities import FloatArray
from omni_platform.sensors import FlowSensor
from omni_platform.signals import Flow

_DEVIATIONS = 6.0  # standard deviations by which a velocity may jump without acceleration


class FlowMonitor:
    """Checks the range of one flow sensor's measurements, and their change since the last one."""

    def __init__(self, sensor: FlowSensor, maximum_acceleration: float) -> None:
        """Prepare for one sensor.

        Args:
            sensor: the flow sensor.
            maximum_acceleration: largest acceleration of the sensor [m/s^2]; 0 for any.
        """
        self._sensor = sensor
        self._acceleration = maximum_acceleration
        self._last: Flow | None = None

    def read(self, flow: Flow) -> FlowReading:
        """Return a measurement as a reading, unmeasured if it is rejected."""
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
            return f"{speed:.3g} m/s is faster than the {limit:g} m/s that it can follow"
        return ""

    def _jump(self, stamp_ns: int, velocity: FloatArray, covariance: FloatArray) -> str:
        last = self._last
        # If a recording is played again, time runs back.
        if last is None or self._acceleration == 0.0 or stamp_ns <= last.stamp_ns:
            return ""
        elapsed = 1e-9 * (stamp_ns - last.stamp_ns)
        change = math.hypot(*(velocity - last.velocity))
        noise = math.sqrt(float(np.trace(covariance + last.covariance)))
        # The range widens with time, so that a wrong last measurement blocks the sensor for a
        # limited time only.
        if change <= self._acceleration * elapsed + _DEVIATIONS * noise:
            return ""
        return f"it changes by {change:.3g} m/s within {1e3 * elapsed:.3g} ms"


def monitors(sensors: Mapping[str, FlowSensor], acceleration: float) -> dict[str, FlowMonitor]:
    """Return a monitor of each sensor, by name; the acceleration [m/s^2] is 0 for any."""
    return {name: FlowMonitor(sensor, acceleration) for name, sensor in sensors.items()}
