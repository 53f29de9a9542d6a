"""An installation without `omni_studies` runs everything else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from omni_process import WORKSPACE, omni_command, omni_environment
from test_architecture import MODULES

LEFT_OUT = "omni_studies"
RECORDING = str(WORKSPACE / "bags/small_stop/assisted")
IMPORTS = """
import importlib, sys
for name in sys.stdin.read().split():
    importlib.import_module(name)
assert not [name for name in sys.modules if name.startswith("omni_studies")]
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a command, with the modules and entry points of all other packages."""
    installed = tmp_path_factory.mktemp("installed")
    kept = []
    for place in filter(None, os.environ["PYTHONPATH"].split(os.pathsep)):
        if WORKSPACE / ".cache/install" in Path(place).parents:
            for entry in Path(place).iterdir():
                if not entry.name.startswith(LEFT_OUT):
                    (installed / entry.name).symlink_to(entry)
        elif Path(place).name != LEFT_OUT:
            kept.append(place)
    return omni_environment() | {"PYTHONPATH": os.pathsep.join((*kept, str(installed)))}


def test_all_other_modules_are_imported(environment: dict[str, str]) -> None:
    names = "\n".join(name for name in MODULES if name.partition(".")[0] != LEFT_OUT)
    command = [sys.executable, "-W", "ignore", "-c", IMPORTS]
    done = subprocess.run(
        command, input=names, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def run(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    """Run a command of the command line."""
    return subprocess.run(
        omni_command(words), env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("line", [
    "replay {} --out {out}", "report {} --out {out}/report.html", "limit straight_line",
    "ros-params {}/configuration.yaml --out {out}",
])  # fmt: skip
def test_commands_run(environment: dict[str, str], tmp_path: Path, line: str) -> None:
    done = run(environment, *(word.format(RECORDING, out=tmp_path) for word in line.split()))
    assert done.returncode == 0, done.stderr


def test_only_the_studies_are_missing(environment: dict[str, str]) -> None:
    listed = json.loads(run(environment, "list", "--json").stdout)
    assert listed["studies"] == {}
    assert listed["vehicles"]
    shown = run(environment, "--help").stdout
    assert "\n    run " in shown
    assert "\n    study " not in shown
    assert run(environment, "study", "table2").returncode == 2
