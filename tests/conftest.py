"""Real runs over the graph, shared by the tests that look at them."""

from __future__ import annotations

import dataclasses
import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from omni_process import WORKSPACE, omni

from omni_analysis.loop.experiment import ExperimentLibrary


@dataclasses.dataclass(frozen=True)
class FinishedRun:
    """What a finished ``omni run --json`` left behind."""

    folder: Path
    metrics: dict[str, Any]

    def value(self, metric: str) -> float:
        """Return the value of a metric such as ``orientation_change.assisted``."""
        return float(self.metrics[metric]["value"])


# A shell that starts the tests in the background has its children ignore Ctrl-C, and so would
# every process that the tests start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

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
    """The standard experiment, without and with the assistant."""
    variants = ("--variant", "unassisted", "--variant", "assisted")
    return run_experiment("straight_line", *variants)


@pytest.fixture(scope="session")
def library() -> ExperimentLibrary:
    return ExperimentLibrary(WORKSPACE / "config")
