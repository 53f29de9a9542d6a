"""Kinematics of the controllers of ros2_control, read from and written to their parameters.

``mecanum_drive_controller`` and ``omni_wheel_drive_controller`` as published by ros-controls, and
controllers of robots that name the same quantities otherwise (`_NAMES`).
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omni_core.geometry import PlatformGeometry, WheelMount, turned
from omni_core.kinematics import PlatformKinematics
from omni_runs.yaml_files import commented_yaml, read_mapping
from omni_tools.robot_files.refusal import refused

MECANUM, OMNI = "mecanum", "omni"
PACKAGES = {MECANUM: "mecanum_drive_controller", OMNI: "omni_wheel_drive_controller"}
CLASSES = {
    MECANUM: "mecanum_drive_controller/MecanumDriveController",
    OMNI: "omni_wheel_drive_controller/OmniWheelDriveController",
}

# Corners of a vehicle and the signs of x and y, in the order of the published parameters.
CORNERS = {
    "front_left": (1.0, 1.0),
    "front_right": (1.0, -1.0),
    "rear_right": (-1.0, -1.0),
    "rear_left": (-1.0, 1.0),
}
_JOINT = re.compile(
    "(?=(?:left_|right_)?(front|rear|back)_)(?=(?:front_|rear_|back_)?(left|right)_)"
    "(?!.*(?:state|multiplier|steer)).*(?:name|joint|wheel)"
)
# Section and name of a parameter; files of ROS 1 have no `ros__parameters`.
_PARAMETER = re.compile(r"(.*?)/ros__parameters/(.+)|(/[^/]+)/(.+)")
# Names of a quantity without the prefix `kinematics.`; those of the published controllers first.
_NAMES = {
    "radius": ("wheels_radius", "wheel_radius"),
    "sum": ("sum_of_robot_center_projection_on_X_Y_axis",),
    "wheelbase": ("wheel_separation_x", "wheel_base", "wheelbase", "axis_separation"),
    "track": ("wheel_separation_y", "wheel_separation", "wheel_track", "track_width"),
    "robot_radius": ("robot_radius", "wheel_distance"),
    "wheel_offset": ("wheel_offset",),
}
# Factor of a quantity whose own name, such as `wheels_radius`, has no factor of its own.
_MULTIPLIERS = {"radius": "wheel_radius_multiplier"}
_MULTIPLIERS |= dict.fromkeys(("sum", "wheelbase", "track"), "wheel_separation_multiplier")
# Difference of two values of the same length that is more than a rounding to three digits [1].
DIFFERENT = 0.01
FARTHEST = 10.0  # distance of a wheel from the center of all wheels [m]
# Largest magnitude, unit, and its name, of a length; and of a parameter by the end of its name.
_LENGTH = FARTHEST, " m", "meters"
_LIMITS = {
    "offset": (math.tau, " rad", "radians"),
    "theta": (math.tau, " rad", "radians"),
    "multiplier": (10.0, "", "a factor"),
}


class Controller(NamedTuple):
    """Kinematics of a controller; a quantity that its parameters lack is None.

    Attributes:
        name: name of the controller and of its file, for messages.
        kind: `MECANUM` or `OMNI`.
        joints: names of the wheel joints; keyed by corner, or by number for omni-wheels.
        radius: radius of the wheels [m].
        factors: factors of the radius of single wheels [1], keyed as the joints; 1 for others.
        sum: half of wheelbase plus track [m].
        wheelbase: distance of the front axle from the rear axle [m].
        track: distance of the left wheels from the right wheels [m].
        offset: position [m, m] and heading [rad] of the base frame in the frame at the center.
        robot_radius: distance of omni-wheels from the center [m].
        wheel_offset: direction of the first omni-wheel from the center [rad]; None if the
            controller is not the published one, whose wheels follow counter-clockwise.
        base: frame of the twist; empty if none is given.
    """

    name: str
    kind: str
    joints: Mapping[str, str]
    radius: float | None = None
    factors: Mapping[str, float] = {}
    sum: float | None = None
    wheelbase: float | None = None
    track: float | None = None
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    robot_radius: float | None = None
    wheel_offset: float | None = None
    base: str = ""

    @property
    def lever(self) -> float | None:
        """Half of wheelbase plus track [m]; None if unknown."""
        if self.sum is not None or self.wheelbase is None or self.track is None:
            return self.sum
        return round(0.5 * (self.wheelbase + self.track), 9)

    @property
    def assumed(self) -> dict[str, tuple[float, float]]:
        """Heading [deg] and factor of the radius of each wheel, keyed by joint; empty if unknown.

        Omni-wheels follow each other counter-clockwise, with radial axles.
        """
        first, step = -math.degrees(self.offset[2]), 0.0
        if self.wheel_offset is not None:
            first += math.degrees(self.wheel_offset) - 90.0
            step = 360.0 / len(self.joints)
        elif self.kind == OMNI:
            return {}
        return {
            joint: (wrapped(first + row * step), self.factors.get(key, 1.0))
            for row, (key, joint) in enumerate(self.joints.items())
        }

    def wheels(self) -> dict[str, WheelMount] | None:
        """Return the wheels in the base frame, keyed by joint; None if a length is unknown.

        The rollers form an X seen from above, which is the convention of the published controller.
        """
        x, y, theta = self.offset
        if self.kind == OMNI:
            angles = np.radians([heading + 90.0 for heading, _ in self.assumed.values()]) + theta
            places = np.stack((np.cos(angles), np.sin(angles)), axis=1)
            rollers, known = np.zeros(len(places)), (self.robot_radius, self.robot_radius)
        else:
            places = 0.5 * np.reshape([CORNERS[corner] for corner in self.joints], (-1, 2))
            rollers, known = -180.0 * np.prod(places, axis=1), (self.wheelbase, self.track)
        if self.radius is None or None in known or not len(places):
            return None
        inside = turned(places * np.array(known, np.float64) - (x, y), -theta)
        return {
            name: WheelMount(
                x=ahead,
                y=left,
                heading_deg=heading,
                roller_angle_deg=roller,
                radius=self.radius * factor,
            )
            for (name, (heading, factor)), (ahead, left), roller in zip(
                self.assumed.items(), inside.tolist(), rollers.tolist(), strict=True
            )
        }


def wrapped(angle: float) -> float:
    """Return an angle above -180 deg and up to 180 deg."""
    return 180.0 - (180.0 - angle) % 360.0


def read_controllers(path: Path) -> list[Controller]:
    """Return the drive controllers in a parameter file, which may contain any other nodes.

    Raises:
        ConfigurationError: the file is not YAML, or a parameter of such a controller is invalid.
    """
    sections: dict[str, dict[str, Any]] = {}
    for key, value in _flat(read_mapping(path, "--from")):
        if found := _PARAMETER.fullmatch(key):
            section, parameter = (one for one in found.groups() if one is not None)
            sections.setdefault(section, {})[parameter.replace("/", ".")] = value
    nodes: dict[str, dict[str, Any]] = {}
    for section, values in sections.items():
        # Sections such as /**/drive and /drive may give parts of the same node.
        known = nodes.setdefault(section.rpartition("/")[2], {})
        if any(str(known.get(key, value)) != str(value) for key, value in values.items()):  # NaN
            known = nodes.setdefault(section, {})
        known |= values
    every = {key: value for values in nodes.values() for key, value in values.items()}
    controllers = []
    for node, named in nodes.items():
        name = node.rpartition("/")[2]
        values = {
            re.sub("^back_", "rear_", re.sub(r"^(kinematics\.|omni_)", "", key)): value
            for key, value in named.items()
        }
        declared = str(every.get(f"{name}.type", values.get("type", "")))
        kind = _kind(declared, values)
        if kind == OMNI and declared in ("", CLASSES[OMNI]):
            values.setdefault("wheel_offset", 0.0)
        if kind:
            controllers.append(_controller(f"{name} ({path.name})", kind, values))
    return controllers


def _flat(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and the value of each parameter of a file."""
    for name, value in tree.items():
        key = f"{above}/{name}"
        yield from _flat(value, key) if isinstance(value, Mapping) else ((key, value),)


def _kind(declared: str, values: Mapping[str, Any]) -> str:
    """Return the kind of a drive controller; empty for any other node."""
    corners = len(list(filter(_JOINT.fullmatch, values)))
    sized = "wheel_names" in values and any(one in values for one in _NAMES["robot_radius"])
    if declared == CLASSES[OMNI] or sized:
        return OMNI
    if corners == len(CORNERS) or "mecanum" in declared.lower():
        return MECANUM
    return ""


def _controller(name: str, kind: str, values: Mapping[str, Any]) -> Controller:
    def number(key: str, usual: float | None = None) -> float:
        return _number(values, key, name, usual)

    def length(quantity: str, key: str) -> float:
        own = f"{key}_multiplier"
        return number(key) * number(own if own in values else _MULTIPLIERS.get(quantity, own), 1.0)

    lengths = {
        quantity: length(quantity, key)
        for quantity, names in _NAMES.items()
        for key in [one for one in names if one in values][:1]
    }
    x, y, theta = (number(f"base_frame_offset.{axis}", 0.0) for axis in ("x", "y", "theta"))
    joints = _joints(kind, values, name)
    listed = list(joints.values())
    if twice := next((joint for joint in listed if listed.count(joint) > 1), None):
        raise refused(f"{name} names the joint {twice!r} for several wheels; correct one of them")
    factors = {
        corner: number(key)
        for corner in joints
        if (key := f"{corner}_wheel_radius_multiplier") in values
    }
    return Controller(
        name=name,
        kind=kind,
        joints=joints,
        factors=factors,
        offset=(x, y, theta),
        base=str(values.get("base_frame_id") or ""),
        **lengths,
    )


def _joints(kind: str, values: Mapping[str, Any], name: str) -> dict[str, str]:
    if kind == OMNI:
        names = values.get("wheel_names")
        if not isinstance(names, list) or len(names) < 3:
            raise refused(f"{name}: wheel_names must list three or more joints")
        return {str(row): str(joint) for row, joint in enumerate(names)}
    found = {
        f"{corner[1]}_{corner[2]}".replace("back", "rear"): str(joint)
        for key, joint in values.items()
        if joint and (corner := _JOINT.fullmatch(key))
    }
    if lacking := [corner for corner in CORNERS if found and corner not in found]:
        raise refused(f"{name} names no joint of the wheel {', '.join(lacking)}; add its parameter")
    return {corner: found[corner] for corner in CORNERS if found}


def _number(values: Mapping[str, Any], key: str, name: str, usual: float | None = None) -> float:
    """Return a parameter as a number, also if it is a text such as "0.05".

    Args:
        values: parameters of the controller, keyed by name.
        key: name of the parameter, which gives its unit and limits.
        name: name of the controller, for messages.
        usual: value of a missing parameter.

    Raises:
        ConfigurationError: the value is no number, or too large for its unit; or it is a length or
            a factor that is not above 0.
    """
    value = values.get(key, usual)
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    limit, unit, words = _LIMITS.get(re.split("[_.]", key)[-1], _LENGTH)
    problem = ""
    if not math.isfinite(number):
        problem = f"{value!r}, must be a number"
    elif number <= 0.0 and "offset" not in key:
        problem = f"{number:g}{unit}, not above 0"
    elif abs(number) > limit:
        problem = f"{number:g}{unit}, more than {limit:.3g}{unit}; give {words}"
    if problem:
        raise refused(f"{name}: {key} is {problem}")
    return number


def controller_of(wheels: Mapping[str, WheelMount]) -> Controller | None:
    """Return the published controller with the kinematics of a vehicle; None if neither has it.

    Args:
        wheels: wheels in the base frame, keyed by joint.
    """
    geometry = PlatformGeometry.from_wheels(wheels)
    if np.ptp(geometry.radius) > 0.0 or len(wheels) < 3:
        return None
    speeds = PlatformKinematics(wheels).wheel_speeds(np.eye(3))
    for found in (_mecanum(geometry), _omni(geometry)):
        again = found and found.wheels()
        if again and set(again) == set(wheels):
            theirs = PlatformKinematics({name: again[name] for name in wheels})
            if np.allclose(theirs.wheel_speeds(np.eye(3)), speeds, rtol=1e-4, atol=1e-3):
                return found
    return None


def _mecanum(geometry: PlatformGeometry) -> Controller | None:
    theta = -math.atan2(geometry.rolling[0, 1], geometry.rolling[0, 0])
    places = turned(geometry.position, theta)
    center = np.round(places.mean(axis=0), 9)
    corners = {
        corner: joint
        for corner, signs in CORNERS.items()
        for joint, place in zip(geometry.names, places - center, strict=True)
        if tuple(np.sign(place)) == signs
    }
    if len(geometry.names) != len(CORNERS) or len(corners) != len(CORNERS):
        return None
    wheelbase, track = np.ptp(places, axis=0).tolist()
    x, y = (0.0 - center).tolist()
    radius, offset = float(geometry.radius[0]), (x, y, theta + 0.0)
    return Controller("", MECANUM, corners, radius, {}, None, wheelbase, track, offset)


def _omni(geometry: PlatformGeometry) -> Controller:
    """Return the controller of omni-wheels around base_link; its first wheel is nearest to x."""
    angles = np.arctan2(geometry.position[:, 1], geometry.position[:, 0])
    order = np.argsort(np.where(angles < -1e-9, angles + 2.0 * math.pi, angles))
    joints = {str(row): geometry.names[wheel] for row, wheel in enumerate(order)}
    reach = float(np.linalg.norm(geometry.position, axis=1).mean())
    radius, first = float(geometry.radius[0]), float(angles[order[0]])
    return Controller("", OMNI, joints, radius, robot_radius=reach, wheel_offset=first)


def controller_file(controller: Controller) -> str:
    """Return the text of a parameter file with the kinematics of a published controller."""
    values: dict[str, Any]
    if controller.kind == OMNI:
        values = {
            "wheel_names": list(controller.joints.values()),
            "wheel_offset": controller.wheel_offset,
            "robot_radius": controller.robot_radius,
            "wheel_radius": controller.radius,
        }
    else:
        names = controller.joints.items()
        values = {f"{corner}_wheel_command_joint_name": joint for corner, joint in names}
        values["kinematics"] = {
            "base_frame_offset": dict(zip(("x", "y", "theta"), controller.offset, strict=True)),
            "wheels_radius": controller.radius,
            "sum_of_robot_center_projection_on_X_Y_axis": controller.lever,
        }
    package = PACKAGES[controller.kind]
    return commented_yaml(
        {f"/**/{package}": {"ros__parameters": {**values, "base_frame_id": "base_link"}}},
        f"Kinematics of {CLASSES[controller.kind]} that agree with the assistant's file.\n"
        "If you have tuned the controller for slip of the rollers, compare before you replace it.",
    )
