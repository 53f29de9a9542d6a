"""``./omni study``: compute figures and numbers that answer a question.

Compute the figures and numbers of a study; ./omni study NAME --help explains the study.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, make_folder
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_core.commands.wrapped_table import WrappedTable
    from omni_runs.metrics import Metric
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

    def run(self, options: Any, workspace: ExperimentWorkspace) -> Report:
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
    """Yield tables of the metrics, the findings, and the number of limits and claims that are met.

    Quantities that have the same cases and no limits share a table, with a row for each case. The
    other metrics have a row each, grouped by quantity, so that long names of metrics fit.
    """
    groups: dict[str, dict[str, Metric]] = {}
    for name, metric in result.metrics.items():
        quantity, _, case = name.partition(".")
        unit = "" if metric.unit == "1" else f" [{metric.unit}]"
        groups.setdefault(quantity + unit, {})[case] = metric
    by_cases: dict[tuple[str, ...], dict[str, dict[str, Metric]]] = {}
    for quantity, cases in groups.items():
        if not any(one.status or one.reference is not None for one in cases.values()):
            by_cases.setdefault(tuple(cases), {})[quantity] = cases
    shared = {
        names: quantities
        for names, quantities in by_cases.items()
        if len(names) > 1 and len(quantities) > 1
    }
    for names, quantities in shared.items():
        yield _side_by_side(names, quantities)
        yield ""
    apart = {quantity for quantities in shared.values() for quantity in quantities}
    listed = {quantity: cases for quantity, cases in groups.items() if quantity not in apart}
    if listed:
        yield _one_below_the_other(listed)
    yield from result.findings
    yield from map(str, result.claims)
    checked = sum(bool(metric.status) for metric in result.metrics.values()) + len(result.claims)
    if checked:
        yield f"{checked - len(result.missed)} of {checked} limits and claims are met"


def _side_by_side(
    names: Sequence[str], quantities: Mapping[str, Mapping[str, Metric]]
) -> WrappedTable:
    """Return a table with a row for each case and a column for each quantity."""
    from omni_core.commands.wrapped_table import WrappedTable

    numbers = {
        quantity.replace("_", "\n").replace(" ", "\n"): [f"{cases[n].value:.4g}" for n in names]
        for quantity, cases in quantities.items()
    }
    return WrappedTable({"case": names}, numbers)


def _one_below_the_other(groups: Mapping[str, Mapping[str, Metric]]) -> WrappedTable:
    """Return a table with a row for each metric, and columns for its reference and limits."""
    from omni_core.commands.wrapped_table import WrappedTable

    rows: list[tuple[str, Metric | None]] = []
    for quantity, cases in groups.items():
        rows.append((quantity, None))
        rows += [(f"  {case}", metric) for case, metric in cases.items()]
    columns = {}
    for kind in ("value", "reference", "at_least", "at_most", "status"):
        entries = [metric and getattr(metric, kind) for _, metric in rows]
        if any(entry not in (None, "") for entry in entries):
            columns[kind] = [
                entry if isinstance(entry, str) else "" if entry is None else f"{entry:.4g}"
                for entry in entries
            ]
    styles = [
        "bold red" if metric is not None and metric.status == "missed" else "" for _, metric in rows
    ]
    return WrappedTable({"quantity and case": [name for name, _ in rows]}, columns, styles)
