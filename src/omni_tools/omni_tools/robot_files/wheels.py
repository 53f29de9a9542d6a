"""Wheels of a robot description: which joints they are, and their geometry."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from omni_core.configuration import did_you_mean
from omni_core.quantities import FloatArray
from omni_tools.robot_files.controllers import Controller, wrapped
from omni_tools.robot_files.links import Joint, Robot, Shape
from omni_tools.robot_files.refusal import refused

_MOVING = ("continuous", "revolute")
_OTHER = "(?!.*(roller|caster|castor|steer|cover|fender|mount|support|arch))"
# Names of wheels; then words that also name a robot, and thereby any of its parts.
_WHEELS = tuple(
    re.compile(f"{_OTHER}.*({words})", re.IGNORECASE)
    for words in ("wheel|whl|tire|tyre", "wheel|whl|tire|tyre|mecanum|omni")
)
_UPRIGHT = 0.2  # limit on the vertical part of the axis of a wheel, and on the rest of a steering's
_STEP, _ROUNDED = 15.0, 0.1  # usual directions, and the error of 3.14 as pi [deg]
_LEVEL = 0.01  # limit on the difference in height of the axles of a vehicle's wheels [m]


class DescribedWheel(NamedTuple):
    """A wheel in the frame of base_link, with all joints at zero.

    Attributes:
        joint: name of its joint.
        place: origin of the joint, moved along the axle to the middle of the shape [m], shape (3,);
            the joint turns the wheel, so that its origin may be anywhere on the axle.
        heading_deg: rolling direction for a positive speed of the joint, counter-clockwise from x.
        roller_deg: axis of the rollers from the rolling direction, above -90 and up to 90 deg; None
            if the description does not contain it.
        radii: radii of the wheel [m], keyed by ``collision`` and ``visual``; without meshes.
        width: width of the wheel [m]; 0 if unknown.
        beside: distance from the joint to the middle of the wheel, along the axis [m]: that of its
            shape, or its center of gravity if it has only meshes.
        mass: mass of the wheel, with its rollers [kg].
        inertia: moment of inertia about the axis [kg m^2].
    """

    joint: str
    place: FloatArray
    heading_deg: float
    roller_deg: float | None
    radii: dict[str, float]
    width: float
    beside: float
    mass: float
    inertia: float


Wheels = Sequence[DescribedWheel]


def base_link(robot: Robot, controller: Controller | None) -> str:
    """Return the link that is base_link: of this name, or the controller's, or the root."""
    named = [name for name in robot.links if name.endswith("base_link")]
    driven = "" if controller is None else controller.base
    # The others are those of an arm.
    above = [one for one in named if set(named) <= set(robot.below(one))]
    for name in ("base_link", driven, *above):
        if name in named:
            return name
    if named:
        raise refused(
            f"{robot.file} has several links named base_link: {', '.join(named)}; give the "
            "description of one robot"
        )
    return driven if driven in robot.links else robot.base


def matched(robot: Robot, controller: Controller) -> Controller:
    """Return a controller with the names of joints and base frame of the robot.

    Raises:
        ConfigurationError: a joint of the controller is missing.
    """
    names = {}
    for key, name in controller.joints.items():
        alike = _alike(name, robot.joints)
        if len(alike) != 1:
            what = f"{len(alike)} of them" if alike else "no such joint"
            raise refused(
                f"{controller.name} names the wheel joint {name!r}, but {robot.file} has "
                f"{what}{did_you_mean(name, robot.joints)}"
            )
        names[key] = alike[0]
    base = min(_alike(controller.base, robot.links), key=len, default=controller.base)
    return controller._replace(joints=names, base=base)


def _alike(name: str, names: Iterable[str]) -> list[str]:
    """Return the names that are a controller's without its namespaces and `$(var ...)`."""
    ending = rf"(^|[/_>]){re.escape(re.split('[/>)}]', name)[-1])}$"
    return [one for one in names if one == name] or [one for one in names if re.search(ending, one)]


def described_wheels(
    robot: Robot, controller: Controller | None, kind: str | None
) -> list[DescribedWheel]:
    """Return the wheels of a robot.

    They are the joints that the controller names; otherwise those that ros2_control drives by
    velocity, those whose names are those of wheels, or the lowest joints with a horizontal axis.

    Args:
        robot: robot description.
        controller: controller with the joints' names of the robot; None if unknown.
        kind: type of the wheels if the user gives it; descriptions of omnidirectional robots for
            simulation may contain steering joints that the robot lacks.

    Raises:
        ConfigurationError: there are fewer than three wheels, or a wheel is steered.
    """
    named = controller.joints.values() if controller is not None else ()
    joints = [robot.joints[name] for name in named] or _likely(robot)
    if len(joints) < 3:
        moving = [one.name for one in robot.joints.values() if one.kind in _MOVING]
        problem = f"{robot.file} has {len(joints) or 'no'} wheels, must have three or more"
        raise refused(
            f"{problem} (moving joints: {', '.join(moving[:12]) or 'none'}); add the parameter "
            "file of the controller, which names the joints of the wheels"
        )
    for joint in joints if kind is None else ():
        steering = [one.name for one in _upright_above(robot, joint) if one.kind in _MOVING]
        if steering:
            raise refused(
                f"the wheel {joint.name} of {robot.file} is steered by the joint {steering[0]}; "
                "begin with a copy of config/vehicles/swerve_robot.yaml (if only a simulation "
                "steers them, give --kind mecanum)"
            )
    return [_wheel(robot, joint) for joint in joints]


def _likely(robot: Robot) -> list[Joint]:
    horizontal = [
        joint
        for joint in robot.joints.values()
        if joint.kind in (*_MOVING, "fixed") and abs(_axis(robot, joint)[2]) < _UPRIGHT
    ]
    moving = [joint for joint in horizontal if joint.kind in _MOVING]
    driven = [joint for joint in moving if joint.name in robot.driven]
    named = [[j for j in horizontal if one.match(f"{j.name} {j.child}")] for one in _WHEELS]
    outermost = _outermost(robot, moving)  # not the rollers below
    lowest = min((float(robot.pose(one.child)[2, 3]) for one in outermost), default=0.0)
    low = [one for one in outermost if robot.pose(one.child)[2, 3] < lowest + _LEVEL]
    turning = [[joint for joint in joints if joint.kind in _MOVING] for joints in named]
    for joints in (driven, *turning, *named, low):
        outer = _outermost(robot, joints)
        if len(outer) >= 3:
            return outer
    return _outermost(robot, turning[1] or named[1])


def _outermost(robot: Robot, joints: Sequence[Joint]) -> list[Joint]:
    """Return the joints that are below no other one of them, such as wheels without rollers."""
    names = {joint.name for joint in joints}
    return [
        joint
        for joint in joints
        if not any(above.name in names for above in robot.chain(joint.parent))
    ]


def possibly_steering(robot: Robot, wheels: Wheels) -> list[str]:
    """Return the fixed joints with a vertical axis that hold one wheel each.

    Simulations of vehicles with steered wheels fix these joints.
    """
    above = Counter(
        joint.name
        for wheel in wheels
        for joint in _upright_above(robot, robot.joints[wheel.joint])
        if joint.kind == "fixed"
    )
    return [name for name in robot.joints if above[name] == 1]


def _upright_above(robot: Robot, wheel: Joint) -> list[Joint]:
    """Return the joints with a vertical axis that hold a wheel."""
    return [
        joint
        for joint in robot.chain(wheel.parent)
        if abs((robot.pose(joint.child)[:3, :3] @ joint.axis)[2]) > 1.0 - _UPRIGHT
    ]


def _axis(robot: Robot, joint: Joint) -> FloatArray:
    """Return the axis of a wheel in base_link; a fixed wheel is taken to roll forward."""
    turn = robot.pose(joint.child)[:3, :3]
    if joint.kind != "fixed":
        return np.asarray(turn @ joint.axis)
    solid = next((one for one in robot.links[joint.child].shapes if one.kind == "cylinder"), None)
    axis = turn @ (joint.axis if solid is None else solid.pose[:3, 2])
    return np.asarray(-axis if axis[1] < -1e-6 else axis)


def _wheel(robot: Robot, joint: Joint) -> DescribedWheel:
    axis, place = _axis(robot, joint), robot.pose(joint.child)[:3, 3]
    if abs(axis[2]) > _UPRIGHT or not np.any(axis):
        raise refused(f"the axis of the wheel {joint.name} of {robot.file} is not horizontal")
    below = robot.below(joint.child)
    mass, center, moments = robot.body(below)
    inertia = float(axis @ moments @ axis + mass * np.sum(np.cross(center - place, axis) ** 2))
    rigid = set(robot.rigid(joint.child)).intersection(below)  # rollers turn by themselves
    round_shapes = sorted(
        (one for one in robot.shapes(rigid) if _is_round(one, axis)),
        key=lambda one: (one.of, one.half[0]),
    )
    cylinders = {one.of: one for one in round_shapes if one.kind == "cylinder"}
    solid = cylinders.get("collision", cylinders.get("visual"))
    middle = solid.pose[:3, 3] if solid is not None else center if mass else place
    beside = float((middle - place) @ axis)
    heading = math.degrees(math.atan2(-axis[0], axis[1]))
    usual = _STEP * round(heading / _STEP)
    heading = round(wrapped(usual if abs(heading - usual) < _ROUNDED else heading), 6)
    grip = robot.grip(joint.child)
    roller = None
    if grip is not None and np.any(grip[:2]):
        away = math.degrees(math.atan2(grip[1], grip[0])) - heading
        roller = round(wrapped(2.0 * away) / 2.0, 1)
    return DescribedWheel(
        joint=joint.name,
        place=place if solid is None else place + beside * axis,
        heading_deg=heading,
        roller_deg=roller,
        radii={one.of: float(one.half[0]) for one in round_shapes},  # the largest is the last one
        width=0.0 if solid is None else 2.0 * float(solid.half[2]),
        beside=beside,
        mass=mass,
        inertia=inertia,
    )


def _is_round(shape: Shape, axis: FloatArray) -> bool:
    """Return whether a shape is round about the axis of a wheel."""
    across = abs(float(shape.pose[:3, 2] @ axis))
    turns = shape.kind == "sphere" or (shape.kind == "cylinder" and across > 1.0 - _UPRIGHT)
    return bool(turns and shape.half[0] > 0.0)
