"""`ros2 run` and `ros2 launch` start the nodes as the page for a real vehicle describes."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from omni_process import WORKSPACE, omni_here

from omni_runs.graph.domain import reserved_domain

pytestmark = pytest.mark.skipif(
    shutil.which("ros2") is None, reason="no ros2 on the PATH; PyPI and Debian have no ros2cli"
)

EXAMPLE = WORKSPACE / "config/hardware/wheel_twist_agv.yaml"


@pytest.fixture
def environment() -> Iterator[dict[str, str]]:
    with reserved_domain() as domain:
        yield {**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"}


@pytest.fixture(scope="module")
def parameters(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parameters")
    finished = omni_here(["ros-params", str(EXAMPLE), "--out", str(folder)])
    assert finished.returncode == 0, finished.stderr
    return folder


def ros2(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["ros2", *words], env=environment, capture_output=True, text=True, timeout=60.0, check=False
    )


def enabled(environment: dict[str, str], deadline: float) -> str:
    """Return the parameter of the assistant as soon as it runs."""
    words = "param", "get", "/brake_assist", "enabled", "--no-daemon", "--spin-time", "1"
    while time.monotonic() < deadline:
        finished = ros2(environment, *words)
        if finished.returncode == 0 and "value" in finished.stdout:
            return finished.stdout
    pytest.fail(f"no /brake_assist: {finished.stdout} {finished.stderr}")


@pytest.mark.parametrize("way", ["run", "launch"])
def test_the_assistant_starts_and_ends(
    way: str, environment: dict[str, str], parameters: Path
) -> None:
    words = {
        "run": [
            *("run", "omni_brake_assist", "brake_assist", "--ros-args", "--params-file"),
            *(str(parameters / "brake_assist.yaml"), "-p", "enabled:=false"),
        ],
        "launch": ["launch", "omni_bringup", "hardware.launch.py", f"parameters:={parameters}"],
    }[way]
    with subprocess.Popen(
        ["ros2", *words],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            assert "False" in enabled(environment, time.monotonic() + 60.0)
            os.killpg(process.pid, signal.SIGINT)
            said = process.communicate(timeout=60.0)[0]
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    assert "Traceback" not in said
    assert way == "run" or "process started with pid" in said


def test_a_misspelled_launch_argument_is_refused(
    environment: dict[str, str], parameters: Path
) -> None:
    given = f"parameters:={parameters}", "namespac:=robot1"
    finished = ros2(environment, "launch", "omni_bringup", "hardware.launch.py", *given)
    assert finished.returncode == 1
    assert "did you mean 'namespace'" in finished.stdout + finished.stderr


def test_every_executable_of_the_packages_is_found(environment: dict[str, str]) -> None:
    finished = ros2(environment, "pkg", "executables")
    found = set(finished.stdout.splitlines())
    assert {"omni_sim simulator", "linescan_odometry odometry", "omni_vehicle camera"} <= found
