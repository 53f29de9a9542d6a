"""Parameters of the brake assistant."""

import math
from collections.abc import Mapping

from omni_core.brakes import BrakeConfiguration
from omni_core.configuration import Configuration, ConfigurationError, parameter, section
from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics, require_omni_wheels
from omni_core.plugins import check_name
from omni_core.quantities import CONTROL_PERIOD

LAWS = ("sliding_mode", "allocation")
"""Built-in control laws."""

MOST_VALVES = 14
"""Limit on the number of on-off valves. The law `allocation` compares all patterns of open and shut
valves in each step; with this number of valves, a step takes at most half of a control period of 10
ms even on a slow computer."""

MOST_STEPS = 10_000
"""Limit on the number of control steps for which the filters wait for a late twist. Each step goes
through the readings of all of them, which takes less than 1 ms."""

WEIGHTINGS = ("zero", "cosine", "enhanced")
"""Weightings psi of the parallel component; `weighting` has their equations."""

LAW_GROUP = "omni_brake_assist.laws"
"""Group of entry points in which an installed package registers control laws by name."""


class AllocationConfiguration(Configuration):
    """Parameters of the law `allocation`; docs/allocation.md explains the effect of each."""

    target_slip: float = parameter(0.13, minimum=0.01, maximum=1.0)
    """Slip at which a tire transmits its largest force: set-point of wheel-slip control, above
    which a wheel counts as sliding; the wheel model and the published error also depend on it"""
    observer_time: float = parameter(0.025, unit="s", minimum=0.001, maximum=1.0)
    """Time constant of the friction observer, of which those of all other loops are multiples, see
    docs/allocation.md"""
    relaxation_speed: float = parameter(3.0, unit="m/s", minimum=0.0, maximum=100.0)
    """Sliding speed that slip control adds to the set-point until the tire has deflected (tire
    relaxation)"""
    return_share: float = parameter(0.36, minimum=0.01, maximum=10.0)
    """Time constant with which the law corrects heading and direction of motion, as a share of the
    remaining time until standstill"""
    deviation_weight: float = parameter(1.2, minimum=0.0, maximum=1.0e6)
    """Weight of heading and line of motion in the quadratic program, relative to the cost 1 of zero
    deceleration; multiplied by the difference between demanded and achieved yaw or lateral
    acceleration, as a share of what all friction capacities could cause"""
    locked_share: float = parameter(0.02, minimum=0.0, maximum=1.0)
    """Share of a speed. The brake of a wheel stays on if, along its active direction, hub and
    vehicle are slower than this share of the vehicle's speed. A wheel is locked if its rim is
    slower than this share of the speed of a rolling one"""


class BrakeAssistConfiguration(Configuration):
    """Configuration of the brake assistant."""

    wheels: Mapping[str, WheelMount] = parameter()
    """Wheels of the platform, keyed by name; the brake enables have the same order"""
    enabled: bool = parameter(True)
    """Whether the assistant may release brakes; the errors are computed in either case"""
    law: str = parameter("sliding_mode")
    """Control law: `sliding_mode` of the dissertation (2013); `allocation` distributes the braking
    according to the friction capacities of the wheels; `my_module:MyLaw` names your own class, see
    docs/extending.md"""
    weighting: str = parameter("enhanced", choices=WEIGHTINGS)
    """Weighting psi of the parallel component: `zero` keeps the orientation best, `cosine` stops in
    the shortest distance, and `enhanced` is a compromise that depends on `k`"""
    k: int = parameter(7, minimum=1, maximum=999)
    """Tuning constant k of the weighting `enhanced`, an odd number; with a larger k, the weighting
    is closer to `zero`"""
    max_rotation: float = parameter(0.3, unit="deg", minimum=0.0, maximum=360.0)
    """Change of the heading, and change of the direction of motion, up to which the law
    `allocation` makes no correction"""
    nominal_mass: float = parameter(1000.0, unit="kg", above=0.0, maximum=1.0e6)
    """Approximate mass of the vehicle for the brake monitor, and initial value in the law
    `allocation`"""
    wheel_inertia: float = parameter(1.0, unit="kg m^2", minimum=1e-6, maximum=1.0e4)
    """Nominal moment of inertia of a wheel about its axis, for the law `allocation`"""
    brake: BrakeConfiguration = section(BrakeConfiguration)
    """Nominal brake model that the law `allocation` uses for each wheel"""
    allocation: AllocationConfiguration = section(AllocationConfiguration)
    """Parameters of the law `allocation`"""
    control_period: float = parameter(CONTROL_PERIOD, unit="s", minimum=1e-4, maximum=1.0)
    """Time between two steps of the assistant; more frequent IMU readings are integrated over it"""
    minimum_dwell_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Minimum time between two switching operations of a valve; ignored when all brakes must act"""
    pedal_threshold: float = parameter(0.05, above=0.0, maximum=1.0)
    """Smallest pedal position at which the driver is regarded as braking"""
    speed_threshold: float = parameter(0.3, unit="m/s", minimum=0.0, maximum=10.0)
    """Speed of the fastest wheel center below which all brakes are on"""
    speed_hysteresis: float = parameter(0.3, unit="m/s", minimum=0.0, maximum=10.0)
    """Amount by which the speed must rise above the threshold before brakes are released again"""
    minimum_reference_speed: float = parameter(0.1, unit="m/s", above=0.0, maximum=10.0)
    """Speed at the start of braking below which no line of motion is stored"""
    feedback_timeout: float = parameter(0.05, unit="s", above=0.0, maximum=10.0)
    """Limit on the age of the twist, the IMU reading and the wheel speeds; with an older twist all
    brakes are on, unless a current IMU reading allows dead reckoning"""
    maximum_time_step: float = parameter(0.25, unit="s", above=0.0, maximum=60.0)
    """Limit on the time between two demands, and on the time between two twists over which the
    heading is integrated; after a longer time, a new line of motion is stored"""
    recovery_count: int = parameter(3, minimum=1, maximum=1000)
    """Number of consecutive valid twists required before brakes are released, at start-up and
    after a fault"""
    maximum_speed_deviation: float = parameter(0.2, unit="m/s", above=0.0, maximum=100.0)
    """Limit on the standard deviation of the velocity of a valid twist in any direction; with an
    IMU, the limit does not apply, and the twist is weighted by its covariance"""
    maximum_yaw_rate_deviation: float = parameter(0.2, unit="rad/s", above=0.0, maximum=100.0)
    """Limit on the standard deviation of the yaw rate of a valid twist or, with an IMU, of a valid
    estimate"""
    maximum_speed: float = parameter(60.0, unit="m/s", above=0.0, maximum=1000.0)
    """Largest plausible speed of the platform and of the rim of a wheel"""
    maximum_yaw_rate: float = parameter(10.0, unit="rad/s", above=0.0, maximum=100.0)
    """Largest plausible yaw rate"""
    maximum_acceleration: float = parameter(30.0, unit="m/s^2", above=0.0, maximum=1000.0)
    """Largest plausible acceleration between two twists, and largest plausible magnitude of each
    component of the specific force"""
    maximum_yaw_acceleration: float = parameter(60.0, unit="rad/s^2", above=0.0, maximum=1000.0)
    """Largest plausible angular acceleration between two twists"""
    speed_noise: float = parameter(0.3, unit="m/s", minimum=0.0, maximum=100.0)
    """Largest change of the velocity between two twists that is attributed to noise"""
    yaw_rate_noise: float = parameter(0.3, unit="rad/s", minimum=0.0, maximum=100.0)
    """Largest change of the yaw rate between two twists that is attributed to noise"""
    fault_detection: bool = parameter(True)
    """Fault detection: whether twist, IMU and wheel speeds are compared, and replace a missing
    twist, and whether the effect of braking is monitored"""
    imu_x: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Position of the IMU, forward of base_link"""
    imu_y: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Position of the IMU, left of base_link"""
    imu_rotation_deg: tuple[float, ...] = parameter((), unit="deg", minimum=-360.0, maximum=360.0)
    """Roll, pitch and yaw of the IMU's axes in base_link, as `rpy` of a joint in a URDF but in deg;
    empty if the messages have the axes of base_link"""
    shared_gyro: bool = parameter(False)
    """Whether the yaw rate of the twist comes from the assistant's IMU, so that it is no second
    measurement"""
    feedback_delay: float = parameter(0.0, unit="s", minimum=0.0, maximum=0.2)
    """Time from the motion that a twist describes to the stamp of the twist; compensated by
    prediction with the IMU"""
    frozen_time: float = parameter(0.2, unit="s", minimum=0.0, maximum=60.0)
    """Time after which a reading that does not change is implausible while the vehicle brakes (0:
    never): a twist above the speed threshold, or a reading of IMU or encoder other than 0"""

    @property
    def steps_until_twist(self) -> int:
        """Number of control steps for which the filters wait for a late twist."""
        return math.ceil((self.feedback_delay + self.feedback_timeout) / self.control_period)

    def check_consistency(self) -> None:
        """Check law, tuning constant k and timeouts, and that the wheels can brake the platform.

        Raises:
            ConfigurationError: the law is unknown, the vehicle has too many valves for the law, k
                is even, which Eq. (59) excludes, `feedback_timeout` exceeds `maximum_time_step`, or
                delay and timeout last too many control periods, or the rotation of the IMU is
                incomplete.
            UnusablePlatformError: the wheels cannot brake the platform in all three degrees of
                freedom, as section 3.3 of the dissertation requires, or a wheel is conventional
                while the assistant may release brakes or detects faults.
        """
        check_name("law", self.law, LAWS, LAW_GROUP)
        try:
            check_tuning_constant(self.k)
        except ValueError as error:
            raise ConfigurationError("k", str(error)) from None
        if self.feedback_timeout > self.maximum_time_step:
            raise ConfigurationError(
                "feedback_timeout",
                f"{self.feedback_timeout:g} s is longer than maximum_time_step = "
                f"{self.maximum_time_step:g} s, must be at most that",
            )
        if self.steps_until_twist > MOST_STEPS:
            raise ConfigurationError(
                "feedback_delay",
                f"{self.feedback_delay:g} s plus feedback_timeout = {self.feedback_timeout:g} s is "
                f"{self.steps_until_twist} times the control_period = {self.control_period:g} s, "
                f"must be at most {MOST_STEPS} times; shorten the timeout or set the period to the "
                "time between two steps of the assistant",
            )
        wheels = len(self.wheels)
        if self.law == "allocation" and self.brake.is_switched and wheels > MOST_VALVES:
            raise ConfigurationError(
                "law",
                f"allocation compares all patterns of on-off valves, which takes too long for "
                f"{wheels} wheels, must be at most {MOST_VALVES}; use sliding_mode",
            )
        if len(self.imu_rotation_deg) not in (0, 3):
            raise ConfigurationError("imu_rotation_deg", "must be three angles: roll, pitch, yaw")
        PlatformKinematics.of(self.wheels)
        used = (f"the law {self.law}", self.enabled), ("fault_detection", self.fault_detection)
        if required := [name for name, on in used if on]:
            remedy = "; set enabled and fault_detection of the brake assistant to false"
            require_omni_wheels(self.wheels, required[0], remedy)


def check_tuning_constant(k: int) -> None:
    """Raise ValueError unless k is an odd positive integer, as Eq. (59) requires."""
    if k < 1 or k % 2 == 0:
        raise ValueError(f"{k} is not an odd positive whole number, as Eq. (59) needs: 1, 3, 5, 7")
