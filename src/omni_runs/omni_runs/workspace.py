"""Workspace of the commands that read experiments and vehicles, and the items that they accept."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from omni_core.commands import commands_of, first_line
from omni_core.commands.workspace import Workspace
from omni_core.plugins import described_modules

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary

KINDS = ("vehicles", "grounds", "sensors", "experiments", "tires")
STUDIES, LAWS = "studies", "laws"
EVERY = (*KINDS, STUDIES, LAWS)


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
        for remark in remarks_on(experiments):
            self.note(remark)


def remarks_on(experiments: Iterable[ExperimentConfiguration]) -> list[str]:
    """Return a remark on each implausible value in the experiments, each only once."""
    from omni_runs.plausibility import remarks  # needs kernels

    return list(dict.fromkeys(words for one in experiments for words in remarks(one)))


def names_of(kind: str, workspace: Path) -> dict[str, str]:
    """Return the descriptions of the items of a kind (one of `EVERY`), keyed by name."""
    if kind == STUDIES:
        return commands_of("omni_studies.studies")
    if kind == LAWS:
        from omni_brake_assist.configuration import LAWS as BUILT_IN

        described = described_modules("omni_brake_assist.laws")
        return {name: first_line(described[name][1]) for name in BUILT_IN}
    files = sorted((workspace / "config" / kind).glob("*.yaml"))
    return {path.stem: first_sentence(path) for path in files}


def first_sentence(path: Path) -> str:
    """Return the first sentence of the comment at the head of a configuration file."""
    words: list[str] = []
    for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines():
        if not line.startswith("#"):
            break
        words.append(line.lstrip("# "))
        if line.rstrip().endswith((".", ":")):
            break
    text = " ".join(words)
    return re.split(r"(?<!Eq)(?<!Eqs)\. ", text)[0].rstrip(".:")
