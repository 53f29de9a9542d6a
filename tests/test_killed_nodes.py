"""If a node is killed or halted in a run, the run reports it and leaves no process behind."""

from __future__ import annotations

import functools
import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest
from omni_process import WORKSPACE


def benchmark() -> Any:
    """Return the benchmark module, which disturbs runs at many more moments."""
    path = WORKSPACE / "benchmarks/killed_nodes.py"
    spec = importlib.util.spec_from_file_location("killed_nodes", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["killed_nodes"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.safety(
    "a run fails without an error",
    "a node is killed, halted or asked to stop",
    "the other nodes detect this, and the run ends with an error of one sentence",
    within="some seconds",
)
@pytest.mark.parametrize(
    ("node", "action", "real_time", "words"),
    [
        ("simulator", "terminate", False, "the simulator was stopped at"),
        ("simulator", "halt", False, "simulator was halted"),
        ("simulator", "resume", False, "simulator was halted by a signal"),
        ("linescan_odometry", "resume", False, "linescan_odometry was halted by a signal"),
        ("linescan_odometry", "kill", True, "linescan_odometry ended (signal 9)"),
    ],
)
def test_no_disturbed_run_ends_without_an_error(
    node: str, action: str, real_time: bool, words: str, tmp_path: Path
) -> None:
    trial = functools.partial(benchmark().trial, real_time=real_time)
    # On a busy machine, a run may end before this process disturbs it.
    found = trial(tmp_path / "run", node, action, 0.1) or trial(tmp_path / "again", node, action, 0)
    assert found is not None
    assert found.returncode == 1
    assert words in found.complaint
