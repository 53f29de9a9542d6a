"""Workspace, the folder whose configuration a command reads and in which it stores results."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.progress_bar import progress_bar

if TYPE_CHECKING:
    from omni_loop.experiment import ExperimentConfiguration, ExperimentLibrary


@dataclass(frozen=True)
class Workspace:
    """Folder with `config`, `bags` and `results`, and the command that is run in this folder.

    Attributes:
        folder: path of the workspace.
        program: name of the command, such as ``omni run``, with which its remarks begin.
    """

    folder: Path
    program: str = "omni"

    @property
    def config(self) -> Path:
        """Folder of the configuration files in this workspace."""
        return self.folder / "config"

    def experiment_library(self) -> ExperimentLibrary:
        """Return the library of experiments and vehicles."""
        from omni_loop.experiment import ExperimentLibrary

        return ExperimentLibrary(self.config)

    def checked_experiments(self) -> ExperimentLibrary:
        """Return a library that reports each implausible value on standard error, but only once."""
        from omni_tools.vehicles.plausibility import RemarkingLibrary

        return RemarkingLibrary(self.config, self.note)

    def check(self, experiments: Iterable[ExperimentConfiguration]) -> None:
        """Report each implausible value in the experiments on standard error, but only once."""
        from omni_tools.vehicles.plausibility import remarks

        for remark in dict.fromkeys(words for one in experiments for words in remarks(one)):
            self.note(remark)

    def note(self, remark: str) -> None:
        """Print a remark on standard error."""
        print(f"{self.program}: note: {remark}", file=sys.stderr)

    def results(self, out: Path | None, *parts: str) -> Path:
        """Return the folder `out` for results; if it is None, a folder below ``results``."""
        return out or self.folder.joinpath("results", *parts)

    def progress(self) -> AbstractContextManager[Callable[[float, str], None]]:
        """Return a context manager that shows a progress bar, named after the command."""
        return progress_bar(self.program.split()[-1])


def workspace_folder() -> Path:
    """Return the workspace that the launcher has set; without the launcher, the current folder."""
    return Path(os.environ.get("OMNI_WORKSPACE", "."))
