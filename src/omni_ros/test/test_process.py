"""A node as a process: an invalid configuration gives one sentence and exit code 2."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from omni_ros.environment import name_log_folder

PROGRAM = """
import sys
from rclpy.node import Node
from omni_ros.process import run_process
sys.exit(run_process(lambda: Node("idle"), lambda node, spinner: print("ran")))
"""
HANGING = """
import os, signal, sys, time
from omni_ros.process import run_process

def make_node():
    os.kill(os.getpid(), signal.SIGTERM)
    print("signaled", flush=True)
    time.sleep(1e6)

sys.exit(run_process(make_node, lambda node, spinner: None))
"""
TIMEOUT = 60.0  # [s] only ends a process that hangs


def start(
    arguments: list[str], domain: str = "", program: str = PROGRAM
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )


def test_a_construction_that_hangs_ends_after_a_signal() -> None:
    finished = start([], program=HANGING)
    assert (finished.returncode, finished.stdout, finished.stderr) == (0, "signaled\n", "")


def test_without_arguments_it_runs() -> None:
    finished = start([])
    assert (finished.returncode, finished.stdout) == (0, "ran\n"), finished.stderr


@pytest.mark.parametrize("home", [None, "", "/dev/null"])
def test_without_a_usable_home_it_runs(home: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.delenv(name, raising=False)
    if home is not None:
        monkeypatch.setenv("HOME", home)
    test_without_arguments_it_runs()


def test_a_log_folder_that_the_user_has_named_is_kept() -> None:
    variables = {"ROS_LOG_DIR": "/dev/null/log"}
    name_log_folder(variables)
    assert variables == {"ROS_LOG_DIR": "/dev/null/log"}


@pytest.mark.parametrize(
    ("arguments", "domain", "words"),
    [
        (["--ros-args", "--params-file", "missing.yaml"], "", "missing.yaml"),
        (["--ros-args", "--params-file", "broken.yaml"], "", "broken.yaml"),
        (["--ros-args", "--nonsense"], "", "--nonsense"),
        (["--ros-args", "-r", "nonsense"], "", "-r nonsense"),
        (["-p", "speed:=1.0"], "", "-p speed:=1.0; put arguments for ROS after --ros-args"),
        (["--ros-args", "-p", "speed:=1.0"], "", "speed: is not a parameter of idle"),
        (["--ros-args", "-p", "use_sim_time:=3"], "", "use_sim_time"),
        ([], "abc", "ROS_DOMAIN_ID: 'abc'"),
        ([], "999", "ROS_DOMAIN_ID: '999'"),
    ],
)
def test_a_bad_start_is_one_sentence(
    arguments: list[str],
    domain: str,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.yaml").write_text("idle: [\n")
    finished = start(arguments, domain)
    assert finished.returncode == 2
    assert words in finished.stderr
    assert len(finished.stderr.strip().splitlines()) == 1
    assert not finished.stdout


def test_an_invalid_name_is_one_sentence() -> None:
    publisher = "Node('idle').create_publisher(Empty, 'a b', 1)"
    program = PROGRAM.replace('Node("idle")', publisher)
    finished = start([], program=f"from std_msgs.msg import Empty\n{program}")
    assert finished.returncode == 2
    assert "'a b'" in finished.stderr
    assert len(finished.stderr.strip().splitlines()) == 1
