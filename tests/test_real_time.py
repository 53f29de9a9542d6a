"""In real time no node waits, and late enables mean all brakes on."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from omni_process import disturbed, omni_here, processes_of

from omni_runs.metrics import run_metrics
from omni_runs.recorded_run import read_run

REAL_TIME = ["--variant", "assisted", "--real-time", "--json"]
REAL_TIME += ["--set", "sensors=three_coarse"]  # a busy machine matches these lines in time


def test_the_steps_are_never_ahead_of_the_clock(tmp_path: Path) -> None:
    finished = omni_here(["run", *REAL_TIME, "--out", str(tmp_path / "run")])
    assert finished.returncode == 0, finished.stderr
    metrics = json.loads(finished.stdout)["metrics"]
    assert metrics["real_time_factor.assisted"]["value"] < 1.02
    history = read_run(tmp_path / "run/assisted")
    # The cameras' batches come in any order, yet the odometry brings together those that a busy
    # machine matches; without any, the error would be NaN.
    assert metrics["twist_rmse.assisted"]["value"] < 0.1
    assert np.mean(np.isfinite(history.estimate[:, 0])) > 0.1
    np.testing.assert_allclose(history.twist[-1], 0.0, atol=0.02)


@pytest.mark.safety(
    "brakes act late",
    "the process of the assistant hangs",
    "the valves keep all brakes on; the run ends with an error",
    within="some seconds",
)
def test_a_hung_assistant_puts_all_brakes_on(tmp_path: Path) -> None:
    """The vehicle then brakes without the assistant: it rotates but stops; an error is reported."""
    folder = tmp_path / "run"

    def halt_the_assistant() -> None:
        (assistant,) = processes_of("omni_brake_assist", os.getpid())
        os.kill(assistant, signal.SIGSTOP)

    words = ["run", *REAL_TIME, "--set", "maneuver.brake_time=4", "--out", str(folder)]
    # Some seconds before it brakes, as this process may have to wait for a busy machine.
    ended = disturbed(words, folder, 500_000, halt_the_assistant)
    assert ended is not None
    assert ended.returncode == 1
    # The process group or the simulator, whichever is first, reports the halted node.
    assert re.search("brake_assist (was halted by a signal|published nothing for)", ended.stderr)
    history = read_run(folder / "assisted")
    metrics = run_metrics(history)
    assert metrics["twist_rmse"].value < 0.1  # the other nodes continue
    assert metrics["orientation_change"].value > 25.0
    long_braked = history.stamp_ns > 4_300_000_000
    assert np.all(np.isnan(history.enable[long_braked]))  # no node published anything
    assert np.all(np.abs(history.wheel_speed[long_braked]) < 1e-3)  # and every wheel is locked
