"""Interface of a study, and loading of studies by name.

A study is a module of `omni_studies.studies`. It contains a docstring that describes the study, a
`Configuration` called ``Options`` that defines the command-line options, and a function
``run(options, study) -> StudyResult``. A module with several studies lists them in ``CASES``, a
literal dictionary of their names and descriptions. In such a module, ``study.case`` is the name of
the study that runs, and ``OPTIONS`` and ``RUNS`` may contain other options and functions for some
of the studies.

A study writes its figures and data into ``study.folder`` and does not print; `run_study` writes the
metrics. A long study calls ``study.report(share, words)``.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

from matplotlib.figure import Figure

from omni_core import configuration, plugins
from omni_core.commands.command_report import write_text
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures import style
from omni_runs.figures.tables import data_table
from omni_runs.metrics import Metric, results_entry
from omni_studies.claims import Claim, evaluate, limited
from omni_tools.campaign.runner import CampaignOptions, Row, Work, run_campaign

_STUDIES = "omni_studies.studies"

Report = Callable[[float, str], None]
"""Function that receives the completed share, 0 to 1, and a short text."""


def _silent(share: float, words: str) -> None: ...


@dataclasses.dataclass(frozen=True)
class StudyRun:
    """Context in which a study runs, and the files that it has written.

    Attributes:
        experiments: library of experiments and vehicles.
        folder: folder for the figures and data of the study.
        report: function that is called with the completed share (0 to 1) and a text.
        case: name of the study, if its module contains several.
        written: figures and data written so far.
    """

    experiments: ExperimentLibrary
    folder: Path
    report: Report = _silent
    case: str = ""
    written: list[Path] = dataclasses.field(default_factory=list)

    def figure(self, name: str, figure: Figure) -> None:
        """Write a figure to a file in the study's folder."""
        self.written.append(style.save_figure(figure, self.folder / name))

    def plot(self, name: str, figure: Figure) -> None:
        """Write a figure, and the points of its lines to a CSV file with the same name."""
        self.figure(f"{name}.png", figure)
        self.written.append(data_table.write_lines(self.folder / f"{name}.csv", figure))

    def table(
        self, name: str, header: Iterable[str], rows: Iterable[Sequence[Any]], digits: int = 9
    ) -> None:
        """Write a table to the file `name`; all other arguments as in `data_table.write_table`."""
        self.written.append(data_table.write_table(self.folder / name, header, rows, digits))

    def campaign(
        self,
        work: Work[Row],
        seeds: range,
        row: type[Row],
        options: CampaignOptions,
        fingerprint: str,
        name: str = "stops.csv",
    ) -> list[Row]:
        """Run a campaign, and write its results to the table `name`; return all results.

        All other arguments are those of `omni_tools.campaign.runner.run_campaign`.
        """
        path = self.folder / name
        self.written.append(path)
        return run_campaign(work, seeds, row, options, path, fingerprint, self.report)

    def result(self, metrics: Mapping[str, Metric], *findings: str) -> StudyResult:
        """Return the result of the study, including the list of all files written so far."""
        return StudyResult(metrics, tuple(self.written), findings)


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """Metrics, files and findings of a study.

    Attributes:
        metrics: metrics, keyed by ``<quantity>.<case>``.
        files: written figures and data.
        findings: sentences about the results.
        claims: claims of the study, which `run_study` evaluates with the metrics.
        conditions: conditions of the runs, as JSON values.
    """

    metrics: Mapping[str, Metric]
    files: tuple[Path, ...] = ()
    findings: tuple[str, ...] = ()
    claims: tuple[Claim, ...] = ()
    conditions: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def missed(self) -> list[str]:
        """Names of metrics outside their limits, and sentences of claims that are not true."""
        found = {claim.sentence: claim.found for claim in self.claims} | dict(self.metrics)
        return [name for name, metric in found.items() if metric.status == "missed"]


class Study(Protocol):
    """A study: a module, or one of the studies that a module lists in ``CASES``."""

    __doc__: str
    Options: type[configuration.Configuration]

    def run(self, options: Any, study: StudyRun) -> StudyResult:
        """Run the study with its `Options`, and write figures and data into the folder."""


def load_study(name: str) -> Study:
    """Return the study with a given name.

    Args:
        name: name of the study, as listed by `./omni list studies`.
    """
    module, _ = plugins.described_modules(_STUDIES)[name]
    loaded: Any = importlib.import_module(f"{_STUDIES}.{module}")
    if hasattr(loaded, "CASES"):
        run = getattr(loaded, "RUNS", {}).get(name, loaded.run)
        loaded = SimpleNamespace(
            __doc__=f"{loaded.CASES[name]}.\n\n{loaded.__doc__}",
            Options=getattr(loaded, "OPTIONS", {}).get(name, loaded.Options),
            run=lambda options, study: run(options, dataclasses.replace(study, case=name)),
        )
    found: Study = loaded
    return found


def run_study(name: str, options: Any, study: StudyRun) -> tuple[StudyResult, dict[str, Any]]:
    """Run a study, apply its limits, evaluate its claims and write metrics and ``summary.json``.

    Args:
        name: name of the study, as listed by `./omni list studies`.
        options: instance of the study's `Options`.
        study: context of the study.

    Returns:
        Results of the study, and the written document.
    """
    result = load_study(name).run(options, study)
    bounded = limited(name, result.metrics)
    result = dataclasses.replace(result, metrics=bounded, claims=evaluate(name, bounded))
    metrics = {key: results_entry(metric) for key, metric in result.metrics.items()}
    document: dict[str, Any] = {"name": name, "metrics": metrics}
    if result.conditions:
        document["conditions"] = result.conditions
    if result.claims:
        document["claims"] = [claim.entry() for claim in result.claims]
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    write_text(study.folder / "summary.json", text)
    cases: dict[str, dict[str, float]] = {}
    for key, metric in bounded.items():
        quantity, _, case = key.partition(".")
        cases.setdefault(case, {})[f"{quantity} [{metric.unit}]"] = metric.value
    table = data_table.write_cases(study.folder / "metrics.csv", "case", cases)
    return dataclasses.replace(result, files=(*result.files, table)), document
