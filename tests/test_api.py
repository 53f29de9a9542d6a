"""docs/api.md names existing objects, and its program runs with the cores alone."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from omni_process import RUN_TIMEOUT, WORKSPACE, omni_environment

from omni_tools.vehicles.estimates import Measured, write_vehicle

PAGE = (WORKSPACE / "docs" / "api.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^\| \[`([\w.]+)`\]\(\.\./(.+)\) \|.*\|$", PAGE, re.MULTILINE)
# Packages that the pip command of docs/extending.md does not install.
OTHERS = ("omni_runs", "omni_tools", "omni_studies", "omni_bringup",
          "omni_recording", "omni_vehicle", "omni_ros", "rclpy")  # fmt: skip


@pytest.mark.parametrize(("name", "file"), ENTRIES)
def test_an_entry_is_an_object_of_its_file(name: str, file: str) -> None:
    module_name = ".".join(Path(file).with_suffix("").parts[2:])
    module = importlib.import_module(module_name)
    assert module.__file__ == str(WORKSPACE / file)
    if name != module_name:
        found = getattr(module, name.removeprefix(f"{module_name}."))
        assert found.__module__ == module_name
        assert found.__doc__


def test_the_page_lists_what_its_program_imports() -> None:
    (program,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    imports = re.findall(r"^from (\S+) import (.+)$", program, re.MULTILINE)
    names = {name for name, _ in ENTRIES}
    for module, objects in imports:
        for name in objects.split(", "):
            assert {module, f"{module}.{name}"} & names, name


def test_the_program_of_the_page_stops_a_vehicle_with_the_cores_alone(tmp_path: Path) -> None:
    measured = Measured(length=0.58, width=0.38, mass=30.0, wheel_radius=0.05, load=8.0)
    write_vehicle("my_robot", measured, tmp_path / "my_robot")
    (program,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    others = f"import sys\nsys.modules.update(dict.fromkeys({OTHERS}))\n"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-"],
        input=others + program,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT,
        check=False,
        env=omni_environment(),
    )
    assert done.returncode == 0, done.stderr
    unassisted, assisted = (
        abs(float(angle)) for angle in re.findall(r"yaw: (\S+) deg", done.stdout)
    )
    assert assisted < 0.3 * unassisted
