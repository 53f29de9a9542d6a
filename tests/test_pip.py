"""The cores are packages for pip too: they install and work where there is no ROS."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from omni_process import WORKSPACE
from test_packages import imports

CORES = ("omni_platform", "linescan_odometry", "omni_brake_assist", "omni_sim")
ON_PYPI = {"PIL": "pillow"}
EXAMPLE = """
import sys


class NoRos:
    def find_spec(self, name, path=None, target=None):
        first = name.split(".")[0]
        if first in ("rclpy", "omni_ros") or first.endswith("_msgs"):
            raise ImportError(f"{name} belongs to ROS")


sys.meta_path.insert(0, NoRos())

import numpy as np

from linescan_odometry.odometry import LineBatch, LineScanOdometry, OdometryConfiguration
from omni_platform.sensors import LineSensor

small = {"pixels": 64, "length": 0.064, "width": 0.002, "line_rate": 1000.0}
sensors = {
    "left": LineSensor(x=0.0, y=0.2, heading_deg=0.0, **small),
    "right": LineSensor(x=0.0, y=-0.2, heading_deg=0.0, **small),
    "front": LineSensor(x=0.3, y=0.0, heading_deg=90.0, **small),
}
ground = np.random.default_rng(0).integers(0, 255, (400, 64)).astype(float)
ground = sum(np.roll(ground, (i, j), (0, 1)) for i in range(4) for j in range(4)) / 16.0
odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors, flat_field_places=0))
for batch in range(4):
    rows = range(10 * batch, 10 * batch + 10)  # 1 mm per line along x: 1 m/s
    along = np.array([ground[row : row + 64, 20] for row in rows]).astype(np.uint8)
    across = np.array([ground[row] for row in rows]).astype(np.uint8)
    views = {"left": along, "right": along, "front": across}
    stamp_ns = 10_000_000 * (batch + 1)
    estimate = odometry.update({name: LineBatch(stamp_ns, seen) for name, seen in views.items()})
assert estimate.measured, estimate.reason
assert np.all(np.abs(estimate.twist - (1.0, 0.0, 0.0)) < (0.02, 0.5, 0.1)), estimate.twist

import omni_brake_assist.brake_assist
import omni_sim.simulator
"""


def test_cores_work_without_ros_when_pip_installed_them(tmp_path: Path) -> None:
    for core in CORES:
        shutil.copytree(WORKSPACE / "src" / core, tmp_path / core)  # a build leaves files
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = [
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--target",
        str(tmp_path / "site"),
    ]
    subprocess.run([*pip, *offline, *(str(tmp_path / core) for core in CORES)], check=True)
    # Nothing is compiled: the same code as plain Python.
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site"), "NUMBA_DISABLE_JIT": "1"}
    ran = subprocess.run(
        [sys.executable, "-c", EXAMPLE],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("core", CORES)
def test_pip_is_told_what_a_core_imports(core: str) -> None:
    package = WORKSPACE / "src" / core
    (call,) = (
        node
        for node in ast.walk(ast.parse((package / "setup.py").read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setup"
    )
    arguments = {keyword.arg: keyword.value for keyword in call.keywords}
    told = set(ast.literal_eval(arguments["install_requires"]))
    used = set(imports(package)) - set(sys.stdlib_module_names) - {core, "rclpy", "omni_ros"}
    of_ros = {name for name in used if name.endswith(("_msgs", "_interfaces", "_srvs"))}
    assert {ON_PYPI.get(name, name) for name in used - of_ros} == told
