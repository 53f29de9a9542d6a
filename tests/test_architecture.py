"""The arrows between the packages point one way, and the cores know no ROS."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from omni_process import WORKSPACE

# What each package may import of the others.
MAY_USE = {
    "omni_platform": set[str](),
    "omni_ros": {"omni_platform"},
    "omni_sim": {"omni_platform", "omni_ros"},
    "linescan_odometry": {"omni_platform", "omni_ros"},
    "omni_brake_assist": {"omni_platform", "omni_ros"},
    "omni_recording": {"omni_platform", "omni_ros"},
    "omni_analysis": {
        "omni_platform",
        "omni_sim",
        "linescan_odometry",
        "omni_brake_assist",
        "omni_recording",
    },
    "omni_bringup": {
        "omni_platform",
        "omni_ros",
        "omni_sim",
        "linescan_odometry",
        "omni_brake_assist",
        "omni_recording",
        "omni_analysis",
    },
}


def modules() -> list[Path]:
    return [
        path for name in MAY_USE for path in sorted((WORKSPACE / "src" / name / name).rglob("*.py"))
    ]


def imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


def package_of(path: Path) -> str:
    return path.relative_to(WORKSPACE / "src").parts[0]


def name_of(path: Path) -> str:
    return path.relative_to(WORKSPACE / "src").with_suffix("").as_posix()


def knows_ros(path: Path) -> bool:
    package = package_of(path)
    return package == "omni_ros" or path.name.endswith("_node.py") or path.name == "messages.py"


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_imports_follow_the_arrows(path: Path) -> None:
    package = package_of(path)
    own = set(imported(path)) & set(MAY_USE) - {package}
    assert own <= MAY_USE[package]
    if not knows_ros(path) and package not in {"omni_bringup", "omni_recording", "omni_ros"}:
        assert "omni_ros" not in own, "only a node may need what the nodes share of ROS"


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_cores_know_no_ros_and_no_clock(path: Path) -> None:
    if knows_ros(path):
        return
    ros = {name for name in imported(path) if name == "rclpy" or name.endswith("_msgs")}
    assert not ros
    # Measuring what a simulation costs takes a clock.
    if package_of(path) != "omni_bringup" and path.stem != "cost":
        assert not {"time", "datetime", "logging"} & set(imported(path))


def test_every_package_is_listed() -> None:
    assert {path.parent.name for path in (WORKSPACE / "src").glob("*/package.xml")} == set(MAY_USE)
