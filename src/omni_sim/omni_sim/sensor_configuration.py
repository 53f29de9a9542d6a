"""Parameters of the simulated sensors other than cameras and flow sensors, and of their faults."""

import math

from omni_core.configuration import Configuration, parameter
from omni_core.quantities import SECOND_NS


class EncoderConfiguration(Configuration):
    """Resolution and noise of the wheel encoders; ideal encoders by default."""

    resolution: int = parameter(0, minimum=0, maximum=100_000_000)
    """Counts per wheel revolution (0: infinite resolution)"""
    noise: float = parameter(0.0, unit="rad/s", minimum=0.0, maximum=100.0)
    """Standard deviation of the noise of a measured wheel speed"""


_AVERAGED = 0.01  # time over which the configured noise is averaged [s]


class ImuConfiguration(Configuration):
    """Mounting and errors of the IMU; the defaults describe a good MEMS unit.

    No error may exceed the largest usual measuring ranges of such units, 2000 deg/s and 16 g.
    """

    enabled: bool = parameter(True)
    """Whether the vehicle has an IMU"""
    rate: float = parameter(0.0, unit="Hz", minimum=0.0, maximum=1.0e5)
    """Number of readings per second, at most one in each physics step; 0 for one reading at every
    control stamp"""
    x: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Mounting position, forward of base_link"""
    y: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Mounting position, left of base_link"""
    misalignment_deg: float = parameter(0.2, unit="deg", minimum=-180.0, maximum=180.0)
    """Error of the mounting angle about the vertical axis"""
    gyro_bias: float = parameter(0.005, unit="rad/s", minimum=-35.0, maximum=35.0)
    """Bias of the yaw rate"""
    gyro_noise: float = parameter(0.003, unit="rad/s", minimum=0.0, maximum=35.0)
    """Standard deviation of the white noise of the yaw rate in the mean over 10 ms"""
    gyro_scale: float = parameter(0.002, minimum=-0.9, maximum=10.0)
    """Scale error of the yaw rate"""
    bias_x: float = parameter(0.05, unit="m/s^2", minimum=-160.0, maximum=160.0)
    """Bias of the accelerometer's x axis"""
    bias_y: float = parameter(-0.05, unit="m/s^2", minimum=-160.0, maximum=160.0)
    """Bias of the accelerometer's y axis"""
    noise: float = parameter(0.05, unit="m/s^2", minimum=0.0, maximum=160.0)
    """Standard deviation of the white noise of each accelerometer axis in the mean over 10 ms"""
    scale: float = parameter(0.003, minimum=-0.9, maximum=10.0)
    """Scale error of both accelerometer axes"""
    latency: float = parameter(0.0, unit="s", minimum=0.0, maximum=0.2)
    """Latency of a reading, rounded to the time between two readings"""

    def period_ns(self, control_period_ns: int) -> int:
        """Return the time between two readings for a given control period [ns]."""
        return round(SECOND_NS / self.rate) if self.rate > 0.0 else control_period_ns

    def noise_factor(self, control_period_ns: int) -> float:
        """Return the noise of a reading divided by the configured noise [1]."""
        return math.sqrt(_AVERAGED * SECOND_NS / self.period_ns(control_period_ns))


FAILURES = ("none", "frozen", "zero", "invalid")
"""Kinds of faults: no fault, or the sensor repeats its last reading, reads 0, or reads NaN."""


class VelocitySensorConfiguration(Configuration):
    """Sampling and errors of the velocity sensor; without noise or offset by default."""

    sample_time: float = parameter(0.01, unit="s", minimum=1.0e-6, maximum=10.0)
    """Time between samples; between them, the last sample is repeated"""
    linear_noise: float = parameter(0.0, minimum=0.0, maximum=10.0)
    """Half width of the uniform noise of v_x and v_y, as a share of the true value"""
    yaw_rate_noise: float = parameter(0.0, minimum=0.0, maximum=10.0)
    """Half width of the uniform noise of the yaw rate, as a share of the true value"""
    offset_x: float = parameter(0.0, unit="m/s", minimum=-50.0, maximum=50.0)
    """Constant error of v_x"""
    offset_y: float = parameter(0.0, unit="m/s", minimum=-50.0, maximum=50.0)
    """Constant error of v_y"""
    yaw_rate_offset: float = parameter(0.0, unit="rad/s", minimum=-50.0, maximum=50.0)
    """Constant error of the yaw rate"""
    failure: str = parameter("none", choices=FAILURES)
    """Fault: `frozen` repeats the last reading, `zero` reads 0, `invalid` reads NaN"""
    failure_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=3600.0)
    """Time at which the fault begins"""
    failure_duration: float = parameter(3600.0, unit="s", above=0.0, maximum=3600.0)
    """Duration of the fault"""


CHANNELS = ("twist", "gyro", "accelerometer", "encoder")
"""Channels: velocity sensor, gyro, accelerometer and wheel encoders."""


KINDS = (
    *("offset", "drift", "ramp", "scale", "sine", "noise", "sign", "drop_out", "zero", "stuck"),
    *("stuck_noise", "delay", "swap", "echo", "square", "quantized"),
)
"""Kinds of faults."""


class FaultConfiguration(Configuration):
    """One fault of one sensor."""

    channel: str = parameter(choices=CHANNELS)
    """Channel that is faulty"""
    kind: str = parameter(choices=KINDS)
    """Kind of the fault; omni_sim/faults.py contains the equation of each kind"""
    axis: int = parameter(-1, minimum=-1, maximum=63)
    """Axis of the channel, or index of the wheel; -1 for all axes or wheels"""
    time: float = parameter(0.0, unit="s", minimum=0.0, maximum=3600.0)
    """Onset of the fault"""
    duration: float = parameter(3600.0, unit="s", above=0.0, maximum=3600.0)
    """Duration of the fault"""
    amplitude: float = parameter(0.0, minimum=-1000.0, maximum=1000.0)
    """Size ``a`` in the unit of the channel; in this unit per second for the fault `drift`, and
    without unit for `scale` and `echo`"""
    period: float = parameter(0.1, unit="s", above=0.0, maximum=3600.0)
    """Duration ``T`` of the fault `ramp`, period of `sine` and `square`, or length of `delay`"""
