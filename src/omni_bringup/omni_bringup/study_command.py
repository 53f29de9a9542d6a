"""``./omni study``: computations without ROS that answer one question each."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_analysis.experiment import ExperimentLibrary
from omni_analysis.metrics import Metric
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
    document = {"name": options.study, "metrics": _entries(result.metrics)}
    (folder / "summary.json").write_text(json.dumps(document, indent=2, allow_nan=False) + "\n")
    if options.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        _print(result)
    return EXIT_OK


def _entries(metrics: Mapping[str, Metric]) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for name, metric in metrics.items():
        entry: dict[str, Any] = {"value": _finite(metric.value), "unit": metric.unit}
        if metric.reference is not None:
            entry["reference"] = _finite(metric.reference)
        if metric.limit is not None:
            entry["limit"] = _finite(metric.limit)
        if metric.note:
            entry["note"] = metric.note
        entries[name] = entry
    return entries


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


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
