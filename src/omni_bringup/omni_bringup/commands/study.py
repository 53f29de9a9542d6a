"""``./omni study``: compute figures and numbers that answer one question."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_bringup.exit_codes import EXIT_OK
from omni_bringup.noting import noting_library
from omni_platform.command_options import json_option, option
from omni_platform.configuration import Configuration, ConfigurationError

if TYPE_CHECKING:
    from omni_analysis.studies import Study, StudyResult

PACKAGE = "omni_analysis.studies"
# Options of a study that brakes what its user names; only there something may not fit together.
_OF_THE_USER = {"experiment", "vehicle", "overrides"}


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Output(Configuration):
    """What every study is told besides its own options."""

    out: Path | None = option(
        None, metavar="DIR", description="folder of the figures and data (results/STUDY)"
    )
    json: bool = json_option()


def command(name: str) -> _StudyCommand:
    """Return a study as a command."""
    from omni_analysis.studies import load_study

    return _StudyCommand(name, load_study(name))


class _StudyCommand:
    """A study, with where its results go."""

    def __init__(self, name: str, study: Study) -> None:
        self._name = name
        self._study = study
        self.__doc__ = study.__doc__
        self.Options = dataclasses.make_dataclass(
            "Options", [], bases=(_Output, study.Options), frozen=True, kw_only=True
        )

    def run(self, options: Any, workspace: Path) -> int:
        """Run the study and return the exit code."""
        from omni_analysis.loop.experiment import ExperimentLibrary
        from omni_analysis.loop.metrics import results_entry
        from omni_analysis.studies import StudyRun
        from omni_bringup.progress_bar import progress_bar

        folder: Path = options.out or workspace / "results" / self._name
        library = ExperimentLibrary(workspace / "config")
        if _OF_THE_USER & {field.name for field in dataclasses.fields(options)}:
            library = noting_library(workspace, f"omni study {self._name}")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with progress_bar(self._name) as report:
                result = self._study.run(options, StudyRun(library, folder.resolve(), report))
        except OSError as error:
            raise ConfigurationError("", f"cannot write {folder}: {error}") from None
        entries = {key: results_entry(metric) for key, metric in result.metrics.items()}
        document = {"name": self._name, "metrics": entries}
        text = json.dumps(document, indent=2, allow_nan=False)
        (folder / "summary.json").write_text(text + "\n")
        if options.json:
            print(text)
        else:
            _print(result)
        return EXIT_OK


def _print(result: StudyResult) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table("quantity", "unit", pad_edge=False)
    table.columns[0].overflow = "fold"  # names are to be looked up whole
    shown = [
        kind
        for kind in ("value", "reference", "limit")
        if any(getattr(metric, kind) is not None for metric in result.metrics.values())
    ]
    for kind in shown:
        table.add_column(kind, justify="right")
    for name, metric in result.metrics.items():
        numbers = (getattr(metric, kind) for kind in shown)
        table.add_row(name, metric.unit, *("" if n is None else f"{n:.4g}" for n in numbers))
    console.print(table)
    for finding in result.findings:
        console.print(finding, highlight=False)
    for path in result.files:
        console.print(f"wrote {path}", soft_wrap=True, highlight=False)
