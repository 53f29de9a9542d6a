"""Parameters of the line-scan odometry."""

import math
from collections.abc import Mapping

from linescan_odometry.twist.least_squares import KinematicsConfiguration, check_placement
from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    check_choice,
    parameter,
    section,
)
from omni_core.quantities import LARGEST_OFFSET
from omni_core.sensors import FlowSensor, LineSensor, Mount

METHODS = ("joint", "pairs")
"""Names of the methods that estimate displacements."""

METRIC_NAMES = ("pearson", "euclidean", "squared_euclidean", "manhattan", "spearman", "cosine")
"""Names of the similarity metrics of the method `pairs`, the keys of `matching.search.METRICS`."""

FEWEST_PIXELS = 32
"""Minimum overlap of two lines for a refinement of their shift [px]."""

_SKEWEST = 30.0  # deg; limit on the angle between camera axis and axis of rotation
_ROUNDING = 1e-6  # deg; error of this angle due to rounding of sine and arcsine


class SideslipWheel(Configuration):
    """Position, direction and camera of a wheel whose sideslip angle is measured."""

    sensor: str = parameter()
    """Line camera next to the wheel, parallel to the wheel's axis of rotation within 30 deg"""
    x: float = parameter(unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the wheel contact, forward of base_link"""
    y: float = parameter(unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the wheel contact, left of base_link"""
    steering_deg: float = parameter(0.0, unit="deg", minimum=-180.0, maximum=180.0)
    """Rolling direction, counter-clockwise from the forward direction"""
    minimum_speed: float = parameter(0.5, unit="m/s", above=0.0, maximum=100.0)
    """Speed of the wheel along its rolling direction below which the angle is undefined"""

    def check_axis(self, sensor: LineSensor) -> None:
        """Check that the camera's axis is nearly parallel to the wheel's axis of rotation.

        Raises:
            ConfigurationError: the angle between the axes is too large.
        """
        along = math.cos(sensor.heading - math.radians(self.steering_deg))
        skew = math.degrees(math.asin(min(1.0, abs(along))))
        if skew > _SKEWEST + _ROUNDING:
            raise ConfigurationError(
                "sensor",
                f"the axis of {self.sensor} is {skew:.1f} deg from the wheel's axis of rotation; "
                f"it must be parallel within {_SKEWEST:g} deg",
            )


class OdometryConfiguration(Configuration):
    """Parameters of displacement search, filters and twist estimation."""

    sensors: Mapping[str, LineSensor] = parameter()
    """Line cameras on the platform: at least three, or two with a kinematic constraint. With flow
    sensors, fewer cameras or none suffice"""
    flow_sensors: Mapping[str, FlowSensor] = section(dict)
    """Optical-flow sensors on the platform; each flow sensor replaces two cameras"""
    method: str = parameter("joint", choices=METHODS)
    """Method that estimates displacements: `joint` maximizes the likelihood of whole batches and
    also estimates the camera's fixed pattern; `pairs` uses line pairs and the median filter of
    section 4.6"""
    metric: str = parameter("pearson", choices=METRIC_NAMES)
    """Similarity metric of lines (section 4.3.2), for the method `pairs`"""
    shift_divisor: float = parameter(2.0, minimum=1.1, maximum=64.0)
    """Divisor k of the limit on the shift between two lines, n / k, where n is the number of
    pixels"""
    search_window: int = parameter(0, unit="px", minimum=0, maximum=16384)
    """Half width of the search range around the last displacement; all shifts are searched with 0,
    and if the best match is at its border or correlates too little"""
    prior_weight: float = parameter(0.0, minimum=0.0, maximum=100.0)
    """Preference for shifts near the last displacement (section 4.6): relative increase of the
    distance measure at a shift that differs from it by the limit on the shift"""
    flat_field_tables: str = parameter("")
    """Folder with the tables of `omni lines reference`, one file <sensor>.npz for each camera that
    has a table; empty for no tables"""
    minimum_correlation: float = parameter(0.4, minimum=0.0, maximum=1.0)
    """Minimum of Pearson's correlation at the best shift of a line pair that is used"""
    median_lines: int = parameter(10, minimum=1, maximum=10000)
    """Number of consecutive displacements whose median rejects outliers (section 4.6)"""
    median_tolerance: float = parameter(1.5, unit="px", above=0.0, maximum=100.0)
    """Difference from the median above which a displacement is an outlier"""
    minimum_inlier_share: float = parameter(0.5, above=0.0, maximum=1.0)
    """Minimum share of usable line pairs in a batch, below which it yields no measurement"""
    maximum_acceleration: float = parameter(50.0, unit="m/s^2", minimum=0.0, maximum=1e6)
    """Limit on the plausible acceleration along a sensor's axis; 0 for no limit"""
    maximum_speed: float = parameter(20.0, unit="m/s", above=0.0, maximum=1000.0)
    """Maximum speed of the vehicle, with which the covariance of the position grows while the
    odometry measures no twist"""
    maximum_yaw_rate: float = parameter(10.0, unit="rad/s", above=0.0, maximum=1000.0)
    """Maximum yaw rate of the vehicle, with which the variance of the yaw angle grows while the
    odometry measures no twist"""
    cover_detection: bool = parameter(True)
    """Whether a camera is rejected (covered, or oblique texture) if its view does not change while
    the platform moves across its axis; false for grounds with stripes along the path"""
    contradiction_limit: float = parameter(8.0, minimum=0.0, maximum=1000.0)
    """Limit on the deviation of a sensor from the twist of all sensors, in standard deviations;
    beyond it, the sensor is excluded (five or more sensors) or the covariance grows (four); 0 for
    no limit"""
    maximum_skew: float = parameter(0.005, unit="s", above=0.0, maximum=10.0)
    """Limit on the difference between the stamps of batches that are used together; without line
    cameras at least 3/4 of the period of the fastest flow sensor"""
    minimum_lever: float = parameter(0.02, unit="m", above=0.0, maximum=10.0)
    """Minimum effective lever arm (RMS) that the sensors need to measure the yaw rate"""
    kinematics: KinematicsConfiguration = section(KinematicsConfiguration)
    """Kinematic constraint: a direction in which the vehicle cannot move while its wheels grip"""
    sideslip: Mapping[str, SideslipWheel] = section(dict)
    """Wheels whose sideslip angles are measured"""

    @property
    def all_sensors(self) -> dict[str, Mount]:
        """All sensors, keyed by name: line cameras, then flow sensors."""
        return {**self.sensors, **self.flow_sensors}

    @property
    def is_steered(self) -> bool:
        """Whether a sensor is on a steered carrier."""
        return any(sensor.carrier for sensor in self.all_sensors.values())

    def shift_limit(self, sensor: LineSensor) -> int:
        """Return the limit on the shift [px]: number of pixels / `shift_divisor`, rounded down."""
        return int(sensor.pixels / self.shift_divisor)

    def check_consistency(self) -> None:
        """Check that the placement of the sensors and the line lengths suffice for a twist.

        Raises:
            ConfigurationError: a placement or length is invalid; the message names the sensors.
        """
        self.check_placement()
        self._check_sideslip()
        for name, sensor in self.sensors.items():
            overlap = sensor.pixels - self.shift_limit(sensor)
            if overlap < FEWEST_PIXELS:
                raise ConfigurationError(
                    f"sensors.{name}.pixels",
                    f"{sensor.pixels} px leave an overlap of {overlap} px at the shift limit, "
                    f"which must be at least {FEWEST_PIXELS} px",
                )
            if self.maximum_skew * sensor.line_rate < 1.0:
                raise ConfigurationError(
                    "maximum_skew",
                    f"{self.maximum_skew:g} s is shorter than the line period of sensor {name}, "
                    f"{1.0 / sensor.line_rate:g} s",
                )

    @property
    def skew(self) -> float:
        """Limit on the difference between the stamps of measurements that are used together [s].

        With cameras, this is `maximum_skew`. Without cameras, each flow sensor measures at its own
        times, so the stamps of two sensors with equal rates differ by up to half a period. The
        limit is then at least three quarters of a period, so that jitter of the stamps does not
        cause lost measurements.
        """
        rates = [sensor.rate for sensor in self.flow_sensors.values()]
        if self.sensors or not rates:
            return self.maximum_skew
        return max(self.maximum_skew, 0.75 / max(rates))

    def check_placement(self) -> None:
        """Check that the sensors together measure every planar motion.

        Raises:
            ConfigurationError: the placement is singular; the message names the sensors.
        """
        both = self.sensors.keys() & self.flow_sensors.keys()
        if both:
            raise ConfigurationError(
                f"flow_sensors.{min(both)}",
                "is also the name of a line camera; choose another name",
            )
        check_placement(self.all_sensors, self.minimum_lever, self.kinematics.axle)

    def _check_sideslip(self) -> None:
        for name, wheel in self.sideslip.items():
            check_choice(f"sideslip.{name}.sensor", wheel.sensor, self.sensors)
            try:
                wheel.check_axis(self.sensors[wheel.sensor])
            except ConfigurationError as error:
                raise error.below(f"sideslip.{name}") from None
