"""Robot descriptions in the shapes of public ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

CONTROLLER = """
/**/controller_manager:
  ros__parameters:
    drive: {type: mecanum_drive_controller/MecanumDriveController}
/**/drive:
  ros__parameters:
    front_left_wheel_name: fl_joint
    front_right_wheel_name: fr_joint
    rear_left_wheel_name: rl_joint
    rear_right_wheel_name: rr_joint
    wheel_separation_x: 0.4
    wheel_separation_y: 0.3
    wheel_radius: 0.05
    base_frame_id: base_link
"""
_CORNERS = {"fl": (1, 1), "fr": (1, -1), "rl": (-1, 1), "rr": (-1, -1)}
_NO_AXES: Mapping[str, str] = {}


def joint(
    name: str,
    parent: str,
    child: str,
    xyz: str,
    *,
    rpy: str = "0 0 0",
    axis: str = "0 1 0",
    kind: str = "continuous",
) -> str:
    """Return a joint."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>'
    )


def link(name: str, *, mass: float = 0.0, xyz: str = "0 0 0", inside: str = "") -> str:
    """Return a link; `inside` contains its shapes and moments of inertia."""
    inertia = "" if "<inertia " in inside else '<inertia ixx="0" iyy="0" izz="0"/>'
    moments, _, shapes = inside.rpartition("|")
    inertial = (
        f'<inertial><origin xyz="{xyz}"/><mass value="{mass}"/>{moments or inertia}</inertial>'
    )
    return f'<link name="{name}">{inertial if mass else ""}{shapes}</link>'


def mecanum_urdf(
    *,
    name: str = "{}_joint",
    kind: str = "continuous",
    height: float = 0.05,
    axis: Mapping[str, str] = _NO_AXES,
    extra: str = "",
) -> str:
    """Return a robot on Mecanum wheels: wheelbase 0.4 m, track 0.3 m, radius 0.05 m.

    Args:
        name: name of the joint of a wheel, with {} for its corner.
        kind: type of these joints.
        height: height of the axles above base_footprint [m].
        axis: axes of joints, keyed by corner; (0, 1, 0) for others.
        extra: further elements.
    """
    body = (
        '<inertia ixx="0.1" iyy="0.2" izz="0.3"/>|'
        '<collision><geometry><box size="0.5 0.2 0.1"/></geometry></collision>'
    )
    round_shape = (
        f'<origin rpy="{math.pi / 2} 0 0"/><geometry><cylinder radius="0.05" length="0.04"/>'
        "</geometry>"
    )
    wheel = (
        '<inertia ixx="0.0004" iyy="0.0006" izz="0.001"/>|'
        f"<visual>{round_shape}</visual><collision>{round_shape}</collision>"
    )
    parts = [
        link("base_footprint"),
        joint("base", "base_footprint", "base_link", f"0 0 {height + 0.05}", kind="fixed"),
        link("base_link", mass=10.0, xyz="0.02 0 0.05", inside=body),
        joint("imu_joint", "base_link", "imu_link", "0.1 -0.03 0.02", kind="fixed"),
        link("imu_link"),
    ]
    for corner, (x, y) in _CORNERS.items():
        place = f"{0.2 * x:g} {0.15 * y:g} -0.05"
        turning = axis.get(corner, "0 1 0")
        parts += [
            joint(
                name.format(corner), "base_link", f"{corner}_wheel", place, axis=turning, kind=kind
            ),
            link(f"{corner}_wheel", mass=0.5, inside=wheel),
        ]
    return f'<robot name="robot">{"".join(parts)}{extra}</robot>'


def omni_urdf() -> str:
    """Return a robot on three omni-wheels of meshes at 60, 180 and 300 deg, 0.13 m out."""
    mesh = '<visual><geometry><mesh filename="package://robot/wheel.stl"/></geometry></visual>'
    parts = [link("base_link", mass=2.0, inside=f'<inertia ixx="0" iyy="0" izz="0.02"/>|{mesh}')]
    for name, angle in (("a", 60.0), ("b", 180.0), ("c", 300.0)):
        turn = math.radians(angle)
        place = f"{0.13 * math.cos(turn)} {0.13 * math.sin(turn)} 0"
        rpy = f"0 {math.pi / 2} {turn}"  # the z axis of the link is the axle
        parts += [
            joint(name, "base_link", f"{name}_wheel", place, rpy=rpy, axis="0 0 1"),
            link(f"{name}_wheel", mass=0.1, inside=mesh),
        ]
    return f'<robot name="robot">{"".join(parts)}</robot>'


def write_packages(source: Path) -> Path:
    """Write a robot of two packages of xacro files, and return the main file.

    Args:
        source: folder of the packages.
    """
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"'
    for package in ("robot_description", "wheels_description"):
        (source / package / "urdf").mkdir(parents=True)
        (source / package / "package.xml").write_text(f"<package><name>{package}</name></package>")
    round_shape = (
        '<collision><origin rpy="${pi/2} 0 0"/><geometry>'
        '<cylinder radius="${radius}" length="0.04"/></geometry></collision>'
    )
    (source / "wheels_description/urdf/wheel.xacro").write_text(
        f'{head}><xacro:macro name="wheel" params="name x y radius:=0.05">'
        + joint("${name}_joint", "base_link", "${name}_wheel", "${x} ${y} 0")
        + link("${name}_wheel", mass=0.5, inside=f"|{round_shape}")
        + "</xacro:macro></robot>"
    )
    calls = "".join(
        f'<xacro:wheel name="{corner}" x="{0.2 * x:g}" y="${{{y} * half}}"/>'
        for corner, (x, y) in _CORNERS.items()
    )
    box = '|<collision><geometry><box size="0.5 0.4 0.1"/></geometry></collision>'
    main = source / "robot_description/urdf/robot.urdf.xacro"
    main.write_text(
        f'{head} name="robot"><xacro:arg name="track" default="0.3"/>'
        '<xacro:property name="track" value="$(arg track)"/>'
        '<xacro:property name="half" value="${track / 2}"/>'
        '<xacro:include filename="$(find wheels_description)/urdf/wheel.xacro"/>'
        + link("base_link", mass=10.0, inside=box)
        + calls
        + "</robot>"
    )
    return main
