"""Workspace of the commands that read experiments and vehicles."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from omni_core.commands.workspace import Workspace

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary


class ExperimentWorkspace(Workspace):
    """Workspace with a library of experiments and vehicles."""

    def experiment_library(self) -> ExperimentLibrary:
        """Return the library of experiments and vehicles."""
        from omni_runs.experiment import ExperimentLibrary

        return ExperimentLibrary(self.config)

    def checked_experiments(self) -> ExperimentLibrary:
        """Return a library that reports each implausible value on standard error, but only once."""
        from omni_runs.plausibility import RemarkingLibrary

        return RemarkingLibrary(self.config, self.note)

    def check(self, experiments: Iterable[ExperimentConfiguration]) -> None:
        """Report each implausible value in the experiments on standard error, but only once."""
        from omni_runs.plausibility import remarks

        for remark in dict.fromkeys(words for one in experiments for words in remarks(one)):
            self.note(remark)
