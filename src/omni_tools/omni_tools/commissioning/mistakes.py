"""Mistakes in the description of a vehicle, by hypothesis tests on a commissioning drive.

Three known motions give three angles per wheel, Eq. (32). Each hypothesis changes one item of the
description. The hypothesis whose prediction fits the measured angles is the mistake. Twist sensor,
gyro and accelerometer are compared with the known motions directly, the brakes with the enables
that they should follow.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from omni_platform import configuration, kinematics
from omni_platform.brakes import BrakeConfiguration
from omni_platform.geometry import WheelMount
from omni_platform.quantities import FloatArray
from omni_tools.commissioning.signals import Motions, Signals


class Tolerances(NamedTuple):
    """Limits of the tests: errors up to which a description counts as right, and conditions.

    Attributes:
        misfit: largest error of a wheel's angles relative to the predicted angles [1].
        heading: largest error of a twist sensor's mounting angle [rad].
        scale: largest relative error of the scale of twist sensor and gyro [1].
        offset: largest error of a twist sensor's position [m].
        force: smallest specific force with which the axes of an IMU are tested [m/s^2].
        latest: time after which a brake must have responded [s].
        response: smallest rise of the slip of a braking wheel [1].
        braked: time for which a moving wheel must have been braked for a test [s].
        exchange: smallest increase of the summed correlations with which brakes count as exchanged
            [1].
        delay: largest difference between measured and described dead time [s].
    """

    misfit: float = 0.06
    heading: float = math.radians(2.0)
    scale: float = 0.05
    offset: float = 0.03
    force: float = 0.05
    latest: float = 0.3
    response: float = 0.03
    braked: float = 0.2
    exchange: float = 0.25
    delay: float = 0.03


_ALLOWED = Tolerances()


@dataclasses.dataclass(frozen=True)
class Mistake:
    """A mistake and its remedy.

    Attributes:
        name: name of the mistake, with the wheel or the sensor.
        remedy: advice what to change.
        wheels: corrected wheels, if the description of the wheels is wrong.
        dead_time: corrected dead time of the brakes [s], if the described one is wrong.
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
    brake: BrakeConfiguration,
    allowed: Tolerances = _ALLOWED,
) -> list[Mistake]:
    """Return the mistakes found in a drive.

    Args:
        wheels: wheels as described in the vehicle's file.
        signals: signals of the drive.
        motions: motions of the drive.
        distance: distance of the motions forward and to the left [m].
        angle: angle of the motion counter-clockwise [rad].
        brake: brakes as described in the vehicle's file.
        allowed: tolerances of the tests.
    """
    known = np.diag([distance, distance, angle])
    wheel = _wheel_mistake(wheels, motions.angle, known, allowed.misfit)
    found = [] if wheel is None else [wheel]
    found += _twist_mistakes(motions.twist, known, allowed)
    # The slip of a wheel needs a correct wheel speed and twist, so brakes are checked last.
    slips = not found and np.any(np.isfinite(signals.enable)) and np.any(motions.twist)
    found += _imu_mistakes(motions, angle, allowed)
    if slips:
        found += _brake_mistakes(wheels, signals, motions.stop, brake, allowed)
    return found


def corrected(vehicle: Mapping[str, Any], mistakes: Iterable[Mistake]) -> dict[str, Any]:
    """Return the values of a vehicle's file with its mistakes corrected.

    Args:
        vehicle: values of the file.
        mistakes: mistakes found; mistakes outside the file change nothing.
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
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray, allowed: float
) -> Mistake | None:
    if _misfit(angle, _predicted(wheels, known)) < allowed:
        return None
    candidates = []
    for mistake in _hypotheses(wheels, angle, known):
        try:
            misfit = _misfit(angle, _predicted(mistake.wheels or wheels, known))
        except configuration.ConfigurationError:  # no valid vehicle
            continue
        candidates.append((misfit, mistake))
    misfit, best = min(candidates, key=lambda candidate: candidate[0])
    if misfit < allowed:
        return best
    return Mistake(
        "wheels: no single mistake explains the wheel angles",
        "check distances and directions of the drive, then wheel by wheel on blocks",
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
    """Yield possible single errors of a wheel: the wrong part, the remedy, and the corrected wheel.

    Args:
        mount: wheel as described.
        scale: measured over predicted angle of the wheel [1].
    """
    turned = (mount.heading_deg + 360.0) % 360.0 - 180.0
    radius = min(mount.radius / max(scale, 0.1), 10.0)  # largest valid radius
    for part, remedy, field, value in (
        ("direction", "negate the speed, or turn heading_deg by 180", "heading_deg", turned),
        ("roller", "negate roller_angle_deg", "roller_angle_deg", -mount.roller_angle_deg),
        ("x", "negate x", "x", -mount.x),
        ("y", "negate y", "y", -mount.y),
        (
            "radius",
            f"set radius to {radius:.4f}, or check the counts of the encoder",
            "radius",
            radius,
        ),
    ):
        yield part, remedy, dataclasses.replace(mount, **{field: value})


def _twist_mistakes(twist: FloatArray, known: FloatArray, allowed: Tolerances) -> Iterator[Mistake]:
    if not np.any(twist):
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
    if abs(mean) > allowed.heading:
        yield Mistake(
            f"twist sensor: mounted {_degrees(mean)} deg off",
            "subtract this angle from heading_deg of its sensors",
        )
    if turn[2] < 0.0:
        yield Mistake("twist sensor: yaw rate has the wrong sign", "negate the yaw rate")
    elif abs(turn[2] / angle - 1.0) > allowed.scale:
        yield Mistake(
            f"twist sensor: yaw rate is {turn[2] / angle:.3f} times the true one",
            "check unit and lever of its sensors",
        )
    scale = 0.5 * (math.hypot(*forward[:2]) + math.hypot(*left[:2])) / distance
    if abs(scale - 1.0) > allowed.scale:
        yield Mistake(
            f"twist sensor: speed is {scale:.3f} times the true one",
            "check height, scale and unit of its sensors",
        )
    # When the vehicle turns by an angle, a sensor at (x, y) moves by (-y, x) times the angle.
    x, y = turn[1] / angle, -turn[0] / angle
    if math.hypot(x, y) > allowed.offset and abs(mean) <= allowed.heading:
        yield Mistake(
            f"twist sensor: measures at ({x:.2f}, {y:.2f}) m instead of the center",
            "enter this position for its sensors",
        )


def _degrees(angle: float) -> int:
    degrees = round(math.degrees(angle))
    return 180 if degrees == -180 else degrees


def _imu_mistakes(motions: Motions, angle: float, allowed: Tolerances) -> Iterator[Mistake]:
    turned = float(motions.gyro[2])
    if np.isfinite(turned) and abs(turned) > 0.0:
        if turned < 0.0:
            yield Mistake("gyro: yaw rate has the wrong sign", "negate it, or mount it upright")
        elif abs(turned / angle - 1.0) > allowed.scale:
            yield Mistake(
                f"gyro: yaw rate is {turned / angle:.3f} times the true one",
                "check its unit (rad/s) and scale",
            )
    force = motions.force[:2]
    if not np.all(np.isfinite(force)) or np.max(np.abs(force), axis=1).min() < allowed.force:
        return
    along = np.array([force[0, 0], force[1, 1]])
    across = np.array([force[0, 1], force[1, 0]])
    if np.all(np.abs(along) > np.abs(across)):
        for axis, value in zip("xy", along, strict=True):
            if value < 0.0:
                yield Mistake(f"accelerometer: {axis} has the wrong sign", f"negate its {axis}")
    elif np.all(np.abs(along) < np.abs(across)):
        yield Mistake("accelerometer: x and y are exchanged", "exchange them, or turn it by 90 deg")


def _brake_mistakes(
    wheels: Mapping[str, WheelMount],
    signals: Signals,
    stop: slice,
    brake: BrakeConfiguration,
    allowed: Tolerances,
) -> Iterator[Mistake]:
    """Compare the slip of each wheel with each enable, both relative to the mean of all wheels.

    The pedal acts on all brakes at once, so only differences to the mean distinguish the wheels.
    """
    names = list(wheels)
    rolling = kinematics.PlatformKinematics.of(wheels).wheel_speeds(signals.twist[stop])
    measured = signals.wheel_speed[stop]
    pedal = np.nan_to_num(signals.pedal[stop])
    demand = pedal[:, np.newaxis] * signals.enable[stop]
    moving = np.abs(rolling) > 0.2 * np.nanmax(np.abs(rolling))
    slip = np.where(moving, 1.0 - measured / np.where(moving, rolling, 1.0), 0.0)
    for row, name in enumerate(names):
        braked = (demand[:, row] > 0.0) & moving[:, row]
        free = (pedal == 0.0) & moving[:, row]
        if np.sum(braked) * signals.period < allowed.braked or not np.any(free):
            continue
        # A loaded wheel has a smaller rolling radius, so it seems to slip by some per cent.
        rise = np.percentile(slip[braked, row], 95) - np.mean(slip[free, row])
        if rise < allowed.response:
            yield Mistake(f"brake {name} does not act", "check its wiring, valve and power")
            return
    braking = np.flatnonzero((pedal > 0.0) & np.any(moving, axis=1))
    relative_slip, relative_demand = _without_mean(slip, moving), _without_mean(demand, moving)
    own, exchanged = [], []  # by delay: fit of the described order; best fit of an exchange, which
    for delay in range(round(allowed.latest / signals.period)):
        late = braking[braking >= delay]
        score = _correlation(relative_slip[late], relative_demand[late - delay])
        fit = np.diagonal(score)
        own.append(float(fit.sum()))
        exchanged.append(
            max(
                (own[-1] + float(score[i, j] + score[j, i] - fit[i] - fit[j]), (i, j))
                for i, j in itertools.combinations(range(len(names)), 2)
            )
        )
    # Each hypothesis is judged at its best delay.
    delay = int(np.argmax(own))
    fit_exchanged, (one, other) = max(exchanged)
    if fit_exchanged > max(own[delay], 0.0) + allowed.exchange:
        yield Mistake(
            f"brakes {names[one]} and {names[other]} are exchanged", "exchange their outputs"
        )
        return
    # The delay was fitted to applying and releasing together.
    found = signals.period * delay
    longest = max(brake.dead_time, brake.release_time)
    short, long = brake.dead_time - found, found - longest
    if own[delay] > 0.0 and max(short, long) > allowed.delay:
        yield Mistake(
            f"brakes: dead time is about {1e3 * found:.0f} ms",
            f"set brake.dead_time to {found:.2f}, or fit it by ./omni fit-brakes",
            dead_time=found,
        )


def _without_mean(values: FloatArray, used: FloatArray) -> FloatArray:
    """Subtract from each row the mean of its used values; unused values become 0."""
    count = np.maximum(np.sum(used, axis=1, keepdims=True), 1)
    mean = np.sum(np.where(used, values, 0.0), axis=1, keepdims=True) / count
    return np.where(used, values - mean, 0.0)


def _correlation(rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the correlations of all pairs of columns, 0 for a constant column."""
    a, b = rows - rows.mean(axis=0), columns - columns.mean(axis=0)
    scale = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    return np.where(scale > 1e-9, (a.T @ b) / np.maximum(scale, 1e-9), 0.0)
