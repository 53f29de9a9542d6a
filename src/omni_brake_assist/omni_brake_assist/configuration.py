"""Parameters of the brake assistant."""

from collections.abc import Mapping

from omni_brake_assist.weighting import WEIGHTINGS, check_tuning_constant
from omni_platform.brakes import BrakeConfiguration
from omni_platform.configuration import Configuration, ConfigurationError, parameter, section
from omni_platform.geometry import WheelMount
from omni_platform.kinematics import PlatformKinematics
from omni_platform.plugins import check_name

LAWS = ("sliding_mode", "allocation")
"""Built-in control laws."""

LAW_GROUP = "omni_brake_assist.laws"
"""Entry points under which an installed package offers its laws by name."""


class AllocationConfiguration(Configuration):
    """Parameters of the law `allocation`; docs/allocation.md explains the effect of each."""

    target_slip: float = parameter(0.13, minimum=0.01, maximum=1.0)
    """Slip at which a tire transmits its largest force; used as set-point of slip control, as
    limit of the friction observer, in the wheel model and in the published error"""
    observer_time: float = parameter(0.025, unit="s", minimum=0.001, maximum=1.0)
    """Time constant of the friction observer; disturbances take twice as long, the mass and the
    return of the heading four times"""
    growth_time: float = parameter(0.5, unit="s", minimum=0.01, maximum=100.0)
    """Time constant with which the estimated friction capacity of a wheel grows while all of it
    is used without sliding (probing)"""
    slip_time: float = parameter(0.015, unit="s", minimum=0.001, maximum=1.0)
    """Time constant with which slip control brings the speed of a wheel to its set-point"""
    relaxation_speed: float = parameter(3.0, unit="m/s", minimum=0.0, maximum=100.0)
    """Sliding speed that slip control adds to the set-point until the tire has deflected
    (relaxation)"""
    return_share: float = parameter(0.36, minimum=0.01, maximum=10.0)
    """Time constants of the control barrier function of the heading, as a share of the time left
    until rest"""
    line_time: float = parameter(0.4, unit="s", minimum=0.01, maximum=100.0)
    """Time constant of the control barrier function of the direction of motion"""
    heading_weight: float = parameter(2.0, minimum=0.0, maximum=1.0e6)
    """Cost of a yaw acceleration per unit beyond its bounds in the QP, relative to 1 for no
    deceleration"""
    line_weight: float = parameter(1.5, minimum=0.0, maximum=1.0e6)
    """Cost of a lateral acceleration per unit beyond its bounds in the QP, relative to 1 for no
    deceleration"""
    locked_share: float = parameter(0.02, minimum=0.0, maximum=1.0)
    """Share of the fastest hub's speed along the active direction below which a wheel is locked, as
    the motion does not drive it"""


class BrakeAssistConfiguration(Configuration):
    """Configuration of the brake assistant."""

    wheels: Mapping[str, WheelMount] = parameter()
    """Wheels of the platform by name; their order is that of the brake enables"""
    enabled: bool = parameter(True)
    """Whether brakes may be released; the errors are computed either way"""
    law: str = parameter("sliding_mode")
    """Control law: sliding_mode is that of 2013, allocation distributes the braking between the
    wheels by their friction capacities; my_module:MyLaw is your own class, see
    docs/extending.md"""
    weighting: str = parameter("enhanced", choices=WEIGHTINGS)
    """Weighting psi of the parallel component: zero keeps the orientation best, cosine stops
    shortest, enhanced is between, by k"""
    k: int = parameter(7, minimum=1, maximum=999)
    """Tuning constant of the enhanced weighting, odd; larger is closer to zero"""
    max_rotation: float = parameter(0.3, unit="deg", minimum=0.0, maximum=360.0)
    """Largest change of heading, and of the direction of motion, that the law allocation allows
    in order to stop shorter"""
    nominal_mass: float = parameter(1000.0, unit="kg", above=0.0, maximum=1.0e6)
    """Approximate mass of the vehicle, with which the estimate of the law allocation starts"""
    wheel_inertia: float = parameter(1.0, unit="kg m^2", above=0.0, maximum=1.0e4)
    """Nominal moment of inertia of a wheel about its axis, for the law allocation"""
    brake: BrakeConfiguration = section(BrakeConfiguration)
    """Nominal brake of each wheel, for the law allocation"""
    allocation: AllocationConfiguration = section(AllocationConfiguration)
    """Parameters of the law allocation"""
    minimum_dwell_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Shortest time between two switchings of a valve; ignored if all brakes must act"""
    pedal_threshold: float = parameter(0.05, above=0.0, maximum=1.0)
    """Pedal position from which the driver brakes"""
    speed_threshold: float = parameter(0.3, unit="m/s", minimum=0.0)
    """Speed of the fastest wheel center below which all brakes are on"""
    speed_hysteresis: float = parameter(0.3, unit="m/s", minimum=0.0)
    """Rise of the speed above the threshold at which assistance resumes"""
    minimum_reference_speed: float = parameter(0.1, unit="m/s", above=0.0)
    """Speed at the start of braking below which there is no line to keep"""
    feedback_timeout: float = parameter(0.05, unit="s", above=0.0, maximum=10.0)
    """Largest age of the twist, the IMU reading and the wheel speeds; with a stale twist and a
    current IMU the state is dead_reckoning"""
    maximum_time_step: float = parameter(0.25, unit="s", above=0.0, maximum=60.0)
    """Longest step between demands; after a longer gap in the feedback the change of heading is
    unknown, and a new line of motion is stored"""
    recovery_count: int = parameter(3, minimum=1, maximum=1000)
    """Number of consecutive valid twists before brakes are released, at the start and after a
    fault"""
    maximum_speed_deviation: float = parameter(0.2, unit="m/s", above=0.0)
    """Largest standard deviation of the velocity, in its worst direction; with an IMU a less
    certain twist is used too, weighted by its covariance"""
    maximum_yaw_rate_deviation: float = parameter(0.2, unit="rad/s", above=0.0)
    """Largest standard deviation of the yaw rate"""
    maximum_speed: float = parameter(60.0, unit="m/s", above=0.0)
    """Largest plausible speed of the platform"""
    maximum_yaw_rate: float = parameter(10.0, unit="rad/s", above=0.0)
    """Largest plausible yaw rate"""
    maximum_acceleration: float = parameter(30.0, unit="m/s^2", above=0.0)
    """Largest plausible acceleration between two feedbacks"""
    maximum_yaw_acceleration: float = parameter(60.0, unit="rad/s^2", above=0.0)
    """Largest plausible angular acceleration between two feedbacks"""
    speed_noise: float = parameter(0.3, unit="m/s", minimum=0.0)
    """Step in velocity that noise alone may cause between two feedbacks"""
    yaw_rate_noise: float = parameter(0.3, unit="rad/s", minimum=0.0)
    """Step in yaw rate that noise alone may cause between two feedbacks"""
    fault_detection: bool = parameter(True)
    """Fault detection: whether the twist is compared with IMU and wheel speeds and replaced by
    them if it is missing, and whether the effect of braking is monitored"""
    imu_x: float = parameter(0.0, unit="m")
    """Mounting of the IMU, forward of the platform center"""
    imu_y: float = parameter(0.0, unit="m")
    """Mounting of the IMU, left of the platform center"""
    feedback_delay: float = parameter(0.0, unit="s", minimum=0.0, maximum=0.2)
    """Age of the feedback beyond its stamp; compensated with the IMU"""
    frozen_time: float = parameter(0.2, unit="s", minimum=0.0)
    """Time after which an identical twist is implausible while braking above the speed threshold
    (0: never)"""

    def check_consistency(self) -> None:
        """Refuse a k that Eq. (58) does not allow and a platform that cannot be braked.

        Raises:
            ConfigurationError: the law is unknown, k is even, or `feedback_timeout` exceeds
                `maximum_time_step`.
            UnusablePlatformError: the wheels cannot move, and so not stop, the platform in all
                three degrees of freedom, which section 3.3 requires.
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
        PlatformKinematics.of(self.wheels)
