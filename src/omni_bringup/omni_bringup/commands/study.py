"""``./omni study``: computations without ROS that answer one question each."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.metrics import results_entry
from omni_analysis.studies import StudyResult, load_study
from omni_bringup.exit_codes import EXIT_OK, EXIT_REFUSED
from omni_bringup.progress_bar import progress_bar
from omni_platform.configuration import ConfigurationError


def study(options: argparse.Namespace, workspace: Path) -> int:
    """Run a study as the command line asks and return the exit code."""
    folder: Path = options.out or workspace / "results" / options.study
    try:
        folder.mkdir(parents=True, exist_ok=True)
        module = load_study(options.study)
        with progress_bar(options.study) as options.report:
            result = module.run(options, ExperimentLibrary(workspace / "config"), folder.resolve())
    except ConfigurationError as error:
        print(f"omni study {options.study}: {error}", file=sys.stderr)
        return EXIT_REFUSED
    except OSError as error:
        print(f"omni study {options.study}: cannot write {folder}: {error}", file=sys.stderr)
        return EXIT_REFUSED
    entries = {name: results_entry(metric) for name, metric in result.metrics.items()}
    document = {"name": options.study, "metrics": entries}
    (folder / "summary.json").write_text(json.dumps(document, indent=2, allow_nan=False) + "\n")
    if options.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        _print(result)
    return EXIT_OK


def _print(result: StudyResult) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table("quantity", "unit", "value", "reference", "limit", pad_edge=False)
    for name, metric in result.metrics.items():
        numbers = (metric.value, metric.reference, metric.limit)
        table.add_row(name, metric.unit, *("" if n is None else f"{n:.4g}" for n in numbers))
    console.print(table)
    for finding in result.findings:
        console.print(finding, highlight=False)
    for path in result.files:
        console.print(f"wrote {path}", soft_wrap=True, highlight=False)
