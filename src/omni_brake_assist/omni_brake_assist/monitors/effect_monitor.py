"""Monitor of the braking effect: it uses pedal, wheel speeds and acceleration, nothing else.

A vehicle that loses speed at ``a`` where it could lose it at ``c`` travels ``v (1 - a / c) dt``
farther than it must. The monitor adds that to the missed distance ``M``, the rest ``v a / c dt`` to
the braked distance ``B``, and bounds

    M <= creep + allowance v_0 + share B

``v`` is the larger of two speeds: of the fastest rim, as some wheel rolls in an assisted stop, and
of the integrated specific force, from the speed before the pedal on. A scale error that all
encoders and the twist share therefore does not shorten the distance; without an IMU it cannot be
observed, and ``v`` falls by `loss` at most. Nothing is missed while every brake acts. Deceleration
is measured twice, and the larger share counts: as the low-passed specific force, and as the
difference of ``v`` and its low-pass. The possible deceleration ``c`` is the largest of this stop,
in proportion to the pedal, and at least `floor`, which the least friction and the rollers allow.

Nor may brakes be released for longer than a stop with a modest deceleration lasts, or for `stall`
at the end of a stop without much deceleration: two brakes may hold a vehicle on a course along
which no roller is braked.

Once a bound is exceeded all brakes act until the pedal is released.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_platform.geometry import PlatformGeometry
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

Record = Any
"""A ledger by reference: an entry of `effect_memory`."""

_LEDGER = np.dtype(
    [
        ("missed", "f8"),  # path [m]
        ("braked", "f8"),  # path [m]
        ("tripped", "?"),  # whether a bound has been exceeded
        ("start", "f8"),  # speed of the fastest rim when the pedal went down [m/s]
        ("demanded", "f8"),  # time since, weighted by the pedal [s]
        ("elapsed", "f8"),  # time since [s]
        ("speed", "f8"),  # of the fastest rim [m/s]
        ("mean_speed", "f8"),  # the same, low-passed [m/s]
        ("seen", "f8"),  # how often it has been seen lately [1]
        ("force_x", "f8"),  # specific force, low-passed [m/s^2]
        ("force_y", "f8"),
        ("force_time", "f8"),  # for how long there has been one [s]
        ("best_force", "f8"),  # best loss of speed that it has shown [m/s^2]
        ("force_pedal", "f8"),  # at which pedal [1]
        ("best_loss", "f8"),  # best one that wheels have shown [m/s^2]
        ("loss_pedal", "f8"),  # at which pedal [1]
        ("stalled", "f8"),  # for how long little has been lost at the end of the stop [s]
    ]
)

_SETTLED = 0.6  # share of a step that a low pass must have followed to be used [1]
_END = 0.3  # share of the speed at the start from which on a stop is at its end [1]
_LITTLE = 0.3  # share of the possible loss of speed that is little [1]
_FASTEST_RIM = 200.0  # [m/s]
_LARGEST_FORCE = 100.0  # [m/s^2]
_LARGEST_LOSS = 12.0  # deceleration that a tire allows [m/s^2]


class EffectConstants(NamedTuple):
    """What never changes.

    Attributes:
        roll: speed along the active direction per wheel speed [m], shape (N,).
        share: of the braked path that may be missed where the specific force is known [1].
        blind_share: of the braked distance that may be missed without it [1].
        allowance: that may be missed on top of it, in seconds of the speed at the start [s].
        creep: path that may be missed in any case [m].
        loss: deceleration while no wheel shows it and the specific force is unknown [m/s^2].
        bias: error of the specific force [m/s^2].
        floor: deceleration that friction of 0.3 allows where half of the wheels brake, as on a
            diagonal course: 0.3 g / 2 [m/s^2].
        force_time: over which the specific force is averaged [s].
        wheel_time: over which the loss of speed is taken from the wheels [s].
        least: deceleration with which a stop must be over, on average [m/s^2].
        grace: time that it may take in any case [s].
        stall: time without much loss of speed at the end of a stop [s].
        empty: ledger, shape (1,).
    """

    roll: FloatArray
    share: float
    blind_share: float
    allowance: float
    creep: float
    loss: float
    bias: float
    floor: float
    force_time: float
    wheel_time: float
    least: float
    grace: float
    stall: float
    empty: NDArray[np.void]


class EffectStep(NamedTuple):
    """A step of the assistant.

    Attributes:
        dt: length [s].
        pedal: the driver's demand, 0 while there is none [1].
        released: whether a brake was released.
    """

    dt: float
    pedal: float
    released: bool


def effect_constants(geometry: PlatformGeometry) -> EffectConstants:
    """Return the constants of wheels in the layout of the kernel."""
    return EffectConstants(
        roll=geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1),
        share=0.25,
        blind_share=0.5,
        allowance=0.15,
        creep=0.1,
        loss=6.0,
        bias=0.5,
        floor=1.5,
        force_time=0.2,
        wheel_time=0.6,
        least=1.0,
        grace=1.0,
        stall=0.2,
        empty=effect_memory(),
    )


def effect_memory() -> NDArray[np.void]:
    """Return the initial memory, shape (1,)."""
    return np.zeros(1, _LEDGER)


@lean
def watch_effect(
    constants: EffectConstants,
    memory: NDArray[np.void],
    step: EffectStep,
    speeds: FloatArray,
    force: FloatArray,
) -> bool:
    """Add the last step; return whether all brakes must act.

    Args:
        constants: of the vehicle.
        memory: of `effect_memory`, changed in place.
        step: commands and readings of the step.
        speeds: current wheel speeds [rad/s], shape (N,); NaN where unknown.
        force: specific force along x and y [m/s^2], shape (2,); NaN without.
    """
    dt, pedal, released = step
    ledger, top, known = memory[0], 0.0, False
    for i in range(speeds.size):
        rim = abs(constants.roll[i] * speeds[i])
        if rim < _FASTEST_RIM:
            top, known = max(top, rim), True
    if pedal <= 0.0:
        memory[0] = constants.empty[0]
        ledger.start = ledger.speed = ledger.mean_speed = top
        ledger.seen = 1.0
        return False
    ledger.elapsed += dt
    ledger.demanded += pedal * dt
    felt = abs(force[0]) < _LARGEST_FORCE and abs(force[1]) < _LARGEST_FORCE
    loss = constants.loss
    if felt:
        loss = min(math.hypot(force[0], force[1]) + constants.bias, _LARGEST_LOSS)
    fallen = ledger.speed - (loss * dt if known else 0.0)
    ledger.speed = max(top, fallen, 0.0)
    share = constants.blind_share
    achieved = _share_of_wheels(constants, ledger, dt, pedal, top >= fallen)
    if felt:
        achieved = max(achieved, _share_of_force(constants, ledger, dt, pedal, force))
        share = constants.share
    if released:
        ledger.missed += ledger.speed * (1.0 - achieved) * dt
    ledger.braked += ledger.speed * achieved * dt
    stalls = released and achieved < _LITTLE and ledger.speed < _END * ledger.start
    ledger.stalled = ledger.stalled + dt if stalls else 0.0
    bound = constants.creep + constants.allowance * ledger.start + share * ledger.braked
    due = constants.grace + ledger.start / constants.least
    exceeded = ledger.demanded > due or ledger.stalled > constants.stall or ledger.missed > bound
    if released and exceeded:
        ledger.tripped = True
    return bool(ledger.tripped)


@lean
def _share_of_wheels(
    constants: EffectConstants, ledger: Record, dt: float, pedal: float, seen: bool
) -> float:
    """Return the achieved share of the possible loss of speed, by the fastest rim."""
    time = constants.wheel_time
    follow = 1.0 - math.exp(-dt / time)
    settled = 1.0 - math.exp(-ledger.elapsed / time)
    ledger.mean_speed += follow * (ledger.speed - ledger.mean_speed)
    ledger.seen += follow * ((1.0 if seen else 0.0) - ledger.seen)
    loss = (ledger.mean_speed - ledger.speed) / (time * settled) if settled > 0.0 else 0.0
    if settled > _SETTLED and seen and ledger.seen > 0.3 and loss > ledger.best_loss:
        ledger.best_loss, ledger.loss_pedal = loss, pedal
    return float(_share(constants, loss, pedal, ledger.best_loss, ledger.loss_pedal))


@lean
def _share_of_force(
    constants: EffectConstants, ledger: Record, dt: float, pedal: float, force: FloatArray
) -> float:
    """Return the achieved share of the possible loss of speed, by the specific force."""
    time = constants.force_time
    follow = 1.0 - math.exp(-dt / time)
    ledger.force_time += dt
    settled = 1.0 - math.exp(-ledger.force_time / time)
    ledger.force_x += follow * (force[0] - ledger.force_x)
    ledger.force_y += follow * (force[1] - ledger.force_y)
    loss = math.hypot(ledger.force_x, ledger.force_y) / settled if settled > 0.0 else 0.0
    if settled > _SETTLED and loss > ledger.best_force:
        ledger.best_force, ledger.force_pedal = loss, pedal
    return float(_share(constants, loss, pedal, ledger.best_force, ledger.force_pedal))


@lean
def _share(
    constants: EffectConstants, loss: float, pedal: float, best: float, best_pedal: float
) -> float:
    """Return a loss of speed over the possible one at a pedal position, 0 to 1."""
    possible = constants.floor * pedal
    if best_pedal > 0.0:
        possible = max(possible, best * min(pedal / best_pedal, 1.0))
    return min(max(loss / possible, 0.0), 1.0)
