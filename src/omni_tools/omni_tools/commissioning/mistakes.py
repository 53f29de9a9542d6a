"""Errors in a vehicle's file, found by hypothesis tests on a commissioning drive.

In this run, the vehicle moves forward by a known distance, to the left by a known distance, and
counter-clockwise by a known angle. Eq. (32) predicts the angle by which each wheel turns in each
motion. Each hypothesis assumes errors in the file's description of the wheels. Of the hypotheses
that explain the measured wheel angles, the one with the fewest errors is reported. Twist sensor,
gyro and accelerometer are compared with the known motions directly, and the brakes with the enables
that they should follow.
"""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from omni_core import configuration, kinematics, topics
from omni_core.geometry import WheelMount
from omni_core.quantities import FloatArray
from omni_core.signals import upwards_problem
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.commissioning import brakes
from omni_tools.commissioning.signals import Motions, Signals, unchecked


class Tolerances(NamedTuple):
    """Tolerances of the tests, within which the description of a vehicle counts as correct.

    Attributes:
        misfit: limit on the difference between measured and predicted angles of a wheel, relative
            to the predicted angles [1].
        wheel: limit on the relative error of a wheel's radius compared with all wheels, and of the
            distances of the wheels from the center [1].
        heading: limit on the error of a twist sensor's mounting angle [rad].
        scale: limit on the relative error of the scale of twist sensor and gyro, and of the radius
            of all wheels, which also depends on their load [1].
        offset: limit on the error of a twist sensor's position [m].
        force: minimum acceleration for a test of an IMU's axes [m/s^2].
        force_heading: limit on the error of an IMU's mounting angle, measured by the acceleration
            [rad].
        radius: factor between measured and expected wheel speeds above which the encoder, and not
            the radius, counts as wrong; a diameter in place of a radius gives a factor of 2 [1].
    """

    misfit: float = 0.06
    wheel: float = 0.03
    heading: float = math.radians(2.0)
    scale: float = 0.05
    offset: float = 0.03
    force: float = 0.05
    force_heading: float = math.radians(20.0)
    radius: float = 2.5


_ALLOWED = Tolerances()


class Mistake(NamedTuple):
    """An error in the description of a vehicle, and the remedy.

    Attributes:
        name: name of the error and of the wheel or sensor concerned.
        remedy: advice on what to change in the description.
        wheels: corrected wheels, keyed by name; None if the error does not concern wheels.
        dead_time: corrected dead time of the brakes [s]; None if the dead time is not wrong.
    """

    name: str
    remedy: str
    wheels: Mapping[str, WheelMount] | None = None
    dead_time: float | None = None


def find_mistakes(
    vehicle: VehicleConfiguration, signals: Signals, motions: Motions, distance: float, angle: float
) -> list[Mistake]:
    """Return the errors in a vehicle's description that a commissioning drive reveals.

    Args:
        vehicle: wheels, brakes, inertia and loads as described in the vehicle's file.
        signals: signals of the run.
        motions: motions of the run.
        distance: distance of the forward motion and of the motion to the left [m].
        angle: angle of the counter-clockwise rotation [rad].

    Raises:
        UnusablePlatformError: a wheel is conventional.
    """
    kinematics.require_omni_wheels(vehicle.wheels, "check-vehicle")
    known = np.diag([distance, distance, angle])
    # A gyro measures the angle of the rotation more accurately than a tape, unless it is wrong.
    turned = motions.gyro[2] if abs(motions.gyro[2] / angle - 1.0) < _ALLOWED.scale else angle
    found = _wheel_mistakes(vehicle.wheels, motions.angle, np.diag([distance, distance, turned]))
    found += _twist_mistakes(motions.twist, known)
    # The slip is computed from wheel speeds and twists, so brakes are checked last.
    slips = not found and topics.TWIST.name not in unchecked(signals, motions)
    found += _imu_mistakes(signals.upwards, motions, angle)
    if slips:
        found += _brake_mistakes(vehicle, signals, motions)
    if signals.inverse_pedal:
        remedy = "1 must be full braking and 0 none: publish 1 minus this value"
        found.append(Mistake("pedal: the braking demand is inverted", remedy))
    return found


def corrected(vehicle: Mapping[str, Any], mistakes: Iterable[Mistake]) -> dict[str, Any]:
    """Return the nested values of a vehicle's file after correction of the errors.

    Args:
        vehicle: values of the file.
        mistakes: errors found; errors outside the file have no effect.
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


def _misfit(wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray) -> FloatArray:
    """Return the error of each wheel's angles relative to the predicted ones [1], shape (N,).

    It is infinite if the wheels are not those of a usable platform.

    Args:
        wheels: wheels that predict the angles.
        angle: measured angle of each wheel in each motion [rad], shape (3, N).
        known: known displacement x, y [m] and rotation [rad] in each motion, shape (3, 3).
    """
    try:
        predicted = _predicted(wheels, known)
    except configuration.ConfigurationError:
        return np.full(len(wheels), math.inf)
    error = np.linalg.norm(angle - predicted, axis=0)
    return np.asarray(error / np.maximum(np.linalg.norm(predicted, axis=0), 1e-9))


def _wheel_mistakes(
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray
) -> list[Mistake]:
    """Return the errors of the encoders and of the description of the wheels.

    The wheel angles are first corrected for the errors of the encoders. Of the hypotheses that
    explain the corrected angles, the one with the fewest errors is returned. If there is none and
    no encoder is wrong, the result is one `Mistake` that names no cause.

    Args:
        wheels: wheels as described in the vehicle's file.
        angle: measured angles as in `_misfit`.
        known: motions as in `_misfit`.
    """
    names, predicted = [f"wheel {name}" for name in wheels], _predicted(wheels, known)
    # In a straight motion, position and signs do not change the sum of squares of the speeds.
    lengths = (np.linalg.norm(values[:2], axis=0) for values in (angle, predicted))
    ratio = np.divide(*lengths)
    wrong = np.abs(np.log(np.maximum(ratio, 1e-9))) > math.log(_ALLOWED.radius)
    if np.all(wrong):
        names, ratio = ["all wheels"], np.full(len(wheels), np.median(ratio))
    found = [
        Mistake(
            f"speed of {name} is {ratio[row]:.3g} times the expected one",
            "check unit (rad/s), counts per revolution and gear ratio of the encoder",
        )
        for row, name in enumerate(names)
        if wrong[row]
    ]
    angle, limit = angle / np.where(wrong, np.maximum(ratio, 1e-9), 1.0), _ALLOWED.misfit
    fits = [
        _explained(words, described, angle, known)
        for words, described in _hypotheses(wheels, angle, known)
    ]
    explained = [(len(mistakes), misfit, mistakes) for misfit, mistakes in fits if misfit < limit]
    if explained:
        return found + min(explained, key=lambda one: one[:2])[2]
    unexplained = Mistake(
        "wheels: no single mistake of each wheel explains the wheel angles",
        "check distances and directions of the motions; then check each wheel on blocks",
    )
    return found or [unexplained]


def _explained(
    words: Sequence[tuple[str, str]],
    described: Mapping[str, WheelMount],
    angle: FloatArray,
    known: FloatArray,
) -> tuple[float, list[Mistake]]:
    """Return the largest misfit of a wheel under a hypothesis [1], and the mistakes.

    The mistakes are those of the hypothesis and those found by `_scale_errors`.

    Args:
        words: name and remedy of each mistake of the hypothesis.
        described: wheels after correction of these mistakes.
        angle: measured angles as in `_misfit`.
        known: motions as in `_misfit`.
    """
    try:
        scaled, final = _scale_errors(described, angle, known)
    except configuration.ConfigurationError:  # wheels that no vehicle can have
        return math.inf, []
    mistakes = [Mistake(*pair, final) for pair in (*words, *scaled)]
    return float(np.max(_misfit(final, angle, known))), mistakes


def _scale_errors(
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray
) -> tuple[list[tuple[str, str]], dict[str, WheelMount]]:
    """Return errors of the wheels' radii and distances from the center, and the corrected wheels.

    Each error is a pair of name and remedy. A least-squares fit gives the scale of the angles of
    each wheel, and the difference of this scale in the rotation, which is common to all wheels.

    Args:
        wheels: wheels as described in the vehicle's file.
        angle: measured angles as in `_misfit`.
        known: motions as in `_misfit`.
    """
    predicted, count = _predicted(wheels, known), len(wheels)
    design = np.zeros((3, count, count + 1))
    design[:, range(count), range(count)] = predicted
    design[2, :, count] = predicted[2]
    solution = np.linalg.lstsq(design.reshape(-1, count + 1), angle.ravel(), rcond=None)[0]
    *each, turn = solution.tolist()
    common = float(np.median(each))
    lever = 1.0 + turn / max(common, 1.0 / _ALLOWED.radius)
    words, described = [], dict(wheels)
    if all_wrong := abs(common - 1.0) > _ALLOWED.scale:
        words.append(("radius of all wheels is wrong", f"divide each radius by {common:.3f}"))
    for (name, mount), scale in zip(wheels.items(), each, strict=True):
        single = abs(scale / common - 1.0) > _ALLOWED.wheel
        if single or all_wrong:
            factor = max(scale if single else common, 1.0 / _ALLOWED.radius)
            described[name] = dataclasses.replace(mount, radius=mount.radius / factor)
        if single:
            remedy = f"set radius to {described[name].radius:.4f}, or check the encoder"
            words.append((f"radius of wheel {name} is wrong", remedy))
    if abs(lever - 1.0) > _ALLOWED.wheel and lever > 0.0:
        described = {
            name: dataclasses.replace(mount, x=lever * mount.x, y=lever * mount.y)
            for name, mount in described.items()
        }
        words.append(
            (
                f"wheelbase or track: the wheels are {lever:.2f} times as far from the center",
                "check the angle of the turn, then x and y of all wheels; on Mecanum wheels the "
                "turn shows only the sum of wheelbase and track",
            )
        )
    return words, described


def _hypotheses(
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray
) -> Iterator[tuple[list[tuple[str, str]], dict[str, WheelMount]]]:
    """Yield the mistakes of each hypothesis by name and remedy, and the corrected wheels.

    In the first hypothesis, each wheel has the change that fits best, or none. In the second,
    wheels are swapped; it is omitted if no swap fits better. In each further hypothesis, all wheels
    have the same change.

    Args:
        wheels: wheels as described in the vehicle's file.
        angle: measured angles as in `_misfit`.
        known: motions as in `_misfit`.
    """
    words, described = [], dict(wheels)
    for row, (name, mount) in enumerate(wheels.items()):
        changes = [("", "", mount), *_changes(mount)]
        fits = [_misfit({**wheels, name: one}, angle, known)[row] for _, _, one in changes]
        part, remedy, described[name] = changes[int(np.argmin(fits))]
        words += [(f"{part} of wheel {name} is wrong", remedy)] * bool(part)
    yield words, described
    names, mounts = list(wheels), list(wheels.values())
    predicted = _predicted(wheels, known)
    # Relative error if the speeds of wheel j are those of wheel i; a wheel keeps its place unless
    # another place fits better by more than the tolerance.
    length = np.maximum(np.linalg.norm(predicted, axis=0), 1e-9)
    error = np.linalg.norm(angle[:, np.newaxis] - predicted[:, :, np.newaxis], axis=0)
    cost = error / length[:, np.newaxis] + _ALLOWED.misfit * ~np.eye(len(names), dtype=np.bool_)
    of_place, of_speed = linear_sum_assignment(cost)
    places = dict(zip(of_speed, of_place, strict=True))
    moved = " and ".join(name for row, name in enumerate(names) if places[row] != row)
    if moved:
        order = {name: mounts[places[row]] for row, name in enumerate(names)}
        yield [(f"wheels {moved} are swapped", "swap their encoders or names")], order
    for of_all in zip(*map(_changes, mounts), strict=True):
        part, remedy, _ = of_all[0]
        changed = {name: mount for name, (_, _, mount) in zip(wheels, of_all, strict=True)}
        yield [(f"{part} of all wheels is wrong", f"{remedy}, for every wheel")], changed


def _changes(mount: WheelMount) -> Iterator[tuple[str, str, WheelMount]]:
    """Yield possible sign errors of a wheel: wrong value, remedy, and the corrected wheel."""
    turned = (mount.heading_deg + 360.0) % 360.0 - 180.0
    changed, roller = dataclasses.replace, -mount.roller_angle_deg
    words = "negate the speed, or turn heading_deg by 180"
    yield "direction", words, changed(mount, heading_deg=turned)
    yield "roller", "negate roller_angle_deg", changed(mount, roller_angle_deg=roller)
    yield "x", "negate x", changed(mount, x=-mount.x)
    yield "y", "negate y", changed(mount, y=-mount.y)


def _twist_mistakes(twist: FloatArray, known: FloatArray) -> Iterator[Mistake]:
    """Yield errors of axes, scale and position of the twist sensor in the three known motions."""
    if not np.all(np.isfinite(twist)):
        return
    forward, left, turn = twist
    distance, angle = known[0, 0], known[2, 2]
    mounting = [*_mounting_mistakes("twist sensor", forward, left, _ALLOWED.heading)]
    yield from mounting
    if np.linalg.det([forward[:2], left[:2]]) < 0.0:  # the axes are mirrored
        return
    remedies = "negate the yaw rate", "check unit and lever of its sensors"
    yield from _scale_mistakes("twist sensor: yaw rate", *remedies, turn[2] / angle)
    scale = 0.5 * (math.hypot(*forward[:2]) + math.hypot(*left[:2])) / distance
    remedy = "check height, scale and unit of its sensors"
    yield from _scale_mistakes("twist sensor: speed", "", remedy, scale)
    # When the vehicle turns by an angle, a sensor at (x, y) moves by (-y, x) times the angle.
    x, y = turn[1] / angle, -turn[0] / angle
    if math.hypot(x, y) > _ALLOWED.offset and not mounting:
        yield Mistake(
            f"twist sensor: measures at ({x:.2f}, {y:.2f}) m instead of the center",
            "enter this position for its sensors",
        )


def _scale_mistakes(quantity: str, of_sign: str, of_scale: str, scale: float) -> Iterator[Mistake]:
    """Yield a `Mistake` if the sign of a quantity is wrong, or its scale is outside the tolerance.

    Args:
        quantity: name of the measured quantity.
        of_sign: advice for a wrong sign.
        of_scale: advice for a wrong scale.
        scale: ratio of the measured to the true quantity [1].
    """
    if scale < 0.0:
        yield Mistake(f"{quantity} has the wrong sign", of_sign)
    elif abs(scale - 1.0) > _ALLOWED.scale:
        yield Mistake(f"{quantity} is {scale:.3f} times the true one", of_scale)


def _mounting_mistakes(
    sensor: str, forward: FloatArray, left: FloatArray, tolerance: float
) -> Iterator[Mistake]:
    """Yield the error of a sensor's axes, if there is one.

    Args:
        sensor: name of the sensor.
        forward: x and y that the sensor measures while the true vector points forward; further
            components are ignored.
        left: x and y that the sensor measures while the true vector points to the left.
        tolerance: limit on the error of the mounting angle [rad].
    """
    heading = math.atan2(forward[1], forward[0])
    across = math.atan2(-left[0], left[1])
    difference = math.remainder(across - heading, math.tau)
    mean = heading + 0.5 * difference
    if abs(difference) > math.pi / 2:
        if abs(forward[1]) > abs(forward[0]):
            yield Mistake(f"{sensor}: x and y are swapped", "swap them, and check the signs")
        else:
            axis = "y" if forward[0] > 0.0 else "x"
            yield Mistake(f"{sensor}: {axis} has the wrong sign", f"negate its {axis}")
    elif abs(mean) > tolerance:
        degrees = 180 - round(180.0 - math.degrees(mean)) % 360  # 180 instead of -180
        yield Mistake(
            f"{sensor}: mounted {degrees} deg off", "subtract this angle from its heading"
        )


def _imu_mistakes(upwards: float, motions: Motions, angle: float) -> Iterator[Mistake]:
    if not math.isnan(upwards) and (problem := upwards_problem(upwards)):
        yield Mistake(*problem)
    turned = float(motions.gyro[2])
    if np.isfinite(turned):
        remedies = "negate it, or mount it upright", "check its unit (rad/s), axes and scale"
        yield from _scale_mistakes("gyro: yaw rate", *remedies, turned / angle)
    forward, left = force = motions.force[:2]
    if np.all(np.isfinite(force)) and np.max(np.abs(force), axis=1).min() >= _ALLOWED.force:
        yield from _mounting_mistakes("accelerometer", forward, left, _ALLOWED.force_heading)


def _brake_mistakes(
    vehicle: VehicleConfiguration, signals: Signals, motions: Motions
) -> Iterator[Mistake]:
    names, response = list(vehicle.wheels), brakes.response_of(vehicle, signals, motions)
    pair, idle = brakes.swapped(response), brakes.idle(response)
    opposite = signals._replace(enable=1.0 - signals.enable)
    if brakes.inverted(response, brakes.response_of(vehicle, opposite, motions)):
        remedy = "1 must pass the demand and 0 release the brake: invert the outputs"
        yield Mistake("brakes: the enables act inversely", remedy)
    elif pair is not None:
        one, other = (names[row] for row in pair)
        yield Mistake(f"brakes {one} and {other} are swapped", "swap their outputs")
    elif idle is not None:
        remedy = "check its wiring, valve and power, and the order of the outputs"
        yield Mistake(f"brake {names[idle]} does not act", remedy)
    elif (delay := brakes.dead_time(response)) is not None:
        yield Mistake(
            f"brakes: dead time is about {1e3 * delay:.0f} ms",
            f"set brake.dead_time to {delay:.2f}, or fit it by ./omni fit-brakes",
            dead_time=delay,
        )


def undistinguished_brakes(
    vehicle: VehicleConfiguration, signals: Signals, motions: Motions
) -> list[tuple[str, str]]:
    """Return the pairs of brakes for which the stops of a run cannot show whether they are swapped.

    Args:
        vehicle: wheels, brakes, inertia and loads as described in the vehicle's file.
        signals: signals of the run.
        motions: motions of the run.
    """
    names, response = list(vehicle.wheels), brakes.response_of(vehicle, signals, motions)
    return [(names[one], names[other]) for one, other in brakes.undistinguished(response)]
