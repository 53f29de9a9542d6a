"""Parameters of the line-scan odometry."""

from collections.abc import Mapping

from linescan_odometry.matching.search import METRICS
from linescan_odometry.matching.subpixel import FEWEST_PIXELS
from linescan_odometry.sideslip.angle import SideslipWheel, check_axis
from linescan_odometry.twist.kinematics import KinematicsConfiguration
from linescan_odometry.twist.least_squares import check_placement
from omni_platform.configuration import (
    Configuration,
    ConfigurationError,
    check_choice,
    parameter,
    section,
)
from omni_platform.sensors import FlowSensor, LineSensor, Mount

METHODS = ("joint", "pairs")
"""Estimators of displacements by name."""


class OdometryConfiguration(Configuration):
    """Parameters of displacement search, filters and twist estimation."""

    sensors: Mapping[str, LineSensor] = parameter(
        description="Line cameras on the platform: three or more, or two with a constraint of the "
        "kinematics; fewer or none in addition to flow sensors"
    )
    flow_sensors: Mapping[str, FlowSensor] = section(
        dict,
        description="Optical-flow sensors on the platform, each of which counts as two cameras",
    )
    method: str = parameter(
        "joint",
        description="Estimator of displacements: `joint`, the likelihood of whole batches together "
        "with the fixed pattern of the camera; `pairs`, pairs of lines and the median of section "
        "4.4 alone",
        choices=METHODS,
    )
    metric: str = parameter(
        "pearson",
        description="Distance between lines (section 4.3.2)",
        choices=tuple(METRICS),
    )
    shift_divisor: float = parameter(
        2.0,
        description="k: the shift search is limited to pixels / k",
        minimum=1.1,
        maximum=64.0,
    )
    search_window: int = parameter(
        0,
        description="Half width of the search around the last displacement; beyond it, or with a "
        "poor peak, the full search follows; 0 for the full search always",
        unit="px",
        minimum=0,
        maximum=16384,
    )
    prior_weight: float = parameter(
        0.0,
        description="Relative increase of the distance between lines at the shift limit away from "
        "the displacement before (section 4.6); 0 for none",
        minimum=0.0,
        maximum=100.0,
    )
    flat_field_tables: str = parameter(
        "",
        description="Folder of the tables that `omni lines reference` made of dark and white "
        "references or of a drive, a file <sensor>.npz for each camera that has one; empty for "
        "none",
    )
    minimum_correlation: float = parameter(
        0.4,
        description="Pearson's correlation at the peak below which a line pair is not used",
        minimum=0.0,
        maximum=1.0,
    )
    peak_recovery: int = parameter(
        4,
        description="Distance from the whole pixel within which a peak displaced by noise is "
        "searched again on smoothed lines; 0 for no recovery",
        unit="px",
        minimum=0,
        maximum=16,
    )
    median_lines: int = parameter(
        10,
        description="n: consecutive displacements whose median rejects outliers (section 4.6)",
        minimum=1,
        maximum=10000,
    )
    median_tolerance: float = parameter(
        1.5,
        description="Distance from the median beyond which a displacement is an outlier",
        unit="px",
        above=0.0,
        maximum=100.0,
    )
    minimum_inlier_share: float = parameter(
        0.5,
        description="Share of usable line pairs below which a sensor has not measured",
        above=0.0,
        maximum=1.0,
    )
    maximum_acceleration: float = parameter(
        50.0,
        description="Largest plausible acceleration along a sensor's axis; 0 for no limit",
        unit="m/s^2",
        minimum=0.0,
        maximum=1e6,
    )
    maximum_speed: float = parameter(
        20.0,
        description="Largest speed of the vehicle, which increases the covariance of the pose "
        "while the twist is not measured",
        unit="m/s",
        above=0.0,
        maximum=1000.0,
    )
    maximum_yaw_rate: float = parameter(
        10.0,
        description="Largest yaw rate of the vehicle, which increases the variance of the yaw "
        "while the twist is not measured",
        unit="rad/s",
        above=0.0,
        maximum=1000.0,
    )
    cover_detection: bool = parameter(
        True,
        description="Whether a camera counts as covered, or as misled by an oblique texture, "
        "if its view stays the same while the platform moves across its axis; "
        "switch it off for grounds with stripes along the path",
    )
    contradiction_limit: float = parameter(
        8.0,
        description="Standard deviations by which a sensor may contradict the others before it is "
        "left out (five sensors and more) or the covariance grows (four); 0 for no limit",
        minimum=0.0,
        maximum=1000.0,
    )
    maximum_skew: float = parameter(
        0.005,
        description="Largest difference between the stamps of batches that belong together",
        unit="s",
        above=0.0,
        maximum=10.0,
    )
    minimum_lever: float = parameter(
        0.02,
        description="Smallest effective lever (RMS) of the sensors for the yaw rate",
        unit="m",
        above=0.0,
        maximum=10.0,
    )
    kinematics: KinematicsConfiguration = section(
        KinematicsConfiguration,
        description="Degree of freedom that the vehicle does not have while its wheels grip",
    )
    sideslip: Mapping[str, SideslipWheel] = section(
        dict, description="Wheels whose sideslip angle is measured"
    )

    @property
    def all_sensors(self) -> dict[str, Mount]:
        """Line cameras, then flow sensors, by name."""
        return {**self.sensors, **self.flow_sensors}

    def shift_limit(self, sensor: LineSensor) -> int:
        """Return the largest shift of the search, n / k rounded down [px]."""
        return int(sensor.pixels / self.shift_divisor)

    def check_consistency(self) -> None:
        """Refuse placements and line lengths that do not determine a twist.

        Raises:
            ConfigurationError: a placement or length is invalid; names the sensors.
        """
        self.check_placement()
        self._check_sideslip()
        for name, sensor in self.sensors.items():
            overlap = sensor.pixels - self.shift_limit(sensor)
            if overlap < FEWEST_PIXELS:
                raise ConfigurationError(
                    f"sensors.{name}.pixels",
                    f"{sensor.pixels} px leave an overlap of {overlap} px at the shift limit, "
                    f"must be at least {FEWEST_PIXELS} px",
                )
            if self.maximum_skew * sensor.line_rate < 1.0:
                raise ConfigurationError(
                    "maximum_skew",
                    f"{self.maximum_skew:g} s is shorter than the line period of sensor {name}, "
                    f"{1.0 / sensor.line_rate:g} s",
                )

    def check_placement(self) -> None:
        """Refuse sensors that do not measure every motion.

        Raises:
            ConfigurationError: the placement is singular; names the sensors.
        """
        both = self.sensors.keys() & self.flow_sensors.keys()
        if both:
            raise ConfigurationError(
                f"flow_sensors.{min(both)}", "is the name of a line camera too; choose another one"
            )
        check_placement(self.all_sensors, self.minimum_lever, self.kinematics.axle)

    def _check_sideslip(self) -> None:
        for name, wheel in self.sideslip.items():
            check_choice(f"sideslip.{name}.sensor", wheel.sensor, self.sensors)
            try:
                check_axis(wheel, self.sensors[wheel.sensor])
            except ConfigurationError as error:
                raise error.below(f"sideslip.{name}") from None
