"""Tests for swapped brakes, brakes without effect and a wrong dead time in a commissioning drive.

The torque of each brake is estimated from slip and deceleration of its wheel. The estimate is
compared with the demand that the brake should follow.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from omni_core.brakes import BrakeConfiguration
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import BoolArray, FloatArray, IntArray
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.plausibility import wheel_facts
from omni_tools.commissioning.signals import Motions, Signals


class Tolerances(NamedTuple):
    """Test conditions, and tolerances within which the brakes count as correct.

    A brake can count as idle only if its demand reaches `braked` or `mean_demand`.

    Attributes:
        latest: longest delay to search for, in addition to the dead time in the vehicle's file [s].
        response: minimum mean ground torque on a braked wheel, as a share of the largest such
            torque of all wheels [1].
        applied: minimum demand of a brake whose effect counts [1]; a smaller effect is lost in the
            errors of the slip.
        braked: minimum time integral of the demand while the wheel moves [s].
        mean_demand: minimum mean of the demand while the driver brakes and the wheel moves [1].
        gain: two brakes count as swapped if their swap increases the sum of correlations by
            more than this value [1].
        delay: limit on the difference between the measured dead time and that in the vehicle's
            file, and between the delay of one brake and those of all others [s].
        significance: minimum gain of a correlation by the delay of one brake, in standard errors
            [1].
        slowest: minimum speed of a wheel for a defined slip, as a share of the top speed [1].
    """

    latest: float = 0.3
    response: float = 0.03
    applied: float = 0.5
    braked: float = 0.5
    mean_demand: float = 0.75
    gain: float = 1.0
    delay: float = 0.03
    significance: float = 3.0
    slowest: float = 0.2


_ALLOWED = Tolerances()


class Response(NamedTuple):
    """Response of the wheels to their brakes during the stops, T rows and N wheels.

    Attributes:
        slip: torque of the ground on each wheel in the direction of rolling [N m], shape (T, N).
        torque: estimated torque of each brake, from slip and deceleration of its wheel [N m], shape
            (T, N).
        demand: demand of each brake after the delays in the vehicle's file [1], shape (T, N).
        rolling: speed of each wheel if it rolled without slip [rad/s], shape (T, N).
        moving: whether the rolling speed of each wheel is high enough for a defined slip, shape (T,
            N).
        braking: whether the driver brakes, shape (T, 1).
        starting: whether a row is within `Tolerances.latest` of the start of a stop, shape (T,).
        period: time between two rows [s].
        radius: radius of each wheel [m], shape (N,).
        limit: maximum torque that the ground can transmit to each wheel [N m], shape (N,).
        brake: brake of each wheel as described in the vehicle's file.
    """

    slip: FloatArray
    torque: FloatArray
    demand: FloatArray
    rolling: FloatArray
    moving: BoolArray
    braking: BoolArray
    starting: BoolArray
    period: float
    radius: FloatArray
    limit: FloatArray
    brake: BrakeConfiguration

    def swapped(self, i: int, j: int) -> "Response":
        """Return a copy of this response in which the demands of brakes i and j are swapped."""
        demand = self.demand.copy()
        demand[:, [i, j]] = demand[:, [j, i]]
        return self._replace(demand=demand)

    def action(self) -> FloatArray:
        """Return the torque that each brake should exert at its demand [N m], shape (T, N).

        The power limit of a drive is applied at the rolling speed, not at the measured wheel speed,
        which depends on the slip.
        """
        return self.brake.limited(self.demand * self.brake.max_torque, self.rolling)

    def measured(self) -> FloatArray:
        """Return the measured torque that is compared with `predicted` [N m], shape (T, N).

        For velocity drives, this is the torque of the ground. For all other brakes, it is the
        torque of the brake.
        """
        return self.slip if self.brake.is_ramped else self.torque

    def predicted(self) -> FloatArray:
        """Return the torque that `measured` should equal, given the demands [N m], shape (T, N)."""
        return self._slip_of_command() if self.brake.is_ramped else self.action()

    def _slip_of_command(self) -> FloatArray:
        """Return the torque of the ground on wheels that follow their speed commands [N m], (T, N).

        The speed command of a braked wheel decreases at the rate of the drive's `ramp`, multiplied
        by the demand. The speed command of a released wheel is its rolling speed.
        """
        rolling, command = np.abs(self.rolling), np.abs(self.rolling)
        fall = self.demand * self.brake.ramp / self.radius * self.period
        for row in range(1, len(rolling)):
            ramped = np.maximum(command[row - 1] - fall[row], 0.0)
            command[row] = np.where(fall[row] > 0.0, ramped, rolling[row])
        slip = 1.0 - command / np.where(self.moving, rolling, 1.0)
        return np.where(self.moving, self.limit * slip, 0.0)


def response_of(vehicle: VehicleConfiguration, signals: Signals, motions: Motions) -> Response:
    """Return the response of the wheels to their brakes.

    The tire force is modeled as proportional to the slip. With the steep initial slope of a real
    tire, small errors of the twist would cause large errors of the force.
    """
    wheel_speeds = PlatformKinematics.of(vehicle.wheels).wheel_speeds
    predicted = wheel_speeds(motions.twist)
    # Slipping rollers: the ratio of measured and predicted angles of all wheels in each motion.
    slip_ratio = np.sum(motions.angle * predicted, axis=1) / np.sum(predicted**2, axis=1)
    predicted = wheel_speeds(slip_ratio[:, np.newaxis] * motions.twist)
    # A loaded wheel has a smaller rolling radius. The ratio of this radius to the described one
    # cancels in the slip.
    scale = np.sum(motions.angle * predicted, axis=0) / np.sum(predicted**2, axis=0)
    rows = np.arange(motions.stop.start, motions.stop.stop)
    late = _wheels_late(signals, wheel_speeds(np.nan_to_num(signals.twist)), motions.stop.start)
    twist = _earlier(signals.twist, rows, min(late, 0))
    rolling = scale * wheel_speeds(slip_ratio * twist)
    pedal = np.nan_to_num(signals.pedal[motions.stop], nan=1.0)  # NaN: full demand
    moving = np.abs(rolling) > _ALLOWED.slowest * np.nanmax(np.abs(rolling))
    speed = _earlier(signals.wheel_speed, rows, min(-late, 0))
    slower = -np.sign(rolling) * np.diff(speed, axis=0, prepend=speed[:1]) / signals.period
    facts = wheel_facts(vehicle)
    radius = np.array([mount.radius for mount in vehicle.wheels.values()])
    limit = radius * [facts[name].grip for name in vehicle.wheels]
    slip = np.where(moving, limit * (1.0 - speed / np.where(moving, rolling, 1.0)), 0.0)
    torque = np.where(moving, slip + vehicle.wheel_inertia * slower, 0.0)
    # A brake without an enable is on.
    demand = pedal[:, np.newaxis] * np.nan_to_num(signals.enable[motions.stop], nan=1.0)
    begun = np.flatnonzero(np.diff((pedal > 0.0).astype(int), prepend=0) > 0)
    apart = np.abs(np.arange(len(pedal))[:, np.newaxis] - begun).min(axis=1, initial=len(pedal))
    delayed = _acting(demand, signals.period, vehicle.brake)
    braking, starting = pedal[:, np.newaxis] > 0.0, apart * signals.period <= _ALLOWED.latest
    values = slip, torque, delayed, rolling, moving, braking, starting
    return Response(*values, signals.period, radius, limit, vehicle.brake)


def _wheels_late(signals: Signals, rolling: FloatArray, count: int) -> int:
    """Return by how many rows the wheel speeds are later than the twist while no wheel brakes.

    Drivers average over counts of an encoder, and filters delay a twist.

    Args:
        signals: signals of the run.
        rolling: speed of each wheel if it rolled as the twist states [rad/s], shape (T, N).
        count: number of rows before the stops.
    """
    most, rows = round(_ALLOWED.latest / signals.period), np.arange(count)
    speed = np.nan_to_num(signals.wheel_speed[:count])
    return max(
        sorted(range(-most, most + 1), key=abs),  # 0 if nothing moves
        key=lambda row: float(np.trace(_correlation(speed, _earlier(rolling, rows, row)))),
    )


def _acting(demand: FloatArray, period: float, brake: BrakeConfiguration) -> FloatArray:
    """Return the demand that acts on each brake after delays and lag [1], shape (T, N).

    Args:
        demand: demanded share of the full torque of each brake [1], shape (T, N).
        period: time between two rows [s].
        brake: brake as described in the vehicle's file, which gives delays and lag.
    """
    applied, released = (round(time / period) for time in (brake.dead_time, brake.release_time))
    if brake.is_switched:
        demand = np.round(demand)
    # A brake with a release delay follows the largest demand within this delay.
    later = [
        np.concatenate((np.zeros((row, demand.shape[1])), demand[: len(demand) - row]))
        for row in range(applied, max(applied, released) + 1)
    ]
    left = math.exp(-period / brake.time_constant) if brake.time_constant > 0.0 else 0.0
    lagged = scipy.signal.lfilter([1.0 - left], [1.0, -left], np.max(later, axis=0), axis=0)
    return np.asarray(lagged)


def _late(response: Response, wheels: Sequence[int] | None = None) -> int:
    """Return the delay of the measured torques relative to `Response.action`, in rows.

    It is the delay with the largest correlation (`_by_delay`), and 1 if the dead time in the
    vehicle's file is correct.
    """
    correlation = _by_delay(response, wheels)
    return max(correlation, key=correlation.__getitem__)


def _by_delay(response: Response, wheels: Sequence[int] | None = None) -> dict[int, float]:
    """Return the correlation of measured torque and action near the starts of the stops [1].

    Both are averaged over the wheels first, because the means over all wheels do not depend on the
    order of the brakes.

    Args:
        response: response of the wheels.
        wheels: indices of the wheels; None for all.

    Returns:
        Correlation, keyed by the delay in rows; only a delay of 1 if no stop begins while a wheel
        moves.
    """
    chosen = slice(None) if wheels is None else list(wheels)
    moving = response.moving[:, chosen]
    torque, action = (
        np.ma.masked_array(values[:, chosen], ~moving).mean(axis=1, keepdims=True).filled(0.0)
        for values in (response.torque, response.action())
    )
    near = np.flatnonzero(response.starting & np.any(moving, axis=1))
    first = -round(response.brake.dead_time / response.period)
    rows = range(first, round(_ALLOWED.latest / response.period)) if len(near) else [1]
    return {
        row: float(_correlation(torque[near], _earlier(action, near, row))[0, 0]) for row in rows
    }


def late_brake(response: Response) -> tuple[int, float] | None:
    """Return the index of a brake that acts later than the others, and by how much [s].

    The result is None if no brake does. The brakes before the start of a stop have no demand, so
    that each is compared with its own.
    """
    found = [_by_delay(response, [row]) for row in range(response.torque.shape[1])]
    delays = [max(one, key=one.__getitem__) for one in found]
    latest = int(np.argmax(delays))
    others = max(np.delete(delays, latest).tolist())
    best, usual = (found[latest].get(row, 0.0) for row in (delays[latest], others))
    count = max(int(np.sum(response.starting & response.moving[:, latest])), 1)
    error = (1.0 - best**2) / math.sqrt(count)  # standard error of a correlation
    difference = (delays[latest] - others) * response.period
    certain = best - usual > _ALLOWED.significance * error
    return (latest, difference) if certain and difference > _ALLOWED.delay else None


def swapped(response: Response) -> tuple[int, int] | None:
    """Return the indices of two swapped brakes; None if no swap is found.

    First, the mean over all wheels is subtracted from the measured and the predicted torques,
    because the pedal acts on all brakes at once. Both are then correlated for each wheel.
    The result is the pair whose swap increases the sum of the correlations most. It is None if the
    increase is at most `Tolerances.gain`, or if a brake would be idle even after the swap.
    """
    pair, best, least = _best_swap(response)
    if best <= least:
        return None
    # A brake that has no effect even after the swap is idle, not swapped.
    return pair if idle(response.swapped(*pair)) is None else None


def _best_swap(response: Response) -> tuple[tuple[int, int], float, float]:
    """Return the swap of two brakes that agrees best with the measured torques.

    Returns:
        Indices of the two brakes; agreement (`_agreement`) after this swap; limit that the
        agreement must exceed for the order in the vehicle's file to count as wrong.
    """
    late = _late(response)
    pairs = itertools.combinations(range(response.torque.shape[1]), 2)
    scores = {pair: _agreement(response.swapped(*pair), late) for pair in pairs}
    best = max(scores, key=lambda pair: scores[pair])
    return best, scores[best], max(_agreement(response, late), 0.0) + _ALLOWED.gain


def _agreement(response: Response, late: int) -> float:
    """Return the correlation of measured and predicted torque [1], summed over all wheels.

    `late` is the result of `_late`.
    """
    measured, predicted = (
        _without_mean(values, response.moving)
        for values in (response.measured(), response.predicted())
    )
    braking = np.flatnonzero(response.braking & np.any(response.moving, axis=1, keepdims=True))
    return float(np.trace(_correlation(measured[braking], _earlier(predicted, braking, late))))


def inverted(response: Response, inverse: Response) -> bool:
    """Return whether the measured torques agree best with inverted brake enables.

    The alternatives are the enables in the order of the vehicle's file, and the enables after any
    swap of two brakes.

    Args:
        response: response of the wheels, computed with the recorded enables.
        inverse: response of the wheels, computed with 1 minus the recorded enables.
    """
    _, best, least = _best_swap(response)
    return _agreement(inverse, _late(inverse)) > max(best, least)


def undistinguished(response: Response) -> list[tuple[int, int]]:
    """Return the index pairs of brakes that `swapped` would not find if they were swapped."""
    pairs = itertools.combinations(range(response.torque.shape[1]), 2)
    return [pair for pair in pairs if swapped(response.swapped(*pair)) != pair]


def idle(response: Response) -> int | None:
    """Return the index of a brake that does not act.

    The result is None if all brakes act, or if the demands are too small for a test.
    """
    applied = response.moving & (response.demand >= _ALLOWED.applied)
    demand = np.where(applied, response.demand, 0.0)
    braked, longest = (
        response.period * np.sum(values, axis=0)
        for values in (demand, response.moving & response.braking)
    )
    tested = braked >= np.minimum(_ALLOWED.braked, _ALLOWED.mean_demand * longest)
    # On a wheel without a brake, the ground torque is at most 0, because the ground only keeps the
    # wheel rolling.
    slip = np.sum(demand * response.slip, axis=0) * response.period / np.maximum(braked, 1e-9)
    found = np.flatnonzero(tested & (slip < _ALLOWED.response * np.max(slip)))
    return int(found[0]) if len(found) else None


def dead_time(response: Response) -> float | None:
    """Return the dead time of the brakes [s]; None if it agrees with the vehicle's file."""
    # The wheels respond to a demand in the next row at the earliest.
    difference = (_late(response) - 1) * response.period
    return response.brake.dead_time + difference if abs(difference) > _ALLOWED.delay else None


def _earlier(values: FloatArray, rows: IntArray, by: int) -> FloatArray:
    """Return the rows of `values`, shape (T, K), that are `by` rows earlier than the given rows."""
    return np.asarray(values[np.clip(rows - by, 0, len(values) - 1)])


def _without_mean(values: FloatArray, used: BoolArray) -> FloatArray:
    """Return values (T, N) minus the mean of the used values in each row; 0 for unused values."""
    chosen = np.ma.masked_array(values, ~used)
    return np.asarray((chosen - chosen.mean(axis=1, keepdims=True)).filled(0.0))


def _correlation(rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the correlation of each column of `rows` with each column of `columns` [1].

    The shape is (columns of `rows`, columns of `columns`). The correlation is 0 for a constant
    column, or if there are no rows.
    """
    if not len(rows):
        return np.zeros((rows.shape[1], columns.shape[1]))
    a, b = rows - rows.mean(axis=0), columns - columns.mean(axis=0)
    scale = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    return np.where(scale > 1e-9, (a.T @ b) / np.maximum(scale, 1e-9), 0.0)
