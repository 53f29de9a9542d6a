"""Robot description (URDF) of a vehicle, for viewers and for the frames of tf2."""

import math
from collections.abc import Mapping
from xml.etree import ElementTree

from omni_core.geometry import WheelMount
from omni_core.sensors import Mount

IMU_FRAME = "imu"
"""Frame of the IMU: the axes of `base_link` at the mounting position."""

_BODY_HEIGHT = 0.2  # [m], only for the picture


def urdf(
    name: str,
    wheels: Mapping[str, WheelMount],
    sensors: Mapping[str, Mount],
    chassis: tuple[float, float, float, float] | None = None,
) -> str:
    """Return the URDF of a vehicle.

    `base_link` is on the ground. Each wheel's joint has the name of the
    wheel, so messages on `wheel_states` are states of these joints. The frame of a camera or flow
    sensor has its origin at the center of the footprint and its x axis along the sensor's axis.

    Args:
        name: name of the robot.
        wheels: wheels, keyed by name.
        sensors: line cameras, flow sensors and IMU, keyed by name.
        chassis: x, y of the chassis' center, length and width [m]; by default the extent of the
            wheel positions.
    """
    robot = ElementTree.Element("robot", name=name)
    radius = max(wheel.radius for wheel in wheels.values())
    x, y, length, width = chassis or _extent(wheels, radius)
    base = ElementTree.SubElement(robot, "link", name="base_link")
    body = _visual(base, (x, y, 1.5 * radius), (0.0, 0.0, 0.0))
    ElementTree.SubElement(body, "box", size=_numbers(length, width, _BODY_HEIGHT))
    for wheel_name, wheel in wheels.items():
        link = ElementTree.SubElement(robot, "link", name=f"{wheel_name}_wheel")
        # The axis of a cylinder is z, the axis of a wheel is its y.
        cylinder = _visual(link, (0.0, 0.0, 0.0), (math.pi / 2.0, 0.0, 0.0))
        shape = {"radius": str(wheel.radius), "length": str(wheel.assumed_width)}
        ElementTree.SubElement(cylinder, "cylinder", shape)
        place = (wheel.x, wheel.y, wheel.radius)
        joint = _joint(robot, wheel_name, "continuous", link, place, wheel.heading_deg)
        ElementTree.SubElement(joint, "axis", xyz="0 1 0")
    for sensor_name, sensor in sensors.items():
        link = ElementTree.SubElement(robot, "link", name=sensor_name)
        place = (sensor.x, sensor.y, 0.0)
        _joint(robot, f"{sensor_name}_mount", "fixed", link, place, sensor.heading_deg)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _extent(wheels: Mapping[str, WheelMount], margin: float) -> tuple[float, float, float, float]:
    """Return center x, y, length and width [m] of the wheel positions, with a margin [m]."""
    x, y = ([getattr(wheel, axis) for wheel in wheels.values()] for axis in "xy")
    low, high = (min(x), min(y)), (max(x), max(y))
    return (
        0.5 * (low[0] + high[0]),
        0.5 * (low[1] + high[1]),
        high[0] - low[0] + margin,
        high[1] - low[1] + margin,
    )


def _visual(
    link: ElementTree.Element, place: tuple[float, float, float], turn: tuple[float, float, float]
) -> ElementTree.Element:
    visual = ElementTree.SubElement(link, "visual")
    ElementTree.SubElement(visual, "origin", xyz=_numbers(*place), rpy=_numbers(*turn))
    return ElementTree.SubElement(visual, "geometry")


def _joint(
    robot: ElementTree.Element,
    name: str,
    kind: str,
    child: ElementTree.Element,
    place: tuple[float, float, float],
    heading_deg: float,
) -> ElementTree.Element:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link="base_link")
    ElementTree.SubElement(joint, "child", link=child.attrib["name"])
    turn = _numbers(0.0, 0.0, math.radians(heading_deg))
    ElementTree.SubElement(joint, "origin", xyz=_numbers(*place), rpy=turn)
    return joint


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)
