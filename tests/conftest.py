"""Real runs over the graph, shared by the tests that look at them."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from omni_analysis.experiment import ExperimentLibrary

WORKSPACE = Path(__file__).resolve().parents[1]
RUN_TIMEOUT = 240.0  # [s] a run takes seconds; this only ends one that hangs


@dataclasses.dataclass(frozen=True)
class FinishedRun:
    """What a finished ``omni run --json`` left behind."""

    folder: Path
    metrics: dict[str, Any]

    def value(self, metric: str) -> float:
        """Return the value of a metric such as ``orientation_change.assisted``."""
        return float(self.metrics[metric]["value"])


def omni(arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end, as the launcher would."""
    return subprocess.run(
        omni_command(arguments),
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT,
        check=False,
        env=omni_environment(),
    )


def omni_command(arguments: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "omni_bringup.cli", *arguments]


def omni_environment() -> dict[str, str]:
    return {**os.environ, "OMNI_WORKSPACE": str(WORKSPACE)}


RunExperiment = Callable[..., FinishedRun]


@pytest.fixture(scope="session")
def run_experiment(tmp_path_factory: pytest.TempPathFactory) -> RunExperiment:
    """Run an experiment over the graph and return what it left."""

    def run(*arguments: str) -> FinishedRun:
        folder = tmp_path_factory.mktemp("runs") / "run"
        finished = omni(["run", *arguments, "--json", "--out", str(folder)])
        assert finished.returncode == 0, finished.stderr
        document = json.loads(finished.stdout)
        return FinishedRun(folder, document["metrics"])

    return run


@pytest.fixture(scope="session")
def straight_line(run_experiment: RunExperiment) -> FinishedRun:
    """The standard experiment, both variants."""
    return run_experiment("straight_line")


@pytest.fixture(scope="session")
def library() -> ExperimentLibrary:
    return ExperimentLibrary(WORKSPACE / "config")
