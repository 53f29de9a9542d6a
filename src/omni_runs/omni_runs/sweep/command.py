"""``./omni run --set key=a,b,c``: run an experiment with several values; write table and figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omni_core.commands.command_report import Report
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_core.commands.wrapped_table import WrappedTable
    from omni_runs.experiment import ExperimentConfiguration
    from omni_runs.sweep.sweep import SweptRun


def run_sweep(
    options: Any,
    configurations: Sequence[tuple[str, Mapping[str, str], ExperimentConfiguration]],
    workspace: ExperimentWorkspace,
) -> Report:
    """Run an experiment with all combinations of the given values; write table and figure.

    The runs take place in this process, without the ROS graph.

    Args:
        options: options of ``omni run``, in which ``--set`` gives several values of a key.
        configurations: variant, values of the swept keys, and configuration of each run.
        workspace: workspace with the folder `config`.
    """
    from omni_runs.experiment import short_name
    from omni_runs.figures.style import save_figure
    from omni_runs.figures.tables.data_table import write_table
    from omni_runs.graph.run_folder import new_folder, time_in_name
    from omni_runs.metrics import results_document
    from omni_runs.sweep.figure import sweep_figure
    from omni_runs.sweep.sweep import sweep

    name = short_name(options.experiment)
    default = f"{name}_{time_in_name()}"
    folder = new_folder(workspace.results(options.out, "sweeps", default))
    with workspace.progress() as report:
        runs = sweep(configurations, report)
    cases = {f"{run.variant}_{index}": run for index, run in enumerate(runs, 1)}
    keys = list(runs[0].values)
    units = {quantity: metric.unit for quantity, metric in runs[0].metrics.items()}
    table = write_table(
        folder / "sweep.csv",
        ["variant", *keys, *(f"{quantity} [{unit}]" for quantity, unit in units.items())],
        [
            [run.variant, *run.values.values(), *(run.metrics[q].value for q in units)]
            for run in runs
        ],
    )
    picture = save_figure(sweep_figure(runs, f"{name}: {', '.join(keys)}"), folder / "sweep.png")
    return Report(
        **results_document(name, {case: run.metrics for case, run in cases.items()}),
        details={
            "cases": {
                case: {"variant": run.variant, "values": dict(run.values)}
                for case, run in cases.items()
            },
            "folder": str(folder),
        },
        text=(_table(runs), f"table      {table}", f"figure     {picture}"),
        summary=folder,
    )


def _table(runs: Sequence[SweptRun]) -> WrappedTable:
    from omni_core.commands.wrapped_table import WrappedTable
    from omni_runs.figures.tables.comparison_table import in_readable_unit, metric_cell
    from omni_runs.sweep.sweep import SHOWN, short_keys

    short = short_keys(runs[0].values)
    names = {short[key]: [run.values[key] for run in runs] for key in short}
    if len({run.variant for run in runs}) > 1:
        names["variant"] = [run.variant for run in runs]
    numbers = {}
    for quantity, label in SHOWN.items():
        unit, entries = in_readable_unit([run.metrics[quantity] for run in runs])
        numbers[f"{label}\n[{unit}]"] = [metric_cell(entry) for entry in entries]
    return WrappedTable(names, numbers)
