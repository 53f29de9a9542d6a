"""Vehicle that the files of a robot describe, with their contradictions and gaps.

If files contradict each other, all values are listed with the one that is used: positions are those
of the joints, and along the axles of the shapes, the radius is the controller's if such wheels fit
between the axles, and the rolling direction is the one that the controller assumes, because its
odometry is right or wrong on the robot.
"""

import itertools
import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import FloatArray, plain
from omni_tools.robot_files.body import find_sensors, ground_height, measure_chassis, weigh
from omni_tools.robot_files.comparison import compare
from omni_tools.robot_files.controllers import (
    DIFFERENT,
    FARTHEST,
    MECANUM,
    OMNI,
    Controller,
    wrapped,
)
from omni_tools.robot_files.described import INVALID, PARALLEL, Described
from omni_tools.robot_files.links import Robot
from omni_tools.robot_files.refusal import refused
from omni_tools.robot_files.wheels import (
    Wheels,
    base_link,
    described_wheels,
    matched,
    possibly_steering,
)

_RADII = 1e-3, 1.0  # radii of omni-wheels in use [m]
_OPTION = "--wheel-radius"
_OBLIQUE = 10.0  # smallest angle of a Mecanum wheel's rollers from its axle and its plane [deg]
_NEAR = 30.0  # limit on the angle between an axle and the direction across the motion [deg]
_BESIDE = 0.01  # distance from the center of the wheels at which a wheel is on one side [m]
_SIDES = {"front": (0, 1), "rear": (0, -1), "back": (0, -1), "left": (1, 1), "right": (1, -1)}
_PLACE = re.compile(rf"(?<![a-z])(?:wheel|{'|'.join(_SIDES)})+")  # not the end of a word: "bright"
_LEVER = 0.3  # smallest plausible ratio of lever to distance of omni-wheels; 1 if tangential [1]
_ROLLERS = (
    "the roller directions, which are an estimate: X seen from above. Check them: from above, the "
    "rollers on top of the wheels must form an X; or drive the robot, and use ./omni check-vehicle"
)


def describe(
    robot: Robot | None, controllers: Sequence[Controller], kind: str | None, radius: float | None
) -> Described:
    """Return the vehicle of a robot description and of parameters of controllers.

    Args:
        robot: robot description; None if only controllers are given.
        controllers: drive controllers.
        kind: type of the wheels if the user gives it.
        radius: radius of the wheels if the user gives it [m].

    Raises:
        ConfigurationError: the files describe no vehicle on omni-wheels.
    """
    for first, other in itertools.pairwise(controllers):
        # The frame of the twist is no kinematics.
        if other._replace(name=first.name, base=first.base) != first:
            raise refused(
                f"several controllers drive wheels in different ways: {first.name} and "
                f"{other.name}; give the file of the one that runs"
            )
    controller = controllers[0] if controllers else None
    if robot is None:
        return _of_controller(controller, radius)
    if controller is not None:
        controller = matched(robot, controller)
    robot.base = base_link(robot, controller)
    wheels: Wheels = described_wheels(robot, controller, kind)
    found = Described()
    found.kind = _kind(found, wheels, controller, kind)
    if found.kind == OMNI:
        if controller is None and _are_parallel(wheels):
            raise refused(
                f"the axles in {robot.file} are parallel, so omni-wheels could not move the robot "
                "sideways; correct <axis> of the joints, or rpy of their <origin>"
            )
        wheels = _outward(robot, wheels)
    _place_wheels(found, robot.file, wheels, controller, radius)
    steering = possibly_steering(robot, wheels)
    if steering and kind is None and _are_parallel(wheels):
        found.questions.append(
            f"the fixed joints {', '.join(steering)} have a vertical axis and hold a wheel each: "
            "are the wheels steered? If not, give --kind mecanum"
        )
    if controller is not None:
        compare(found, robot, wheels, controller)
    ground = ground_height(found, robot, wheels)
    measure_chassis(found, robot, wheels)
    weigh(found, robot, wheels, ground)
    find_sensors(found, robot)
    return found


def _of_controller(controller: Controller | None, radius: float | None) -> Described:
    """Return the vehicle of a controller alone."""
    if controller is None:
        problem = "the files contain neither a robot description nor a drive controller"
        raise refused(f"{problem}; add the URDF of the robot")
    known = radius or controller.radius
    mounts = controller._replace(radius=known).wheels()
    if mounts is None:
        raise refused(
            f"{controller.name} gives no position of a single wheel; add the URDF of the robot"
        )
    places = np.array([(mount.x, mount.y) for mount in mounts.values()])
    _usable({_OPTION if radius else controller.name: known or 0.0}, places, controller.name)
    found = Described(kind=controller.kind)
    for name, mount in mounts.items():
        keys = ("x", "y", "heading_deg", "roller_angle_deg", "radius")
        found.wheels[name] = {key: round(getattr(mount, key), 6) + 0.0 for key in keys}
    found.sources["wheels"] = f"{controller.name}, which assumes the roller directions"
    found.enter_chassis("")
    found.questions += [_ROLLERS] * (found.kind == MECANUM)
    found.questions.append(
        "the files contain no chassis: how long and wide is it? (--length, --width)"
    )
    return found


def _kind(
    found: Described, wheels: Wheels, controller: Controller | None, given: str | None
) -> str:
    """Return the kind of the wheels: the user's, the controller's, or that of the axles."""
    parallel = _are_parallel(wheels)
    if given is not None:
        return given
    if controller is not None:
        if parallel == (controller.kind == OMNI):
            directions = "parallel" if parallel else "not parallel"
            found.contradictions.append(
                f"the axles are {directions} in the description, but {controller.name} is for "
                f"{controller.kind} wheels; used: {controller.kind}; look at the wheels"
            )
        return controller.kind
    arms = _arms(wheels)
    lever, distance = float(np.mean(np.abs(arms[:, 1]))), float(np.mean(np.hypot(*arms.T)))
    kind, other, why = OMNI, MECANUM, "the axles are not parallel"
    if parallel:
        kind, other, why = MECANUM, OMNI, "the axles are parallel"
    elif lever < _LEVER * distance:
        kind, other = MECANUM, OMNI
        why = (
            "the axes let the wheels roll past their center at a distance of only "
            f"{plain(lever, 2)} m, as axes of the rollers of Mecanum wheels would"
        )
    name = {MECANUM: "Mecanum wheels", OMNI: "omni-wheels"}[kind]
    found.questions.append(
        f"{why}, so the wheels are taken as {name}: are they? (--kind {other} for others)"
    )
    return kind


def _are_parallel(wheels: Wheels) -> bool:
    away = [abs(wrapped(2.0 * (w.heading_deg - wheels[0].heading_deg))) / 2.0 for w in wheels]
    return max(away) < PARALLEL


def _arms(wheels: Wheels) -> FloatArray:
    """Return the positions of N wheels from their center [m], shape (N, 2).

    The axes are those of each wheel: its rolling direction, and the direction to the left of it.
    """
    center = np.mean([wheel.place[:2] for wheel in wheels], axis=0)
    return np.array(
        [turned(one.place[:2] - center, -math.radians(one.heading_deg)) for one in wheels]
    )


def _outward(robot: Robot, wheels: Wheels) -> Wheels:
    """Return the wheels; axles on fixed joints, which give no sign, point away from the center."""
    return [
        wheel._replace(heading_deg=wrapped(wheel.heading_deg + 180.0))
        if left < 0.0 and robot.joints[wheel.joint].kind == "fixed"
        else wheel
        for wheel, left in zip(wheels, _arms(wheels)[:, 1], strict=True)
    ]


def _place_wheels(
    found: Described, file: str, wheels: Wheels, controller: Controller | None, radius: float | None
) -> None:
    """Enter position, direction, rollers, radius and width of each wheel."""
    center = np.mean([wheel.place[:2] for wheel in wheels], axis=0)
    assumed = {} if controller is None else _assumed(wheels, controller)
    if controller is None and found.kind == MECANUM and not _are_parallel(wheels):
        assumed = {wheel.joint: (0.0, 1.0) for wheel in wheels}
    alike: dict[tuple[tuple[str, float], ...], list[str]] = {}  # joints with the same radii
    for wheel in wheels:
        heading, factor = assumed.get(wheel.joint, (wheel.heading_deg, 1.0))
        heading = _rolling_direction(heading, wheel.heading_deg)
        x, y = (round(float(value), 6) + 0.0 for value in wheel.place[:2])
        values = {"x": x, "y": y}
        if abs(heading) > 1e-3:
            values["heading_deg"] = heading
        ahead, left = turned(wheel.place[:2] - center, -math.radians(heading))
        across = (ahead > 0.0) == (left > 0.0)  # front left and rear right
        values["roller_angle_deg"] = 0.0 if found.kind == OMNI else -45.0 if across else 45.0
        radii = {_OPTION: radius or 0.0}
        if controller is not None:
            radii[controller.name] = (controller.radius or 0.0) * factor
        radii |= {f"{of} of {file}": size for of, size in wheel.radii.items()}
        radii = {source: size for source, size in radii.items() if size}
        radii = _usable(radii, np.array([one.place[:2] for one in wheels]), file)
        if radii:
            values["radius"] = next(iter(radii.values()))
            alike.setdefault(tuple(radii.items()), []).append(wheel.joint)
        if wheel.width > 0.0:
            values["width"] = wheel.width
        found.wheels[INVALID.sub("_", wheel.joint)] = values
    for pairs, names in alike.items():
        remedy = "measure the height of the axle of the loaded wheel"
        found.differ(f"radius of {', '.join(names)}", dict(pairs), pairs[0][0], remedy)
    _ask_about_directions(found, file, wheels, controller, assumed)
    if not alike:
        found.questions.append(
            "the shapes of the wheels are meshes or have no size: which radius do they have "
            "(--wheel-radius), and are their middles at the joints?"
        )
    found.sources["wheels"] = f"joints of {file}"
    if found.kind == MECANUM:
        _estimate_rollers(found, file, wheels, controller)
    _ask_about_names(found, wheels)


def _assumed(wheels: Wheels, controller: Controller) -> dict[str, tuple[float, float]]:
    """Return heading [deg] and factor of the radius that a controller assumes for each wheel.

    If it expects an omni-wheel elsewhere, the wheel turns the robot in the same sense there.
    """
    center = np.mean([wheel.place[:2] for wheel in wheels], axis=0)
    x, y = np.transpose([wheel.place[:2] - center for wheel in wheels])
    across = np.degrees(np.arctan2(y, x)) - 90.0
    at_place = dict(zip((wheel.joint for wheel in wheels), across.tolist(), strict=True))
    return {
        joint: (heading if controller.kind == MECANUM else wrapped(at_place[joint]), factor)
        for joint, (heading, factor) in controller.assumed.items()
    }


def _rolling_direction(assumed: float, by_axis: float) -> float:
    """Return the direction in which a wheel rolls [deg].

    The axis of its joint is more accurate, but may have the wrong sign or be missing.

    Args:
        assumed: direction that the controller assumes [deg].
        by_axis: direction across the axis of the joint [deg].
    """
    for angle in (by_axis, wrapped(by_axis + 180.0)):
        if abs(wrapped(angle - assumed)) < _NEAR:
            return angle
    return assumed


def _estimate_rollers(
    found: Described, file: str, wheels: Wheels, controller: Controller | None
) -> None:
    """Mark the roller directions as an estimate, or take those of Gazebo's friction."""
    oblique = {
        wheel.joint: wheel.roller_deg
        for wheel in wheels
        if wheel.roller_deg is not None and _OBLIQUE < abs(wheel.roller_deg) < 90.0 - _OBLIQUE
    }
    kept = {name: found.wheels[INVALID.sub("_", name)] for name in oblique}
    other = [n for n, one in kept.items() if one["roller_angle_deg"] * oblique[n] < 0.0]
    if other:
        used = f"an X, as {controller.name} assumes" if controller else "fdir1"
        found.contradictions.append(
            f"rollers of {', '.join(other)}: fdir1 of {file} is not that of an X seen from above; "
            f"used: {used}; look at the rollers"
        )
    if controller is None:
        for name, wheel in kept.items():
            wheel["roller_angle_deg"] = oblique[name]
    shape = "rollers of fdir1" if oblique and controller is None else "rollers that form an X"
    found.sources["wheels"] += f"; estimate: {shape} seen from above"
    found.questions.append(_ROLLERS)


def _ask_about_directions(
    found: Described,
    file: str,
    wheels: Wheels,
    controller: Controller | None,
    assumed: Mapping[str, tuple[float, float]],
) -> None:
    """List wheels that by their axis roll sideways, backward, or against the other omni-wheels."""
    forward: dict[str, float] = {}
    if controller is not None:
        forward = {joint: heading for joint, (heading, _) in assumed.items()}
    elif found.kind == MECANUM and _are_parallel(wheels):
        forward = {wheel.joint: 0.0 for wheel in wheels}
    by_axis = {wheel.joint: wheel.heading_deg for wheel in wheels}
    difference = {name: abs(wrapped(by_axis[name] - angle)) for name, angle in forward.items()}
    sense = np.sign(_arms(wheels)[:, 1]) * (found.kind == OMNI and controller is None)
    against = [w.joint for w, one in zip(wheels, sense, strict=True) if one * np.sum(sense) < 0.0]
    where = "base_link" if controller is None else controller.name
    listed = found.questions if controller is None else found.contradictions
    for names, problem, remedy in (
        (
            [name for name, angle in difference.items() if 45.0 <= angle <= 135.0],
            f"they roll sideways in {where}",
            "correct <axis> of the joint, which is 1 0 0 if the file does not name it, or turn "
            "base_link so that x points forward",
        ),
        (
            [name for name, angle in difference.items() if angle > 135.0],
            f"a positive speed is backward in {where}",
            "turn these wheels forward by hand and look at the sign of their velocity",
        ),
        (
            against,
            "a positive speed turns the robot the other way than that of the other wheels",
            "turn the robot by hand and compare the signs of the velocities",
        ),
    ):
        if names:
            listed.append(
                f"{', '.join(names)}: by the axes in {file}, {problem}; used: "
                f"{'the axes' if controller is None else controller.name}; {remedy}"
            )


def _words_of_place(name: str) -> str:
    """Return the words in a name, such as ``frontLeft_wheel``, that can be words of `_SIDES`."""
    return " ".join(_PLACE.findall(re.sub("(?<=[a-z])(?=[A-Z])", "_", name).lower()))


def _ask_about_names(found: Described, wheels: Wheels) -> None:
    center = np.mean([wheel.place[:2] for wheel in wheels], axis=0)
    elsewhere = [
        wheel.joint
        for wheel in wheels
        for word, (axis, sign) in _SIDES.items()
        if word in _words_of_place(wheel.joint)
        and sign * (wheel.place[:2] - center)[axis] < -_BESIDE
    ]
    if elsewhere:
        found.contradictions.append(
            f"{', '.join(dict.fromkeys(elsewhere))}: not where their names say; used: the "
            "positions; does x of base_link point forward, and y to the left?"
        )
    changed = [wheel.joint for wheel in wheels if wheel.joint not in found.wheels]
    if changed:
        found.questions.append(
            f"names consist of letters, digits and _, so {', '.join(changed)} are named "
            f"{', '.join(INVALID.sub('_', name) for name in changed)}: do messages reach the nodes "
            "with these names?"
        )
    apart = {
        wheel.joint: f"{plain(abs(wheel.beside))} m"
        for wheel in wheels
        if abs(wheel.beside) > 1e-3 + DIFFERENT * math.dist(wheel.place[:2], center)
    }
    shaped = [wheel.joint for wheel in wheels if wheel.width > 0.0]  # moved to their middle
    for what, used, joints in (
        ("middle of the shape", "shape", [one for one in apart if one in shaped]),
        ("center of gravity of the mesh", "joint", [one for one in apart if one not in shaped]),
    ):
        if joints:
            distances = ", ".join(dict.fromkeys(apart[one] for one in joints))
            found.contradictions.append(
                f"{', '.join(joints)}: the {what} is {distances} beside the joint along the axle; "
                f"used: the {used}; measure from the center to the middle of a wheel"
            )


def _usable(radii: Mapping[str, float], places: FloatArray, file: str) -> dict[str, float]:
    """Return the radii of a wheel; those that do not fit between the axles are the last ones.

    Args:
        radii: radii of a wheel [m], keyed by source.
        places: positions of all N wheels [m], shape (N, 2).
        file: name of the robot description.

    Raises:
        ConfigurationError: a length is not that of a vehicle in meters, or no radius fits.
    """
    smallest, largest = _RADII
    distance = float(np.max(np.hypot(*(places - places.mean(axis=0)).T)))
    wrong = {f"radius of a wheel in {s}": r for s, r in radii.items() if not smallest < r < largest}
    if distance > FARTHEST:
        wrong[f"distance of a wheel from the center in {file}"] = distance
    for what, value in wrong.items():
        problem = f"the {what} is {plain(value)} m, which looks like millimeters or inches"
        raise refused(f"{problem}; give meters")
    apart = float(np.max(np.ptp(places, axis=0)))
    usable = dict(sorted(radii.items(), key=lambda one: one[0] != _OPTION and one[1] >= apart))
    source = next(iter(usable), "")
    if (size := usable.get(source, 0.0)) >= apart:
        problem = f"wheels of a radius of {plain(size)} m ({source}) do not fit on axles that"
        remedy = "correct the files, or give --wheel-radius"
        raise refused(f"{problem} are {plain(apart)} m apart; {remedy}")
    return usable
