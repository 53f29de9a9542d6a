"""Studies: computations that answer one question, with figures, data and metrics.

A study is a module of this package. It has a docstring whose first line says what it shows, a
function ``add_arguments(parser)`` for its own options, and ``run(options, library, folder) ->
StudyResult``. It writes its figures and data into `folder` and knows nothing of the terminal; one
that takes long calls ``options.report(share, words)``, a `Report`, as it goes on.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import pkgutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.metrics import Metric

Report = Callable[[float, str], None]
"""Takes the share done, 0..1, and a few words about it."""


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """What a study found.

    Attributes:
        metrics: by ``<quantity>.<case>``.
        files: figures and data written.
        findings: sentences about what the numbers say, for people.
    """

    metrics: Mapping[str, Metric]
    files: tuple[Path, ...] = ()
    findings: tuple[str, ...] = ()


class Study(Protocol):
    """The module of a study."""

    __doc__: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the study's own options."""

    def run(
        self, options: argparse.Namespace, library: ExperimentLibrary, folder: Path
    ) -> StudyResult:
        """Compute, and write figures and data into `folder`."""


def study_names() -> list[str]:
    """Return the names of all studies, sorted."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def load_study(name: str) -> Study:
    """Return the module of a study.

    Args:
        name: one of `study_names`.
    """
    study: Study = importlib.import_module(f"{__name__}.{name}")
    return study
