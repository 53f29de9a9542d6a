"""Detection of a brake without torque from the specific force of the body.

A brake that has lost its torque exerts no force on its wheel, so the friction force of the wheel is
``I/g^2 du/dt`` instead of ``B + I/g^2 du/dt`` (`observers`). In each step, the law compares the
specific force that the IMU measures with ``F/m``, for the sum ``F`` of all friction forces if every
brake works, and for that without the force of one brake. The logarithm of the ratio of both
likelihoods is accumulated for each wheel (Page's cumulative sum, as in `monitors.brake_monitor`).
A reading that is held for several steps counts once, with the mean of the forces in these steps.
A slip of the wheel is evidence that its brake works. A brake with little effect gives no evidence.

A push, or any other external force, changes the specific force too, but in any direction. It is a
further hypothesis, so that a brake only counts as failed if its force explains the change better.

Ice does not look like a failure: a wheel on ice slows down, so its calculated friction force
decreases, too. The mass ``m`` is estimated by recursive least squares over the stop while there is
no evidence of a failure, because an error that is common to all forces must not count as one. The
nominal values of mass, brake torques and wheel inertia therefore only need to be roughly known.
On a slope, or with a tilted sensor, the specific force contradicts the twist, and nothing is
detected.
"""

import math

from omni_brake_assist.filter_bank.state import SHARE
from omni_brake_assist.filter_bank.state import WHEEL as WHEEL_DEVIATION
from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.law import NO_WHEEL, Motion
from omni_brake_assist.laws.observers import LONGEST_DEAD_TIME
from omni_core.kernels import lean
from omni_core.quantities import Pair, Triple

MASS = 0.7
"""Standard deviation of the reciprocal of the mass at the start of a stop, relative to nominal
[1]."""

SLOW = 0.5
"""Smallest speed along the active direction at which rolling and slip are distinguished [m/s]."""
ROLLS = 2.5
"""Deviation of a rim's speed from rolling at which rolling and slip are equally likely, in standard
deviations of a rolling rim [1]."""

_CERTAIN = 0.95  # probability above which a brake counts as failed [1]
# Largest evidence of an external force per correlation time, and largest exponent of the likelihood
# of a reading [1]. The evidence of a lost brake is little larger, so no single reading decides.
_MOST, _LARGEST = 4.0, 0.5
_FORCE = 0.12  # standard deviation of the friction force of a wheel, relative to this force [1]
_LATE = 0.03  # time constant with which a brake may lag behind its nominal force [s]
_VELOCITY = 0.03  # error of the velocity from the specific force that contradicts the twist [m/s]
_ACCELERATION = 0.25  # standard deviation of the specific force, including swaying tires [m/s^2]
_OBSERVABLE = 3.0  # smallest effect of a brake that is evidence, in this unit [1]
_PUSH = 1.0  # standard deviation of the effect of an external force, a tenth of the weight [m/s^2]
_CORRELATION = 0.03  # time over which these errors are correlated [s]
# Time constant with which evidence is forgotten [s]. The evidence of a failure grows faster. Wrong
# forces of locked wheels, for example, may cause little evidence per time, but for a long time.
_FORGET = 0.2


@lean
def observe_brakes(law: Constants, memory: Memory, motion: Motion) -> bool:
    """Update the evidence of a failed brake of each wheel; return whether any brake has failed.

    Args:
        law: constants of the law.
        memory: memory of the law, with the friction forces of the last period.
        motion: motion of the vehicle and its wheels.
    """
    body, wheels = memory.body[0], memory.wheel
    known = math.isfinite(motion.force_x + motion.force_y) and not law.follows
    if not known or motion.failed_brake != NO_WHEEL:
        wheels["lost"][:] = body.pushed = body.span = 0.0
        return False
    if body.span == 0.0:
        body.felt[:] = wheels["impulse"][:] = wheels["spun"][:] = 0.0
    felt, follow = _acceleration(law, memory, motion), 1.0 - math.exp(-body.dt / _LATE)
    body.span += body.dt
    for j in range(2):
        body.felt[j] += felt[j] * body.dt
    for i, wheel in enumerate(wheels):
        wheel.impulse += wheel.measured * body.dt
        wheel.spun += law.wheel_mass[i] * (wheel.speed - wheel.last_speed)
    if motion.new_force:
        _weigh_reading(law, memory)
        body.span = 0.0
    for wheel in wheels:
        wheel.late_brake += follow * (wheel.brake - wheel.late_brake)
    return failed_brake(memory, motion.pedal) != NO_WHEEL


@lean
def _weigh_reading(law: Constants, memory: Memory) -> None:
    """Update the evidence with the mean forces since the last reading of the accelerometer."""
    body, wheels = memory.body[0], memory.wheel
    force_x = force_y = s_xx = s_xy = s_yy = 0.0
    for i, wheel in enumerate(wheels):
        x, y = -wheel.sign * law.active[i, 0], -wheel.sign * law.active[i, 1]
        variance, mean = _variance(law, memory, i), wheel.impulse / body.span
        force_x, force_y = force_x + mean * x, force_y + mean * y
        s_xx, s_xy, s_yy = s_xx + variance * x * x, s_xy + variance * x * y, s_yy + variance * y * y
    force, spread = (force_x, force_y), (s_xx, s_xy, s_yy)
    felt = body.felt[0] / body.span, body.felt[1] / body.span
    pushed = _evidence(memory, felt, force, spread, _PUSH)
    works = max(_evidence(memory, felt, force, spread, 0.0), pushed - _MOST)
    share, largest = min(body.span / _CORRELATION, _LARGEST), 0.0
    kept = math.exp(-body.span / _FORGET)
    body.pushed = max(kept * body.pushed + share * (pushed - works), 0.0)
    # The brake forces are known only if the wheels have responded within the longest dead time.
    begun = body.responded and body.steps * body.dt > LONGEST_DEAD_TIME >= body.dead_time
    for i, wheel in enumerate(wheels):
        x, y = -wheel.sign * law.active[i, 0], -wheel.sign * law.active[i, 1]
        less = (wheel.spun - wheel.impulse) / body.span
        without = force_x + less * x, force_y + less * y
        variance = _variance(law, memory, i)
        known = s_xx - variance * x * x, s_xy - variance * x * y, s_yy - variance * y * y
        slip = (wheel.hub - wheel.speed) / (WHEEL_DEVIATION + SHARE * wheel.hub)
        gained = _evidence(memory, felt, without, known, 0.0) - works
        gained += 0.5 * min(ROLLS**2 - slip**2, 0.0)
        wheel.lost *= kept
        observable = -less * body.inverse_mass > _OBSERVABLE * _ACCELERATION
        if begun and observable and wheel.known and wheel.hub >= SLOW:
            wheel.lost = max(wheel.lost + share * gained, 0.0)
        largest = max(largest, wheel.lost)
    if begun and largest == 0.0:
        _observe_mass(memory, felt, force, spread)


@lean
def _acceleration(law: Constants, memory: Memory, motion: Motion) -> Pair:
    """Return the specific force at the center of the wheels [m/s^2].

    Also update the part of the velocity's change that this force does not explain.
    """
    body, dt, rate = memory.body[0], memory.body[0].dt, motion.yaw_rate
    turn, kept = (rate - body.twist[2]) / dt, math.exp(-dt / _FORGET)
    x = motion.force_x + turn * law.imu_y + rate * rate * law.imu_x
    y = motion.force_y - turn * law.imu_x + rate * rate * law.imu_y
    a_x = (motion.v_x - body.twist[0]) / dt - rate * motion.v_y
    a_y = (motion.v_y - body.twist[1]) / dt + rate * motion.v_x
    body.contradiction[0] = kept * body.contradiction[0] + (a_x - x) * dt
    body.contradiction[1] = kept * body.contradiction[1] + (a_y - y) * dt
    return x, y


@lean
def failed_brake(memory: Memory, pedal: float) -> int:
    """Return the wheel whose brake has failed, or NO_WHEEL; without pedal, delete the evidence."""
    if pedal <= 0.0:
        memory.wheel["lost"][:] = memory.body[0].pushed = 0.0
    # The hypothesis that all brakes work has the ratio 1.
    lost, total = memory.wheel["lost"], 1.0 + math.exp(memory.body[0].pushed)
    for value in lost:
        total += math.exp(value)
    most, error = lost.argmax(), memory.body[0].contradiction
    certain = math.exp(lost[most]) > _CERTAIN * total
    return int(most) if certain and math.hypot(error[0], error[1]) < _VELOCITY else NO_WHEEL


@lean
def _variance(law: Constants, memory: Memory, i: int) -> float:
    """Return the variance of the friction force of a wheel whose brake works [N^2].

    The force of a wheel that does not turn, or whose speed is unknown, may have any value up to the
    capacity.
    """
    wheel = memory.wheel[i]
    turns = max(wheel.speed, wheel.last_speed) > law.locked_share * wheel.hub
    share = _FORCE if wheel.known and turns else 1.0
    mean = wheel.impulse / memory.body[0].span
    return float((share * mean + abs(wheel.brake - wheel.late_brake)) ** 2)


@lean
def _evidence(memory: Memory, felt: Pair, force: Pair, spread: Triple, push: float) -> float:
    """Return the log-likelihood of the measured specific force, except a constant.

    Args:
        memory: memory of the law.
        felt: specific force at the center of the wheels [m/s^2].
        force: sum of the friction forces of all wheels [N].
        spread: covariance (xx, xy, yy) of this sum [N^2].
        push: standard deviation of an external force, relative to the mass [m/s^2].
    """
    body, (x, y), (s_xx, s_xy, s_yy) = memory.body[0], force, spread
    inverse, noise = body.inverse_mass, _ACCELERATION**2 + push**2
    c_xx = noise + inverse**2 * s_xx + body.inverse_variance * x * x
    c_xy = inverse**2 * s_xy + body.inverse_variance * x * y
    c_yy = noise + inverse**2 * s_yy + body.inverse_variance * y * y
    determinant = c_xx * c_yy - c_xy * c_xy
    e_x, e_y = felt[0] - inverse * x, felt[1] - inverse * y
    squares = (c_yy * e_x * e_x - 2.0 * c_xy * e_x * e_y + c_xx * e_y * e_y) / determinant
    return float(-0.5 * (squares + math.log(determinant)))


@lean
def _observe_mass(memory: Memory, felt: Pair, force: Pair, spread: Triple) -> None:
    """Update the reciprocal of the mass and its variance by least squares.

    The arguments are those of `_evidence`.
    """
    body, (x, y), (s_xx, s_xy, s_yy) = memory.body[0], force, spread
    inverse, noise = body.inverse_mass, _ACCELERATION**2
    c_xx, c_yy = noise + inverse**2 * s_xx, noise + inverse**2 * s_yy
    c_xy = inverse**2 * s_xy
    weight = min(body.span / _CORRELATION, 1.0) / (c_xx * c_yy - c_xy * c_xy)
    w_x, w_y = weight * (c_yy * x - c_xy * y), weight * (c_xx * y - c_xy * x)
    body.inverse_variance /= 1.0 + body.inverse_variance * (w_x * x + w_y * y)
    error = w_x * (felt[0] - inverse * x) + w_y * (felt[1] - inverse * y)
    body.inverse_mass = max(inverse + body.inverse_variance * error, 0.1 * inverse)
