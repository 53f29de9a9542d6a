"""Studies: computations that answer one question, with figures, data and metrics.

A study is a module of this package. It has a docstring whose first line says what it shows, its
options as a `Configuration` called ``Options`` (they become ``--like-this``), and a function
``run(options, study) -> StudyResult``. It writes its figures and data into ``study.folder`` and
knows nothing of the terminal; one that takes long calls ``study.report(share, words)``.
"""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.metrics import Metric
from omni_platform.configuration import Configuration

Report = Callable[[float, str], None]
"""Takes the share done, 0..1, and a few words about it."""


def _silent(share: float, words: str) -> None: ...


@dataclasses.dataclass(frozen=True)
class StudyRun:
    """Where a study runs.

    Attributes:
        experiments: the configuration files by name.
        folder: for its figures and data.
        report: called as the study goes on.
    """

    experiments: ExperimentLibrary
    folder: Path
    report: Report = _silent


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


def claim(words: str, found: str, *, holds: bool) -> str:
    """Return the finding about a claim of the dissertation.

    Args:
        words: what is claimed.
        found: what the numbers are.
        holds: whether they bear it out.
    """
    return f"{words}: {found}; {'holds' if holds else 'does not hold'}"


class Study(Protocol):
    """The module of a study."""

    __doc__: str
    Options: type[Configuration]

    def run(self, options: Any, study: StudyRun) -> StudyResult:
        """Compute, and write figures and data into the folder; `options` is its `Options`."""


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
