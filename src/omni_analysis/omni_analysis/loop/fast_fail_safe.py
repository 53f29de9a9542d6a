"""The fail-safe's judgement of the velocity sensor as a compiled kernel, for many runs.

The same checks as `omni_brake_assist.fail_safe.FeedbackMonitor` makes, without the words: of a
feedback that comes with every demand, with the stamp of the demand and the covariance that the
simulator gives its velocity sensor. Tests hold the two together decision by decision.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_sim.simulator import SMALLEST_DEVIATION
from omni_sim.velocity_sensor import VelocitySensorConfiguration

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# The memory from step to step: stamp of the last good feedback [ns], since when it has not
# changed [ns], good feedbacks in a row while there is no trust, whether there is trust, and
# whether there has been a good one at all.
LAST_NS, UNCHANGED_NS, GOOD, TRUSTED, STARTED = range(5)
CLOCK_SIZE = 5


class Judge(NamedTuple):
    """What a feedback must be like; see `BrakeAssistConfiguration`.

    Attributes:
        linear_share: half width of the noise that the sensor says it has on v_x and v_y [1].
        yaw_rate_share: likewise on the yaw rate [1].
        maximum_speed_deviation: [m/s].
        maximum_yaw_rate_deviation: [rad/s].
        maximum_speed: [m/s].
        maximum_yaw_rate: [rad/s].
        maximum_acceleration: [m/s^2].
        maximum_yaw_acceleration: [rad/s^2].
        speed_noise: [m/s].
        yaw_rate_noise: [rad/s].
        frozen_time: [s], 0 for never.
        speed_threshold: [m/s].
        reach: distance of the farthest wheel from the centre [m].
        recovery_count: good feedbacks until there is trust.
        maximum_time_step: [s].
    """

    linear_share: float
    yaw_rate_share: float
    maximum_speed_deviation: float
    maximum_yaw_rate_deviation: float
    maximum_speed: float
    maximum_yaw_rate: float
    maximum_acceleration: float
    maximum_yaw_acceleration: float
    speed_noise: float
    yaw_rate_noise: float
    frozen_time: float
    speed_threshold: float
    reach: float
    recovery_count: int
    maximum_time_step: float


def make_judge(
    limits: BrakeAssistConfiguration, sensor: VelocitySensorConfiguration, reach: float
) -> Judge:
    """Lay out the limits for the kernel.

    Args:
        limits: of the assistant.
        sensor: what gives the feedback.
        reach: distance of the farthest wheel from the centre [m].
    """
    return Judge(
        linear_share=sensor.linear_noise,
        yaw_rate_share=sensor.yaw_rate_noise,
        maximum_speed_deviation=limits.maximum_speed_deviation,
        maximum_yaw_rate_deviation=limits.maximum_yaw_rate_deviation,
        maximum_speed=limits.maximum_speed,
        maximum_yaw_rate=limits.maximum_yaw_rate,
        maximum_acceleration=limits.maximum_acceleration,
        maximum_yaw_acceleration=limits.maximum_yaw_acceleration,
        speed_noise=limits.speed_noise,
        yaw_rate_noise=limits.yaw_rate_noise,
        frozen_time=limits.frozen_time,
        speed_threshold=limits.speed_threshold,
        reach=reach,
        recovery_count=limits.recovery_count,
        maximum_time_step=limits.maximum_time_step,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def judge(
    limits: Judge,
    last: FloatArray,
    clock: IntArray,
    now_ns: int,
    twist: FloatArray,
    braking: bool,
) -> bool:
    """Judge a feedback and remember whether there is trust, ``clock[TRUSTED]``.

    Args:
        limits: what it must be like.
        last: the last good feedback [m/s, m/s, rad/s], zeros at the start, shape (3,).
        clock: memory, zeros at the start, shape (5,).
        now_ns: stamp of demand and feedback [ns].
        twist: the feedback [m/s, m/s, rad/s], shape (3,).
        braking: whether the driver brakes.

    Returns:
        Whether it is good.
    """
    if not (
        _confident(limits, twist)
        and _plausible(limits, twist)
        and (clock[STARTED] == 0 or _follows(limits, last, clock, now_ns, twist, braking))
    ):
        clock[GOOD] = clock[TRUSTED] = 0
        return False
    if not braking or clock[STARTED] == 0 or not _same(twist, last):
        clock[UNCHANGED_NS] = now_ns
    last[:] = twist
    clock[LAST_NS] = now_ns
    clock[STARTED] = 1
    if clock[TRUSTED] == 0:
        clock[GOOD] += 1
        if clock[GOOD] >= limits.recovery_count:
            clock[TRUSTED] = 1
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _same(twist: FloatArray, other: FloatArray) -> bool:
    same: bool = twist[0] == other[0] and twist[1] == other[1] and twist[2] == other[2]
    return same


@njit(cache=True, nogil=True, error_model="numpy")
def _variance(share: float, value: float) -> float:
    """Return the variance of uniform noise, as `Simulator` states it."""
    return max((share * value) ** 2 / 3.0, SMALLEST_DEVIATION**2)


@njit(cache=True, nogil=True, error_model="numpy")
def _confident(limits: Judge, twist: FloatArray) -> bool:
    if not (math.isfinite(twist[0]) and math.isfinite(twist[1]) and math.isfinite(twist[2])):
        return False
    # The axes of the covariance are those of the body: its worst direction is one of them.
    worst = max(_variance(limits.linear_share, twist[0]), _variance(limits.linear_share, twist[1]))
    return (
        math.sqrt(worst) <= limits.maximum_speed_deviation
        and math.sqrt(_variance(limits.yaw_rate_share, twist[2]))
        <= limits.maximum_yaw_rate_deviation
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _plausible(limits: Judge, twist: FloatArray) -> bool:
    return (
        math.hypot(twist[0], twist[1]) <= limits.maximum_speed
        and abs(twist[2]) <= limits.maximum_yaw_rate
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _follows(
    limits: Judge,
    last: FloatArray,
    clock: IntArray,
    now_ns: int,
    twist: FloatArray,
    braking: bool,
) -> bool:
    """Return whether a twist may come after the last good one."""
    elapsed = now_ns - clock[LAST_NS]
    if elapsed > round(limits.maximum_time_step * 1e9):
        return True  # too long ago to say anything
    dt = elapsed / 1e9
    angle = (last[2] + twist[2]) / 2 * dt
    c, s = math.cos(angle), math.sin(angle)
    step = math.hypot(
        twist[0] - (c * last[0] + s * last[1]), twist[1] - (c * last[1] - s * last[0])
    )
    if not (
        step <= limits.speed_noise + limits.maximum_acceleration * dt
        and abs(twist[2] - last[2]) <= limits.yaw_rate_noise + limits.maximum_yaw_acceleration * dt
    ):
        return False
    speed = math.hypot(twist[0], twist[1]) + abs(twist[2]) * limits.reach
    moving = limits.frozen_time != 0.0 and speed >= limits.speed_threshold
    if braking and moving and _same(twist, last):
        return bool((now_ns - clock[UNCHANGED_NS]) / 1e9 <= limits.frozen_time)
    return True
