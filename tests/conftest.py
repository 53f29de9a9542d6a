"""Fixtures for runs over the graph, which several tests share."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from omni_process import WORKSPACE, omni_here

from omni_runs.experiment import ExperimentLibrary


@dataclasses.dataclass(frozen=True)
class FinishedRun:
    """Output and files of a finished ``omni run --json``."""

    folder: Path
    metrics: dict[str, Any]

    def value(self, metric: str) -> float:
        """Return the value of a metric such as ``orientation_change.assisted``."""
        return float(self.metrics[metric]["value"])


# A shell that starts the tests in the background has its children ignore Ctrl-C, and so would
# every process that the tests start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

RunExperiment = Callable[..., FinishedRun]


@pytest.fixture(scope="session", autouse=True)
def _kernels() -> None:
    """Compile changed kernels before the tests, whose timeouts for nodes do not include this."""
    cache = Path(os.environ["NUMBA_CACHE_DIR"])
    modules = WORKSPACE.glob("src/*/*/**/*.py")
    changed = max(module.stat().st_ctime for module in modules)
    with (cache / "compiled").open("a") as stamp:
        fcntl.flock(stamp, fcntl.LOCK_EX)
        if not stamp.tell() or os.fstat(stamp.fileno()).st_mtime < changed:
            command = [sys.executable, "-m", "omni_bringup.warm_up", "--all"]
            subprocess.run(command, check=True)
            stamp.write("\n")


@pytest.fixture(scope="session")
def run_experiment(tmp_path_factory: pytest.TempPathFactory) -> RunExperiment:
    """Run an experiment over the graph and return its results."""

    def run(*arguments: str) -> FinishedRun:
        folder = tmp_path_factory.mktemp("runs") / "run"
        finished = omni_here(["run", *arguments, "--json", "--out", str(folder)])
        assert finished.returncode == 0, finished.stderr
        document = json.loads(finished.stdout)
        return FinishedRun(folder, document["metrics"])

    return run


@pytest.fixture(scope="session")
def library() -> ExperimentLibrary:
    return ExperimentLibrary(WORKSPACE / "config")
