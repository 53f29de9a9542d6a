"""Input gate: checks of the received twist; unless the twist is valid, all brakes are on.

A twist is valid if it is present, finite, recent, accurate enough, and physically possible after
the last valid twist. A single invalid twist closes the gate. At start-up and after each fault, the
gate opens after a number of consecutive valid twists. Each twist is compared with the last valid
one, and the permitted change grows with time, so that valid data are not rejected for long. With an
IMU, the filter bank weights the twist by its variance and compares it with all other sources. The
limits on the standard deviation and on the change then do not apply.

The gate is one compiled kernel, `check_twist`, which the node, the simulation and the campaigns
share. It stores the number of the violated condition, a row of `conditions.CONDITIONS`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from omni_brake_assist import conditions
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core.kernels import by_reference, lean
from omni_core.quantities import FloatArray, IntArray
from omni_core.signals import MISSING, VALID, ImuSample, TwistSample, WheelSample

_RESOLUTION = 1e-6  # smaller changes are attributed to rounding [m/s], [rad/s]
_LONG_NS = 2**62  # longer than any step, but fits into 64 bits

GATE_STATE = np.dtype(
    [
        ("cause", "i8"),  # condition that closed the gate, GOOD while it is open
        ("value", "f8"),  # value that violated the condition
        ("limit", "f8"),  # limit on this value
        ("within", "f8"),  # duration of the change if the value is a change; otherwise 0 [s]
        ("good", "i8"),  # number of consecutive valid twists since the gate closed
        ("clocked", "?"),  # whether a demand has been received; the next field is its stamp [ns]
        ("now_ns", "i8"),
        ("known", "?"),  # whether a valid twist exists; the next fields are its stamp and value
        ("last_ns", "i8"),
        ("v_x", "f8"),
        ("v_y", "f8"),
        ("yaw_rate", "f8"),
        ("unchanged_ns", "i8"),  # stamp since which the twist has not changed [ns]
    ]
)
"""Data type of the gate's memory, which `assist_state.new_memory` creates."""


@by_reference
class Limits(NamedTuple):
    """Limits within which inputs are valid, and thresholds of the assistant.

    All but `reach` are fields of `BrakeAssistConfiguration` with the same name.

    Attributes:
        maximum_time_step: limit on the time between two demands or two twists [s].
        feedback_timeout: limit on the age of a reading [s].
        maximum_speed_deviation: limit on the standard deviation of the velocity [m/s].
        maximum_yaw_rate_deviation: limit on the standard deviation of the yaw rate [rad/s].
        maximum_speed: limit on the speed [m/s].
        maximum_yaw_rate: limit on the yaw rate [rad/s].
        maximum_acceleration: limit on the acceleration [m/s^2].
        maximum_yaw_acceleration: limit on the yaw acceleration [rad/s^2].
        speed_noise: change of the velocity between two twists that noise may cause [m/s].
        yaw_rate_noise: change of the yaw rate between two twists that noise may cause [rad/s].
        frozen_time: duration after which an unchanged twist is invalid [s], 0 for never.
        speed_threshold: speed of the fastest wheel center below which all brakes act, and an
            unchanged twist remains valid [m/s].
        speed_hysteresis: amount by which the speed must rise above this threshold before brakes are
            released again [m/s].
        pedal_threshold: smallest pedal position at which the driver is regarded as braking [1].
        minimum_reference_speed: speed at the start of braking below which no line of motion is
            stored [m/s].
        reach: distance of the farthest wheel from the center of the wheels [m].
        recovery_count: number of consecutive valid twists that opens the gate.
    """

    maximum_time_step: float
    feedback_timeout: float
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
    speed_hysteresis: float
    pedal_threshold: float
    minimum_reference_speed: float
    reach: float
    recovery_count: int


def make_limits(configuration: BrakeAssistConfiguration, reach: float) -> Limits:
    """Return the limits of a configuration for the kernel.

    Args:
        configuration: configuration of the assistant.
        reach: distance of the farthest wheel from the center of the wheels [m].
    """
    same = {
        name: getattr(configuration, name)
        for name in Limits._fields
        if hasattr(configuration, name)
    }
    return Limits(reach=reach, **same)


@lean
def close_gate(gate: Any, check: int, value: float, limit: float, within: float) -> None:
    """Close the gate because of a violated condition, and set the recovery count to 0.

    Args:
        gate: memory, a record of `GATE_STATE`, changed in place.
        check: violated condition, a row of `conditions.CONDITIONS`.
        value: measured value.
        limit: limit on the value.
        within: time in which the change occurred [s], if the value is a change; otherwise 0.
    """
    gate.cause = check
    gate.value = value
    gate.limit = limit
    gate.within = within
    gate.good = 0


class Others(NamedTuple):
    """Yaw rate, specific force and wheel speeds [rad/s, m/s^2, rad/s], with their last changes.

    Attributes:
        values: readings after their check, NaN where not received, shape (3 + N,).
        seen: readings when they last changed, shape (3 + N,).
        changed_ns: times of these changes [ns], shape (3 + N,).
    """

    values: FloatArray
    seen: FloatArray
    changed_ns: IntArray


@lean
def check_others(
    limits: Limits,
    rim: FloatArray,
    others: Others,
    gate: Any,
    now_ns: int,
    wheels: WheelSample,
    imu: ImuSample,
) -> tuple[bool, bool]:
    """Store wheel speeds and IMU reading; store NaN for values that are old or implausible.

    A value that has not changed for `frozen_time` since `Others.changed_ns` is implausible.

    Args:
        limits: limits within which inputs are valid.
        rim: speed of each rim along the active direction per wheel speed [m], shape (N,).
        others: memory, changed in place.
        gate: memory of the gate, with the stamp of the last demand.
        now_ns: stamp of the demand [ns].
        wheels: latest received wheel speeds.
        imu: IMU reading of the step.

    Returns:
        Whether there is a recent and complete IMU reading; whether a reading has just become stuck.
    """
    inertial, speeds = others.values[:3], others.values[3:]
    known = _is_recent(limits, now_ns, wheels.validity, wheels.stamp_ns)
    for i in range(speeds.size):
        plausible = abs(rim[i] * wheels.speed[i]) <= limits.maximum_speed
        speeds[i] = wheels.speed[i] if known and plausible else math.nan
    known = _is_recent(limits, now_ns, imu.validity, imu.stamp_ns)
    plausible = abs(imu.yaw_rate) <= limits.maximum_yaw_rate
    inertial[0] = imu.yaw_rate if known and plausible else math.nan
    for j in range(2):
        plausible = abs(imu.acceleration[j]) <= limits.maximum_acceleration
        inertial[j + 1] = imu.acceleration[j] if known and plausible else math.nan
    stuck = drop_frozen(limits, others, gate.now_ns, now_ns)
    return math.isfinite(inertial[0] + inertial[1] + inertial[2]), stuck


@lean
def _is_recent(limits: Limits, now_ns: int, validity: int, stamp_ns: int) -> bool:
    """Return whether a reading is valid and its stamp is near `now_ns`."""
    return bool(validity == VALID and abs(since(now_ns, stamp_ns)) / 1e9 <= limits.feedback_timeout)


@lean
def check_twist(
    limits: Limits, gate: Any, now_ns: int, sample: TwistSample, braking: bool, weighed: bool
) -> bool:
    """Check the stamp of a demand and the latest twist, and open or close the gate.

    Args:
        limits: limits within which a twist is valid.
        gate: memory, a record of `GATE_STATE`, changed in place.
        now_ns: stamp of the demand [ns].
        sample: latest twist, possibly the same as in the last call.
        braking: whether the driver brakes; if so, a twist that does not change with time is
            invalid.
        weighed: whether the filter bank compares the twist with the IMU. If so, variance and change
            of the twist are not limited here.

    Returns:
        Whether this twist is valid. The gate is open only if ``gate.cause == GOOD``.
    """
    if not _in_time(limits, gate, now_ns):
        gate.known = False
        return False
    if sample.validity != VALID:
        cause = conditions.ABSENT if sample.validity == MISSING else conditions.UNREADABLE
        close_gate(gate, cause, 0.0, 0.0, 0.0)
        return False
    if not (
        _is_finite(gate, sample)
        and _is_fresh(limits, gate, now_ns, sample.stamp_ns)
        and _is_confident(limits, gate, sample.covariance, weighed)
        and _is_plausible(limits, gate, sample.value)
        and _is_alive(limits, gate, sample, braking)
        and (weighed or _follows(limits, gate, sample))
    ):
        return False
    _accept(limits, gate, sample.stamp_ns, sample.value, braking)
    return True


@lean
def since(later_ns: int, earlier_ns: int) -> int:
    """Return the difference between two stamps [ns], clipped to the range of 64-bit integers."""
    difference = float(later_ns) - float(earlier_ns)
    if difference > _LONG_NS:
        return _LONG_NS
    if difference < -_LONG_NS:
        return -_LONG_NS
    return later_ns - earlier_ns


@lean
def _within(gate: Any, check: int, value: float, limit: float, within: float) -> bool:
    if value <= limit:
        return True
    close_gate(gate, check, value, limit, within)
    return False


@lean
def _in_time(limits: Limits, gate: Any, now_ns: int) -> bool:
    step = since(now_ns, gate.now_ns) / 1e9 if gate.clocked else 0.0
    gate.clocked = True
    gate.now_ns = now_ns
    return bool(
        _within(gate, conditions.DEMAND_BACK, -step, 0.0, 0.0)
        and _within(gate, conditions.DEMAND_LEAP, step, limits.maximum_time_step, 0.0)
    )


@lean
def _is_finite(gate: Any, sample: TwistSample) -> bool:
    for number in sample.value:
        if not math.isfinite(number):
            close_gate(gate, conditions.TWIST_NOT_FINITE, number, 0.0, 0.0)
            return False
    for row in sample.covariance:
        for number in row:
            if not math.isfinite(number):
                close_gate(gate, conditions.COVARIANCE_NOT_FINITE, number, 0.0, 0.0)
                return False
    return True


@lean
def _is_fresh(limits: Limits, gate: Any, now_ns: int, stamp_ns: int) -> bool:
    """Return whether the stamp of a twist [ns] is valid at the time of a demand, `now_ns`.

    The difference between the stamp and `now_ns` must not exceed the timeout. The stamp must not be
    earlier than the stamp of the last valid twist.
    """
    age, timeout = since(now_ns, stamp_ns) / 1e9, limits.feedback_timeout
    earlier = since(gate.last_ns, stamp_ns) / 1e9 if gate.known else 0.0
    return bool(
        _within(gate, conditions.STALE, age, timeout, 0.0)
        and _within(gate, conditions.AHEAD, -age, timeout, 0.0)
        and _within(gate, conditions.BACK, earlier, 0.0, 0.0)
    )


@lean
def _is_confident(limits: Limits, gate: Any, covariance: FloatArray, weighed: bool) -> bool:
    """Return whether the stated covariance of a twist is known and, unless `weighed`, small."""
    xx, yy, ww = covariance[0, 0], covariance[1, 1], covariance[2, 2]
    # ROS messages use a covariance of zeros for "unknown". A negative value counts as unknown too.
    if min(xx, yy, ww) <= 0.0:
        close_gate(gate, conditions.UNKNOWN_VARIANCE, 0.0, 0.0, 0.0)
        return False
    # The largest variance of the velocity in any direction is an eigenvalue.
    across = covariance[0, 1] / 2 + covariance[1, 0] / 2
    worst = xx / 2 + yy / 2 + math.hypot(xx / 2 - yy / 2, across)
    speed, yaw_rate = math.sqrt(worst), math.sqrt(ww)
    speed_limit, yaw_limit = limits.maximum_speed_deviation, limits.maximum_yaw_rate_deviation
    return bool(
        weighed
        or (
            _within(gate, conditions.SPEED_DEVIATION, speed, speed_limit, 0.0)
            and _within(gate, conditions.YAW_RATE_DEVIATION, yaw_rate, yaw_limit, 0.0)
        )
    )


@lean
def _is_plausible(limits: Limits, gate: Any, twist: FloatArray) -> bool:
    """Return whether speed and yaw rate of a twist are within the limits of the vehicle."""
    speed = math.hypot(twist[0], twist[1])
    return bool(
        _within(gate, conditions.TOO_FAST, speed, limits.maximum_speed, 0.0)
        and _within(gate, conditions.TURNS_TOO_FAST, abs(twist[2]), limits.maximum_yaw_rate, 0.0)
    )


@lean
def _is_same(gate: Any, twist: FloatArray) -> bool:
    """Return whether a twist equals the last valid twist."""
    change = max(abs(twist[0] - gate.v_x), abs(twist[1] - gate.v_y), abs(twist[2] - gate.yaw_rate))
    return bool(change < _RESOLUTION)


@lean
def _is_alive(limits: Limits, gate: Any, sample: TwistSample, braking: bool) -> bool:
    """Return whether a twist changes, as the twist of a moving vehicle does while it brakes."""
    twist = sample.value
    speed = math.hypot(twist[0], twist[1]) + abs(twist[2]) * limits.reach
    moving = limits.frozen_time != 0.0 and speed >= limits.speed_threshold
    same = gate.known and braking and moving and _is_same(gate, twist)
    frozen = since(sample.stamp_ns, gate.unchanged_ns) / 1e9 if same else 0.0
    return bool(_within(gate, conditions.FROZEN, frozen, limits.frozen_time, 0.0))


@lean
def _follows(limits: Limits, gate: Any, sample: TwistSample) -> bool:
    """Return whether a twist is physically possible after the last valid twist."""
    stamp_ns, twist = sample.stamp_ns, sample.value
    dt = since(stamp_ns, gate.last_ns) / 1e9
    if not gate.known or dt > limits.maximum_time_step:
        return True  # after this long, any change is possible
    # The body axes have rotated since the last valid twist. Its velocity is therefore transformed
    # to the axes of the new sample; otherwise the rotation would look like an acceleration.
    angle = (gate.yaw_rate + twist[2]) / 2 * dt
    c, s = math.cos(angle), math.sin(angle)
    step = math.hypot(
        twist[0] - (c * gate.v_x + s * gate.v_y), twist[1] - (c * gate.v_y - s * gate.v_x)
    )
    speed_limit = limits.speed_noise + limits.maximum_acceleration * dt
    yaw_limit = limits.yaw_rate_noise + limits.maximum_yaw_acceleration * dt
    return bool(
        _within(gate, conditions.SPEED_STEP, step, speed_limit, dt)
        and _within(gate, conditions.YAW_RATE_STEP, abs(twist[2] - gate.yaw_rate), yaw_limit, dt)
    )


@lean
def drop_frozen(limits: Limits, others: Others, last_ns: int, now_ns: int) -> bool:
    """Replace each reading that has not changed for `frozen_time`, as of a stuck sensor, by NaN.

    A reading of 0 may be constant, because a locked wheel does not turn.

    Args:
        limits: limits within which inputs are valid.
        others: readings, changed in place.
        last_ns: time of the last step [ns].
        now_ns: present time [ns].

    Returns:
        Whether any of these readings was not yet replaced in the last step.
    """
    stuck, (values, seen, changed_ns) = False, others
    for j in range(values.size):
        before = since(last_ns, changed_ns[j]) / 1e9
        if values[j] == 0.0 or not abs(values[j] - seen[j]) < _RESOLUTION:
            seen[j], changed_ns[j] = values[j], now_ns
        if 0.0 < limits.frozen_time < since(now_ns, changed_ns[j]) / 1e9:
            stuck = stuck or before <= limits.frozen_time
            values[j] = math.nan
    return stuck


@lean
def _accept(limits: Limits, gate: Any, stamp_ns: int, twist: FloatArray, braking: bool) -> None:
    """Store a valid twist; open the gate after `recovery_count` valid twists in a row."""
    if gate.known and stamp_ns == gate.last_ns:
        return  # the sample is that of the last call
    if not braking or not gate.known or not _is_same(gate, twist):
        gate.unchanged_ns = stamp_ns
    gate.known = True
    gate.last_ns = stamp_ns
    gate.v_x = twist[0]
    gate.v_y = twist[1]
    gate.yaw_rate = twist[2]
    if gate.cause != conditions.GOOD:
        gate.good += 1
        if gate.good >= limits.recovery_count:
            gate.cause = conditions.GOOD
