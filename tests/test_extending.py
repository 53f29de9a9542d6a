"""The commands and files of docs/extending.md work as written."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from omni_process import RUN_TIMEOUT, WORKSPACE, omni_command, omni_environment, run_notebook

# What ./omni does once its environment is there.
LAUNCHER = f"""#!/bin/sh
if [ "$1" = exec ]; then shift 2; exec {shlex.quote(sys.executable)} "$@"; fi
exec {shlex.quote(sys.executable)} -m omni_bringup.cli "$@"
"""


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of the page, in which the commands of the page have been run."""
    folder = tmp_path_factory.mktemp("reader")
    (folder / "omni").write_text(LAUNCHER)
    (folder / "omni").chmod(0o755)
    page = (WORKSPACE / "docs/extending.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```(\w+)\n(.*?)```", page, re.DOTALL)
    assert [kind for kind, _ in blocks].count("python") == 3
    for number, (kind, text) in enumerate(blocks):
        if kind == "python":
            (folder / text.splitlines()[0].removeprefix("# ")).write_text(text)
            continue
        if kind == "text":  # its result depends on the load of this machine
            continue
        # A file, since a process in the background would hold a pipe open.
        said = folder / f"block_{number}.log"
        with said.open("w") as log:
            shell = subprocess.Popen(
                ["sh", "-e", "-c", text],
                cwd=folder,
                stdout=log,
                stderr=log,
                env=omni_environment(),
                start_new_session=True,
            )
            try:
                code = shell.wait(RUN_TIMEOUT)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(shell.pid, signal.SIGKILL)
        assert code == 0, f"block {number}: {said.read_text()}"
    return folder


@pytest.mark.parametrize("place", ["its own", "another"])
def test_the_notebook_s_law_beats_the_dissertation_s(place: str, tmp_path: Path) -> None:
    notebook = WORKSPACE / "docs/tutorials/own_law.ipynb"
    # Jupyter starts the kernel of a notebook in the notebook's folder.
    folder = {"its own": notebook.parent, "another": tmp_path}[place]
    text = notebook.read_text(encoding="utf-8")
    assert not any(
        cell.get("outputs") for cell in json.loads(text)["cells"]
    )  # they come when it is run
    done = run_notebook(text, folder)
    assert done.returncode == 0, done.stderr
    distances = {line.split()[0]: float(line.split()[1]) for line in done.stdout.splitlines()}
    assert distances["BestPattern"] < distances["zero"]  # the notebook asserts both numbers


def value(folder: Path, name: str) -> float:
    metrics = json.loads((folder / "summary.json").read_text())["metrics"]
    return float(metrics[name]["value"])


def test_a_law_brakes_in_studies_and_campaigns(followed: Path) -> None:
    study = followed / "braked"
    assisted, unassisted = (
        value(study, f"orientation_change.{variant}") for variant in ("assisted", "unassisted")
    )
    assert assisted < 0.3 * unassisted
    assert value(study, "brake_switchings.assisted") > 0
    assert value(followed / "campaign", "runs.all") == 20
    text = (followed / "campaign/worst_distance_1.yaml").read_text()
    assert "my_law:BrakeTheSpin" in text


def test_an_odometry_is_accepted_over_the_graph(followed: Path) -> None:
    run = followed / "run/assisted"
    assert value(run, "twist_rmse.assisted") < 0.2
    assert value(run, "fail_safe_share.assisted") < 0.05
    configuration = (run / "configuration.yaml").read_text()
    assert "feedback: my_odometry:CorrelationOdometry" in configuration
    assert "law: my_law:BrakeTheSpin" in configuration
    assert (followed / "report.html").stat().st_size > 10_000


def test_a_node_from_outside_answers(followed: Path) -> None:
    run = followed / "external/assisted"
    assert value(run, "brake_switchings.assisted") == 0
    assert value(run, "stopping_time.assisted") > 0.5


def test_output_and_faults_of_a_law_reach_the_screen(tmp_path: Path) -> None:
    (tmp_path / "noisy.py").write_text(
        "class Noisy:\n"
        "    def __init__(self, configuration, geometry):\n"
        "        print('a law is made')\n"
        "    def step(self, motion, error, enable):\n"
        "        print('a step is taken')\n"
        "        raise RuntimeError('lost count')\n"
    )
    short = ["maneuver.brake_time=0.1", "simulation.duration_limit=0.5"]
    plain = ["feedback=velocity_sensor", "simulation.render_lines=false", "maneuver.speed=2"]
    finished = subprocess.run(
        omni_command(
            ["run", "small_stop", "--law", "noisy:Noisy", "--out", "bag", "--json"]
            + [word for value in (*short, *plain) for word in ("--set", value)]
        ),
        cwd=tmp_path,
        env=omni_environment(),
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT,
        check=False,
    )
    assert "a step is taken" in finished.stderr
    assert finished.stderr.count("all brakes are on (shown once)") == 1
    assert "RuntimeError: lost count" in finished.stderr
    assert f'{tmp_path / "noisy.py"}", line 6' in finished.stderr
    document = json.loads(finished.stdout)  # the only output
    assert [path.name for path in (tmp_path / "bag").iterdir() if path.is_dir()] == ["assisted"]
    assert document["name"] == "small_stop"
