"""Vehicle that the files of a robot describe, with their contradictions and gaps.

If files contradict each other, all values are listed with the one that is used: positions are those
of the joints, the radius is the controller's, and the rolling direction is the one that the
controller assumes, because its odometry is right or wrong on the robot.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omni_core.configuration import ConfigurationError
from omni_core.geometry import turned
from omni_core.quantities import FloatArray, plain
from omni_tools.robot_files.controllers import (
    CORNERS,
    DIFFERENT,
    MECANUM,
    OMNI,
    Controller,
    wrapped,
)
from omni_tools.robot_files.links import Robot
from omni_tools.robot_files.wheels import DescribedWheel, base_link, described_wheels, matched

_IMU = re.compile(r"(^|[/_])imu\d*($|[/_])", re.IGNORECASE)
_CAMERA = re.compile(r"cam(era)?\d*($|[/_])|line_?scan|flow|otos|pmw3901|paa5100", re.IGNORECASE)
_RADII = 1e-3, 1.0  # radii of omni-wheels in use [m]
_UNITS = {"millimeters": 1000.0, "inches": 1.0 / 0.0254}  # lengths of a meter
_ALIKE = 0.1  # difference of two radii in the same unit, relative [1]
_FARTHEST = 10.0  # distance of a wheel from the center of all wheels [m]
_PARALLEL = 5.0  # limit on the angle between the axles of Mecanum wheels [deg]
_LISTED = 4  # names in a sentence
_LIGHTEST = 0.1  # smallest mass of a vehicle; less stands for an unknown mass [kg]
_DOWN = -0.7  # limit on the vertical part of the direction of view of a camera at the ground
_SPAN = 0.5  # smallest plausible ratio of the chassis to the wheelbase, or to the track [1]
_NAMES = re.compile(r"[^A-Za-z0-9_]")
_ROLLERS = (
    "the roller directions, which are an estimate: X seen from above. Check them: from above, the "
    "rollers on top of the wheels must form an X; or drive the robot, and use ./omni check-vehicle"
)


@dataclasses.dataclass
class Described:
    """Vehicle that the files describe; None or empty what they lack.

    Attributes:
        kind: `MECANUM` or `OMNI`.
        wheels: wheels in base_link, keyed by joint; without a radius if it is unknown.
        chassis: smallest and largest x and y of the chassis [m], shape (2, 2).
        mass: mass [kg].
        center: center of gravity in base_link, with its height above the ground [m], shape (3,).
        yaw_inertia: moment of inertia about the vertical through the center of gravity [kg m^2].
        wheel_inertia: mean moment of inertia of a wheel about its axis [kg m^2].
        imu: pose of the IMU in base_link, shape (4, 4).
        cameras: position [m] and heading [deg] of cameras that look at the ground, by name.
        sources: where a value comes from, keyed by key of the vehicle's file.
        contradictions: sentences on values that differ between the files.
        questions: sentences on what the files lack, with the question to answer.
    """

    kind: str = MECANUM
    wheels: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    chassis: FloatArray | None = None
    mass: float | None = None
    center: FloatArray | None = None
    yaw_inertia: float | None = None
    wheel_inertia: float | None = None
    imu: FloatArray | None = None
    cameras: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    sources: dict[str, str] = dataclasses.field(default_factory=dict)
    contradictions: list[str] = dataclasses.field(default_factory=list)
    questions: list[str] = dataclasses.field(default_factory=list)

    @property
    def lists(self) -> dict[str, list[str]]:
        """Sentences on contradictions and on missing values, for the JSON document."""
        return {"contradictions": self.contradictions, "missing": self.questions}

    @property
    def measured(self) -> dict[str, Any]:
        """Values of `Measured` that the files contain, or that follow from the wheels."""
        radii = [values["radius"] for values in self.wheels.values() if "radius" in values]
        values: dict[str, Any] = {"kind": self.kind, "wheels": len(self.wheels)}
        values |= {"mass": self.mass} if self.mass else {}
        values |= {"wheel_radius": max(radii)} if radii else {}
        length, width = np.ptp(self._extent, axis=0)
        return {**values, "length": rounded(length), "width": rounded(width)}

    @property
    def chassis_center(self) -> FloatArray:
        """Center of the chassis in base_link [m], shape (2,)."""
        return np.asarray(self._extent.mean(axis=0))

    @property
    def _extent(self) -> FloatArray:
        """Extent of the chassis, or of the wheels if it is unknown [m], shape (2, 2)."""
        if self.chassis is not None:
            return self.chassis
        around = max((wheel.get("radius", 0.0) for wheel in self.wheels.values()), default=0.0)
        places = np.array([(wheel["x"], wheel["y"]) for wheel in self.wheels.values()])
        return np.array([places.min(axis=0) - around, places.max(axis=0) + around])

    def differ(self, what: str, values: Mapping[str, float], used: str, remedy: str) -> None:
        """List values of a length [m], keyed by source, if they differ from the used one."""
        away = [abs(value - values[used]) for value in values.values()]
        if max(away) > DIFFERENT * abs(values[used]) + 1e-9:
            texts = [f"{plain(value, 4)} m in {source}" for source, value in values.items()]
            self.contradictions.append(f"{what}: {', '.join(texts)}; used: {used}; {remedy}")


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")


def rounded(value: float) -> float:
    """Return a length, mass or inertia with five significant digits, without a negative zero."""
    return float(f"{value:.5g}") + 0.0


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
    if len(controllers) > 1:
        _check_one(controllers)
    controller = controllers[0] if controllers else None
    if robot is not None and controller is not None:
        controller = matched(robot, controller)
    if robot is None:
        return _of_controller(controller, radius)
    base = base_link(robot, controller)
    wheels = described_wheels(robot, controller, base)
    found = Described()
    found.kind = _kind(found, wheels, controller, kind)
    _place_wheels(found, robot.file, wheels, controller, radius)
    if controller is not None:
        _compare(found, robot, wheels, controller, base)
    ground = _ground(found, robot, wheels, base)
    _measure_chassis(found, robot, wheels, base)
    _weigh(found, robot, wheels, base, ground)
    _find_sensors(found, robot, base)
    return found


def _check_one(controllers: Sequence[Controller]) -> None:
    first, *others = controllers
    for other in others:
        if other._replace(name=first.name) != first:
            raise ConfigurationError(
                "--from",
                f"several controllers drive wheels in different ways: {first.name} and "
                f"{other.name}; give the file of the one that runs",
            )


def _of_controller(controller: Controller | None, radius: float | None) -> Described:
    """Return the vehicle of a controller alone."""
    if controller is None:
        problem = "the files contain neither a robot description nor a drive controller"
        raise ConfigurationError("--from", f"{problem}; add the URDF of the robot")
    mounts = controller._replace(radius=radius or controller.radius).wheels()
    if mounts is None:
        raise ConfigurationError(
            "--from",
            f"{controller.name} gives no position of a single wheel; add the URDF of the robot",
        )
    found = Described(kind=controller.kind)
    for name, mount in mounts.items():
        angles = {"heading_deg": mount.heading_deg, "roller_angle_deg": mount.roller_angle_deg}
        values = {"x": mount.x, "y": mount.y, **angles, "radius": mount.radius}
        found.wheels[name] = {key: round(value, 6) + 0.0 for key, value in values.items()}
    found.sources["wheels"] = f"{controller.name}, which assumes the roller directions"
    found.questions.append("the files contain no chassis; how long and wide is it?")
    return found


def _kind(
    found: Described,
    wheels: Sequence[DescribedWheel],
    controller: Controller | None,
    given: str | None,
) -> str:
    """Return the kind of the wheels: the user's, the controller's, or that of the axles."""
    away = [abs(wrapped(2.0 * (w.heading_deg - wheels[0].heading_deg))) / 2.0 for w in wheels]
    parallel = max(away) < _PARALLEL
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
    if parallel:
        found.questions.append(
            "the axles are parallel, so the wheels are taken as Mecanum wheels: are they? "
            "(--kind omni for others)"
        )
    return MECANUM if parallel else OMNI


def _place_wheels(
    found: Described,
    file: str,
    wheels: Sequence[DescribedWheel],
    controller: Controller | None,
    radius: float | None,
) -> None:
    """Enter position, direction, rollers, radius and width of each wheel."""
    center = np.mean([wheel.place[:2] for wheel in wheels], axis=0)
    assumed = _assumed(controller)
    backward: list[str] = []
    alike: dict[tuple[tuple[str, float], ...], list[str]] = {}  # joints with the same radii
    for wheel in wheels:
        heading, factor = assumed.get(wheel.joint, (wheel.heading_deg, 1.0))
        if abs(wrapped(wheel.heading_deg - heading)) < 90.0:
            heading = wheel.heading_deg
        else:
            heading = wrapped(wheel.heading_deg + 180.0)
            backward.append(wheel.joint)
        values = {"x": round(float(wheel.place[0]), 6), "y": round(float(wheel.place[1]), 6)}
        if abs(heading) > 1e-3:
            values["heading_deg"] = heading
        ahead, left = turned(wheel.place[:2] - center, -math.radians(heading))
        across = (ahead > 0.0) == (left > 0.0)  # front left and rear right
        values["roller_angle_deg"] = 0.0 if found.kind == OMNI else -45.0 if across else 45.0
        radii = {"--wheel-radius": radius or 0.0}
        if controller is not None:
            radii[controller.name] = (controller.radius or 0.0) * factor
        radii |= {f"{of} of {file}": size for of, size in wheel.radii.items()}
        radii = {source: size for source, size in radii.items() if size}
        _check_units(radii, wheel.place[:2] - center, file)
        if radii:
            values["radius"] = next(iter(radii.values()))
            alike.setdefault(tuple(radii.items()), []).append(wheel.joint)
        if wheel.width > 0.0:
            values["width"] = wheel.width
        found.wheels[_NAMES.sub("_", wheel.joint)] = values
    for pairs, names in alike.items():
        remedy = "measure the height of the axle of the loaded wheel"
        found.differ(f"radius of {', '.join(names)}", dict(pairs), pairs[0][0], remedy)
    if backward and controller is not None:
        found.contradictions.append(
            f"{', '.join(backward)}: a positive speed is forward for {controller.name}, but "
            f"backward by the axis in {file}; used: {controller.name}; turn these wheels forward "
            "by hand and look at the sign of their velocity"
        )
    found.sources["wheels"] = f"joints of {file}"
    if found.kind == MECANUM:
        found.sources["wheels"] += "; estimate: rollers that form an X seen from above"
        found.questions.append(_ROLLERS)
    _ask_about_names(found, wheels)


def _ask_about_names(found: Described, wheels: Sequence[DescribedWheel]) -> None:
    changed = [wheel.joint for wheel in wheels if wheel.joint not in found.wheels]
    if changed:
        found.questions.append(
            f"names consist of letters, digits and _, so {', '.join(changed)} are named "
            f"{', '.join(_NAMES.sub('_', name) for name in changed)}: do messages reach the nodes "
            "with these names?"
        )
    for wheel in wheels:
        if abs(wheel.beside) > max(DIFFERENT * wheel.width, 1e-3):
            found.contradictions.append(
                f"{wheel.joint}: the middle of its collision shape is {plain(abs(wheel.beside))} m "
                "beside its joint along the axle; used: the joint; measure the track"
            )


def _assumed(controller: Controller | None) -> dict[str, tuple[float, float]]:
    """Return heading [deg] and factor of the radius that a controller assumes, keyed by joint."""
    if controller is None:
        return {}
    theta, count = math.degrees(controller.offset[2]), len(controller.joints)
    first = math.degrees(controller.wheel_offset or 0.0) - 90.0
    omni = controller.kind == OMNI
    return {
        joint: (
            first + 360.0 * row / count if omni else -theta,
            controller.factors.get(key, 1.0),
        )
        for row, (key, joint) in enumerate(controller.joints.items())
    }


def _check_units(radii: Mapping[str, float], place: FloatArray, file: str) -> None:
    """Raise `ConfigurationError` if a length is not that of a vehicle in meters.

    Args:
        radii: radii of a wheel [m], keyed by source.
        place: position of the wheel from the center of all wheels [m], shape (2,).
        file: name of the robot description.
    """
    smallest, largest = _RADII
    for unit, factor in _UNITS.items():
        for source, radius in radii.items():
            if any(abs(radius / other / factor - 1.0) < _ALIKE for other in radii.values()):
                raise _in_other_unit(f"the radius of a wheel in {source}", radius, unit)
    for source, radius in radii.items():
        if not smallest < radius < largest:
            raise _in_other_unit(f"the radius of a wheel in {source}", radius, *_UNITS)
    if (distance := float(np.linalg.norm(place))) > _FARTHEST:
        raise _in_other_unit(
            f"the distance of a wheel from the center in {file}", distance, *_UNITS
        )


def _in_other_unit(what: str, value: float, *units: str) -> ConfigurationError:
    problem = f"{what} is {plain(value)} m, which looks like {' or '.join(units)}; give meters"
    return ConfigurationError("--from", problem)


def _compare(
    found: Described,
    robot: Robot,
    wheels: Sequence[DescribedWheel],
    controller: Controller,
    base: str,
) -> None:
    """List differences between the wheels of a description and those of a controller."""
    x, y, theta = controller.offset
    places = {wheel.joint: turned(wheel.place[:2], theta) for wheel in wheels}
    center = np.mean(list(places.values()), axis=0)
    if math.dist(center, (-x, -y)) > 1e-3 + DIFFERENT * float(np.ptp(list(places.values()))):
        found.contradictions.append(
            f"center of the wheels in {base}: ({plain(center[0])}, {plain(center[1])}) m in "
            f"{robot.file}, ({plain(-x)}, {plain(-y)}) m in {controller.name}; used: {robot.file}; "
            f"measure from {base} to the axles"
        )
    if controller.base in robot.links and controller.base != base:
        apart = robot.pose(controller.base, base)[:2, 3]
        if np.linalg.norm(apart) > 1e-3:
            found.contradictions.append(
                f"{controller.name} moves {controller.base}, which is at ({plain(apart[0])}, "
                f"{plain(apart[1])}) m in {base}; used: {base}"
            )
    at = {
        key: places[joint] - center for key, joint in controller.joints.items() if joint in places
    }
    if controller.kind == OMNI:
        _compare_circle(found, robot.file, at, controller)
        return
    wrong = [key for key, place in at.items() if tuple(np.sign(place)) != CORNERS[key]]
    if wrong:
        found.contradictions.append(
            f"{', '.join(f'{controller.joints[key]} is {key}' for key in wrong)} in "
            f"{controller.name}, but elsewhere in {robot.file}; used: {robot.file}; turn each "
            "wheel by hand and look at the name of its velocity"
        )
    span = [float(one) for one in np.ptp(list(places.values()), axis=0)]
    described = {"wheelbase": span[0], "track": span[1], "lever": 0.5 * sum(span)}
    if controller.wheelbase is not None and controller.track is not None and controller.sum is None:
        del described["lever"]
    what = {"lever": "half of wheelbase plus track"}
    for key, value in described.items():
        theirs = getattr(controller, key)
        if theirs is not None:
            remedy = "measure it; a larger one of the controller may be tuned for slip in turns"
            values = {robot.file: value, controller.name: theirs}
            found.differ(what.get(key, key), values, robot.file, remedy)


def _compare_circle(
    found: Described, file: str, at: Mapping[str, FloatArray], controller: Controller
) -> None:
    if controller.robot_radius is not None:
        mean = float(np.mean([np.linalg.norm(place) for place in at.values()]))
        values = {file: mean, controller.name: controller.robot_radius}
        found.differ("distance of the wheels from the center", values, file, "measure it")
    first = math.degrees(controller.wheel_offset or 0.0)
    for row, (key, place) in enumerate(at.items()):
        assumed = wrapped(first + 360.0 * row / len(at))
        angle = math.degrees(math.atan2(place[1], place[0]))
        if abs(wrapped(angle - assumed)) > _PARALLEL:
            found.contradictions.append(
                f"{controller.joints[key]}: its direction from the center is {angle:.0f} deg in "
                f"{file}, {assumed:.0f} deg in {controller.name}; used: {file}; turn each wheel by "
                "hand and look at the name of its velocity"
            )


def _ground(
    found: Described, robot: Robot, wheels: Sequence[DescribedWheel], base: str
) -> float | None:
    """Return the height of the ground in base_link [m]; None if no radius is known."""
    radius = _mean_radius(found)
    if not radius:
        return None
    axle = float(np.mean([wheel.place[2] for wheel in wheels]))
    footprint = next((name for name in robot.links if name.endswith("footprint")), None)
    if footprint is not None:
        height = axle - float(robot.pose(footprint, base)[2, 3])
        if abs(height - radius) > DIFFERENT * radius + 1e-3:
            found.contradictions.append(
                f"height of the axles: {plain(height, 4)} m above {footprint} in {robot.file}, but "
                f"the radius is {plain(radius, 4)} m; used: the radius; measure the height of the "
                "axle of the loaded wheel"
            )
    return axle - radius


def _weigh(
    found: Described,
    robot: Robot,
    wheels: Sequence[DescribedWheel],
    base: str,
    ground: float | None,
) -> None:
    """Enter mass, center of gravity and moments of inertia, summed over all links."""
    mass = sum(link.mass for link in robot.links.values())
    lacking = [n for n, one in robot.links.items() if not one.mass and (one.shapes or one.meshes)]
    if mass < _LIGHTEST:
        problem = f"{robot.file} contains no plausible mass ({plain(mass)} kg)"
        found.questions.append(f"{problem}; what does the robot weigh? (--mass)")
        return
    if lacking:
        found.questions.append(
            f"{_some(lacking)} have shapes but no mass; "
            f"does the robot weigh {plain(mass, 4)} kg? (--mass)"
        )
    center, inertia = _mass_center(robot, base, mass)
    found.mass = rounded(mass)
    found.center = None if ground is None else center - np.array((0.0, 0.0, ground))
    source = f"summed over the links of {robot.file}"
    found.sources |= dict.fromkeys(("body.mass", "body.x"), source)
    reach = 0.5 * math.hypot(found.measured["length"], found.measured["width"])
    found.yaw_inertia = _possible(found, "body.yaw_inertia", inertia, mass * reach**2, source)
    ring = float(np.mean([_wheel_mass(robot, one) for one in wheels])) * _mean_radius(found) ** 2
    own = float(np.mean([wheel.inertia for wheel in wheels]))
    found.wheel_inertia = _possible(found, "wheel_inertia", own, ring, f"links of {robot.file}")


def _mass_center(robot: Robot, base: str, mass: float) -> tuple[FloatArray, float]:
    """Return the center of gravity in the link `base` [m], and the yaw inertia [kg m^2]."""
    poses = {name: robot.pose(name, base) for name in robot.links}
    points = {
        name: poses[name][:3, :3] @ link.center + poses[name][:3, 3]
        for name, link in robot.links.items()
    }
    center = np.zeros(3)
    for name, link in robot.links.items():
        center = center + link.mass / mass * points[name]
    inertia = 0.0
    for name, link in robot.links.items():
        up = poses[name][2, :3]  # the vertical of the base in the frame of the link
        inertia += float(up @ link.inertia @ up)
        inertia += link.mass * float(np.sum((points[name] - center)[:2] ** 2))
    return center, inertia


def _wheel_mass(robot: Robot, wheel: DescribedWheel) -> float:
    child = robot.joints[wheel.joint].child
    return sum(robot.links[name].mass for name in robot.below(child))


def _mean_radius(found: Described) -> float:
    radii = [values["radius"] for values in found.wheels.values() if "radius" in values]
    return float(np.mean(radii)) if radii else 0.0


def _possible(found: Described, key: str, inertia: float, most: float, source: str) -> float | None:
    """Return a moment of inertia, or None if no body of this mass and size can have it.

    Args:
        found: receives the source, or a contradiction.
        key: key of the moment in the vehicle's file.
        inertia: described moment [kg m^2].
        most: moment of the mass at the edge of the body [kg m^2]; 0 if unknown.
        source: where the moment comes from.
    """
    if inertia <= 0.0:
        return None
    if inertia > most > 0.0:
        found.contradictions.append(
            f"{key}: {plain(inertia)} kg m^2 in {source}, but mass and size permit at most "
            f"{plain(most)} kg m^2; used: an estimate; correct the inertia of the links"
        )
        return None
    found.sources[key] = source
    return inertia


def _measure_chassis(
    found: Described, robot: Robot, wheels: Sequence[DescribedWheel], base: str
) -> None:
    """Enter the extent of the shapes that are fixed to base_link, without the wheels."""
    of_wheels = {n for w in wheels for n in robot.below(robot.joints[w.joint].child)}
    links = [robot.links[name] for name in robot.rigid(base) if name not in of_wheels]
    places = np.array([wheel.place[:2] for wheel in wheels])
    meshes = [link.name for link in links if link.meshes]
    for of in ("collision", "visual"):
        corners = [
            shape.corners @ pose[:3, :3].T + pose[:3, 3]
            for link in links
            for pose in [robot.pose(link.name, base)]
            for shape in link.shapes
            if shape.of == of
        ]
        if corners:
            both = np.concatenate(corners)[:, :2]
            if np.all(np.ptp(both, axis=0) > _SPAN * np.ptp(places, axis=0)):
                found.chassis = np.array([both.min(axis=0), both.max(axis=0)])
                source = f"{of} shapes of {robot.file}"
                found.sources |= {"chassis_length": source, "chassis_width": source}
                break
    if found.chassis is None:
        source = "estimate: around the wheels"
        found.sources |= {"chassis_length": source, "chassis_width": source}
    if found.chassis is None or meshes:
        what = f"the meshes of {_some(meshes)}" if meshes else "the chassis"
        found.questions.append(
            f"{what} are not measured: how long and wide is the chassis? (--length, --width)"
        )


def _find_sensors(found: Described, robot: Robot, base: str) -> None:
    """Enter the IMU, and the cameras that look at the ground."""
    imus = [name for name in robot.links if _IMU.search(name)]
    if imus:
        poses = [robot.pose(name, base) for name in imus]
        found.imu = poses[0]
        if max(math.dist(pose[:2, 3], poses[0][:2, 3]) for pose in poses) > 1e-3:
            found.contradictions.append(f"IMU: {', '.join(imus)}; used: {imus[0]}")
    else:
        found.questions.append("no link is an IMU: is there one, and where? (imu_x, imu_y)")
    ahead = []
    for name in (name for name in robot.links if _CAMERA.search(name)):
        if name in robot.parents and _CAMERA.search(robot.parents[name].parent):
            continue  # a further frame of the same camera
        pose = robot.pose(name, base)
        if pose[2, 2 if "optical" in name else 0] < _DOWN:
            heading = wrapped(math.degrees(math.atan2(pose[1, 1], pose[0, 1])))
            x, y = (round(float(value), 6) + 0.0 for value in pose[:2, 3])
            found.cameras[_NAMES.sub("_", name)] = {"x": x, "y": y, "heading_deg": heading}
        else:
            ahead.append(name)
    if ahead:
        found.questions.append(
            f"no view of the ground: {_some(ahead)}; which sensor measures the speed over it?"
        )
