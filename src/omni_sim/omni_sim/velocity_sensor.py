"""Velocity sensor of the dissertation: sampled, with noise and offset, Eqs. (60), (61).

For a limited time, the sensor can have one of three faults that occur in real sensors: it repeats
its last reading, returns zero, or reports that it has no valid reading.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import by_reference, lean
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.signals import TwistSample
from omni_sim.sensor_configuration import VelocitySensorConfiguration

# Lower limit on the reported standard deviation, for sensors with little noise [m/s], [rad/s].
SMALLEST_DEVIATION = 1e-4


@by_reference
class SensorConstants(NamedTuple):
    """Constants of the sensor for the kernel; see `VelocitySensorConfiguration`.

    Attributes:
        period_ns: period of the samples [ns].
        share: half widths of the uniform noise of v_x, v_y and yaw rate, each divided by the true
            value [1], shape (3,).
        offset: constant errors [m/s, m/s, rad/s], shape (3,).
        fails_from_ns: time at which the fault begins [ns].
        fails_until_ns: time at which the fault ends [ns].
        holds: whether the sensor repeats its last reading during the fault.
        failed: reading during any other fault, 0 or NaN.
    """

    period_ns: int
    share: FloatArray
    offset: FloatArray
    fails_from_ns: int
    fails_until_ns: int
    holds: bool
    failed: float


# Last sample that was due, whether it was taken or a fault prevented it.
SENSOR_MEMORY = np.dtype(
    [("sample", "i8"), ("stamp_ns", "i8"), ("v_x", "f8"), ("v_y", "f8"), ("yaw_rate", "f8")]
)


def sensor_constants(configuration: VelocitySensorConfiguration) -> SensorConstants:
    """Return the constants of the sensor for a configuration."""
    c = configuration
    start = round(c.failure_time * SECOND_NS)
    duration = round(c.failure_duration * SECOND_NS) if c.failure != "none" else 0
    return SensorConstants(
        round(c.sample_time * SECOND_NS),
        np.array([c.linear_noise, c.linear_noise, c.yaw_rate_noise]),
        np.array([c.offset_x, c.offset_y, c.yaw_rate_offset]),
        start,
        start + duration,
        c.failure == "frozen",
        math.nan if c.failure == "invalid" else 0.0,
    )


def sensor_memory() -> NDArray[np.void]:
    """Return the memory of a sensor that has taken no sample, `SENSOR_MEMORY`, shape (1,)."""
    memory = np.zeros(1, SENSOR_MEMORY)
    memory["sample"] = -1
    return memory


@lean
def samples_now(sensor: SensorConstants, memory: Any, stamp_ns: int) -> bool:
    """Return whether the sensor takes a sample at a stamp [ns]; it takes none during a fault."""
    if sensor.fails_from_ns <= stamp_ns < sensor.fails_until_ns:
        return False
    due: bool = stamp_ns // sensor.period_ns > memory[0].sample
    return due


@lean
def read(
    sensor: SensorConstants,
    memory: Any,
    stamp_ns: int,
    twist: FloatArray,
    draw: FloatArray,
    reading: FloatArray,
) -> int:
    """Take a sample if one is due, write the present reading, and return its time stamp [ns].

    Args:
        sensor: constants.
        memory: memory from `sensor_memory`, changed in place.
        stamp_ns: time since the start of the run [ns].
        twist: true body twist [m/s, m/s, rad/s], shape (3,).
        draw: noise of a sample, uniform between -1 and 1, shape (3,).
        reading: output, the measured body twist [m/s, m/s, rad/s], shape (3,).
    """
    held = memory[0]
    samples = samples_now(sensor, memory, stamp_ns)
    if stamp_ns // sensor.period_ns > held.sample:
        held.sample = stamp_ns // sensor.period_ns
        held.stamp_ns = stamp_ns
    if samples:
        share, offset = sensor.share, sensor.offset
        held.v_x = twist[0] * (1.0 + share[0] * draw[0]) + offset[0]  # Eqs. (60), (61)
        held.v_y = twist[1] * (1.0 + share[1] * draw[1]) + offset[1]
        held.yaw_rate = twist[2] * (1.0 + share[2] * draw[2]) + offset[2]
    if sensor.fails_from_ns <= stamp_ns < sensor.fails_until_ns and not sensor.holds:
        reading[:] = sensor.failed
    else:
        reading[0], reading[1], reading[2] = held.v_x, held.v_y, held.yaw_rate
    return int(held.stamp_ns)


@lean
def state_covariance(sensor: SensorConstants, reading: FloatArray, covariance: FloatArray) -> None:
    """Write the covariance of a reading, whose noise is uniform and proportional to the reading.

    Args:
        sensor: constants.
        reading: reading of the sensor [m/s, m/s, rad/s], shape (3,).
        covariance: output, the covariance of the reading, shape (3, 3).
    """
    covariance[:] = 0.0
    for j in range(3):
        covariance[j, j] = max((sensor.share[j] * reading[j]) ** 2 / 3.0, SMALLEST_DEVIATION**2)


class VelocitySensor:
    """Sensor of the body twist with zero-order hold.

    Attributes:
        configuration: sampling and errors.
    """

    def __init__(
        self, configuration: VelocitySensorConfiguration, random: np.random.Generator
    ) -> None:
        """Create a sensor that has not taken a sample yet.

        Args:
            configuration: sampling and errors.
            random: source of the noise.
        """
        self.configuration = configuration
        self._random = random
        self._constants = sensor_constants(configuration)
        self._memory = sensor_memory()

    def measure(self, stamp_ns: int, twist: FloatArray) -> TwistSample:
        """Return the present reading, with the time stamp of its sample.

        Samples are due at multiples of the sample time. A sample is taken at the first call at or
        after its due time, so repeated calls with the same stamp return the same reading. A faulty
        sensor takes no samples, but stamps its messages as if it did.

        Args:
            stamp_ns: time since the start of the run [ns], not decreasing.
            twist: true body twist [m/s, m/s, rad/s], shape (3,).
        """
        draw = np.zeros(3)
        if samples_now(self._constants, self._memory, stamp_ns):
            draw = self._random.uniform(-1.0, 1.0, 3)
        reading, covariance = np.empty(3), np.empty((3, 3))
        taken_ns = read(self._constants, self._memory, stamp_ns, twist, draw, reading)
        self.state_covariance(reading, covariance)
        return TwistSample(taken_ns, reading, covariance)

    def state_covariance(self, reading: FloatArray, covariance: FloatArray) -> None:
        """Write the covariance, shape (3, 3), that the sensor reports for a reading, shape (3,)."""
        state_covariance(self._constants, reading, covariance)
