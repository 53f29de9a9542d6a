"""Errors in the description of a vehicle, found by hypothesis tests on a commissioning drive.

In the drive, the vehicle moves forward, to the left and counter-clockwise, each by a known distance
or angle. Each wheel turns by an angle in each motion, which Eq. (32) predicts. Each hypothesis
changes one item of the description. The hypothesis whose prediction fits the measured wheel angles
best identifies the error. Twist sensor, gyro and accelerometer are compared with the known motions
directly, and the brakes with the enables that they should follow.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter

from omni_platform import configuration, kinematics, topics
from omni_platform.brakes import ON_OFF, BrakeConfiguration
from omni_platform.geometry import WheelMount
from omni_platform.quantities import BoolArray, FloatArray, IntArray
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.commissioning.signals import Motions, Signals, unchecked
from omni_tools.vehicles.plausibility import wheel_facts


class Tolerances(NamedTuple):
    """Tolerances of the tests, up to which a description counts as correct, and test conditions.

    Attributes:
        misfit: largest error of a wheel's angles, relative to the predicted angles [1].
        heading: largest error of a twist sensor's mounting angle [rad].
        scale: largest relative error of the scale of twist sensor and gyro [1].
        offset: largest error of a twist sensor's position [m].
        force: smallest specific force with which the axes of an IMU are tested [m/s^2].
        latest: longest delay of a brake's response after its described dead time [s].
        response: smallest ratio of the mean torque of a braked wheel to the largest one [1].
        braked: smallest integral of the demand while a wheel moves, for a test of its brake [s].
        share: smallest mean demand that is also sufficient for this test [1].
        gain: smallest increase in the summed correlations at which brakes count as exchanged [1].
        delay: largest difference between measured and described dead time [s].
        slowest: smallest speed of a wheel with a defined slip, as a share of the top speed [1].
    """

    misfit: float = 0.06
    heading: float = math.radians(2.0)
    scale: float = 0.05
    offset: float = 0.03
    force: float = 0.05
    latest: float = 0.3
    response: float = 0.02
    braked: float = 0.5
    share: float = 0.75
    gain: float = 1.0
    delay: float = 0.03
    slowest: float = 0.2


_ALLOWED = Tolerances()


class Mistake(NamedTuple):
    """An error in the description, and its remedy.

    Attributes:
        name: name of the error, with the wheel or the sensor.
        remedy: advice on what to change in the description.
        wheels: corrected wheels, if the error is in the wheels.
        dead_time: corrected dead time of the brakes [s], if the error is in the dead time.
    """

    name: str
    remedy: str
    wheels: Mapping[str, WheelMount] | None = None
    dead_time: float | None = None


def find_mistakes(
    wheels: Mapping[str, WheelMount],
    signals: Signals,
    motions: Motions,
    *,
    distance: float,
    angle: float,
    vehicle: VehicleConfiguration,
) -> list[Mistake]:
    """Return the errors found in a drive.

    Args:
        wheels: wheels as described in the vehicle's file.
        signals: signals of the drive.
        motions: motions of the drive.
        distance: distance of the motions forward and to the left [m].
        angle: angle of the motion counter-clockwise [rad].
        vehicle: brakes, inertia and loads of the wheels as described in the vehicle's file.
    """
    known = np.diag([distance, distance, angle])
    wheel = _wheel_mistake(wheels, motions.angle, known)
    found = [] if wheel is None else [wheel]
    found += _twist_mistakes(motions.twist, known)
    # The slip of a wheel requires correct wheel speeds and twists, so brakes are checked last.
    slips = not found and topics.TWIST.name not in unchecked(signals, motions)
    found += _imu_mistakes(motions, angle)
    if slips:
        found += _brake_mistakes(wheels, signals, motions, vehicle)
    return found


def corrected(vehicle: Mapping[str, Any], mistakes: Iterable[Mistake]) -> dict[str, Any]:
    """Return the values of a vehicle's file after correction of the errors.

    Args:
        vehicle: values of the file.
        mistakes: errors found; those outside the file change nothing.
    """
    changed = dict(vehicle)
    for mistake in mistakes:
        if mistake.wheels is not None:
            changed["wheels"] = {
                name: configuration.to_mapping(mount) for name, mount in mistake.wheels.items()
            }
        if mistake.dead_time is not None:
            changed["brake"] = {**changed.get("brake", {}), "dead_time": mistake.dead_time}
    return changed


def _predicted(wheels: Mapping[str, WheelMount], known: FloatArray) -> FloatArray:
    return kinematics.PlatformKinematics.of(wheels).wheel_speeds(known)


def _misfit(angle: FloatArray, predicted: FloatArray) -> float:
    """Return the largest relative error of the wheels' angles against the prediction [1]."""
    error = np.linalg.norm(angle - predicted, axis=0)
    return float(np.max(error / np.maximum(np.linalg.norm(predicted, axis=0), 1e-9)))


def _wheel_mistake(
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray
) -> Mistake | None:
    if _misfit(angle, _predicted(wheels, known)) < _ALLOWED.misfit:
        return None
    candidates = []
    for mistake in _hypotheses(wheels, angle, known):
        try:
            misfit = _misfit(angle, _predicted(mistake.wheels or wheels, known))
        except configuration.ConfigurationError:  # no valid vehicle
            continue
        candidates.append((misfit, mistake))
    misfit, best = min(candidates, key=lambda candidate: candidate[0])
    if misfit < _ALLOWED.misfit:
        return best
    return Mistake(
        "wheels: no single mistake explains the wheel angles",
        "check distances and directions of the drive; then check each wheel on blocks",
    )


def _hypotheses(
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray
) -> Iterator[Mistake]:
    for one, other in itertools.combinations(wheels, 2):
        swapped = {**wheels, one: wheels[other], other: wheels[one]}
        yield Mistake(
            f"wheels {one} and {other} are exchanged", "exchange their encoders or names", swapped
        )
    predicted = _predicted(wheels, known)
    scale = np.sum(angle * predicted, axis=0) / np.sum(predicted**2, axis=0)
    for row, (name, mount) in enumerate(wheels.items()):
        for part, remedy, changed in _changes(mount, float(scale[row])):
            yield Mistake(f"{part} of wheel {name} is wrong", remedy, {**wheels, name: changed})
    common = float(np.median(scale))
    for of_all in zip(*(_changes(mount, common) for mount in wheels.values()), strict=True):
        part, remedy, _ = of_all[0]
        described = dict(zip(wheels, (changed for _, _, changed in of_all), strict=True))
        yield Mistake(f"{part} of all wheels is wrong", f"{remedy}, for every wheel", described)


def _changes(mount: WheelMount, scale: float) -> Iterator[tuple[str, str, WheelMount]]:
    """Yield possible single errors of a wheel: the wrong item, its remedy, and the corrected wheel.

    Args:
        mount: wheel as described.
        scale: ratio of the measured to the predicted angle of the wheel [1].
    """
    turned = (mount.heading_deg + 360.0) % 360.0 - 180.0
    radius = min(mount.radius / max(scale, 0.1), 10.0)  # largest valid radius
    other_radius = f"set radius to {radius:.4f}, or check the counts of the encoder"
    for part, remedy, changed in (
        ("direction", "negate the speed, or turn heading_deg by 180", {"heading_deg": turned}),
        ("roller", "negate roller_angle_deg", {"roller_angle_deg": -mount.roller_angle_deg}),
        ("x", "negate x", {"x": -mount.x}),
        ("y", "negate y", {"y": -mount.y}),
        ("radius", other_radius, {"radius": radius}),
    ):
        yield part, remedy, dataclasses.replace(mount, **changed)


def _twist_mistakes(twist: FloatArray, known: FloatArray) -> Iterator[Mistake]:
    if not np.all(np.isfinite(twist)):
        return
    forward, left, turn = twist
    distance, angle = known[0, 0], known[2, 2]
    heading = math.atan2(forward[1], forward[0])
    across = math.atan2(-left[0], left[1])
    difference = math.remainder(across - heading, math.tau)
    if abs(difference) > math.pi / 2:
        axis = "y" if abs(heading) < math.pi / 2 else "x"
        yield Mistake(f"twist sensor: {axis} has the wrong sign", f"negate v_{axis}")
        return
    mean = heading + 0.5 * difference
    if abs(mean) > _ALLOWED.heading:
        degrees = 180 - round(180.0 - math.degrees(mean)) % 360  # 180 instead of -180
        remedy = "subtract this angle from heading_deg of its sensors"
        yield Mistake(f"twist sensor: mounted {degrees} deg off", remedy)
    remedies = "negate the yaw rate", "check unit and lever of its sensors"
    yield from _scale_mistakes("twist sensor: yaw rate", *remedies, turn[2] / angle)
    scale = 0.5 * (math.hypot(*forward[:2]) + math.hypot(*left[:2])) / distance
    remedy = "check height, scale and unit of its sensors"
    yield from _scale_mistakes("twist sensor: speed", "", remedy, scale)
    # When the vehicle turns by an angle, a sensor at (x, y) moves by (-y, x) times the angle.
    x, y = turn[1] / angle, -turn[0] / angle
    if math.hypot(x, y) > _ALLOWED.offset and abs(mean) <= _ALLOWED.heading:
        yield Mistake(
            f"twist sensor: measures at ({x:.2f}, {y:.2f}) m instead of the center",
            "enter this position for its sensors",
        )


def _scale_mistakes(quantity: str, of_sign: str, of_scale: str, scale: float) -> Iterator[Mistake]:
    """Yield the error of a quantity from its ratio of measured to true [1], of sign or of scale."""
    if scale < 0.0:
        yield Mistake(f"{quantity} has the wrong sign", of_sign)
    elif abs(scale - 1.0) > _ALLOWED.scale:
        yield Mistake(f"{quantity} is {scale:.3f} times the true one", of_scale)


def _imu_mistakes(motions: Motions, angle: float) -> Iterator[Mistake]:
    turned = float(motions.gyro[2])
    if np.isfinite(turned):
        remedies = "negate it, or mount it upright", "check its unit (rad/s) and scale"
        yield from _scale_mistakes("gyro: yaw rate", *remedies, turned / angle)
    force = motions.force[:2]
    if not np.all(np.isfinite(force)) or np.max(np.abs(force), axis=1).min() < _ALLOWED.force:
        return
    along, across = np.diag(force), np.diag(force[:, ::-1])
    if np.all(np.abs(along) > np.abs(across)):
        for axis, value in zip("xy", along, strict=True):
            if value < 0.0:
                yield Mistake(f"accelerometer: {axis} has the wrong sign", f"negate its {axis}")
    elif np.all(np.abs(along) < np.abs(across)):
        yield Mistake("accelerometer: x and y are exchanged", "exchange them, or turn it by 90 deg")


class _Response(NamedTuple):
    """Response of the wheels to their brakes during the stops, T rows and N wheels.

    Attributes:
        torque: torque of each brake [N m], from slip and deceleration of its wheel, shape (T, N).
        demand: predicted demand of each brake after its described delays [1], shape (T, N).
        rolling: speed of each wheel if it rolled without slip [rad/s], shape (T, N).
        moving: whether each wheel would roll fast enough for its slip to be defined, shape (T, N).
        braking: whether the driver brakes, shape (T, 1).
        near: whether a row is close to the beginning of a stop, shape (T,).
    """

    torque: FloatArray
    demand: FloatArray
    rolling: FloatArray
    moving: BoolArray
    braking: BoolArray
    near: BoolArray


def _response(
    wheels: Mapping[str, WheelMount],
    signals: Signals,
    motions: Motions,
    vehicle: VehicleConfiguration,
) -> _Response:
    """Return the response of the wheels, on tires whose force is proportional to the slip.

    A steeper model of the tires would turn small errors of the twist into large forces.
    """
    predicted = _predicted(wheels, motions.twist)
    # A loaded wheel has a smaller rolling radius. The ratio of this radius to the described one
    # cancels in the slip.
    scale = np.sum(motions.angle * predicted, axis=0) / np.sum(predicted**2, axis=0)
    rolling = scale * _predicted(wheels, signals.twist[motions.stop])
    pedal = np.nan_to_num(signals.pedal[motions.stop], nan=1.0)  # no value: full demand
    moving = np.abs(rolling) > _ALLOWED.slowest * np.nanmax(np.abs(rolling))
    speed = signals.wheel_speed[motions.stop]
    slip = 1.0 - speed / np.where(moving, rolling, 1.0)
    slower = -np.sign(rolling) * np.diff(speed, axis=0, prepend=speed[:1]) / signals.period
    facts = wheel_facts(vehicle)
    limit = np.array([facts[name].grip * mount.radius for name, mount in vehicle.wheels.items()])
    torque = np.where(moving, limit * slip + vehicle.wheel_inertia * slower, 0.0)
    # A brake without an enable is on.
    demand = pedal[:, np.newaxis] * np.nan_to_num(signals.enable[motions.stop], nan=1.0)
    rows = np.arange(len(pedal))
    begun = np.flatnonzero(np.diff((pedal > 0.0).astype(int), prepend=0) > 0)
    apart = np.abs(rows[:, np.newaxis] - begun).min(axis=1, initial=len(rows))
    return _Response(
        torque,
        _acting(demand, signals.period, vehicle.brake),
        rolling,
        moving,
        pedal[:, np.newaxis] > 0.0,
        apart * signals.period <= _ALLOWED.latest,
    )


def _acting(demand: FloatArray, period: float, brake: BrakeConfiguration) -> FloatArray:
    """Return the demand of each brake after its described delays and lag [1], shape (T, N)."""
    applied, released = (round(time / period) for time in (brake.dead_time, brake.release_time))
    if brake.kind == ON_OFF:
        demand = np.round(demand)
    # A brake that releases late follows the largest of the demands in between.
    later = [
        np.concatenate((np.zeros((row, demand.shape[1])), demand[: len(demand) - row]))
        for row in range(applied, max(applied, released) + 1)
    ]
    left = math.exp(-period / brake.time_constant) if brake.time_constant > 0.0 else 0.0
    return np.asarray(lfilter([1.0 - left], [1.0, -left], np.max(later, axis=0), axis=0))


def _action(response: _Response, demand: FloatArray, brake: BrakeConfiguration) -> FloatArray:
    """Return the torque of each brake [N m] for demands [1], shape (T, N).

    The rolling speed limits the torque, because the measured speed depends on the slip.
    """
    return brake.limited(demand * brake.max_torque, response.rolling)


def _late(response: _Response, period: float, brake: BrakeConfiguration) -> int:
    """Return the delay of the wheels after the predicted torque when stops begin, in rows.

    The mean of all wheels neither depends on the order of the brakes nor on a single brake. If no
    stop begins while a wheel moves, this is the delay of brakes as described.
    """
    torque, action = (
        np.ma.masked_array(values, ~response.moving).mean(axis=1, keepdims=True).filled(0.0)
        for values in (response.torque, _action(response, response.demand, brake))
    )
    near = np.flatnonzero(response.near & np.any(response.moving, axis=1))
    rows = range(-round(brake.dead_time / period), round(_ALLOWED.latest / period))
    if not len(near):
        return 1
    return max(rows, key=lambda row: _correlation(torque[near], _earlier(action, near, row)))


def _gains(
    response: _Response, late: int, brake: BrakeConfiguration
) -> dict[tuple[int, int], float]:
    """Return by how much the exchange of two brakes increases the sum of correlations, by indices.

    Measured and predicted torque are correlated relative to the mean of all wheels: the pedal acts
    on all brakes at once, so wheels differ only in their deviation from the mean.
    """
    torque = _without_mean(response.torque, response.moving)
    braking = np.flatnonzero(response.braking & np.any(response.moving, axis=1, keepdims=True))

    def score(order: list[int]) -> float:
        """Return the sum of correlations if each wheel has the brake with this index."""
        action = _action(response, response.demand[:, order], brake)
        action = _earlier(_without_mean(action, response.moving), braking, late)
        return float(np.trace(_correlation(torque[braking], action)))

    order = list(range(torque.shape[1]))
    described, gains = score(order), {}
    for i, j in itertools.combinations(order, 2):
        exchanged = [{i: j, j: i}.get(row, row) for row in order]
        gains[i, j] = score(exchanged) - described + min(described, 0.0)
    return gains


def undistinguished_brakes(
    wheels: Mapping[str, WheelMount],
    signals: Signals,
    motions: Motions,
    *,
    vehicle: VehicleConfiguration,
) -> list[tuple[str, str]]:
    """Return the pairs of brakes whose exchange could not be detected from the stops of a drive.

    Args:
        wheels: wheels as described in the vehicle's file.
        signals: signals of the drive.
        motions: motions of the drive.
        vehicle: brakes, inertia and loads of the wheels as described in the vehicle's file.
    """
    response = _response(wheels, signals, motions, vehicle)
    gains = _gains(response, _late(response, signals.period, vehicle.brake), vehicle.brake)
    names = list(wheels)
    return [
        (names[one], names[other]) for (one, other), gain in gains.items() if gain > -_ALLOWED.gain
    ]


def _brake_mistakes(
    wheels: Mapping[str, WheelMount],
    signals: Signals,
    motions: Motions,
    vehicle: VehicleConfiguration,
) -> Iterator[Mistake]:
    brake, names = vehicle.brake, list(wheels)
    response = _response(wheels, signals, motions, vehicle)
    demand = np.where(response.moving, response.demand, 0.0)
    braked, longest = np.sum(demand, axis=0), np.sum(response.moving & response.braking, axis=0)
    tested = braked >= np.minimum(_ALLOWED.braked / signals.period, _ALLOWED.share * longest)
    torque = np.sum(demand * response.torque, axis=0) / np.maximum(braked, 1e-9)
    dead = tested & (torque < _ALLOWED.response * np.max(torque))
    for row in np.flatnonzero(dead):
        remedy = "check its wiring, valve and power, and the order of the outputs"
        yield Mistake(f"brake {names[row]} does not act", remedy)
        return
    late = _late(response, signals.period, brake)
    gains = _gains(response, late, brake)
    pair = max(gains, key=lambda key: gains[key])
    if gains[pair] > _ALLOWED.gain:
        one, other = (names[row] for row in pair)
        yield Mistake(f"brakes {one} and {other} are exchanged", "exchange their outputs")
        return
    # The wheels respond to a demand in the next row at the earliest.
    delay = brake.dead_time + (late - 1) * signals.period
    if abs(delay - brake.dead_time) > _ALLOWED.delay:
        yield Mistake(
            f"brakes: dead time is about {1e3 * delay:.0f} ms",
            f"set brake.dead_time to {delay:.2f}, or fit it by ./omni fit-brakes",
            dead_time=delay,
        )


def _earlier(values: FloatArray, rows: IntArray, by: int) -> FloatArray:
    """Return the values `by` rows before the given rows."""
    return np.asarray(values[np.clip(rows - by, 0, len(values) - 1)])


def _without_mean(values: FloatArray, used: BoolArray) -> FloatArray:
    """Subtract from each row the mean of its used values; unused values become 0."""
    chosen = np.ma.masked_array(values, ~used)
    return np.asarray((chosen - chosen.mean(axis=1, keepdims=True)).filled(0.0))


def _correlation(rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the correlations of all pairs of columns, 0 for a constant column or without rows."""
    if not len(rows):
        return np.zeros((rows.shape[1], columns.shape[1]))
    a, b = rows - rows.mean(axis=0), columns - columns.mean(axis=0)
    scale = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    return np.where(scale > 1e-9, (a.T @ b) / np.maximum(scale, 1e-9), 0.0)
