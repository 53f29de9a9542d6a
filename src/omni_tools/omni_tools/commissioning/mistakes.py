"""Errors in a vehicle's file, found by hypothesis tests on a commissioning drive.

In this run, the vehicle moves forward by a known distance, to the left by a known distance, and
counter-clockwise by a known angle. Eq. (32) predicts the angle by which each wheel turns in each
motion. `causes` compares hypotheses about wheels, motions and sensors; this module compares the
sensors with the motions of a hypothesis, and the brakes with the enables that they should follow.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from omni_core import configuration, topics
from omni_core.geometry import WheelMount, turned
from omni_core.quantities import FloatArray
from omni_core.signals import upwards_problem
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.commissioning import brakes, causes
from omni_tools.commissioning.causes import Cause
from omni_tools.commissioning.scales import ALLOWED, SLIP
from omni_tools.commissioning.signals import Motions, Signals, unchecked


class Tolerances(NamedTuple):
    """Tolerances of the sensors, within which they count as correct; scales have those of `scales`.

    Attributes:
        heading: limit on the error of a twist sensor's mounting angle [rad].
        offset: limit on the error of a twist sensor's position [m].
        force: minimum acceleration for a test of an IMU's axes [m/s^2].
        force_heading: limit on the error of an IMU's mounting angle, measured by the acceleration
            [rad].
    """

    heading: float = math.radians(2.0)
    offset: float = 0.03
    force: float = 0.05
    force_heading: float = math.radians(20.0)


_ALLOWED = Tolerances()
_BRAKES = "brakes"  # key of the causes that concern brakes


class Findings(NamedTuple):
    """What a commissioning drive reveals about a vehicle's description.

    Attributes:
        mistakes: errors that are certain.
        undecided: alternatives that the drive cannot distinguish, each a set of causes.
        remarks: causes, such as slipping rollers, that are no error.
        wheels: wheels after the correction of the mistakes, keyed by name.
        predicted: angle of each wheel in each motion as the file predicts it [rad], shape (3, N).
    """

    mistakes: list[Cause]
    undecided: list[list[causes.Solution]]
    remarks: list[Cause]
    wheels: Mapping[str, WheelMount]
    predicted: FloatArray

    @property
    def uncertain(self) -> bool:
        """Whether an undecided alternative requires a change of the file or of the wiring."""
        every = (cause for group in self.undecided for one in group for cause in one)
        return not all(cause.harmless for cause in every)


def find_mistakes(
    vehicle: VehicleConfiguration, signals: Signals, motions: Motions, stated: causes.Stated
) -> Findings:
    """Return the errors in a vehicle's description that a commissioning drive reveals.

    Args:
        vehicle: wheels, brakes, inertia and loads as described in the vehicle's file.
        signals: signals of the run.
        motions: motions of the run.
        stated: the three motions as the user measured them.
    """
    # A gyro measures the angle of the rotation more accurately than a tape, unless it is wrong.
    by_tape = float(stated.size[2])
    if abs(motions.gyro[2] / by_tape - 1.0) < ALLOWED.scale:
        stated = stated._replace(size=np.array([*stated.size[:2], motions.gyro[2]]))
    wheels, known = vehicle.wheels, np.diag(stated.size)
    predicted = causes.predicted_angles(wheels, known)
    found: list[Cause] = []

    def sensors(moved: FloatArray) -> tuple[list[Cause], FloatArray]:
        of_sensors, ratios = _sensors(motions, moved)
        ratios[2] *= stated.size[2] / by_tape  # the yaw rate is compared with the tape
        return of_sensors, ratios

    explained = causes.solutions(wheels, motions.angle, stated, sensors)
    if not explained:
        words = "wheels: no single mistake of each wheel explains the wheel angles"
        remedy = "check distances and directions of the motions; then check each wheel on blocks"
        found.append(Cause("wheels", words, remedy))
        explained = causes.solutions(wheels, predicted, stated, sensors)
    certain, undecided = causes.classes(explained)
    found += [cause for cause in certain if cause.cost != SLIP]
    remarks = [cause for cause in certain if cause.cost == SLIP]
    if not math.isnan(signals.upwards) and (problem := upwards_problem(signals.upwards)):
        found.append(Cause("imu upwards", *problem))
    # The slip is computed from wheel speeds and twists, so brakes are checked last.
    involved = [*found, *certain, *(one for group in undecided for part in group for one in part)]
    if all(map(_leaves_brakes, involved)) and topics.TWIST.name not in unchecked(signals, motions):
        found += _brake_mistakes(vehicle, signals, motions)
    if signals.inverse_pedal:
        remedy = "1 must be full braking and 0 none: publish 1 minus this value"
        found.append(Cause("pedal", "pedal: the braking demand is inverted", remedy))
    return Findings(found, undecided, remarks, causes.corrected_wheels(wheels, certain), predicted)


def _leaves_brakes(cause: Cause) -> bool:
    """Return whether the brakes can be checked although this cause may exist."""
    return cause.harmless or cause.key in ("lever", "gyro") or cause.key.startswith("imu")


def corrected(vehicle: Mapping[str, Any], found: Findings) -> dict[str, Any]:
    """Return the nested values of a vehicle's file after correction of the errors.

    Args:
        vehicle: values of the file.
        found: errors found; errors outside the file have no effect.
    """
    changed = dict(vehicle)
    for mistake in found.mistakes:
        if mistake.mounts or mistake.radius:
            changed["wheels"] = {
                name: configuration.to_mapping(mount) for name, mount in found.wheels.items()
            }
        if mistake.dead_time is not None:
            changed["brake"] = {**changed.get("brake", {}), "dead_time": mistake.dead_time}
    return changed


def _sensors(motions: Motions, known: FloatArray) -> tuple[list[Cause], FloatArray]:
    """Return errors of signs, axes and positions of the sensors, and the ratios of their scales.

    Args:
        motions: measured motions.
        known: displacement x, y [m] and rotation [rad] in each motion, shape (3, 3).

    Returns:
        The errors; measured/predicted displacement of the twist sensor in each motion and rotation
        of the gyro [1], shape (4,), NaN if it was not measured.
    """
    signs, size = np.sign(np.diag(known))[:, np.newaxis], np.abs(np.diag(known))
    found: list[Cause] = []
    ratios = np.full(4, math.nan)
    if np.all(np.isfinite(motions.twist)):
        forward, left, turn = signs * motions.twist
        found += _twist_errors(forward, left, turn, signs[2] * known[2])
        ratios[:3] = np.array([math.hypot(*forward[:2]), math.hypot(*left[:2]), abs(turn[2])])
        ratios[:3] /= size
    if np.isfinite(motions.gyro[2]):
        ratios[3] = abs(motions.gyro[2]) / size[2]
        if motions.gyro[2] * known[2, 2] < 0.0:
            remedy = "negate it, or mount it upright"
            found.append(Cause("imu yaw", "gyro: yaw rate has the wrong sign", remedy))
    forward, left = force = signs[:2] * motions.force[:2]
    if np.all(np.isfinite(force)) and np.max(np.abs(force), axis=1).min() >= _ALLOWED.force:
        name, limit = "accelerometer", _ALLOWED.force_heading
        found += _mounting_errors("imu axes", name, forward, left, limit)
    return found, ratios


def _twist_errors(
    forward: FloatArray, left: FloatArray, turn: FloatArray, known: FloatArray
) -> Iterator[Cause]:
    """Yield errors of axes, signs and position of the twist sensor.

    Args:
        forward: measured displacement in the motion forward [m, m, rad], shape (3,).
        left: measured displacement in the motion to the left, shape (3,).
        turn: measured displacement in the counter-clockwise turn, shape (3,).
        known: actual displacement of `base_link` in the turn, shape (3,).
    """
    yield from _mounting_errors("twist axes", "twist sensor", forward, left, _ALLOWED.heading)
    if turn[2] < 0.0:
        yield Cause("twist yaw", "twist sensor: yaw rate has the wrong sign", "negate the yaw rate")
    if np.linalg.det([forward[:2], left[:2]]) < 0.0:  # the axes are mirrored
        return
    mean = _mounting_angle(forward, left)[0]
    moved = turned(turn[:2], -mean if abs(mean) > _ALLOWED.heading else 0.0)
    # When the vehicle turns by an angle, a sensor at (x, y) moves by (-y, x) times the angle.
    y, x = (moved - known[:2]) / known[2] * (-1.0, 1.0)
    if math.hypot(x, y) > _ALLOWED.offset:
        name = f"twist sensor: measures at ({x:.2f}, {y:.2f}) m instead of the center"
        yield Cause("twist place", name, "enter this position for its sensors")


def _mounting_angle(forward: FloatArray, left: FloatArray) -> tuple[float, float]:
    """Return the mean angle by which two axes are turned, and the difference of the angles [rad].

    Args:
        forward: x and y that the sensor measures while the true vector points forward; further
            components are ignored.
        left: x and y that the sensor measures while the true vector points to the left.
    """
    heading = math.atan2(forward[1], forward[0])
    difference = math.remainder(math.atan2(-left[0], left[1]) - heading, math.tau)
    return heading + 0.5 * difference, difference


def _mounting_errors(
    key: str, sensor: str, forward: FloatArray, left: FloatArray, tolerance: float
) -> Iterator[Cause]:
    """Yield the error of a sensor's axes, if there is one.

    Args:
        key: key of the cause.
        sensor: name of the sensor.
        forward: as in `_mounting_angle`.
        left: as in `_mounting_angle`.
        tolerance: limit on the error of the mounting angle [rad].
    """
    mean, difference = _mounting_angle(forward, left)
    if abs(difference) > math.pi / 2:
        if abs(forward[1]) > abs(forward[0]):
            name = f"{sensor}: x and y are swapped"
            yield Cause(key, name, "swap them, and check the signs")
        else:
            axis = "y" if forward[0] > 0.0 else "x"
            yield Cause(key, f"{sensor}: {axis} has the wrong sign", f"negate its {axis}")
    elif abs(mean) > tolerance:
        degrees = 180.0 - round(180.0 - math.degrees(mean), 1) % 360.0  # 180 instead of -180
        name = f"{sensor}: mounted {degrees:.4g} deg off"
        yield Cause(key, name, "subtract this angle from its heading")


def _brake_mistakes(
    vehicle: VehicleConfiguration, signals: Signals, motions: Motions
) -> Iterator[Cause]:
    names, response = list(vehicle.wheels), brakes.response_of(vehicle, signals, motions)
    pair, idle = brakes.swapped(response), brakes.idle(response)
    opposite = signals._replace(enable=1.0 - signals.enable)
    if brakes.inverted(response, brakes.response_of(vehicle, opposite, motions)):
        remedy = "1 must pass the demand and 0 release the brake: invert the outputs"
        yield Cause(_BRAKES, "brakes: the enables act inversely", remedy)
    elif pair is not None:
        one, other = (names[row] for row in pair)
        yield Cause(_BRAKES, f"brakes {one} and {other} are swapped", "swap their outputs")
    elif idle is not None:
        remedy = "check its wiring, valve and power, and the order of the outputs"
        yield Cause(_BRAKES, f"brake {names[idle]} does not act", remedy)
    elif (late := brakes.late_brake(response)) is not None:
        row, later = late
        name = f"brake {names[row]} acts {1e3 * later:.0f} ms later than the others"
        yield Cause(_BRAKES, name, "check its valve, lines, clearance and wiring")
    elif (delay := brakes.dead_time(response)) is not None:
        yield Cause(
            _BRAKES,
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
