"""Twist of base_link from the twist that one sensor measures, with a complete covariance.

A sensor that is mounted at r with its x axis at the angle phi measures the velocity ``v_s`` of its
position in its own axes. With the rotation R by phi and the unit vector k upwards, Eq. (23) gives
the velocity of base_link, ``R v_s - Omega k x r``. It needs the yaw rate Omega, of the sensor
itself or of an IMU.

A component with a positive variance in the message is passed on as it is. For any other component
the source gives no variance, and the configured standard deviation takes its place. Without a
variance, a value that has always been exactly zero is no evidence of a measurement: the source may
never set the component. It counts as unmeasured until it differs from zero.
"""

import itertools
import math
from collections import deque
from typing import NamedTuple

import numpy as np

from omni_core import topics
from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import LARGEST_OFFSET, SECOND_NS, FloatArray
from omni_core.sensors import Mount
from omni_core.signals import UNMEASURED_VARIANCE

INPUT_TYPES = {
    "odometry": topics.ODOMETRY,
    "twist_stamped": topics.TWIST_STAMPED,
    "twist_with_covariance": topics.TWIST_WITH_COVARIANCE,
}
"""Types of the messages with the twist, keyed by the words of the parameter `input_type`."""

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
    unmeasured: tuple[str, ...] = parameter((), choices=COMPONENTS)
    """Components that the source does not measure, such as angular.z; they are published as 0 with
    a variance of 1e6"""

    def check_consistency(self) -> None:
        """Check that the standard deviations are valid."""
        if self.deviation and (len(self.deviation) != 3 or min(self.deviation) <= 0.0):
            raise ConfigurationError("deviation", "must be three numbers above 0")
        if self.replace_covariance and not self.deviation:
            raise ConfigurationError("replace_covariance", "needs the parameter deviation")


class TwistAdapterConfiguration(CovarianceConfiguration, Mount):
    """Input, mounting and covariance of the sensor that measures the twist."""

    input_type: str = parameter("twist_with_covariance", choices=tuple(INPUT_TYPES))
    """Message type of the topic 'input'"""
    sensor: str = parameter("")
    """Name of a flow sensor whose topic flow/<sensor>/twist is the input; empty for the topic
    'input'"""
    base_frame: str = parameter("base_link")
    """Frame that the message of the twist must name, after the parameter `frame_prefix`; empty for
    any frame. The name of the sensor's frame if `x`, `y` and `heading_deg` give its mounting;
    ignored for a flow `sensor`"""
    x: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position at which the twist is measured, forward of base_link"""
    y: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position at which the twist is measured, left of base_link"""
    heading_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Direction of the x axis of the measured velocity, counter-clockwise from the forward
    direction"""
    maximum_speed: float = parameter(0.0, unit="m/s", minimum=0.0, maximum=1000.0)
    """Largest speed that the sensor can measure; a faster twist is not published. 0 for no limit"""
    gyro: str = parameter("input", choices=("input", "imu"))
    """Source of the yaw rate: `input` for the angular.z of the input, `imu` for the topic imu"""
    gyro_deviation: float = parameter(0.02, unit="rad/s", above=0.0, maximum=10.0)
    """Standard deviation of the IMU's yaw rate if its messages contain no variance above 0"""
    gyro_timeout: float = parameter(0.05, unit="s", above=0.0, maximum=1.0)
    """Limit on the time between a twist and the nearest reading of the IMU"""
    imu_rotation_deg: tuple[float, ...] = parameter((), unit="deg", minimum=-360.0, maximum=360.0)
    """Roll, pitch and yaw of the IMU's axes in base_link; empty if they are equal"""
    odom: bool = parameter(False)
    """Whether the node also publishes the integrated pose on odom and, if tf2_msgs is installed,
    on /tf"""

    def check_consistency(self) -> None:
        """Check that the standard deviations are valid, and given if the source has none."""
        super().check_consistency()
        if self.input_type == "twist_stamped" and not self.deviation:
            raise ConfigurationError("deviation", "is needed: a TwistStamped has no covariance")
        if self.sensor and self.input_type != "twist_with_covariance":
            raise ConfigurationError("input_type", "must be twist_with_covariance for a sensor")
        if len(self.imu_rotation_deg) not in (0, 3):
            raise ConfigurationError("imu_rotation_deg", "must be three angles: roll, pitch, yaw")


class YawRates:
    """Stores the yaw rates of an IMU over a second, and returns the one at the stamp of a twist.

    Args:
        timeout: limit on the time between this stamp and the nearest reading [s].
    """

    def __init__(self, timeout: float) -> None:
        self._timeout_ns = 1e9 * timeout
        self._readings: deque[tuple[int, float]] = deque()

    def add(self, stamp_ns: int, yaw_rate: float) -> None:
        """Store a yaw rate [rad/s]; if its stamp [ns] went back, forget all earlier readings."""
        readings = self._readings
        if readings and stamp_ns <= readings[-1][0]:
            readings.clear()
        readings.append((stamp_ns, yaw_rate))
        while stamp_ns - readings[0][0] > SECOND_NS:
            readings.popleft()

    def at(self, stamp_ns: int) -> float:
        """Return the interpolated yaw rate [rad/s], or that of the nearest reading at either end.

        The result is NaN if no reading is near enough.
        """
        if not self._readings:
            return math.nan
        stamps, rates = zip(*self._readings, strict=True)
        since = np.array(stamps, np.int64) - stamp_ns
        is_near = np.min(np.abs(since)) <= self._timeout_ns
        return float(np.interp(0.0, since, rates)) if is_near else math.nan


class Mounting:
    """Converts the twist of a mounted sensor to that of base_link, Eq. (23)."""

    def __init__(self, mount: Mount) -> None:
        self._mount = mount
        cos, sin = math.cos(mount.heading), math.sin(mount.heading)
        self._matrix = np.array([[cos, -sin, mount.y], [sin, cos, -mount.x], [0.0, 0.0, 1.0]])
        self.is_off_center = bool(mount.x or mount.y)

    def base_twist(
        self, value: FloatArray, covariance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return twist and covariance of base_link, which include the errors of the calibration.

        Args:
            value: (v_x, v_y, yaw rate) in the axes of the sensor [m/s, m/s, rad/s], shape (3,).
            covariance: covariance of `value`, in the squares of its units, shape (3, 3).
        """
        v_x, v_y, yaw_rate = value.tolist()
        mount = self._mount
        errors = np.zeros((3, 4))  # of scale, heading, and lever of each axis
        errors[:2, 0] = mount.scale_error * value[:2]
        errors[:2, 1] = math.radians(mount.heading_error_deg) * np.array([-v_y, v_x])
        errors[0, 2] = errors[1, 3] = mount.lever_error * yaw_rate
        total = self._matrix @ (covariance + errors @ errors.T) @ self._matrix.T
        # Rounding must not make an unmeasured component a measured one.
        unmeasured = np.diagonal(total) > UNMEASURED_VARIANCE * (1.0 - 1e-9)
        total[unmeasured, unmeasured] = np.fmax(total[unmeasured, unmeasured], UNMEASURED_VARIANCE)
        return self._matrix @ value, total


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
    remedy = "correct the source, or set the parameters deviation and replace_covariance"
    for i, j in itertools.permutations(range(3), 2):
        largest, element = math.sqrt(covariance[i, i] * covariance[j, j]), covariance[i, j]
        if not abs(element) < largest:
            names = " and ".join(COMPONENTS[row] for row in sorted((i, j)))
            return (
                f"the covariance of {names} is {element:g}, must be below {largest:g}, the product "
                f"of the standard deviations: {remedy}"
            )
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        return f"the covariance of {', '.join(COMPONENTS)} is not positive definite: {remedy}"
    return ""
