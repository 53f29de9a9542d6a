"""The URDF of a vehicle contains the positions of wheels and cameras, and is a tree."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

from omni_core.description import urdf
from omni_core.geometry import WheelMount
from omni_core.sensors import LineSensor


@pytest.mark.parametrize("count", [3, 4, 6])
def test_every_wheel_and_camera_hangs_where_it_is_bolted(count: int) -> None:
    angles = [2.0 * math.pi * i / count for i in range(count)]
    wheels = {
        f"wheel_{i}": WheelMount(
            x=math.cos(angle),
            y=math.sin(angle),
            heading_deg=math.degrees(angle) % 360.0,
            roller_angle_deg=0.0,
            radius=0.1,
        )
        for i, angle in enumerate(angles)
    }
    sensors = {"front": LineSensor(x=0.6, y=0.1, heading_deg=90.0)}
    robot = ElementTree.fromstring(urdf("toy", wheels, sensors))
    links = {link.attrib["name"] for link in robot.iter("link")}
    joints = {joint.attrib["name"]: joint for joint in robot.iter("joint")}
    children = [joint.find("child").attrib["link"] for joint in joints.values()]  # type: ignore[union-attr]
    assert sorted([*children, "base_link"]) == sorted(links)
    assert {name for name, joint in joints.items() if joint.attrib["type"] == "continuous"} == set(
        wheels
    )
    for name, x, y, heading in (
        *((n, w.x, w.y, w.heading_deg) for n, w in wheels.items()),
        ("front_mount", 0.6, 0.1, 90.0),
    ):
        origin = joints[name].find("origin")
        assert origin is not None
        place = [float(value) for value in origin.attrib["xyz"].split()]
        assert place[:2] == pytest.approx([x, y], abs=1e-8)
        assert float(origin.attrib["rpy"].split()[2]) == pytest.approx(math.radians(heading))


def test_the_chassis_is_drawn_around_its_center() -> None:
    wheels = {"only": WheelMount(x=0.0, y=0.0, roller_angle_deg=0.0, radius=0.1)}
    robot = ElementTree.fromstring(urdf("toy", wheels, {}, (-0.14, 0.02, 0.75, 0.5)))
    body = robot.find("link/visual")
    assert body is not None
    place, box = body.find("origin"), body.find("geometry/box")
    assert place is not None
    assert box is not None
    assert place.attrib["xyz"].split()[:2] == ["-0.14", "0.02"]
    assert box.attrib["size"].split()[:2] == ["0.75", "0.5"]
