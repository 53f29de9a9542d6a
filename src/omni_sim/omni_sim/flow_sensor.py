"""Optical-flow sensors, which count the displacement of the ground along two axes.

A sensor integrates the motion of its mounting position along its own axes. At its own rate it
returns the whole counts since the last reading; a remaining fraction is added to the next reading.
The sensor driver divides the counts by the elapsed time and publishes the velocity with the
variance due to noise and rounding. Above its maximum speed the sensor has no valid reading; real
sensors report this as a low surface quality.
"""

import math
from collections.abc import Mapping

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.geometry import turned
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.sensors import FlowSensor
from omni_core.signals import Flow


class FlowConfiguration(Configuration):
    """Errors of the flow sensors; the defaults are for a PMW3901 80 mm above the ground."""

    resolution: float = parameter(0.0002, unit="m", minimum=0.0, maximum=0.1)
    """Displacement of the ground per count"""
    noise: float = parameter(0.0002, unit="m", above=0.0, maximum=0.1)
    """Standard deviation of the noise of a measured displacement, for each axis"""
    scale: float = parameter(0.005, minimum=-0.9, maximum=10.0)
    """Scale error of all sensors"""
    failing: str = parameter("")
    """Name of a faulty sensor; empty for none"""
    failure: str = parameter("zero", choices=("zero", "frozen", "invalid", "double"))
    """Fault: `zero` reads 0, `frozen` repeats the last reading, `invalid` reads NaN, `double` reads
    twice the velocity"""
    failure_start: float = parameter(0.0, unit="s", minimum=0.0, maximum=3600.0)
    """Time at which the fault begins"""


def check_flow_sensors(
    sensors: Mapping[str, FlowSensor], configuration: FlowConfiguration, control_period: float
) -> None:
    """Check the rates of the sensors, and the name of the faulty sensor.

    Raises:
        ConfigurationError: a check fails; the message names the sensor.
    """
    control_ns = round(SECOND_NS * control_period)
    for name, sensor in sensors.items():
        if round(SECOND_NS / sensor.rate) % control_ns:
            raise ConfigurationError(
                f"flow_sensors.{name}.rate",
                f"{sensor.rate:g} 1/s is a period of {1.0 / sensor.rate:g} s, which must be a "
                f"multiple of the control period of {control_period:g} s",
            )
    if configuration.failing and configuration.failing not in sensors:
        raise ConfigurationError(
            "flow.failing",
            f"{configuration.failing!r} is none of {', '.join(sensors) or 'nothing'}",
        )


class FlowSensorArray:
    """All simulated flow sensors of a vehicle."""

    def __init__(
        self,
        sensors: Mapping[str, FlowSensor],
        configuration: FlowConfiguration,
        random: np.random.Generator,
        twist: FloatArray,
    ) -> None:
        """Create the sensors of a vehicle that moved with a constant twist before the start.

        Args:
            sensors: sensors, keyed by name.
            configuration: errors of the sensors.
            random: source of the noise.
            twist: body twist before the start [m/s, m/s, rad/s], shape (3,).
        """
        self._sensors = sensors
        self._configuration = configuration
        self._random = random
        self._periods: dict[str, int] = {}
        self._path: dict[str, FloatArray] = {}  # motion since the last reading, in sensor axes [m]
        self._last: dict[str, Flow] = {}
        v_x, v_y, rate = (float(value) for value in twist)
        for name, sensor in sensors.items():
            period_ns = round(SECOND_NS / sensor.rate)
            self._periods[name] = period_ns
            place = np.array([v_x - rate * sensor.y, v_y + rate * sensor.x])
            self._path[name] = turned(place, -sensor.heading) * period_ns / SECOND_NS

    def measure(self, stamp_ns: int, trajectory: FloatArray | None = None) -> dict[str, Flow]:
        """Return the measurements that are due at a stamp, keyed by sensor name.

        Args:
            stamp_ns: time since the start of the run [ns].
            trajectory: motion since the last call: x, y [m], yaw [rad] of base_link in the world
                frame, then any other columns, shape (n + 1, at least 3); None at the start.
        """
        if trajectory is not None:
            self._integrate(trajectory)
        due = {name: period for name, period in self._periods.items() if stamp_ns % period == 0}
        return {name: self._measure(name, stamp_ns, 1e-9 * due[name]) for name in due}

    def _integrate(self, trajectory: FloatArray) -> None:
        yaw = trajectory[:, 2]
        middle = 0.5 * (yaw[1:] + yaw[:-1])
        for name, sensor in self._sensors.items():
            place = trajectory[:, :2] + turned(np.array([sensor.x, sensor.y]), yaw)
            path = turned(np.diff(place, axis=0), -(middle + sensor.heading))
            self._path[name] = self._path[name] + np.sum(path, axis=0)

    def _measure(self, name: str, stamp_ns: int, elapsed: float) -> Flow:
        c = self._configuration
        path = self._path[name]
        measured = path * (1.0 + c.scale) + c.noise * self._random.standard_normal(2)
        counted = (
            np.round(measured / c.resolution) * c.resolution if c.resolution > 0.0 else measured
        )
        # The fraction of a count is added to the next measurement.
        self._path[name] = (measured - counted) / (1.0 + c.scale)
        velocity = counted / elapsed
        limit = self._sensors[name].maximum_speed
        if math.hypot(*path) / elapsed > limit > 0.0:
            velocity = np.full(2, math.nan)
        if name == c.failing and stamp_ns >= c.failure_start * SECOND_NS:
            last = self._last[name].velocity if name in self._last else np.zeros(2)
            velocity = {
                "zero": np.zeros(2),
                "frozen": last,
                "invalid": np.full(2, math.nan),
                "double": 2.0 * velocity,
            }[c.failure]
        variance = (c.noise**2 + c.resolution**2 / 6.0) / elapsed**2  # rounding errors at both ends
        self._last[name] = Flow(stamp_ns, velocity, variance * np.eye(2))
        return self._last[name]
