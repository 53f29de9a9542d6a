"""Causes of what a commissioning drive measured, found by comparing hypotheses.

A hypothesis combines motions in other directions than stated, wrong signs or swapped wheels,
mounting errors of the sensors, and scale errors (`scales`). It explains the drive if the measured
angles of all wheels, the displacements of the twist sensor and the rotation of the gyro agree with
its predictions. The cheapest explanations are kept. A cause that all of them contain is certain.
The others form classes: a drive of these three motions cannot distinguish the causes of a class.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from omni_core.configuration import ConfigurationError
from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_tools.commissioning import scales

_ENCODER = 2.5
"""Factor between measured and predicted wheel angles above which the encoder, and not the radius,
counts as wrong; a diameter in place of a radius gives a factor of 2 [1]"""

_CENTER = 0.5
"""Largest distance from `base_link` to the point about which a vehicle is turned, as a share of the
distance of the farthest wheel [1]"""

_WORSE = 0.25
"""Difference of the residuals, as a share of the tolerance, above which an explanation fits worse
than a cheaper one, and is no alternative to it [1]"""

_WAYS = (("forward", "backward"), ("left", "right"), ("counter-clockwise", "clockwise"))


class Stated(NamedTuple):
    """Motions as the user measured them.

    Attributes:
        size: displacement x of the first motion [m], displacement y of the second [m], and rotation
            of the third [rad], shape (3,).
        shared: whether both distances are one measurement.
        placed: whether the positions of the wheels in the file are measured and count as correct.
    """

    size: FloatArray
    shared: bool = True
    placed: bool = False


class Cause(NamedTuple):
    """A possible cause of a difference between measurement and prediction.

    Attributes:
        key: kind of the cause, and the wheel that it concerns.
        name: name of the cause, with its size.
        remedy: what to change.
        check: measurement that confirms or excludes the cause.
        cost: cost of the cause in an explanation.
        harmless: whether the file and the wiring of the vehicle can remain as they are.
        mounts: corrected mounts of wheels.
        radius: factor by which the radius of a wheel must be divided [1].
        dead_time: corrected dead time of the brakes [s]; None if it is not the cause.
    """

    key: str
    name: str
    remedy: str
    check: str = ""
    cost: int = scales.MISTAKE
    harmless: bool = False
    mounts: Mapping[str, WheelMount] = {}
    radius: Mapping[str, float] = {}
    dead_time: float | None = None


Solution = tuple[Cause, ...]

Sensors = Callable[[FloatArray], tuple[list[Cause], FloatArray]]
"""Function of the displacement and rotation in each motion, shape (3, 3). It returns errors of
signs, axes and positions of the sensors, and the measured/predicted displacement of the twist
sensor in each motion and rotation of the gyro [1], shape (4,); NaN if it was not measured."""


def predicted_angles(wheels: Mapping[str, WheelMount], known: FloatArray) -> FloatArray:
    """Return the angle of each wheel in each motion without slip, Eq. (32) [rad], shape (3, N)."""
    return PlatformKinematics.of(wheels).wheel_speeds(known)


def solutions(
    wheels: Mapping[str, WheelMount], angle: FloatArray, stated: Stated, sensors: Sensors
) -> list[Solution]:
    """Return the cheapest explanations of a drive; none if nothing explains it.

    Args:
        wheels: wheels as described in the vehicle's file.
        angle: measured angle of each wheel in each motion [rad], shape (3, N).
        stated: the motions.
        sensors: comparison of the sensors with the motions.
    """
    errors = [
        one
        for one in scales.possible_errors(len(wheels), stated.shared, _rolls_forward(wheels))
        if not (stated.placed and one.kind in ("lever", "place"))
    ]
    found: dict[frozenset[str], tuple[int, float, Solution]] = {}
    best = math.inf
    for causes, described, known in _hypotheses(wheels, angle, stated):
        of_sensors, ratios = sensors(known)
        base = (*causes, *of_sensors)
        cost = sum(cause.cost for cause in base)
        budget = min(best + scales.MARGIN, 10 * scales.MISTAKE) - cost
        if budget < 0:
            continue
        try:
            predicted = predicted_angles(described, known)
        except ConfigurationError:  # wheels that no vehicle can have
            continue
        for fit in scales.explanations(predicted, angle, ratios, errors, int(budget)):
            named = [_named(one, factor, list(described), stated) for one, factor in fit.errors]
            keys = frozenset(cause.key for cause in (*base, *named))
            total = cost + fit.cost
            found.setdefault(keys, (total, fit.residual, (*base, *named)))
            best = min(best, total)
    ordered = sorted(found.values(), key=lambda one: one[:2])
    chosen = [
        one
        for one in ordered
        if one[0] <= best + scales.MARGIN and one[1] <= ordered[0][1] + _WORSE
    ]
    sets = [({cause.key for cause in solution}, solution) for *_, solution in chosen]
    return [one for keys, one in sets if not any(other < keys for other, _ in sets)]


def classes(found: Sequence[Solution]) -> tuple[list[Cause], list[list[Solution]]]:
    """Return the causes that all explanations contain, and the alternatives of each class."""
    keys = [{cause.key for cause in solution} for solution in found]
    groups = [{key} for key in dict.fromkeys(cause.key for one in found for cause in one)]
    pairs = sorted(itertools.combinations(keys, 2), key=lambda pair: len(pair[0] ^ pair[1]))
    for one, other in pairs:
        differing = [group for group in groups if group & (one ^ other)]
        # Explanations that differ in a class contain another cause of it each.
        if not all(group & one and group & other for group in differing):
            groups = [group for group in groups if group not in differing]
            groups.append(set().union(*differing))
    undecided = []
    for group in groups:
        parts = [tuple(c for c in solution if c.key in group) for solution in found]
        distinct = {frozenset(cause.key for cause in part): part for part in reversed(parts)}
        if len(distinct) > 1:
            undecided.append(list(distinct.values())[::-1])
    first = found[0] if found else ()
    return [cause for cause in first if all(cause.key in one for one in keys)], undecided


def _rolls_forward(wheels: Mapping[str, WheelMount]) -> bool:
    """Return whether rollers turn, and can slip, while the vehicle moves forward."""
    geometry, forward = PlatformGeometry.from_wheels(wheels), np.array([1.0, 0.0, 0.0])
    rim = geometry.radius * PlatformKinematics.of(wheels).wheel_speeds(forward)
    speed = np.hypot(*(forward[:2] - rim[:, np.newaxis] * geometry.rolling).T)
    return bool(np.max(speed) > scales.ALLOWED.entry)


def _hypotheses(
    wheels: Mapping[str, WheelMount], angle: FloatArray, stated: Stated
) -> Iterator[tuple[Solution, Mapping[str, WheelMount], FloatArray]]:
    """Yield causes other than scale errors, with the corrected wheels and motions, (3, 3)."""
    for signs in sorted(itertools.product((1.0, -1.0), repeat=3), key=sum, reverse=True):
        known = np.diag(np.array(signs) * stated.size)
        reversed_ = tuple(_reversed(row, stated.size[row]) for row in range(3) if signs[row] < 0.0)
        for causes, described in _structures(wheels, angle, known):
            yield (*reversed_, *causes), described, known
            if turned := _turned_about(described, angle, known):
                cause, elsewhere = turned
                yield (*reversed_, *causes, cause), described, elsewhere


def _reversed(row: int, size: float) -> Cause:
    stated, other = _WAYS[row] if size > 0.0 else _WAYS[row][::-1]
    option = ("--forward", "--left", "--turn")[row]
    value = -math.degrees(size) if row == 2 else -size
    return Cause(
        f"reversed {row}",
        f"motion {stated}: the vehicle moved {other}",
        f"repeat it, or set {option} to {value:.4g}",
        "watch the vehicle",
    )


def _turned_about(
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray
) -> tuple[Cause, FloatArray] | None:
    """Return the cause that the vehicle was turned about another point, and the motions then."""
    try:
        x, y, turn = PlatformKinematics.of(wheels).twist(angle[2])
    except ConfigurationError:  # wheels that no vehicle can have
        return None
    reach = max(math.hypot(mount.x, mount.y) for mount in wheels.values())
    if turn == 0.0:
        return None
    center = -y / turn, x / turn
    if not scales.ALLOWED.scale * reach < math.hypot(*center) < _CENTER * reach:
        return None
    elsewhere = known.copy()
    elsewhere[2, :2] = known[2, 2] * center[1], -known[2, 2] * center[0]
    words = f"turn: about the point ({center[0]:.2f}, {center[1]:.2f}) m, not about base_link"
    cause = Cause(
        "center",
        words,
        "nothing is wrong if the controller turns about this point",
        "turn the vehicle about base_link",
        scales.SLIP,
        harmless=True,
    )
    return cause, elsewhere


def _structures(
    wheels: Mapping[str, WheelMount], angle: FloatArray, known: FloatArray
) -> Iterator[tuple[Solution, dict[str, WheelMount]]]:
    """Yield possible errors of signs and places of wheels, and the corrected wheels.

    Each wheel may have one wrong sign; or wheels are swapped; or all wheels have the same error.

    Args:
        wheels: wheels as described in the vehicle's file.
        angle: measured angle of each wheel in each motion [rad], shape (3, N).
        known: displacement x, y [m] and rotation [rad] in each motion, shape (3, 3).
    """
    predicted = predicted_angles(wheels, known)
    size = scales.mean_size(predicted)
    options: list[list[tuple[Solution, WheelMount]]] = []
    for row, (name, mount) in enumerate(wheels.items()):
        fitting: list[tuple[Solution, WheelMount]] = []
        changes = [one for one in _changes(mount) if one[2] != mount]
        for part, remedy, changed in (("", "", mount), *changes):
            turned = _column({**wheels, name: changed}, known, row)
            if turned is not None and scales.turns_alike(turned, angle[:, [row]], size)[0]:
                key, words = f"{part} {name}", f"{part} of wheel {name} is wrong"
                cause = Cause(key, words, remedy, f"look at wheel {name}", mounts={name: changed})
                fitting.append(((cause,) if part else (), changed))
        options.append(fitting)
    for chosen in itertools.product(*options):
        causes = tuple(cause for one, _ in chosen for cause in one)
        yield causes, {name: mount for name, (_, mount) in zip(wheels, chosen, strict=True)}
    yield from _swaps(wheels, angle, predicted)
    for of_all in zip(*map(_changes, wheels.values()), strict=True):
        part, remedy, _ = of_all[0]
        mounts = {name: mount for name, (_, _, mount) in zip(wheels, of_all, strict=True)}
        name, advice = f"{part} of all wheels is wrong", f"{remedy}, for every wheel"
        yield (Cause(f"{part} all", name, advice, "look at the wheels", mounts=mounts),), mounts


def _column(wheels: Mapping[str, WheelMount], known: FloatArray, row: int) -> FloatArray | None:
    try:
        return predicted_angles(wheels, known)[:, [row]]
    except ConfigurationError:  # wheels that no vehicle can have
        return None


def _changes(mount: WheelMount) -> Iterator[tuple[str, str, WheelMount]]:
    """Yield possible sign errors of a wheel: wrong value, remedy, and the corrected wheel."""
    turned = (mount.heading_deg + 360.0) % 360.0 - 180.0
    changed, roller = dataclasses.replace, -mount.roller_angle_deg
    words = "negate the speed, or turn heading_deg by 180"
    yield "direction", words, changed(mount, heading_deg=turned)
    yield "roller", "negate roller_angle_deg", changed(mount, roller_angle_deg=roller)
    yield "x", "negate x", changed(mount, x=-mount.x)
    yield "y", "negate y", changed(mount, y=-mount.y)


def _swaps(
    wheels: Mapping[str, WheelMount], angle: FloatArray, predicted: FloatArray
) -> Iterator[tuple[Solution, dict[str, WheelMount]]]:
    """Yield the order of the wheels that fits best, if it is not that of the file."""
    names, mounts = list(wheels), list(wheels.values())
    scale = [_typical(a, p) for a, p in zip(angle, predicted, strict=True)]
    measured = angle / np.array(scale)[:, np.newaxis]
    # Relative error if the speeds of wheel j are those of wheel i; a wheel keeps its place unless
    # another place fits better by more than the tolerance.
    length = np.maximum(np.linalg.norm(predicted, axis=0), 1e-9)
    error = np.linalg.norm(measured[:, np.newaxis] - predicted[:, :, np.newaxis], axis=0)
    elsewhere = ~np.eye(len(names), dtype=np.bool_)
    cost = error / length[:, np.newaxis] + scales.ALLOWED.entry * elsewhere
    of_place, of_speed = linear_sum_assignment(cost)
    places = dict(zip(of_speed.tolist(), of_place.tolist(), strict=True))
    moved = [row for row in range(len(names)) if places[row] != row]
    if moved:
        order = {name: mounts[places[row]] for row, name in enumerate(names)}
        words = " and ".join(names[row] for row in moved)
        swaps = len(names) - connected_components(np.eye(len(names))[of_speed])[0]
        cause = Cause(
            "swap",
            f"wheels {words} are swapped",
            "swap their encoders or names",
            "lift one wheel after the other and turn it",
            swaps * scales.MISTAKE,
            mounts=order,
        )
        yield (cause,), order


def _typical(angle: FloatArray, predicted: FloatArray) -> float:
    """Return the median ratio of measured and predicted angles of the wheels that turn [1]."""
    turning = np.abs(predicted) > 0.3 * np.max(np.abs(predicted))
    return max(float(np.median(np.abs(angle[turning] / predicted[turning]))), 1e-9)


def _named(error: scales.Scale, factor: float, names: Sequence[str], stated: Stated) -> Cause:
    """Return the cause of a scale error.

    Args:
        error: the error.
        factor: measured/predicted [1].
        names: names of the wheels.
        stated: the motions.
    """
    row = "flt".find(error.kind[-1])
    wheel = names[error.wheel] if error.wheel >= 0 else ""
    key = f"{error.kind} {wheel}".strip()
    of_wheels = [wheel] if error.wheel >= 0 else names
    if error.kind in ("wheel", "radius"):
        return _of_radius(key, wheel, factor, of_wheels)
    if error.kind.startswith("slip"):
        motion = _WAYS[row][0]
        return Cause(
            key,
            f"rollers slip: {motion}, the wheels turn {factor:.2f} times as far as without slip",
            "nothing is wrong",
            "repeat the motion with another load or on another ground: only a slip changes",
            scales.SLIP,
            harmless=True,
        )
    if error.kind == "lever":
        return Cause(
            key,
            f"wheelbase or track: the wheels are {factor:.2f} times as far from the center",
            "correct x and y of the wheels",
            "measure x and y of the wheels, and if they are right, add --placed",
        )
    if error.kind == "place":
        words = f"position of wheel {wheel}: it turns {factor:.2f} times as far in the turn"
        return Cause(key, words, "correct its x, y and angles", f"measure x and y of wheel {wheel}")
    if error.kind.startswith("stated") or error.kind == "distance":
        return _of_option(key, row, factor, stated)
    return _of_sensor(key, error.kind, factor)


def _of_radius(key: str, wheel: str, factor: float, wheels: Iterable[str]) -> Cause:
    """Return the cause that the radius or the encoder of one wheel, or of all, is wrong."""
    name = f"wheel {wheel}" if wheel else "all wheels"
    if abs(math.log(factor)) > math.log(_ENCODER):
        shown = factor if factor > 1e-5 else 0.0
        return Cause(
            key,
            f"speed of {name} is {shown:.3g} times the expected one",
            "check unit (rad/s), counts per revolution and gear ratio of the encoder",
            "turn a wheel once by hand: its angle must change by 6.283 rad",
        )
    remedy = f"divide its radius by {factor:.3f}, or check the encoder"
    if not wheel:
        remedy = f"divide each radius by {factor:.3f}"
    check = "push the vehicle straight by ten turns of a wheel: 62.8 radii"
    radius = dict.fromkeys(wheels, factor)
    return Cause(key, f"radius of {name} is wrong", remedy, check, radius=radius)


def _of_option(key: str, row: int, factor: float, stated: Stated) -> Cause:
    """Return the cause that a distance or an angle is not what the user measured.

    Args:
        key: key of the cause.
        row: index of the motion; -1 for the distance of both straight motions.
        factor: actual/measured motion [1].
        stated: the motions.
    """
    moved = factor * float(stated.size[max(row, 0)])
    words = ("forward", "left", "turn", "distance")[row]
    value, unit = (math.degrees(moved), "deg") if row == 2 else (moved, "m")
    return Cause(
        key,
        f"{words}: the vehicle moved {factor:.3g} times as far as stated",
        f"set --{words} {value:.4g} if this is right; its unit is {unit}",
        f"measure the {'angle' if row == 2 else 'distance'} again ({words})",
        harmless=True,
    )


def _of_sensor(key: str, kind: str, factor: float) -> Cause:
    """Return the cause that the scale of a sensor is wrong."""
    quantity, remedy = {
        "twist fl": ("twist sensor: speed", "check wiring, height, scale, unit of its sensors"),
        "twist f": ("twist sensor: v_x", "check scale and unit of its sensors"),
        "twist l": ("twist sensor: v_y", "check scale and unit of its sensors"),
        "twist t": (
            "twist sensor: yaw rate",
            "check unit and lever of its sensors; if it is always 0, add angular.z to the "
            "parameter unmeasured of twist_adapter",
        ),
        "gyro": ("gyro: yaw rate", "check its unit (rad/s), axes and scale"),
    }[kind]
    return Cause(
        key,
        f"{quantity} is {factor:.3f} times the true one",
        remedy,
        "move the vehicle along a ruler, and compare",
    )


def corrected_wheels(
    wheels: Mapping[str, WheelMount], causes: Iterable[Cause]
) -> dict[str, WheelMount]:
    """Return the wheels of a vehicle's file after the correction of certain causes."""
    changed = dict(wheels)
    for cause in causes:
        changed |= cause.mounts
    for cause in causes:
        for name, factor in cause.radius.items():
            radius = changed[name].radius / factor
            changed[name] = dataclasses.replace(changed[name], radius=radius)
    return changed
