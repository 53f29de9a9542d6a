"""The kinematics of published controllers is ours, is read from every name, and is written back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import published_controllers as published
import pytest
import yaml

from omni_core.configuration import ConfigurationError
from omni_core.kinematics import PlatformKinematics
from omni_core.pose import PoseIntegrator
from omni_core.quantities import FloatArray
from omni_tools.robot_files.controllers import (
    MECANUM,
    OMNI,
    Controller,
    controller_file,
    controller_of,
    read_controllers,
)

TWISTS = np.random.default_rng(1).uniform(-2.0, 2.0, (20, 3))
NAMES = {corner: f"{corner}_wheel_joint" for corner in ("front_left", "front_right")}
NAMES |= {corner: f"{corner}_wheel_joint" for corner in ("rear_right", "rear_left")}


def assert_equal(ours: FloatArray, theirs: FloatArray) -> None:
    """Require equality up to the rounding of a double in sums of some tens of terms."""
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def mecanum(offset: tuple[float, float, float]) -> Controller:
    return Controller("m", MECANUM, NAMES, 0.05, wheelbase=0.4, track=0.3, offset=offset)


def omni(count: int, angle: float) -> Controller:
    joints = {str(row): f"wheel_{row}" for row in range(count)}
    return Controller("o", OMNI, joints, 0.04, robot_radius=0.2, wheel_offset=angle)


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.1, -0.05, 0.0), (0.2, 0.1, 0.7)])
def test_speeds_and_twists_of_the_mecanum_controller_are_ours(
    offset: tuple[float, float, float],
) -> None:
    wheels = mecanum(offset).wheels()
    assert wheels is not None
    assert tuple(wheels) == tuple(NAMES.values())
    ours = PlatformKinematics(wheels)
    for twist in TWISTS:
        speeds = published.mecanum_speeds(twist, 0.05, 0.35, offset)
        assert_equal(ours.wheel_speeds(twist), speeds)
        assert_equal(published.mecanum_twist(speeds, 0.05, 0.35, offset), twist)
        assert_equal(ours.twist(speeds), twist)


@pytest.mark.parametrize(
    ("count", "angle"), [(3, 0.0), (3, math.pi / 3), (4, math.pi / 4), (6, 0.0)]
)
def test_speeds_and_twists_of_the_omni_controller_are_ours(count: int, angle: float) -> None:
    wheels = omni(count, angle).wheels()
    assert wheels is not None
    ours = PlatformKinematics(wheels)
    for twist in TWISTS:
        speeds = published.omni_speeds(twist, count, 0.04, 0.2, angle)
        assert_equal(ours.wheel_speeds(twist), speeds)
        slipping = speeds + TWISTS[0, 0] * np.arange(count)
        assert_equal(ours.twist(slipping), published.omni_twist(slipping, 0.04, 0.2, angle))


def test_the_published_odometry_becomes_ours_with_shorter_periods() -> None:
    twist, covariance, away = np.array((0.8, -0.3, 0.9)), np.zeros((3, 3)), []
    for steps in (500, 1000):
        pose, ours = np.zeros(3), PoseIntegrator()
        ours.update(0, twist, covariance)
        for step in range(1, steps + 1):
            pose = published.mecanum_pose(pose, twist, 1.0 / steps)
            value = ours.update(step * 10**9 // steps, twist, covariance).value
        away.append(float(np.linalg.norm(pose[:2] - value[:2])))
        assert pose[2] == pytest.approx(value[2], abs=1e-9)
    # It turns before it moves, which is an error of first order.
    assert away[0] == pytest.approx(2.0 * away[1], rel=1e-2)
    assert away[1] < 1e-3


@pytest.mark.parametrize(
    "controller",
    [mecanum((0.0, 0.0, 0.0)), mecanum((0.1, -0.05, 0.0)), omni(3, math.pi / 3), omni(4, 0.0)],
)
def test_what_is_written_is_read_again(controller: Controller, tmp_path: Path) -> None:
    wheels = controller.wheels()
    assert wheels is not None
    found = controller_of(wheels)
    assert found is not None
    path = tmp_path / "controller.yaml"
    path.write_text(controller_file(found))
    (again,) = read_controllers(path)
    assert again.kind == controller.kind
    assert again.joints == dict(controller.joints)
    assert again.radius == controller.radius
    assert again.offset == pytest.approx(controller.offset)
    assert again.lever == pytest.approx(controller.lever)
    assert again.robot_radius == pytest.approx(controller.robot_radius)
    assert again.wheel_offset == pytest.approx(controller.wheel_offset)


def test_no_controller_is_written_that_moves_the_wheels_otherwise() -> None:
    wheels = mecanum((0.0, 0.0, 0.0)).wheels()
    assert wheels is not None
    first, *others = wheels
    assert controller_of({name: wheels[name] for name in others}) is None
    moved = dict(wheels)
    moved[first] = wheels[others[0]]
    assert controller_of(moved) is None


PUBLISHED = """
/**:
  controller_manager:
    ros__parameters:
      drive: {type: mecanum_drive_controller/MecanumDriveController}
      arm: {type: joint_trajectory_controller/JointTrajectoryController}
  arm: {ros__parameters: {joints: [a, b]}}
  drive:
    ros__parameters:
      front_left_wheel_command_joint_name: fl
      front_right_wheel_command_joint_name: fr
      rear_right_wheel_command_joint_name: rr
      rear_left_wheel_command_joint_name: rl
      front_left_wheel_state_joint_name: other
      kinematics:
        base_frame_offset: {x: 0.1, y: 0.0, theta: 0.0}
        wheels_radius: "0.05"
        sum_of_robot_center_projection_on_X_Y_axis: 0.35
      base_frame_id: base_link
"""
FLAT = """
/robot1/drive:
  ros__parameters:
    front_left_wheel_command_joint_name: fl
    front_right_wheel_command_joint_name: fr
    rear_right_wheel_command_joint_name: rr
    rear_left_wheel_command_joint_name: rl
    kinematics.wheels_radius: 5e-2
    kinematics.sum_of_robot_center_projection_on_X_Y_axis: 0.35
    kinematics.base_frame_offset.x: 0.1
"""
OTHER_NAMES = """
/**/drive:
  ros__parameters:
    front_left_wheel_name: fl
    front_right_wheel_name: fr
    rear_right_wheel_name: rr
    rear_left_wheel_name: rl
    wheel_separation_x: 0.4
    wheel_separation_y: 0.15
    wheel_separation_y_multiplier: 2.0
    wheel_radius: 0.025
    wheel_radius_multiplier: 2.0
"""
OLDER_NAMES = """
drive:
  ros__parameters:
    front_left_joint_name: fl
    front_right_joint_name: fr
    back_right_joint_name: rr
    back_left_joint_name: rl
    wheel_base: 0.4
    wheel_separation: 0.3
    wheel_radius: 0.05
    back_left_wheel_radius_multiplier: 1.1
"""


COMMON_FACTORS = FLAT.replace("5e-2", "0.04").replace("0.35", "0.25") + (
    "    wheel_radius_multiplier: 1.25\n    wheel_separation_multiplier: 1.4\n"
)
ROS_1 = """
drive:
  type: "mecanum_drive_controller/MecanumDriveController"
  front_left_wheel_joint: fl
  back_left_wheel_joint: rl
  front_right_wheel_joint: fr
  back_right_wheel_joint: rr
  wheel_separation_x: 0.2
  wheel_separation_y: 0.15
  wheel_separation_multiplier: 2.0
  wheel_radius: 0.05
  linear: {x: {max_velocity: 1.1}}
ekf: {frequency: 50, odom0: /drive/odom}
"""
LEFT_FRONT = """
drive:
  ros__parameters:
    type: omni_drive_controller/OmniDriveController
    left_front_wheel: fl
    left_back_wheel: rl
    right_front_wheel: fr
    right_back_wheel: rr
    axis_separation: 0.4
    wheel_separation: 0.3
    wheel_radius: 0.05
"""


@pytest.mark.parametrize(
    "text", [PUBLISHED, FLAT, OTHER_NAMES, OLDER_NAMES, COMMON_FACTORS, ROS_1, LEFT_FRONT]
)
def test_parameters_of_any_release_are_read(text: str, tmp_path: Path) -> None:
    path = tmp_path / "controllers.yaml"
    path.write_text(text)
    (controller,) = read_controllers(path)
    assert controller.kind == MECANUM
    corners = ("front_left", "front_right", "rear_right", "rear_left")
    assert controller.joints == dict(zip(corners, ("fl", "fr", "rr", "rl"), strict=True))
    assert controller.radius == pytest.approx(0.05)
    assert controller.lever == pytest.approx(0.35)
    assert controller.offset[0] == (0.1 if "base_frame_offset" in text else 0.0)
    wheels = controller.wheels()
    assert (wheels is None) == ("sum_of" in text)
    if text is OLDER_NAMES:
        assert wheels is not None
        assert wheels["rl"].radius == pytest.approx(0.055)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("0.35", "wide"),
            "sum_of_robot_center_projection_on_X_Y_axis is 'wide', must be a number",
        ),
        (('"0.05"', "0.0"), "wheels_radius is 0 m, not above 0"),
        (("x: 0.1", "x: 100"), r"base_frame_offset\.x is 100 m, more than 10 m; give meters"),
        (("theta: 0.0", "theta: 45"), "theta is 45 rad, more than 6.28 rad; give radians"),
        (('"0.05"', "true"), "wheels_radius is True, must be a number"),
        (("/**:", "{"), "is not valid YAML"),
    ],
)
def test_a_wrong_parameter_is_named(change: tuple[str, str], words: str, tmp_path: Path) -> None:
    path = tmp_path / "controllers.yaml"
    path.write_text(PUBLISHED.replace(*change))
    with pytest.raises(ConfigurationError, match=words):
        read_controllers(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("wheel_offset: 30", "wheel_offset is 30 rad, more than 6.28 rad; give radians"),
        ("wheel_radius: 0.0", "wheel_radius is 0 m, not above 0"),
    ],
)
def test_a_wrong_size_of_omni_wheels_is_named(change: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "controllers.yaml"
    given = {"wheel_radius": 0.05, "robot_radius": 0.2, "wheel_names": ["a", "b", "c"]}
    given |= yaml.safe_load(change)
    path.write_text(yaml.safe_dump({"base": {"ros__parameters": given}}))
    with pytest.raises(ConfigurationError, match=words):
        read_controllers(path)


def test_two_sections_of_a_file_describe_one_controller(tmp_path: Path) -> None:
    path = tmp_path / "controllers.yaml"
    path.write_text(f"{PUBLISHED}drive: {{ros__parameters: {{reference_timeout: 0.5}}}}\n")
    (controller,) = read_controllers(path)
    assert controller.radius == 0.05
    path.write_text(
        f"{PUBLISHED}robot2/drive: {{ros__parameters: {{kinematics.wheels_radius: 1}}}}"
    )
    assert len(read_controllers(path)) == 2


def test_other_nodes_are_no_drive_controllers(tmp_path: Path) -> None:
    path = tmp_path / "nav2.yaml"
    tree = {"amcl": {"ros__parameters": {"alpha1": 0.2}}, "joint_state_broadcaster": {}}
    path.write_text(yaml.safe_dump(tree))
    assert read_controllers(path) == []
    path.write_text("ros__parameters: {alpha1: 0.2}")  # the name of the node is missing
    assert read_controllers(path) == []
    corners = ("front_left", "front_right", "rear_left", "rear_right")
    forks = {f"{corner}_steering": {"joint": f"{corner}_fork"} for corner in corners}
    path.write_text(yaml.safe_dump({"robot": forks}))
    assert read_controllers(path) == []
