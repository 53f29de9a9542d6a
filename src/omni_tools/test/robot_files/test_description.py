"""What the files of a robot say becomes a vehicle; contradictions and gaps are listed."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from made_robots import CONTROLLER, joint, link, mecanum_urdf, omni_urdf, write_packages

from omni_core.configuration import ConfigurationError
from omni_runs.experiment import ExperimentLibrary
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.robot_files.described import Described
from omni_tools.vehicles import command
from omni_tools.vehicles.from_files import described_vehicle

CONFIG = Path(__file__).parents[4] / "config"
Write = Callable[..., Described]
SIGNS = {"fl": (1, 1), "fr": (1, -1), "rr": (-1, -1), "rl": (-1, 1)}


@pytest.fixture
def described(tmp_path: Path) -> Write:
    """Return a function that writes texts as files, and describes their vehicle."""

    def write(urdf: str, *controllers: str, **options: Any) -> Described:
        path = tmp_path / "robot.urdf"
        path.write_text(urdf)
        words = [str(path)]
        for row, text in enumerate(controllers):
            (tmp_path / f"controllers_{row}.yaml").write_text(text)
            words.append(str(tmp_path / f"controllers_{row}.yaml"))
        return described_vehicle(words, **options)

    return write


def test_wheels_keep_their_names_and_places(described: Write) -> None:
    found = described(mecanum_urdf(), CONTROLLER)
    assert found.kind == "mecanum"
    assert found.contradictions == []
    for name, (x, y) in SIGNS.items():
        wheel = found.wheels[f"{name}_joint"]
        assert (wheel["x"], wheel["y"]) == (0.2 * x, 0.15 * y)
        assert wheel["roller_angle_deg"] == -45.0 * x * y  # X seen from above
        assert wheel["radius"] == 0.05
        assert wheel["width"] == 0.04
    assert any("roller directions" in one and "check-vehicle" in one for one in found.questions)


@pytest.mark.parametrize("kind", ["continuous", "revolute", "fixed"])
def test_wheels_may_be_held_by_any_joint(kind: str, described: Write) -> None:
    found = described(mecanum_urdf(kind=kind, name="{}_wheel_joint"))
    assert len(found.wheels) == 4
    assert all("heading_deg" not in wheel for wheel in found.wheels.values())


def test_masses_are_summed_about_their_common_center(described: Write) -> None:
    found = described(mecanum_urdf(), CONTROLLER)
    # The body of 10 kg is 0.02 m ahead of base_link, each wheel of 0.5 kg at its joint.
    assert found.values["body.mass"] == 12.0
    x = 10.0 * 0.02 / 12.0
    center = [found.values[f"body.{key}"] for key in ("x", "y", "height")]
    height = (10.0 * 0.15 + 2.0 * 0.05) / 12.0
    np.testing.assert_allclose(center, (x, 0.0, height), rtol=1e-4)
    wheels = 4 * 1e-3 + 2.0 * (0.2**2 + 0.15**2 + x**2)
    yaw_inertia = 0.3 + 10.0 * (0.02 - x) ** 2 + wheels
    assert found.values["body.yaw_inertia"] == pytest.approx(yaw_inertia, rel=1e-4)
    assert found.values["wheel_inertia"] == pytest.approx(6e-4)
    assert found.values["chassis_length"] == 0.5
    assert found.values["chassis_width"] == 0.2
    assert "chassis_x" not in found.values
    assert found.imu is not None
    np.testing.assert_allclose(found.imu[:2, 3], (0.1, -0.03), atol=1e-12)


def test_turned_links_give_the_same_vehicle(described: Write) -> None:
    turned = mecanum_urdf().replace(
        '<origin xyz="0.2 0.15 -0.05" rpy="0 0 0"/>',
        f'<origin xyz="0.2 0.15 -0.05" rpy="{-math.pi / 2} 0 0"/>',
    )
    turned = re.sub(
        r'(<joint name="fl_joint".*?)<axis xyz="0 1 0"/>',
        r'\1<axis xyz="0 0 1"/>',
        turned,
        flags=re.S,
    )
    before, after = described(mecanum_urdf()), described(turned)
    assert after.wheels["fl_joint"].get("heading_deg", 0.0) == 0.0
    for key in ("body.mass", "body.x", "body.y", "body.height"):
        assert before.values[key] == after.values[key]


@pytest.mark.parametrize("named", [True, False])
def test_omni_wheels_point_along_their_axles(named: bool, described: Write) -> None:
    controller = """
base:
  ros__parameters:
    wheel_names: [a, b, c]
    wheel_offset: 1.0471975511965976
    robot_radius: 0.13
    wheel_radius: 0.05
"""
    found = described(omni_urdf(), *([controller] if named else []))
    assert found.kind == "omni"
    headings = {name: wheel.get("heading_deg", 0.0) for name, wheel in found.wheels.items()}
    assert headings == {"a": -30.0, "b": 90.0, "c": -150.0}
    assert all(wheel["roller_angle_deg"] == 0.0 for wheel in found.wheels.values())
    assert found.contradictions == []
    assert ("radius" in found.wheels["a"]) == named
    assert named or any("wheels are meshes" in one for one in found.questions)
    assert named or any("taken as omni-wheels" in one for one in found.questions)
    # Where the controller expects other wheels, each turns the robot in the same sense.
    elsewhere = controller.replace("1.047", "-2.094").replace("[a, b, c]", "[a, c, b]")
    found = described(omni_urdf(), *([elsewhere] if named else []))
    assert headings == {name: wheel.get("heading_deg", 0.0) for name, wheel in found.wheels.items()}
    assert len(found.contradictions) == named


def test_mecanum_wheels_may_be_described_with_the_axes_of_their_rollers(described: Write) -> None:
    axis = {corner: f"{-x * y} 1 0" for corner, (x, y) in SIGNS.items()}
    assert described(mecanum_urdf(axis=axis), kind="omni").kind == "omni"
    found = described(mecanum_urdf(axis=axis))
    assert any("roll past their center at a distance of only" in one for one in found.questions)
    for name, wheel in described(mecanum_urdf()).wheels.items():
        assert "heading_deg" not in found.wheels[name]
        assert found.wheels[name]["roller_angle_deg"] == wheel["roller_angle_deg"]


def test_an_omni_wheel_that_counts_the_other_way_is_asked_about(described: Write) -> None:
    words = "a: by the axes in robot.urdf, a positive speed turns the robot the other way"
    assert not any(words in one for one in described(omni_urdf()).questions)
    found = described(omni_urdf().replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>', 1))
    assert any(words in one for one in found.questions)


def test_wheels_elsewhere_than_their_names_say_are_listed(described: Write) -> None:
    assert described(mecanum_urdf(name="{}_wheel_joint")).contradictions == []
    urdf = mecanum_urdf(name="{}_wheel_joint")
    for corner in ("fl", "fr", "rl", "rr"):
        ahead, side = {"f": "front", "r": "back"}[corner[0]], {"l": "left", "r": "Right"}[corner[1]]
        urdf = urdf.replace(f"{corner}_wheel_joint", f"{ahead}{side}_wheel_joint")
    assert described(urdf).contradictions == []
    assert described(urdf.replace("frontleft", "bright")).contradictions == []
    (listed,) = described(urdf.replace("frontleft", "BACKleft")).contradictions
    assert listed.startswith("BACKleft_wheel_joint: not where their names say; used: the positions")


def test_wheels_may_have_other_names_than_their_rollers(described: Write) -> None:
    rollers = "".join(
        joint(f"{name}_roller_wheel_joint", f"{name}_rim", f"{name}_roller", "0 0 -0.04")
        + link(f"{name}_roller", mass=0.01)
        for name in ("fl", "fr", "rl", "rr")
    )
    urdf = mecanum_urdf(name="{}_axle", extra=rollers)
    found = described(
        re.sub(r'"(\w\w)_wheel"', r'"\1_rim"', urdf).replace("roller_wheel", "roller")
    )
    assert set(found.wheels) == {f"{name}_axle" for name in ("fl", "fr", "rl", "rr")}


@pytest.mark.parametrize(
    ("prefix", "distance"), [("", "robot_radius"), ("omni_", "omni_wheel_distance")]
)
def test_directions_of_an_unknown_controller_of_omni_wheels_are_not_assumed(
    prefix: str, distance: str, described: Write, tmp_path: Path
) -> None:
    controller = f"""
controller_manager: {{ros__parameters: {{base: {{type: other_controllers/OmniController}}}}}}
base:
  ros__parameters:
    {{{prefix}wheel_names: [c, b, a], gamma: 30.0, {distance}: 0.13, wheel_radius: 0.05}}
"""
    found = described(omni_urdf(), controller)
    assert found.wheels["a"]["radius"] == 0.05
    headings = {name: wheel.get("heading_deg", 0.0) for name, wheel in found.wheels.items()}
    assert headings == {"a": -30.0, "b": 90.0, "c": -150.0}
    assert found.contradictions == []
    path = tmp_path / "alone.yaml"
    path.write_text(controller)
    with pytest.raises(ConfigurationError, match="gives no position of a single wheel"):
        described_vehicle([str(path)])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("wheel_separation_y: 0.3", "wheel_separation_y: 0.26"), "track: 0.3 m in .*, 0.26 m in"),
        (("wheel_radius: 0.05", "wheel_radius: 0.048"), "radius of .*: 0.048 m in .*, 0.05 m in"),
        (
            ("wheel_separation_x: 0.4", "wheel_separation_x: 0.5"),
            "wheelbase: 0.4 m in .*, 0.5 m in",
        ),
        (("base_link", "base_footprint"), ""),
        (("left_wheel_name: fl_joint", "left_wheel_name: fr_joint"), "elsewhere in"),
    ],
)
def test_values_that_differ_between_files_are_listed(
    change: tuple[str, str], words: str, described: Write
) -> None:
    text = CONTROLLER.replace(*change)
    if "fr_joint" in change[1]:
        text = text.replace("right_wheel_name: fr_joint", "right_wheel_name: fl_joint", 1)
    contradictions = described(mecanum_urdf(), text).contradictions
    if not words:
        assert contradictions == []
        return
    assert any(re.search(words, one) and "used:" in one for one in contradictions)


def test_the_offset_of_the_controller_is_compared(described: Write) -> None:
    text = f"{CONTROLLER}    kinematics.base_frame_offset.x: 0.1\n"
    (listed,) = described(mecanum_urdf(), text).contradictions
    assert listed.startswith("center of the wheels in base_link: (0, 0) m in robot.urdf, (-0.1, ")
    urdf = mecanum_urdf().replace('xyz="0.2 ', 'xyz="0.1 ').replace('xyz="-0.2 ', 'xyz="-0.3 ')
    assert described(urdf, text).contradictions == []


def test_parameters_may_be_nan(described: Write) -> None:
    found = described(mecanum_urdf(), f"{CONTROLLER}    linear.x.max_jerk: .NAN\n")
    assert found.contradictions == []
    assert found.wheels["fl_joint"]["radius"] == 0.05


def test_shapes_beside_the_joints_are_listed_once(described: Write) -> None:
    apart = '<origin xyz="0 0.03 0" rpy='
    found = described(mecanum_urdf().replace("<origin rpy=", apart))
    (listed,) = found.contradictions
    assert listed.startswith("fl_joint, fr_joint, rl_joint, rr_joint: the middle of the shape is")
    assert "0.03 m beside the joint along the axle; used: the shape" in listed
    assert (found.wheels["fl_joint"]["y"], found.wheels["fr_joint"]["y"]) == (0.18, -0.12)


def test_shapes_and_meshes_beside_the_joints_are_listed_apart(described: Write) -> None:
    urdf = re.sub(r"<cylinder [^>]*>", '<mesh filename="wheel.stl"/>', mecanum_urdf(), count=2)
    urdf = urdf.replace("<origin rpy=", '<origin xyz="0 0.03 0" rpy=')
    mass = '<origin xyz="0 {} 0"/><mass value="0.5"/>'.format
    urdf = urdf.replace(mass(0), mass(0.02))
    shapes, meshes, *_ = described(urdf, CONTROLLER).contradictions
    assert "fl_joint" not in shapes
    assert (
        "middle of the shape is 0.03 m beside the joint along the axle; used: the shape" in shapes
    )
    assert meshes.startswith("fl_joint: the center of gravity of the mesh is 0.02 m beside")
    assert "used: the joint" in meshes


def test_meshes_beside_the_joints_are_listed_by_their_centers_of_gravity(described: Write) -> None:
    meshes = re.sub(r"<cylinder [^>]*>", '<mesh filename="wheel.stl"/>', mecanum_urdf())
    assert described(meshes, CONTROLLER).contradictions == []
    apart = '<origin xyz="0 0.02 0"/><mass value="0.5"/>'
    urdf = meshes.replace('<origin xyz="0 0 0"/><mass value="0.5"/>', apart)
    (listed,) = described(urdf, CONTROLLER).contradictions
    assert (
        "center of gravity of the mesh is 0.02 m beside the joint along the axle; used: the joint"
        in listed
    )


def test_the_chassis_around_three_wheels_has_its_middle_between_them(described: Write) -> None:
    found = described(omni_urdf(), radius=0.05)
    assert "chassis_x" not in found.values
    assert found.measured["length"] == pytest.approx(2.0 * (0.13 + 0.05))


def test_the_middle_of_the_masses_is_known_without_a_radius(described: Write) -> None:
    found = described(omni_urdf().replace('xyz="0 0 0"/><mass', 'xyz="0.1 0.02 0"/><mass', 1))
    assert found.radii == []
    # Wheels of 0.1 kg about base_link, whose 2 kg are at (0.1, 0.02) m; no height above a ground.
    assert found.values["body.x"] == pytest.approx(2.0 * 0.1 / 2.3, rel=1e-4)
    assert found.values["body.y"] == pytest.approx(2.0 * 0.02 / 2.3, rel=1e-4)
    assert "body.height" not in found.values


@pytest.mark.parametrize(("inertia", "possible"), [(2.0, True), (6.0, False)])
def test_a_chassis_of_unknown_size_may_be_larger_than_the_wheels_are_apart(
    inertia: float, possible: bool, described: Write
) -> None:
    urdf = mecanum_urdf().replace('<box size="0.5 0.2 0.1"/>', '<mesh filename="body.stl"/>')
    found = described(urdf.replace('izz="0.3"', f'izz="{inertia}"'))
    assert ("body.yaw_inertia" in found.values) == possible
    assert any("body.yaw_inertia" in one for one in found.contradictions) != possible


@pytest.mark.parametrize(
    ("name", "is_one"),
    [
        ("ImuBaseGyroscope_frame", True),
        ("robotimu_link", True),
        ("base_IMU", True),
        ("chassisImu", True),
        ("simulator_link", False),
        ("simu_link", False),
        ("SIMULATION", False),
    ],
)
def test_an_imu_is_found_by_the_name_of_its_link(name: str, is_one: bool, described: Write) -> None:
    found = described(mecanum_urdf().replace("imu_link", name))
    assert (found.imu is not None) == is_one
    assert any("no link is an IMU" in one for one in found.questions) != is_one


def test_an_imu_on_a_head_that_turns_is_not_used(described: Write) -> None:
    head = link("head_imu") + joint("neck", "base_link", "head_imu", "0 0 1", kind="revolute")
    found = described(mecanum_urdf(extra=head).replace("imu_link", "board"))
    assert found.imu is None
    assert any("head_imu turns on a joint: is there one" in one for one in found.questions)


def test_parts_of_an_omni_robot_are_no_wheels(described: Write) -> None:
    parts = "".join(
        link(f"omni_{part}")
        + joint(f"omni_{part}_joint", "base_link", f"omni_{part}", "0 0 0.3", kind="fixed")
        for part in ("structure", "pivot", "frame")
    )
    for kind in ("fixed", "continuous"):
        found = described(mecanum_urdf(kind=kind, extra=parts))
        assert set(found.wheels) == {f"{corner}_joint" for corner in SIGNS}


def test_an_imu_on_the_vehicle_is_used_rather_than_one_on_its_head(described: Write) -> None:
    head = link("head_imu") + joint("neck", "base_link", "head_imu", "0 0 1", kind="revolute")
    found = described(mecanum_urdf().replace("<link", f"{head}<link", 1))
    assert found.imu is not None
    assert found.imu[0, 3] == pytest.approx(0.1)
    assert any(one.startswith("IMU: imu_link, head_imu; used: imu_link") for one in
               found.contradictions)  # fmt: skip


@pytest.mark.parametrize("height", [-0.01, 0.0, 0.5])
def test_a_footprint_elsewhere_than_on_the_ground_gives_no_radius(
    height: float, described: Write
) -> None:
    words = "is this the radius of the wheels?"
    for above, asked in ((height, False), (0.05, True)):
        urdf = re.sub(r"<cylinder [^>]*>", '<mesh filename="a.stl"/>', mecanum_urdf(height=above))
        assert any(words in one for one in described(urdf).questions) == asked


def test_a_radius_that_does_not_fit_between_the_axles_is_not_used(
    described: Write, tmp_path: Path
) -> None:
    text = CONTROLLER.replace("0.05", "0.5")
    found = described(mecanum_urdf(), text)
    assert found.wheels["fl_joint"]["radius"] == 0.05
    assert any("0.5 m in drive" in one and "used: collision" in one for one in found.contradictions)
    with pytest.raises(ConfigurationError, match=r"radius of 0.5 m \(drive .* are 0.4 m apart"):
        described_vehicle([str(tmp_path / "controllers_0.yaml")])
    with pytest.raises(ConfigurationError, match=r"radius of 0.45 m \(--wheel-radius\)"):
        described(mecanum_urdf(), text, radius=0.45)


def test_axles_of_omni_wheels_on_fixed_joints_point_outward(described: Write) -> None:
    found = described(omni_urdf().replace("continuous", "fixed"))
    assert found.wheels == described(omni_urdf()).wheels
    assert not any("turns the robot the other way" in one for one in found.questions)


def test_a_file_without_a_known_controller_is_named(described: Write) -> None:
    found = described(mecanum_urdf(), "amcl: {ros__parameters: {alpha1: 0.2}}")
    assert any("controllers_0.yaml contains no known controller" in one for one in found.questions)


def test_base_link_of_an_arm_is_not_that_of_the_robot(described: Write) -> None:
    arm = joint("arm", "robot_base_link", "arm_base_link", "0 0 0.1", kind="fixed")
    urdf = mecanum_urdf().replace("base_link", "robot_base_link")
    found = described(urdf.replace("</robot>", f"{arm}{link('arm_base_link')}</robot>"))
    assert found.wheels["fl_joint"]["x"] == 0.2
    apart = joint("a", "base_footprint", "arm_base_link", "0 0 0.1", kind="fixed")
    with pytest.raises(ConfigurationError, match="several links named base_link"):
        described(urdf.replace("</robot>", f"{apart}{link('arm_base_link')}</robot>"))


def test_rollers_are_those_of_the_friction_in_gazebo(described: Write) -> None:
    def gazebo(sign: int) -> str:
        return "".join(
            f'<gazebo reference="{name}_wheel"><collision><fdir1 gz:expressed_in="base_link">'
            f"1 {sign * y} 0</fdir1></collision></gazebo>"
            for name, y in (("fl", -1), ("fr", 1), ("rl", 1), ("rr", -1))
        )

    def angles(extra: str, *controllers: str) -> tuple[list[float], list[str]]:
        urdf = mecanum_urdf(extra=extra).replace("<robot", '<robot xmlns:gz="gz"')
        found = described(urdf, *controllers)
        return [one["roller_angle_deg"] for one in found.wheels.values()], found.contradictions

    shape = angles("", CONTROLLER)[0]
    reverse = [-angle for angle in angles("")[0]]
    assert angles(gazebo(1)) == ([-angle for angle in reverse], [])
    opposite, listed = angles(gazebo(-1))
    assert opposite == reverse
    assert "used: fdir1" in listed[0]
    used, listed = angles(gazebo(-1), CONTROLLER)
    assert used == shape
    assert "as drive (controllers_0.yaml) assumes" in listed[0]


def test_an_effective_sum_is_compared_with_the_distances(described: Write) -> None:
    lines = [line for line in CONTROLLER.splitlines() if "separation" not in line]
    lines.append("    kinematics.sum_of_robot_center_projection_on_X_Y_axis: 0.42")
    (found,) = described(mecanum_urdf(), "\n".join(lines)).contradictions
    assert "half of wheelbase plus track: 0.35 m in robot.urdf, 0.42 m in" in found


def test_a_wheel_that_turns_backward_is_listed(described: Write) -> None:
    urdf = mecanum_urdf(axis={"fr": "0 -1 0", "rr": "0 -1 0"})
    found = described(urdf, CONTROLLER)
    (listed,) = found.contradictions
    assert listed.startswith(
        "fr_joint, rr_joint: by the axes in robot.urdf, a positive speed is back"
    )
    assert "used: drive (controllers_0.yaml)" in listed
    assert all("heading_deg" not in wheel for wheel in found.wheels.values())
    alone = described(urdf)
    assert alone.wheels["fr_joint"]["heading_deg"] == 180.0
    assert any("a positive speed is backward in base_link" in one for one in alone.questions)


def test_a_forgotten_axis_is_listed_and_the_direction_of_the_controller_used(
    described: Write,
) -> None:
    urdf = mecanum_urdf().replace('<axis xyz="0 1 0"/>', "")
    found = described(urdf, CONTROLLER)
    assert any("fl_joint" in one and "correct <axis>" in one for one in found.contradictions)
    right = described(mecanum_urdf(), CONTROLLER)
    for name, wheel in found.wheels.items():
        assert "heading_deg" not in wheel
        assert wheel["roller_angle_deg"] == right.wheels[name]["roller_angle_deg"]


def test_wheels_that_roll_along_y_by_their_axes_are_asked_about(described: Write) -> None:
    found = described(mecanum_urdf().replace('<axis xyz="0 1 0"/>', ""))
    assert {wheel["heading_deg"] for wheel in found.wheels.values()} == {-90.0}
    words = "fl_joint, fr_joint, rl_joint, rr_joint: by the axes in robot.urdf, they roll sideways"
    (asked,) = [one for one in found.questions if words in one]
    assert "so that x points forward" in asked


def test_an_impossible_inertia_of_wheels_becomes_that_of_discs_of_their_mass(
    described: Write,
) -> None:
    found = described(mecanum_urdf().replace('iyy="0.0006"', 'iyy="1"'))
    assert found.values["wheel_inertia"] == pytest.approx(0.5 * 0.5 * 0.05**2)
    assert found.sources["wheel_inertia"] == "estimate: a solid disc of 0.5 kg"


def test_heavy_wheels_beside_a_small_chassis_have_a_possible_inertia(described: Write) -> None:
    urdf = mecanum_urdf().replace('size="0.5 0.2 0.1"', 'size="0.25 0.16 0.1"')
    found = described(urdf.replace('mass value="0.5"', 'mass value="20"'))
    yaw_inertia = 0.304 + 80.0 * 0.25**2 + 8.889 * 0.02**2
    assert found.values["body.yaw_inertia"] == pytest.approx(yaw_inertia, rel=1e-4)


def test_axles_above_the_ground_and_impossible_inertias_are_listed(described: Write) -> None:
    urdf = mecanum_urdf(height=0.08).replace('iyy="0.0006"', 'iyy="1"')
    listed = described(
        urdf.replace('mass value="0.5"', 'mass value="5"'), CONTROLLER
    ).contradictions
    assert any("mass of a wheel: 5 kg in" in one and "(--mass)" in one for one in listed)
    assert any("height of the axles: 0.08 m above base_footprint" in one for one in listed)
    assert any("wheel_inertia: 1 kg m^2" in one and "used: an estimate" in one for one in listed)


def test_a_center_of_gravity_in_the_ground_is_listed(tmp_path: Path) -> None:
    (tmp_path / "low.urdf").write_text(
        mecanum_urdf().replace('xyz="0.02 0 0.05"', 'xyz="0 0 -0.1"')
    )
    document = run(tmp_path, str(tmp_path / "low.urdf"))
    assert any("center of gravity: 0.00833 m above" in one for one in document["contradictions"])
    text = (tmp_path / "vehicle/vehicle.yaml").read_text()
    assert "height: 0.075 # estimate: 1.5 wheel radii" in text


def test_wheels_are_found_by_what_drives_them_or_where_they_are(described: Write) -> None:
    arm = joint("shoulder", "base_link", "upper_arm", "0 0 0.4", axis="0 1 0") + link("upper_arm")
    by_place = mecanum_urdf(name="{}", extra=arm)
    assert set(described(by_place).wheels) == {"fl", "fr", "rl", "rr"}
    driven = "".join(
        f'<joint name="{name}"><command_interface name="velocity"/></joint>'
        for name in ("fl", "fr", "rl", "rr")
    )
    both = driven[: driven.index("</joint>")].replace("fl", "shoulder")
    for names in (driven, f'{driven}{both}<command_interface name="position"/></joint>'):
        extra = f'{arm}<ros2_control name="a" type="system">{names}</ros2_control>'
        found = described(mecanum_urdf(name="{}", extra=extra))
        assert set(found.wheels) == {"fl", "fr", "rl", "rr"}


def test_rollers_are_no_wheels(described: Write) -> None:
    rollers = "".join(
        joint(f"{name}_roller_{row}_wheel_joint", f"{name}_wheel", f"{name}_roller_{row}", "0 0 0")
        + link(f"{name}_roller_{row}", mass=0.01)
        for name in ("fl", "fr", "rl", "rr")
        for row in range(3)
    )
    found = described(mecanum_urdf(extra=rollers))
    assert set(found.wheels) == {f"{name}_joint" for name in ("fl", "fr", "rl", "rr")}
    assert found.values["body.mass"] == 12.12


def test_names_with_a_namespace_or_a_dash_are_matched(described: Write) -> None:
    for prefix in ("robot1/", "$(var prefix)"):
        text = CONTROLLER.replace("_name: ", f"_name: {prefix}")
        assert set(described(mecanum_urdf(), text).wheels) == {
            f"{name}_joint" for name in ("fl", "fr", "rl", "rr")
        }
    found = described(mecanum_urdf(name="{}-wheel"))
    assert set(found.wheels) == {f"{name}_wheel" for name in ("fl", "fr", "rl", "rr")}
    assert any("fl-wheel" in one for one in found.questions)


@pytest.mark.parametrize(
    ("urdf", "words"),
    [
        ("<robot name='a'/>", "has no links; give the file of the robot"),
        ("<sdf/>", "its first element is <sdf>, not <robot>"),
        ("<sdf>${height}</sdf>", "not <robot>; give the URDF"),
        ("<robot>", "is not valid XML"),
        (
            mecanum_urdf().replace('name="fl_wheel"', 'name="base_link"'),
            "two links named 'base_link'",
        ),
        (mecanum_urdf(extra=link("alone")), "has 2 links that no joint holds"),
        (mecanum_urdf(extra=joint("j", "base_link", "lost", "0 0 0")), "lacks the link 'lost'"),
        (
            mecanum_urdf(
                extra=link("a")
                + link("b")
                + joint("j", "a", "b", "0 0 0")
                + joint("k", "b", "a", "0 0 0")
            ),
            "has a loop of joints through the link",
        ),
        (
            mecanum_urdf().replace('radius="0.05"', 'radius="50"'),
            "looks like millimeters or inches",
        ),
        (mecanum_urdf().replace('radius="0.05"', 'radius="wide"'), "must be a number"),
        (f"<robot name='a'>{link('base_link')}</robot>", "has no wheels, must have three or more"),
    ],
)
def test_what_describes_no_robot_is_refused(urdf: str, words: str, described: Write) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(words)) as error:
        described(urdf)
    assert "\n" not in str(error.value)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_any_wrong_value_is_refused_in_a_sentence(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("robot")
    urdf, text = mecanum_urdf(), CONTROLLER
    wrong = st.sampled_from(["nan", "-1", "1e400", "", "0", "1 2", "x", "0 0 0", "1e-9", "900"])
    values = [match.span(1) for match in re.finditer(r'="([^"]*)"', urdf)]
    for first, last in sorted(data.draw(st.sets(st.sampled_from(values), max_size=3)))[::-1]:
        urdf = urdf[:first] + data.draw(wrong) + urdf[last:]
    lines = [match.span(1) for match in re.finditer(r": ([\w.]+)$", text, re.MULTILINE)]
    for first, last in sorted(data.draw(st.sets(st.sampled_from(lines), max_size=2)))[::-1]:
        text = text[:first] + data.draw(wrong) + text[last:]
    (folder / "robot.urdf").write_text(urdf)
    (folder / "drive.yaml").write_text(text)
    said = ""
    try:
        described_vehicle([str(folder / "robot.urdf"), str(folder / "drive.yaml")])
    except ConfigurationError as error:
        said = str(error)
    assert "\n" not in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CONTROLLER.replace("0.05", "50.0"), "wheel_radius is 50 m, more than 10 m; give meters"),
        (CONTROLLER.replace("0.05", "1.97"), "looks like millimeters or inches"),
        (
            CONTROLLER.replace("fl_joint", "fl_joind"),
            "'fl_joind', but robot.urdf has no such joint",
        ),
        (
            CONTROLLER.replace("fl_joint", "fr_joint"),
            "names the joint 'fr_joint' for several wheels",
        ),
        (
            CONTROLLER.replace("    front_left_wheel_name: fl_joint\n", ""),
            "names no joint of the wheel front_left",
        ),
        (CONTROLLER.replace("0.4", "400.0"), "wheel_separation_x is 400 m, more than 10 m"),
    ],
)
def test_a_controller_of_another_robot_is_refused(text: str, words: str, described: Write) -> None:
    with pytest.raises(ConfigurationError, match=words):
        described(mecanum_urdf(), text)


def test_a_controller_alone_must_be_in_meters(tmp_path: Path) -> None:
    path = tmp_path / "drive.yaml"
    path.write_text(CONTROLLER.replace("0.05", "5.0"))
    with pytest.raises(ConfigurationError, match=r"the radius of a wheel in drive .* is 5 m"):
        described_vehicle([str(path)])
    with pytest.raises(ConfigurationError, match=r"radius of 0.9 m \(--wheel-radius\)"):
        described_vehicle([str(path)], radius=0.9)


def test_steered_wheels_and_several_controllers_are_refused(described: Write) -> None:
    urdf = mecanum_urdf().replace('<parent link="base_link"/><child link="fl_wheel"/>',
        '<parent link="fork"/><child link="fl_wheel"/>')  # fmt: skip
    fork = joint("fork_joint", "base_link", "fork", "0 0 0", axis="0 0 1") + link("fork")
    with pytest.raises(ConfigurationError, match="is steered by the joint fork_joint"):
        described(urdf.replace("</robot>", f"{fork}</robot>"))
    simulated = described(urdf.replace("</robot>", f"{fork}</robot>"), kind="mecanum")
    assert simulated.wheels == described(mecanum_urdf(), kind="mecanum").wheels
    still = fork.replace("continuous", "fixed")
    questions = described(urdf.replace("</robot>", f"{still}</robot>")).questions
    assert any("fixed joints fork_joint have a vertical axis" in one for one in questions)
    assert not any("vertical axis" in one for one in described(mecanum_urdf()).questions)
    other = CONTROLLER.replace("0.3", "0.4").replace("drive:", "other:")
    with pytest.raises(ConfigurationError, match="several controllers drive wheels"):
        described(mecanum_urdf(), CONTROLLER, other)
    same = CONTROLLER.replace("drive:", "other:").replace(": base_link", ": base_footprint")
    described(mecanum_urdf(), CONTROLLER, same)


def test_parallel_axles_of_omni_wheels_are_refused(described: Write) -> None:
    with pytest.raises(ConfigurationError, match="are parallel, so omni-wheels could not"):
        described(mecanum_urdf(), kind="omni")


@pytest.mark.parametrize("frame", ["base_link", "$(var prefix)base_link", "robot1/base_link", "a"])
def test_the_frame_of_the_controller_is_a_link(frame: str, described: Write) -> None:
    text = CONTROLLER.replace(": base_link", f': "{frame}"')
    found = described(mecanum_urdf(), text).contradictions
    assert [one for one in found if "moves a, which is no link of robot.urdf" in one] == found
    assert len(found) == (frame == "a")


def test_only_a_camera_that_looks_down_is_a_ground_sensor(described: Write) -> None:
    down = f"0 {math.pi / 2} 0"
    extra = joint("a", "base_link", "ground_camera", "0.1 0 0", rpy=down, kind="fixed")
    extra += joint("b", "base_link", "front_camera", "0.2 0 0", kind="fixed")
    extra += joint("c", "base_link", "gimbal_camera", "0.2 0 0", rpy=down, kind="revolute")
    extra += link("ground_camera") + link("front_camera") + link("gimbal_camera")
    found = described(mecanum_urdf(extra=extra))
    assert set(found.cameras) == {"ground_camera"}
    assert found.cameras["ground_camera"]["x"] == pytest.approx(0.1)
    words = "no view of the ground: front_camera, gimbal_camera;"
    assert any(words in one for one in found.questions)
    assert any("ground_camera look at the ground: do they" in one for one in found.questions)


def run(tmp_path: Path, *words: str, **options: Any) -> dict[str, Any]:
    """Run the command, and return its JSON document."""
    out = tmp_path / "vehicle"
    given = command.Options(name="mine", files=words, out=out, **options)
    report = command.run(given, ExperimentWorkspace(CONFIG.parent))
    document: dict[str, Any] = json.loads(json.dumps(report.document))
    return document


def test_what_options_give_is_not_asked_for(tmp_path: Path) -> None:
    (tmp_path / "drive.yaml").write_text(CONTROLLER)
    sizes = {"mass": 12.0, "length": 0.5, "width": 0.4}
    asked = [
        run(tmp_path / name, str(tmp_path / "drive.yaml"), **given)["missing"]
        for name, given in (("all", sizes), ("some", {**sizes, "width": None}))
    ]
    assert not any("chassis" in one for one in asked[0])
    assert any("(--length, --width)" in one for one in asked[1])


def test_the_written_vehicle_is_complete(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(mecanum_urdf())
    (tmp_path / "drive.yaml").write_text(CONTROLLER.replace("0.3\n", "0.26\n"))
    document = run(tmp_path, str(tmp_path / "robot.urdf"), str(tmp_path / "drive.yaml"))
    assert document["notes"] == []
    assert any("track" in one for one in document["contradictions"])
    experiment = ExperimentLibrary(CONFIG).load(str(tmp_path / "vehicle"), "assisted")
    vehicle = experiment.vehicle
    assert vehicle.body.mass == 12.0
    assert vehicle.masses.yaw_inertia == pytest.approx(0.42967, rel=1e-4)
    assert (experiment.brake_assist.imu_x, experiment.brake_assist.imu_y) == (0.1, -0.03)
    text = (tmp_path / "vehicle/vehicle.yaml").read_text()
    assert "# contradiction: track" in text
    assert "# joints of robot.urdf; estimate: rollers" in text
    assert yaml.safe_load(text)["chassis_length"] == 0.5


def test_base_link_may_be_anywhere(tmp_path: Path) -> None:
    imu = '<origin xyz="0.1 -0.03 0.02" rpy="0 0 {}"/>'
    urdf = mecanum_urdf().replace(imu.format(0), imu.format(math.pi / 2))
    # base_link is 0.3 m behind the body.
    urdf = urdf.replace("base_link", "body").replace(
        'child link="body"/>', 'child link="base_link"/>'
    )
    ahead = link("base_link") + joint("rear", "base_link", "body", "0.3 0 0", kind="fixed")
    (tmp_path / "new.urdf").write_text(urdf.replace("</robot>", f"{ahead}</robot>"))
    run(tmp_path, str(tmp_path / "new.urdf"))
    experiment = ExperimentLibrary(CONFIG).load(str(tmp_path / "vehicle"), "assisted")
    assert experiment.vehicle.wheels["fl_joint"].x == pytest.approx(0.5)
    assert experiment.vehicle.chassis_x == pytest.approx(0.3)
    assert experiment.vehicle.chassis_length == 0.5
    assert experiment.sensors["front"].x == pytest.approx(0.3 + 0.35 * 0.5)
    assert experiment.brake_assist.imu_x == pytest.approx(0.4)
    assert experiment.brake_assist.imu_rotation_deg == (0.0, 0.0, 90.0)
    run(tmp_path / "heavy", str(tmp_path / "new.urdf"), mass=30.0, load=3.0)
    heavy = ExperimentLibrary(CONFIG).load(str(tmp_path / "heavy/vehicle"), "assisted").vehicle
    assert heavy.body.x == pytest.approx(0.3)  # the middle of the chassis
    assert heavy.load.x == pytest.approx(0.3 + 0.3 * 0.5)


def test_what_is_missing_is_asked_for_and_may_be_given(tmp_path: Path) -> None:
    lacking = r"<inertial>.*?</inertial>|<collision>.*?</collision>|<visual>.*?</visual>"
    urdf = re.sub(lacking, "", mecanum_urdf())
    path = tmp_path / "robot.urdf"
    path.write_text(urdf)
    with pytest.raises(
        ConfigurationError, match=r"--mass: is required.*; --wheel-radius: is"
    ) as error:
        run(tmp_path, str(path))
    assert "the axles are 0.05 m above base_footprint: is this the radius" in str(error.value)
    assert "contains no plausible mass" in str(error.value)
    document = run(tmp_path, str(path), mass=15.0, wheel_radius=0.05, length=0.6, width=0.4)
    assert not any("what does the robot weigh?" in one for one in document["missing"])
    vehicle = ExperimentLibrary(CONFIG).load(str(tmp_path / "vehicle"), "assisted").vehicle
    assert vehicle.body.mass == 15.0
    assert {mount.radius for mount in vehicle.wheels.values()} == {0.05}
    assert (vehicle.chassis_length, vehicle.chassis_width) == (0.6, 0.4)


def test_a_controller_alone_gives_the_wheels(tmp_path: Path) -> None:
    (tmp_path / "drive.yaml").write_text(CONTROLLER)
    run(tmp_path, str(tmp_path / "drive.yaml"), mass=12.0)
    assert "roller directions" in (tmp_path / "vehicle/vehicle.yaml").read_text()
    vehicle = ExperimentLibrary(CONFIG).load(str(tmp_path / "vehicle"), "assisted").vehicle
    assert vehicle.wheels["rl_joint"].x == -0.2


def test_a_folder_that_exists_is_refused(tmp_path: Path) -> None:
    (tmp_path / "vehicle").mkdir()
    (tmp_path / "vehicle/notes.txt").write_text("mine")
    with pytest.raises(ConfigurationError, match="exists and is not an empty folder"):
        run(tmp_path, "robot.urdf")


def test_xacro_finds_packages_beside_the_file(tmp_path: Path) -> None:
    main = write_packages(tmp_path / "src")
    found = described_vehicle([str(main), "track:=0.3"])
    assert set(found.wheels) == {f"{name}_joint" for name in ("fl", "fr", "rl", "rr")}
    assert found.wheels["fl_joint"]["y"] == 0.15
    wide = described_vehicle([str(main), "track:=0.5"])
    assert wide.wheels["fl_joint"]["y"] == 0.25
    with pytest.raises(ConfigurationError, match="uses no argument trak; did you mean 'track'"):
        described_vehicle([str(main), "trak:=0.5"])


def test_folders_around_a_file_may_disappear(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    main, scan = write_packages(tmp_path / "src"), os.scandir
    (tmp_path / "src/gone").mkdir()

    def scan_again(path: Any = ".") -> Any:
        if str(path).endswith("gone"):
            raise FileNotFoundError(path)
        return scan(path)

    monkeypatch.setattr(os, "scandir", scan_again)
    assert len(described_vehicle([str(main)]).wheels) == 4


def test_xacro_finds_files_that_a_package_installs_elsewhere(tmp_path: Path) -> None:
    main = write_packages(tmp_path / "src")
    package = tmp_path / "src/wheels_description"
    (package / "description").mkdir()
    (package / "urdf").rename(package / "description/urdf")
    assert len(described_vehicle([str(main)]).wheels) == 4
    values = "${xacro.load_yaml('$(find wheels_description)/config/lost.yaml')['track']}"
    main.write_text(main.read_text().replace("$(arg track)", values))
    with pytest.raises(ConfigurationError, match=r"lacks the file .*/lost\.yaml; on the robot"):
        described_vehicle([str(main)])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("find wheels_description", "find other_package"), "the package other_package is not in"),
        (("wheel.xacro", "lost.xacro"), "lacks the file .*/lost.xacro; on the robot"),
        (("${track / 2}", "${trak / 2}"), "the property trak is not defined"),
        (('<xacro:arg name="track" default="0.3"/>', ""), "track has no value; give track:=VALUE"),
        (("${track / 2}", "$(arg a)$(arg b)"), "argument a has no value; give a:=VALUE b:=VALUE;"),
        (("<xacro:wheel", "<xacro:whel"), "unknown macro name: xacro:whel"),
        (
            ("</robot>", '<xacro:include filename="robot.urdf.xacro"/></robot>'),
            "calls itself without end; on the robot",
        ),
        (("<xacro:wheel", "<xacro:wheel<"), "is not valid XML"),
        (
            ("<link", '<property name="a" value="1"/><link size="${a}"'),
            "a is not defined .* write <x",
        ),
        (("<link", '<macro name="b" params="c d"/><xacro:b/><link'), "unknown .*b; .* write <x"),
        (("<link", '<include filename="b.xacro"/><xacro:b/><link'), "unknown .*b; .* write <x"),
        (("${track / 2}", "${(lambda: 0).__globals__}"), "repeat the command with --trust"),
        (
            ("${track / 2}", "${(x for x in [1]).gi_frame.f_back}"),
            "repeat the command with --trust",
        ),
        (("${track / 2}", "${python.vars(python)}"), "vars"),
        (("${track / 2}", "$(eval track.gi_frame)"), "repeat the command with --trust"),
    ],
)
def test_what_a_xacro_file_lacks_is_named(
    change: tuple[str, str], words: str, tmp_path: Path
) -> None:
    main = write_packages(tmp_path / "src")
    text = main.read_text()
    assert change[0] in text
    main.write_text(text.replace(*change))
    with pytest.raises(ConfigurationError, match=words) as error:
        described_vehicle([str(main)])
    assert "\n" not in str(error.value)


def test_an_argument_of_a_macro_in_another_file_is_asked_for(tmp_path: Path) -> None:
    main = write_packages(tmp_path / "src")
    (main.parent / "mast.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="mast">'
        '<link name="$(arg mast)"/></xacro:macro></robot>'
    )
    call = '<xacro:include filename="mast.xacro"/><xacro:mast/></robot>'
    main.write_text(main.read_text().replace("</robot>", call))
    with pytest.raises(ConfigurationError, match="mast has no value; give mast:=VALUE;"):
        described_vehicle([str(main)])


def test_a_missing_package_can_be_left_out(tmp_path: Path) -> None:
    main = write_packages(tmp_path / "src")
    include = '<xacro:include filename="$(find lidar_description)/lidar.xacro" ns="lidar"/>'
    call = '<xacro:lidar.sensor parent="base_link"><origin xyz="0 0 0"/></xacro:lidar.sensor>'
    main.write_text(main.read_text().replace("</robot>", f"{include}{call}</robot>"))
    with pytest.raises(ConfigurationError, match=r"lidar_description.*--skip-missing"):
        described_vehicle([str(main)])
    found = described_vehicle([str(main)], skip_missing=True)
    assert len(found.wheels) == 4
    assert any("lidar_description is left out" in one for one in found.questions)
    text = main.read_text()
    main.write_text(text.replace("</robot>", '<link name="${lidar_name}"/></robot>'))
    with pytest.raises(ConfigurationError, match=r"lidar_name .* left out: lidar_description"):
        described_vehicle([str(main)], skip_missing=True)
    main.write_text(text)
    held = "".join(  # more links than the vehicle has
        joint(name, "lidar_mount", name, "0 0 1", kind="fixed") + link(name, mass=1.0)
        for name in map("mast_{}".format, range(8))
    )
    main.write_text(main.read_text().replace("</robot>", f"{held}</robot>"))
    assert described_vehicle([str(main)], skip_missing=True).values == found.values
    folder = '<xacro:arg name="meshes" default="$(find robot_meshes)/meshes"/>'
    main.write_text(main.read_text().replace("</robot>", f"{folder}</robot>"))
    found = described_vehicle([str(main)], skip_missing=True)
    assert any("robot_meshes is left out" in one for one in found.questions)


def test_python_of_a_trusted_file_is_evaluated(tmp_path: Path) -> None:
    main = write_packages(tmp_path / "src")
    text = main.read_text().replace("${track / 2}", "${0.15 * (1.0).__abs__()}")
    main.write_text(text)
    with pytest.raises(ConfigurationError, match="--trust"):
        described_vehicle([str(main)])
    # xacro itself refuses some names with underscores in any case.
    with pytest.raises(ConfigurationError, match="__abs__"):
        described_vehicle([str(main)], trust=True)
    main.write_text(text.replace("(1.0).__abs__()", "(lambda: (1.0).__abs__())()"))
    assert described_vehicle([str(main)], trust=True).wheels["fl_joint"]["y"] == 0.15
