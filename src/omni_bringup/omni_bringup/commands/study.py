"""``./omni study``: compute figures and numbers that answer a question.

Compute the figures and numbers of a study; ./omni study NAME --help explains the study.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_bringup.command_report import Report, make_folder
from omni_bringup.workspace import Workspace
from omni_platform.command_options import CommandOptions, option

if TYPE_CHECKING:
    from omni_studies.study import Study, StudyResult

PACKAGE = "omni_studies.studies"
# Options that select the simulated vehicle. Only studies with such an option report implausible
# values.
_OF_THE_USER = {"experiment", "vehicle", "overrides"}


class _Output(CommandOptions):
    """Options that every study has in addition to its own options."""

    out: Path | None = option(None, metavar="DIR")
    """folder for figures and data (default: results/STUDY)"""
    strict: bool = option(False)
    """exit code 1 if a metric violates its limit or a claim is not true"""


def command(name: str) -> _StudyCommand:
    """Return the study with the given name as a command."""
    from omni_studies.study import load_study

    return _StudyCommand(name, load_study(name))


class _StudyCommand:
    """Command that runs a study, and determines the folder of its results."""

    def __init__(self, name: str, study: Study) -> None:
        self._name = name
        self.__doc__ = study.__doc__
        self.Options: Any = type("Options", (_Output, study.Options), {})

    def run(self, options: Any, workspace: Workspace) -> Report:
        """Run the study."""
        from omni_studies.study import StudyRun, run_study

        of_the_user = _OF_THE_USER & {field.name for field in dataclasses.fields(options)}
        library = workspace.checked_experiments() if of_the_user else workspace.experiment_library()
        folder = make_folder(workspace.results(options.out, self._name))
        with workspace.progress() as report:
            study = StudyRun(library, folder, report)
            result, document = run_study(self._name, options, study)
        return Report(
            name=self._name,
            details=document,
            text=_text(result),
            files=result.files,
            ok=not (options.strict and result.missed),
        )


def _text(result: StudyResult) -> Iterator[Any]:
    """Yield a table of the metrics, the findings, and the number of limits and claims that are met.

    The table is grouped by quantity, so that long names of metrics fit.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("quantity and case", overflow="fold")
    metrics = result.metrics.values()
    kinds = ("value", "reference", "at_least", "at_most")
    shown = [kind for kind in kinds if any(getattr(m, kind) is not None for m in metrics)]
    for kind in shown:
        table.add_column(kind, justify="right", no_wrap=True)
    table.add_column("status" if any(metric.status for metric in metrics) else "", no_wrap=True)
    groups: dict[str, list[str]] = {}
    for name, metric in result.metrics.items():
        quantity = name.partition(".")[0] + ("" if metric.unit == "1" else f" [{metric.unit}]")
        groups.setdefault(quantity, []).append(name)
    for quantity, names in groups.items():
        table.add_row(Text(quantity))
        for name in names:
            metric = result.metrics[name]
            numbers = (getattr(metric, kind) for kind in shown)
            cells = ["" if n is None else f"{n:.4g}" for n in numbers]
            style = "bold red" if metric.status == "missed" else ""
            table.add_row(f"  {name.partition('.')[2]}", *cells, metric.status, style=style)
    yield table
    yield from result.findings
    yield from map(str, result.claims)
    checked = sum(bool(metric.status) for metric in metrics) + len(result.claims)
    if checked:
        yield f"{checked - len(result.missed)} of {checked} limits and claims are met"
