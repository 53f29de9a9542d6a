"""Experiments and vehicles of which a command says what does not fit together."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omni_analysis.vehicles.plausibility import RemarkingLibrary


def noting_library(workspace: Path, program: str) -> RemarkingLibrary:
    """Return the files of a workspace; what does not fit together goes to standard error, once.

    Args:
        workspace: holds `config`.
        program: such as ``omni run``, at the beginning of each line.
    """
    from omni_analysis.vehicles.plausibility import RemarkingLibrary

    def say(remark: str) -> None:
        print(f"{program}: note: {remark}", file=sys.stderr)

    return RemarkingLibrary(workspace / "config", say)
