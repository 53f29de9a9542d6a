"""An installation without `omni_studies` runs everything else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from omni_process import WORKSPACE, omni_environment
from test_architecture import MODULES

LEFT_OUT = "omni_studies"
RECORDING = str(WORKSPACE / "bags/small_stop/assisted")
COMMANDS = (
    "replay {bag} --out {out}/replayed", "report {bag} --out {out}/report.html",
    "limit straight_line", "ros-params {bag}/configuration.yaml --out {out}",
    "list --json", "--help", "study table2",
)  # fmt: skip
PROGRAM = """
import importlib, json, sys
from omni_process import omni_here
lines, modules = json.load(sys.stdin)
done = [omni_here(words) for words in lines]
for name in modules:
    importlib.import_module(name)
assert not [name for name in sys.modules if name.startswith("omni_studies")]
print(json.dumps([(one.returncode, one.stdout, one.stderr) for one in done]))
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a command, with the modules and entry points of all other packages."""
    installed = tmp_path_factory.mktemp("installed")
    kept = [str(Path(__file__).parent)]
    for place in filter(None, os.environ["PYTHONPATH"].split(os.pathsep)):
        if WORKSPACE / ".cache/install" in Path(place).parents:
            for entry in Path(place).iterdir():
                if not entry.name.startswith(LEFT_OUT):
                    (installed / entry.name).symlink_to(entry)
        elif Path(place).name != LEFT_OUT:
            kept.append(place)
    return omni_environment() | {"PYTHONPATH": os.pathsep.join((*kept, str(installed)))}


@pytest.fixture(scope="module")
def answers(
    environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[int, str, str]]:
    """Exit code, output and errors of each command, all of one process.

    The process then imports all other modules.
    """
    out = tmp_path_factory.mktemp("out")
    lines = [[word.format(bag=RECORDING, out=out) for word in line.split()] for line in COMMANDS]
    modules = [name for name in MODULES if name.partition(".")[0] != LEFT_OUT]
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM],
        input=json.dumps((lines, modules)),
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    return {line.split()[0]: answer for line, answer in zip(COMMANDS, found, strict=True)}


@pytest.mark.parametrize("command", ["replay", "report", "limit", "ros-params"])
def test_commands_run(answers: dict[str, tuple[int, str, str]], command: str) -> None:
    code, _, errors = answers[command]
    assert code == 0, errors


def test_only_the_studies_are_missing(answers: dict[str, tuple[int, str, str]]) -> None:
    listed = json.loads(answers["list"][1])
    assert listed["studies"] == {}
    assert listed["vehicles"]
    shown = answers["--help"][1]
    assert "\n    run " in shown
    assert "\n    study " not in shown
    assert answers["study"][0] == 2
