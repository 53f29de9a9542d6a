"""Control allocation: forces of the wheels that stop the vehicle shortest on its heading and line.

A wheel's speed tells its friction, ``f = (T + I dw/dt) / g``, and true ground speed tells its slip,
so a single slide shows what a wheel can bear: no mass, load or tire need be known. At every step

1. the forces of the last period are observed, and capacities of wheels near the peak learned,
2. what the forces do not explain of yaw and lateral acceleration is taken for a disturbance (a
   center of gravity off the center, a slope, wheels that stand and hold against a push),
3. bounded least squares find the forces with the largest deceleration; if heading or line would
   leave what `max_rotation` allows, their rates are brought back as equations of high weight,
4. each force becomes a torque, and slip is held at its target by the wheel's speed; on-off valves
   take the pattern that is predicted to come nearest instead.

A wheel that the motion hardly drags along its active direction is locked: its friction holds
against any drift and takes energy from it. A dead time of the brakes beyond the nominal one shows
at the start of a stop, in wheels that roll on. A wheel whose speed is not known is taken to roll,
by less torque than it last bore. docs/allocation.md derives all this.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws.box_least_squares import box_least_squares
from omni_brake_assist.laws.law import ASSIST, NO_HELP, Motion
from omni_brake_assist.laws.wheel_model import (
    QUEUE,
    BrakedWheel,
    NominalBrake,
    asked_at,
    lagged,
    turn_on,
)
from omni_platform.geometry import PlatformGeometry, cross
from omni_platform.kernels import kernel, lean, njit
from omni_platform.quantities import FloatArray

_GRAVITY = 9.81
_PERIOD = 0.01  # of control, where no time has passed yet [s]
_SLIP, _VALVE_SLIP = 0.13, 0.15  # targets, of which valves are too coarse to keep the lower one [1]
_STANDING = 0.02  # share of the fastest hub's speed below which a wheel is locked [1]
_FORCE_SHARE = 0.7  # of a newly observed force [1]
_LEARNING_TIME = 0.03  # of a capacity, down to what a slide shows [s]
_GROWTH_TIME = 0.3  # of a capacity that was reached without a slide [s]
_SHY_STEPS = 3  # at the start, in which nothing is learned of capacities
_DISTURBANCE_TIME = 0.04  # [s]
_MASS_TIME = 0.1  # [s]
_MASS_STEPS = 8  # after which a mass is believed
_MASS_RANGE = 5.0  # the mass is within this factor of the nominal one [1]
_LINE_TIME = 0.4  # in which a drift is to end [s]
_LARGEST_ASIDE = 5.0  # lateral acceleration that may be asked for [m/s^2]
# In which a yaw rate is to be within its limit, and of the approach to the limit of the heading: at
# least [s], at most [s], and of what is left of the stop [1].
_YAW_TIME, _YAW_LONGEST, _YAW_SHARE = 0.1, 0.6, 0.4
_HEADING_TIME, _HEADING_LONGEST, _HEADING_SHARE = 0.15, 0.9, 0.6
_FIRM_TIME, _FIRM_SHARE = 0.4, 0.4  # likewise of a turn that the limit has room for
_FIRM_TURN = 1.6  # yaw deceleration that such a turn needs, at most [rad/s^2]
_GENTLE_TURN = 0.5  # yaw deceleration towards the limit, at least [rad/s^2]
_LEAST_TURN = math.radians(0.5)  # that may be spent on either side [rad]
_TURN_TIME = 1.0  # for which the yaw rate of the start may go on [s]
_HEADINGS = 8  # compared on either side
_TURN_RESERVE = 1.0  # of the yaw deceleration that the start of a turn needs [1]
_TURN_WEIGHT, _LINE_WEIGHT = 300.0, 12.0  # beside a weight of 1 of the deceleration
_LINE_SPENT = 11.0  # less, where heading may be spent for distance
_REGULAR = 1e-3
_SERVO_TIME = 0.015  # in which a wheel is brought to its slip [s]
_FORESIGHT = 0.3  # share of the missing force that will be there on average in a period [1]
_AT_BOUND = 0.98
_UNKNOWN_SHARE = 0.8  # of its capacity that is asked of a wheel whose speed is not known [1]
_PUSH = 3.0  # sliding speed beyond that at the target while there is no force yet [m/s]
_RISING = 0.01  # share of its capacity by which a force grows while it builds up in a period [1]
_RISE_STEPS = 2.0  # for which a force that builds up is believed to do so at least
_SHORT_STOP = 0.22  # in which tires take a good part of the time to deflect [s]
_SHORT_SPENT = 0.34  # longer, where heading may be spent for distance [s]
_MUCH_ROTATION = math.radians(5.0)  # that is spent, of the direction of motion at most [rad]
_SHORT_SLIDE = 0.3  # sliding speed times hub speed, in such a stop, at least [m^2/s^2]
_ANSWER = 0.3  # share of the expected loss of wheel speed that shows a brake acting [1]
_PLAIN = 0.02  # share of the wheels' speed from which on such a loss is plain to see [1]
_LONGEST_DELAY = 0.15  # that is learned beyond the nominal one [s]
_HOLD = 0.5  # share of the capacity of a standing wheel that is relied on [1]
_LEAST_SHARE = 0.01  # of the last brake that is on [1]
_HORIZON = 3  # periods over which the pattern of valves is predicted
_MOST_PATTERNS = 8  # wheels of which all patterns are compared
_VALVE_TURN_WEIGHT, _VALVE_LINE_WEIGHT = 30.0, 20.0
_DEEP_WEIGHT = 0.06  # of wheels below the speed at their slip, which take time to come back

WHEEL = np.dtype(
    [
        ("speed", "f8"),  # of the last step [rad/s]
        ("torque", "f8"),  # of the nominal brake now [N m]
        ("mean", "f8"),  # likewise over the period to come
        ("force", "f8"),  # observed, at least 0 [N]
        ("risen", "f8"),  # by how much in the last period [N]
        ("capacity", "f8"),  # [N]
        ("wanted", "f8"),  # [N]
        ("told", "f8"),  # as torque, if the brake needs no longer than its nominal dead time [N m]
    ]
)
BODY = np.dtype(
    [
        ("steps", "i8"),  # since the start of braking
        ("heading", "f8"),  # since then [rad]
        ("v_x", "f8"),  # of the last step [m/s]
        ("v_y", "f8"),
        ("yaw_rate", "f8"),
        ("most", "f8"),  # of the heading that may be spent [rad]
        ("least", "f8"),
        ("turn_limit", "f8"),  # yaw deceleration that the limit is approached with [rad/s^2]
        ("turning", "f8"),  # yaw acceleration that the forces do not explain [rad/s^2]
        ("aside", "f8"),  # lateral acceleration, likewise [m/s^2]
        ("mass", "f8"),  # learned [kg]
        ("slowing", "f8"),  # magnitude of the acceleration [m/s^2]
        ("pull", "f8"),  # magnitude of the forces' sum [N]
        ("left", "f8"),  # time that the stop would take with all capacities along it [s]
        ("whole", "f8"),  # likewise at its start [s]
        ("delay", "f8"),  # dead time of the brakes, at least the nominal one [s]
        ("answered", "?"),  # whether the wheels have been seen to answer
    ]
)


class Constants(NamedTuple):
    """What the law is made of.

    Attributes:
        n_x: active directions [1], shape (N,).
        n_y: likewise.
        lever: ``cross(r_i, n_wi)`` [m], shape (N,).
        rim: ``r_i (n_wi . u_i)``, with its sign [m], shape (N,).
        radius: [m], shape (N,).
        gyration: assumed square of the radius of gyration [m^2].
        inertia: nominal, of a wheel [kg m^2].
        mass: nominal, of the vehicle [kg].
        max_rotation: allowed change of heading, and of the direction of motion [rad].
        slip: target [1].
        short_stop: in which wheels are locked at once [s].
        line_weight: of a broken bound of the line, beside 1 of the deceleration [1].
        brake: nominal.
    """

    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    rim: FloatArray
    radius: FloatArray
    gyration: float
    inertia: float
    mass: float
    max_rotation: float
    slip: float
    short_stop: float
    line_weight: float
    brake: NominalBrake


class Memory(NamedTuple):
    """What the law remembers.

    Attributes:
        body: of `BODY`, shape (1,).
        wheel: of `WHEEL`, shape (N,).
        sent: torques asked of the brakes by step, a ring, shape (QUEUE, N).
    """

    body: NDArray[np.void]
    wheel: NDArray[np.void]
    sent: FloatArray


def make_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> Constants:
    """Lay out a configuration for the kernel."""
    n_x, n_y = np.ascontiguousarray(geometry.active.T)
    brake = configuration.brake
    max_rotation = math.radians(configuration.max_rotation)
    spent = min(max_rotation / _MUCH_ROTATION, 1.0)
    return Constants(
        n_x,
        n_y,
        cross(geometry.position, geometry.active),
        geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1),
        geometry.radius.copy(),
        0.5 * float(np.mean(np.sum(geometry.position**2, axis=1))),
        configuration.wheel_inertia,
        configuration.nominal_mass,
        max_rotation,
        _VALVE_SLIP if brake.grain >= 1.0 else _SLIP,
        _SHORT_STOP + _SHORT_SPENT * spent,
        _LINE_WEIGHT - _LINE_SPENT * spent,
        NominalBrake(brake.max_torque, brake.dead_time, brake.time_constant, brake.grain),
    )


def new_memory(wheels: int) -> Memory:
    """Return the memory of a law that has not been asked anything."""
    return Memory(np.zeros(1, BODY), np.zeros(wheels, WHEEL), np.zeros((QUEUE, wheels)))


class _Wheels(NamedTuple):
    """The wheels at a step, in the sense in which each rolls, all of shape (N,).

    Attributes:
        sign: of the hub's velocity along the active direction [1].
        hub: its magnitude [m/s].
        spin: wheel speed, at least 0 [rad/s].
        slip: Eq. (20) [1].
        rim: lever [m].
        stands: whether the motion hardly drags it [1].
        known: whether its speed is; else it is taken to roll [1].
    """

    sign: FloatArray
    hub: FloatArray
    spin: FloatArray
    slip: FloatArray
    rim: FloatArray
    stands: FloatArray
    known: NDArray[np.bool_]


@kernel  # it is handed arrays by what it calls, and must free them
def step(
    law: Constants, memory: Memory, motion: Motion, error: FloatArray, enable: FloatArray
) -> int:
    """Share the braking between the wheels; arguments as `Law.step`.

    The error of a wheel is its sliding speed less that at the target slip [m/s].
    """
    if motion.pedal <= 0.0:
        return NO_HELP
    body = memory.body[0]
    first = motion.first
    if first:
        _start(law, memory, motion)
    unknown = 0
    for i in range(error.size):
        unknown += not math.isfinite(motion.wheel_speed[i])
    if unknown > 1 or (unknown == 1 and body.steps <= _SHY_STEPS):
        return NO_HELP  # one wheel may be taken to roll, if it has been known
    wheels = _look(law, motion)
    if not first:
        if not body.answered:
            _await(law, memory, motion, wheels)
        _observe(law, memory, motion, wheels)
        _explain(law, memory, motion, wheels)
    _learn(law, memory, wheels)
    body.v_x, body.v_y, body.yaw_rate = motion.v_x, motion.v_y, motion.yaw_rate
    for i in range(error.size):
        memory.wheel[i].speed = motion.wheel_speed[i]
        sliding = wheels.hub[i] - wheels.rim[i] * wheels.spin[i]
        error[i] = sliding - law.slip * law.radius[i] * wheels.spin[i]
    total = 1e-9
    for i in range(error.size):
        total += memory.wheel[i].capacity
    task = _task(law, memory, motion, wheels, total)
    _allocate(law, memory, wheels, task, total)
    if law.brake.grain >= 1.0:
        _choose(law, memory, motion, wheels, task, enable)
    else:
        _share_out(law, memory, motion, wheels, enable)
    _remember(law, memory, motion, enable)
    body.steps += 1
    return ASSIST


@lean
def _start(law: Constants, memory: Memory, motion: Motion) -> None:
    """Forget everything but the guess that the wheels share the nominal mass."""
    body, wheel = memory.body[0], memory.wheel
    body.steps = 0
    body.heading = body.turning = body.aside = body.slowing = body.pull = 0.0
    body.mass = law.mass
    body.delay, body.answered = law.brake.dead_time, False
    need = _TURN_RESERVE * motion.yaw_rate**2 / (2.0 * max(law.max_rotation, 1e-3))
    body.turn_limit = max(_GENTLE_TURN, need)
    _limit_heading(law, body, motion)
    memory.sent[:] = 0.0
    for i in range(wheel.size):
        wheel[i].torque = wheel[i].mean = wheel[i].force = wheel[i].risen = 0.0
        wheel[i].told = 0.0
        wheel[i].capacity = wheel[i].wanted = law.mass * _GRAVITY / wheel.size


@lean
def _limit_heading(law: Constants, body: Any, motion: Motion) -> None:
    """Allow a turn towards where the wheels brake more, and one that is going on.

    Elsewhere heading would be spent without gain: a Mecanum vehicle brakes best along its axes.
    """
    best, place = 0.0, 0.0
    reach = min(law.max_rotation, 0.5 * math.pi) / _HEADINGS
    for k in range(2 * _HEADINGS + 1):  # the nearest first
        heading = reach * ((k + 1) // 2) * (1.0 if k % 2 else -1.0)
        cos, sin = math.cos(heading), math.sin(heading)
        v_x, v_y = cos * motion.v_x + sin * motion.v_y, cos * motion.v_y - sin * motion.v_x
        dragged = 0.0
        for i in range(law.rim.size):
            dragged += abs(law.n_x[i] * v_x + law.n_y[i] * v_y)
        if dragged > (1.0 + 1e-6) * best:
            best, place = dragged, heading
    spin = _TURN_TIME * motion.yaw_rate
    body.most = min(max(place, spin, 0.0) + _LEAST_TURN, law.max_rotation)
    body.least = max(min(place, spin, 0.0) - _LEAST_TURN, -law.max_rotation)


@kernel
def _look(law: Constants, motion: Motion) -> _Wheels:
    n = law.rim.size
    sign, hub, spin, slip = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    rim, stands, known = np.abs(law.rim), np.zeros(n), np.zeros(n, np.bool_)
    fastest = 0.0
    for i in range(n):
        w = law.n_x[i] * motion.v_x + law.n_y[i] * motion.v_y + law.lever[i] * motion.yaw_rate
        hub[i] = abs(w)
        sign[i] = 1.0 if w >= 0.0 else -1.0
        turning = sign[i] if law.rim[i] >= 0.0 else -sign[i]
        known[i] = math.isfinite(motion.wheel_speed[i])
        spin[i] = max(turning * motion.wheel_speed[i], 0.0) if known[i] else hub[i] / rim[i]
        slip[i] = (hub[i] - rim[i] * spin[i]) / (law.radius[i] * spin[i] + 1e-3)
        fastest = max(fastest, hub[i])
    for i in range(n):
        stands[i] = 1.0 if hub[i] <= _STANDING * fastest else 0.0
    return _Wheels(sign, hub, spin, slip, rim, stands, known)


@lean
def _await(law: Constants, memory: Memory, motion: Motion, wheels: _Wheels) -> None:
    """Wait for the wheels to answer the first torque; what they take longer is dead time.

    As long as they do not slow down, nothing of what has been asked has arrived.
    """
    body, dt = memory.body[0], motion.dt
    expected, seen, total = 0.0, 0.0, 0.0
    newest = int(body.steps % QUEUE) - 1
    for i in range(law.rim.size):
        wheel = memory.wheel[i]
        turning = wheels.sign[i] if law.rim[i] >= 0.0 else -wheels.sign[i]
        before = turning * wheel.speed
        asked = asked_at(memory.sent, newest, law.brake.dead_time / dt, i)
        wheel.told, mean = lagged(law.brake, wheel.told, asked, dt)
        if wheels.known[i] and before > 0.0 and wheels.stands[i] == 0.0:
            after, _ = turn_on(_braked(law, memory, wheels, i), before, mean, wheels.hub[i], dt)
            expected += before - after
            seen += before - wheels.spin[i]
            total += before
    late = body.delay - law.brake.dead_time
    if expected <= _PLAIN * total and late == 0.0:
        return  # too little to tell
    body.answered = seen > _ANSWER * expected or late > _LONGEST_DELAY
    if not body.answered:
        body.delay += dt
    for i in range(law.rim.size):
        wheel = memory.wheel[i]
        asked = asked_at(memory.sent, newest, body.delay / dt, i) if body.answered else 0.0
        wheel.torque, wheel.mean = lagged(law.brake, 0.0, asked, dt)


@lean
def _observe(law: Constants, memory: Memory, motion: Motion, wheels: _Wheels) -> None:
    """Observe the forces of the last period: ``f = (T + I dw/dt) / g``."""
    for i in range(law.rim.size):
        wheel = memory.wheel[i]
        turning = wheels.sign[i] if law.rim[i] >= 0.0 else -wheels.sign[i]
        before = max(turning * wheel.speed, 0.0) if math.isfinite(wheel.speed) else wheels.spin[i]
        least = 0.01 * wheels.hub[i] / wheels.rim[i]
        if wheels.stands[i] != 0.0:
            seen = 0.0  # what holds against a push is left to the disturbance
        elif wheels.spin[i] <= least and before <= least:
            seen = wheel.force  # a locked wheel tells nothing
        else:
            gained = law.inertia * (wheels.spin[i] - before) / motion.dt
            seen = min(max(wheel.mean + gained, 0.0), law.brake.max_torque) / wheels.rim[i]
        wheel.risen = _FORCE_SHARE * (seen - wheel.force)
        wheel.force += wheel.risen


@lean
def _explain(law: Constants, memory: Memory, motion: Motion, wheels: _Wheels) -> None:
    """Compare the accelerations of the last period with the forces; learn mass and the rest."""
    body, dt = memory.body[0], motion.dt
    body.heading += 0.5 * (body.yaw_rate + motion.yaw_rate) * dt
    f_x, f_y, moment = 0.0, 0.0, 0.0
    for i in range(law.rim.size):
        force = -wheels.sign[i] * memory.wheel[i].force
        f_x += force * law.n_x[i]
        f_y += force * law.n_y[i]
        moment += force * law.lever[i]
    a_x = (motion.v_x - body.v_x) / dt - motion.yaw_rate * motion.v_y
    a_y = (motion.v_y - body.v_y) / dt + motion.yaw_rate * motion.v_x
    turned = (motion.yaw_rate - body.yaw_rate) / dt
    share = min(dt / _MASS_TIME, 1.0)
    body.slowing += share * (math.hypot(a_x, a_y) - body.slowing)
    body.pull += share * (math.hypot(f_x, f_y) - body.pull)
    if body.steps > _MASS_STEPS and body.slowing > 1.0:
        body.mass += share * (body.pull / body.slowing - body.mass)
        body.mass = min(max(body.mass, law.mass / _MASS_RANGE), law.mass * _MASS_RANGE)
    share = min(dt / _DISTURBANCE_TIME, 1.0)
    body.turning += share * (turned - moment / (body.mass * law.gyration) - body.turning)
    rest_x, rest_y = a_x - f_x / body.mass, a_y - f_y / body.mass
    aside = rest_x * motion.across_x + rest_y * motion.across_y
    body.aside += share * (aside - body.aside)


@lean
def _learn(law: Constants, memory: Memory, wheels: _Wheels) -> None:
    """Learn what the wheels can bear: down by a slide, up where none came."""
    for i in range(law.rim.size):
        wheel = memory.wheel[i]
        capacity = wheel.capacity
        told = wheels.known[i] and wheels.stands[i] == 0.0  # a standing wheel tells nothing
        if memory.body[0].steps > _SHY_STEPS and told:
            if wheel.risen > _RISING * capacity:
                # The tire still deflects: it bears no less than it is about to. Valves, which only
                # push or not, fare better with what is there already.
                ahead = _RISE_STEPS * wheel.risen if law.brake.grain < 1.0 else 0.0
                capacity = max(capacity, wheel.force + ahead)
            elif wheels.slip[i] > 0.6 * law.slip:
                capacity += min(_PERIOD / _LEARNING_TIME, 1.0) * (wheel.force - capacity)
            elif wheel.wanted > 0.9 * capacity:
                capacity += _PERIOD / _GROWTH_TIME * capacity
        most = law.brake.max_torque / wheels.rim[i]
        wheel.capacity = min(max(capacity, wheel.force, 1.0), most)


class _Bounded(NamedTuple):
    """A sum of forces, by the share of each wheel in it, that is to stay between two bounds."""

    row: FloatArray
    least: float
    most: float
    weight: float


class _Squares(NamedTuple):
    """What `box_least_squares` minimizes."""

    hessian: FloatArray
    linear: FloatArray
    upper: FloatArray


class _Task(NamedTuple):
    """What the forces are to do; rows of the sums that they make, shape (N,), and their bounds."""

    along: FloatArray
    across: FloatArray
    turns: FloatArray
    left: float
    right: float
    least: float
    most: float


@kernel
def _task(law: Constants, memory: Memory, motion: Motion, wheels: _Wheels, total: float) -> _Task:
    """Return deceleration, line and heading as sums of forces over the sum of capacities."""
    n = law.rim.size
    body = memory.body[0]
    speed = math.hypot(motion.v_x, motion.v_y)
    e_x, e_y = (motion.v_x / speed, motion.v_y / speed) if speed > 0.0 else (0.0, 0.0)
    p_x, p_y = motion.across_x, motion.across_y
    reach = math.sqrt(law.gyration) + 1e-9
    along, across, turns = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        unit = wheels.sign[i] / total
        along[i] = unit * (law.n_x[i] * e_x + law.n_y[i] * e_y)
        across[i] = -unit * (law.n_x[i] * p_x + law.n_y[i] * p_y)
        turns[i] = -unit * law.lever[i] / reach
    drift = p_x * motion.v_x + p_y * motion.v_y
    leeway = speed * math.sin(min(law.max_rotation, _MUCH_ROTATION))
    aside_least = max((-leeway - drift) / _LINE_TIME, -_LARGEST_ASIDE)
    aside_most = min((leeway - drift) / _LINE_TIME, _LARGEST_ASIDE)
    body.left = speed * body.mass / total
    if body.steps == 0:
        body.whole = body.left
    push, swing = body.mass / total, body.mass * law.gyration / (total * reach)
    # What holds against a push by itself: so much may be asked of it, and is no disturbance.
    aside_held, turn_held = 0.0, 0.0
    for i in range(n):
        held = _HOLD * memory.wheel[i].capacity * wheels.stands[i]
        aside_held += held * abs(across[i])
        turn_held += held * abs(turns[i])
    aside_rest = _beyond(body.aside * push, aside_held)
    turn_rest = _beyond(body.turning * swing, turn_held)
    return _Task(
        along,
        across,
        turns,
        aside_least * push - aside_rest - aside_held,
        aside_most * push - aside_rest + aside_held,
        _turn_rate(law, body, -1.0) * swing - turn_rest - turn_held,
        _turn_rate(law, body, 1.0) * swing - turn_rest + turn_held,
    )


@lean
def _beyond(value: float, bound: float) -> float:
    """Return what a value is beyond a bound on either side."""
    return math.copysign(max(abs(value) - bound, 0.0), value)


@lean
def _turn_rate(law: Constants, body: Any, side: float) -> float:
    """Return the largest (side 1) or least (-1) yaw acceleration that keeps within the limit.

    The yaw rate may be as large as a constant deceleration can still stop at the limit; near it
    and beyond the heading returns exponentially, the slower the more of the stop is left, for a
    yaw moment takes force from the deceleration. A turn that ends within the limit by a moderate
    deceleration is ended so, for it buys distance. Valves are not fine enough for a slow return.
    """
    left = side * ((body.most if side > 0.0 else body.least) - body.heading)
    yaw_time = max(_YAW_TIME, min(_YAW_LONGEST, _YAW_SHARE * body.left))
    time = max(_HEADING_TIME, min(_HEADING_LONGEST, _HEADING_SHARE * body.left))
    if left > 0.0 and _GENTLE_TURN < body.turn_limit <= _FIRM_TURN:
        yaw_time = _YAW_TIME
        time = max(_HEADING_TIME, min(_FIRM_TIME, _FIRM_SHARE * body.left))
    if law.brake.grain >= 1.0:
        time = _HEADING_TIME
    rate = left / time
    if left > 0.0:
        rounding = body.turn_limit * time
        rate = math.sqrt(2.0 * body.turn_limit * left + rounding * rounding) - rounding
    return float(side * (rate - side * body.yaw_rate) / yaw_time)


@kernel
def _allocate(law: Constants, memory: Memory, wheels: _Wheels, task: _Task, total: float) -> None:
    """Want the forces with the largest deceleration that heading and line allow."""
    n = wheels.hub.size
    wheel = memory.wheel
    upper, wanted = np.empty(n), np.empty(n)
    for i in range(n):
        upper[i] = wheel[i].capacity if wheels.stands[i] == 0.0 else 0.0
        if not wheels.known[i]:
            upper[i] *= _UNKNOWN_SHARE
        wanted[i] = wheel[i].wanted
    hessian, linear = np.zeros((n, n)), task.along.copy()
    for i in range(n):
        for j in range(n):
            hessian[i, j] = task.along[i] * task.along[j]
        hessian[i, i] += _REGULAR / total**2
    box_least_squares(hessian, linear, upper, wanted)
    squares = _Squares(hessian, linear, upper)
    turns = _Bounded(task.turns, task.least, task.most, _TURN_WEIGHT)
    line = _Bounded(task.across, task.left, task.right, law.line_weight)
    turns_kept = line_kept = False
    for _ in range(2):  # one may leave its bounds by the other
        if not turns_kept:
            turns_kept = _keep(turns, squares, wanted)
        if not line_kept:
            line_kept = _keep(line, squares, wanted)
    for i in range(n):
        wheel[i].wanted = wanted[i]


@lean
def _keep(bounded: _Bounded, squares: _Squares, wanted: FloatArray) -> bool:
    """Bring a sum of forces back to its bounds if it is beyond; return whether it was."""
    row, least, most, weight = bounded
    hessian, linear, upper = squares
    value = 0.0
    for i in range(row.size):
        value += row[i] * wanted[i]
    if least <= value <= most:
        return False
    goal = least if value < least else most
    for i in range(row.size):
        for j in range(row.size):
            hessian[i, j] += weight * row[i] * row[j]
        linear[i] += weight * goal * row[i]
    box_least_squares(hessian, linear, upper, wanted)
    return True


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _braked(law: Constants, memory: Memory, wheels: _Wheels, i: int) -> BrakedWheel:
    capacity = memory.wheel[i].capacity
    return BrakedWheel(capacity, law.slip, wheels.rim[i], law.radius[i], law.inertia)


@lean
def _in_time(
    law: Constants, memory: Memory, wheels: _Wheels, hub: float, dt: float, i: int
) -> tuple[float, float, float]:
    """Return speed [rad/s], torque [N m] and force [N] of a wheel when a new torque reaches it.

    Until then the brake does what it has been told already.
    """
    wheel = memory.wheel[i]
    spin, torque, force = wheels.spin[i], wheel.torque, wheel.force
    delay = memory.body[0].delay / dt
    newest = int(memory.body[0].steps % QUEUE) - 1
    for k in range(min(math.ceil(delay - 1e-9), QUEUE)):
        asked = asked_at(memory.sent, newest, max(delay - 1.0 - k, 0.0), i)
        torque, mean = lagged(law.brake, torque, asked, dt)
        spin, force = turn_on(_braked(law, memory, wheels, i), spin, mean, hub, dt)
    return spin, torque, force


@kernel
def _share_out(
    law: Constants, memory: Memory, motion: Motion, wheels: _Wheels, enable: FloatArray
) -> None:
    """Turn the wanted forces into shares of the torque of proportional brakes."""
    body, brake = memory.body[0], law.brake
    dt = motion.dt if motion.dt > 0.0 else _PERIOD
    slowing = body.slowing / max(math.hypot(motion.v_x, motion.v_y), 0.5)
    most = brake.max_torque * motion.pedal
    servo_time = _SERVO_TIME + body.delay + 0.5 * brake.time_constant
    neediest, largest = 0, -math.inf
    short = body.whole < law.short_stop
    for i in range(enable.size):
        wheel = memory.wheel[i]
        hub = wheels.hub[i] * (1.0 - min(slowing * (body.delay + dt), 0.5))
        spin, torque, force = _in_time(law, memory, wheels, hub, dt, i)
        # A tire must deflect before it pushes: the faster it slides, the sooner.
        push = _PUSH * (1.0 - min(wheel.force / wheel.capacity, 1.0))
        slide = push + (_SHORT_SLIDE / (hub + 1e-6) if short else 0.0)
        goal = max(hub - push, 0.0) / (wheels.rim[i] + law.radius[i] * law.slip)
        goal = min(goal, max(hub - slide, 0.0) / wheels.rim[i])
        expected = force + _FORESIGHT * (wheel.capacity - force)
        need = wheels.rim[i] * expected + law.inertia * (spin - goal) / servo_time
        if short and goal <= 0.0:
            need = most
        if wheel.wanted < _AT_BOUND * wheel.capacity or not wheels.known[i]:
            need = min(need, wheels.rim[i] * wheel.wanted + law.inertia * spin * slowing)
        if brake.time_constant > 0.0:  # leads the lag
            need = torque + (need - torque) / -math.expm1(-2.0 * dt / brake.time_constant)
        if wheels.stands[i] != 0.0:
            need = most
        if need > largest:
            neediest, largest = i, need
        enable[i] = min(max(need / most, 0.0), 1.0)
        if brake.grain > 0.0:
            enable[i] = min(math.floor(enable[i] / brake.grain + 0.5) * brake.grain, 1.0)
    if not np.any(enable > 0.0):  # for no law may let the vehicle roll unbraked
        enable[neediest] = max(brake.grain, _LEAST_SHARE)


@kernel
def _choose(
    law: Constants,
    memory: Memory,
    motion: Motion,
    wheels: _Wheels,
    task: _Task,
    enable: FloatArray,
) -> None:
    """Open and shut valves in the pattern whose predicted forces do the task best.

    Each wheel's force is predicted for either case over the next periods; all patterns of few
    wheels are compared, of more the best that single changes lead to.
    """
    n = enable.size
    brake, dt = law.brake, (motion.dt if motion.dt > 0.0 else _PERIOD)
    slowing = memory.body[0].slowing / max(math.hypot(motion.v_x, motion.v_y), 0.5)
    most = brake.max_torque * motion.pedal
    horizon = _HORIZON + math.ceil(brake.time_constant / dt)
    forces, deep = np.empty((2, n)), np.empty((2, n))
    for i in range(n):
        hub = wheels.hub[i] * (1.0 - min(slowing * (memory.body[0].delay + dt), 0.5))
        start = _in_time(law, memory, wheels, hub, dt, i)
        for state in range(2):
            spin, torque, total = start[0], start[1], 0.0
            for _ in range(horizon):
                torque, mean = lagged(brake, torque, most * state, dt)
                spin, force = turn_on(_braked(law, memory, wheels, i), spin, mean, hub, dt)
                total += force
            forces[state, i] = total / horizon
            goal = hub / (wheels.rim[i] + law.radius[i] * law.slip)
            missing = max(1.0 - spin / goal, 0.0) if goal > 0.0 else 0.0
            deep[state, i] = _DEEP_WEIGHT / n * missing * missing
        enable[i] = 1.0
    if n <= _MOST_PATTERNS:
        best, chosen = math.inf, 0
        for pattern in range(1, 1 << n):
            for i in range(n):
                enable[i] = float((pattern >> i) & 1)
            cost = _cost(task, wheels, forces, deep, enable)
            if cost < best:
                best, chosen = cost, pattern
        for i in range(n):
            enable[i] = float((chosen >> i) & 1)
        return
    best = _cost(task, wheels, forces, deep, enable)
    for _ in range(2 * n):
        changed = -1
        for i in range(n):
            enable[i] = 1.0 - enable[i]
            cost = _cost(task, wheels, forces, deep, enable)
            if cost < best:
                best, changed = cost, i
            enable[i] = 1.0 - enable[i]
        if changed < 0:
            return
        enable[changed] = 1.0 - enable[changed]


@lean
def _cost(
    task: _Task, wheels: _Wheels, forces: FloatArray, deep: FloatArray, enable: FloatArray
) -> float:
    """Return how badly a pattern of valves does the task; standing wheels should be locked."""
    along, across, turns, cost = 0.0, 0.0, 0.0, 0.0
    for i in range(enable.size):
        state = 1 if enable[i] != 0.0 else 0
        if wheels.stands[i] != 0.0:
            cost += 1.0 - enable[i]
            continue
        along += task.along[i] * forces[state, i]
        across += task.across[i] * forces[state, i]
        cost += deep[state, i]
        turns += task.turns[i] * forces[state, i]
    turned = max(task.least - turns, turns - task.most, 0.0)
    pushed = max(task.left - across, across - task.right, 0.0)
    cost += (1.0 - along) ** 2 + _VALVE_TURN_WEIGHT * turned * turned
    return cost + _VALVE_LINE_WEIGHT * pushed * pushed


@lean
def _remember(law: Constants, memory: Memory, motion: Motion, enable: FloatArray) -> None:
    """Keep what is asked of the brakes, and what they will do until the next step."""
    dt = motion.dt if motion.dt > 0.0 else _PERIOD
    newest = int(memory.body[0].steps % QUEUE)
    for i in range(enable.size):
        wheel = memory.wheel[i]
        memory.sent[newest, i] = enable[i] * law.brake.max_torque * motion.pedal
        asked = asked_at(memory.sent, newest, memory.body[0].delay / dt, i)
        wheel.torque, wheel.mean = lagged(law.brake, wheel.torque, asked, dt)
