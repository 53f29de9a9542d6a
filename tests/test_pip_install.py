"""The cores install with pip alone, and need neither ROS nor a package that they do not declare."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import Distribution
from pathlib import Path

from omni_process import WORKSPACE

CORES = ("omni_platform", "linescan_odometry", "omni_brake_assist", "omni_sim")
IMPORT_NAMES = {"pillow": "PIL"}

# Imports every module of the cores but nodes and messages; told apart, what they declare is all
# that is let in besides the standard library. Then measures a motion of 1 m/s.
LOOK = """
import importlib, importlib.util, json, pkgutil, sys
cores, allowed = json.loads(sys.argv[1])
class Gate:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        asked = sys._getframe(1)
        while asked and "importlib" in asked.f_code.co_filename:
            asked = asked.f_back
        by = (asked.f_globals.get("__name__") or "").partition(".")[0] if asked else ""
        if by in cores and top not in allowed and top not in sys.stdlib_module_names:
            raise ImportError(f"{by} imports {name}, which it does not declare")
sys.meta_path.insert(0, Gate())
count = 0
for core in cores:
    package = importlib.import_module(core)
    for module in pkgutil.walk_packages(package.__path__, core + "."):
        last = module.name.rpartition(".")[2]
        if not (last.endswith("_node") or last == "messages" or last.startswith("start_")):
            importlib.import_module(module.name)
            count += 1
assert "rclpy" not in sys.modules
print(count)

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
"""


def test_the_cores_install_with_pip_and_import_without_ros(tmp_path: Path) -> None:
    site = tmp_path / "site"
    sources = [tmp_path / "src" / core for core in CORES]
    for core, source in zip(CORES, sources, strict=True):
        ignored = shutil.ignore_patterns("test", "__pycache__", "*.egg-info", "build")
        shutil.copytree(WORKSPACE / "src" / core, source, ignore=ignored)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    words = [*pip, "--no-build-isolation", "--target", str(site), *map(str, sources)]
    installed = subprocess.run(words, capture_output=True, text=True, check=False)
    assert installed.returncode == 0, installed.stderr
    allowed = set(CORES)
    for core in CORES:
        (found,) = (
            one
            for one in Distribution.discover(path=[str(site)])
            if re.sub("[-.]", "_", one.metadata["Name"]) == core
        )
        names = [re.split(r"[ <>=!;\[]", words)[0] for words in found.requires or ()]
        allowed |= {IMPORT_NAMES.get(name, name.replace("-", "_")) for name in names}
    code = f"import sys; sys.path.insert(0, {str(site)!r})\n" + LOOK
    looked = subprocess.run(
        [sys.executable, "-I", "-c", code, json.dumps([CORES, sorted(allowed)])],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},  # the same code as plain Python
    )
    assert looked.returncode == 0, looked.stderr[-2000:]
    assert int(looked.stdout) > 60
