"""The cores install with pip alone, and need neither ROS nor a package that they do not declare."""

from __future__ import annotations

import json
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
# that is let in besides the standard library.
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
    )
    assert looked.returncode == 0, looked.stderr[-2000:]
    assert int(looked.stdout) > 60
