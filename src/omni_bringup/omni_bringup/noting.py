"""Experiments and vehicles of which a command says what does not fit together."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omni_analysis.loop.experiment import ExperimentConfiguration
    from omni_analysis.vehicles.plausibility import RemarkingLibrary


def noting_library(workspace: Path, program: str) -> RemarkingLibrary:
    """Return the files of a workspace; what does not fit together goes to standard error, once.

    Args:
        workspace: holds `config`.
        program: such as ``omni run``, at the beginning of each line.
    """
    from omni_analysis.vehicles.plausibility import RemarkingLibrary

    return RemarkingLibrary(workspace / "config", lambda remark: _say(program, remark))


def say_notes(experiments: Iterable[ExperimentConfiguration], program: str) -> None:
    """Say what does not fit together in experiments, each remark once."""
    from omni_analysis.vehicles.plausibility import remarks

    for remark in dict.fromkeys(words for one in experiments for words in remarks(one)):
        _say(program, remark)


def _say(program: str, remark: str) -> None:
    print(f"{program}: note: {remark}", file=sys.stderr)
