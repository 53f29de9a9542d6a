"""``./omni run --set key=a,b,c``: a table and a picture instead of recordings."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED
from omni_bringup.noting import noting_library
from omni_platform.configuration import ConfigurationError

if TYPE_CHECKING:
    from omni_analysis.loop.experiment import ExperimentConfiguration
    from omni_analysis.loop.sweep import SweptRun


def run_sweep(options: Any, workspace: Path) -> int:
    """Run every combination in one process and return the exit code.

    Args:
        options: those of ``omni run``.
        workspace: holds `config`.
    """
    from omni_analysis.figures.data_table import write_table
    from omni_analysis.figures.style import save_figure
    from omni_analysis.figures.sweep_figure import sweep_figure
    from omni_analysis.loop.metrics import results_document
    from omni_analysis.loop.sweep import sweep
    from omni_bringup.graph.run_folder import check_unused, time_in_name
    from omni_bringup.progress_bar import progress_bar

    name = Path(options.experiment).stem
    try:
        if options.real_time or options.replace:
            option = "--real-time" if options.real_time else "--replace"
            raise ConfigurationError(option, "a sweep runs in one process, without nodes")
        configurations = _configurations(options, workspace)
        if options.out is not None:
            check_unused(options.out)
    except ConfigurationError as error:
        print(f"omni run: {error}", file=sys.stderr)
        return EXIT_REFUSED
    folder = options.out or workspace / "results" / "sweeps" / f"{name}_{time_in_name()}"
    with progress_bar("sweep") as report:
        runs = sweep(configurations, report)
    cases = {f"{run.variant}_{index}": run for index, run in enumerate(runs, 1)}
    document: dict[str, Any] = results_document(name, {c: r.metrics for c, r in cases.items()})
    document["cases"] = {
        case: {"variant": run.variant, "values": dict(run.values)} for case, run in cases.items()
    }
    keys = list(runs[0].values)
    quantities = list(runs[0].metrics)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        table = write_table(
            folder / "sweep.csv",
            ["variant", *keys, *(f"{q} [{runs[0].metrics[q].unit}]" for q in quantities)],
            [
                [run.variant, *run.values.values(), *(run.metrics[q].value for q in quantities)]
                for run in runs
            ],
        )
        picture = save_figure(
            sweep_figure(runs, f"{name}: {', '.join(keys)}"), folder / "sweep.png"
        )
        text = json.dumps(document | {"folder": str(folder)}, indent=2, allow_nan=False)
        (folder / "summary.json").write_text(text + "\n")
    except OSError as error:
        print(f"omni run: cannot write to {folder}: {error}", file=sys.stderr)
        return EXIT_FAILED
    if options.json:
        print(text)
    else:
        _print(runs)
        print(f"table      {table}\nfigure     {picture}")
    return EXIT_OK


def _configurations(
    options: Any, workspace: Path
) -> list[tuple[str, dict[str, str], ExperimentConfiguration]]:
    """Check every combination before the first one runs."""
    from omni_analysis.loop.ground_choice import ground_overrides, prepare_grounds
    from omni_analysis.loop.sweep import combinations
    from omni_sim.texture.cache import TextureCache

    library = noting_library(workspace, "omni run")
    ground = ground_overrides(options.ground, options.dpi)
    configurations = [
        (variant, values, library.load(options.experiment, variant, [*ground, *overrides]))
        for values, overrides in combinations(options.changes)
        for variant in options.variant or library.variants(options.experiment)
    ]
    for _, _, configuration in configurations:
        configuration.check_drivable()
    prepare_grounds([entry[2] for entry in configurations], TextureCache.of_user())
    return configurations


def _print(runs: Sequence[SweptRun]) -> None:
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from omni_analysis.figures.comparison_table import in_small_units, metric_label, metric_number
    from omni_analysis.loop.sweep import SHOWN

    table = Table(pad_edge=False, box=box.SIMPLE_HEAD)
    for key in runs[0].values:
        table.add_column(key.replace(".", ".\n"), justify="right", overflow="fold")
    table.add_column("variant")
    columns = []
    for quantity in SHOWN:
        unit, entries = in_small_units([run.metrics[quantity] for run in runs])
        columns.append(["-" if one is None else metric_number(one.value, unit) for one in entries])
        label = metric_label(quantity).replace(" ", "\n")
        table.add_column(f"{label}\n{escape(f'[{unit}]')}", justify="right", overflow="fold")
    for run, *numbers in zip(runs, *columns, strict=True):
        table.add_row(*run.values.values(), run.variant, *numbers)
    Console().print(table)
