"""``./omni run``: run an experiment over the ROS graph, record it and compute metrics.

Run every variant of an experiment over real ROS processes, record it to a rosbag2 folder, print the
results, and draw the figures.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from functools import cache, partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.commands import command_report, interruption
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.workspace import progress_bar
from omni_core.configuration import ConfigurationError, InputError, WorkError, check_choice
from omni_runs.options import LoopOptions
from omni_runs.workspace import ExperimentWorkspace, remarks_on

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
    from omni_runs.graph.run_variant import VariantResult
    from omni_runs.history import RunHistory
    from omni_runs.metrics import Metric

_PANELS = 6  # in a figure; further stops are in further figures

REPLACEABLE = ("brake_assist", "linescan_odometry")
"""Nodes that a user's own node may replace."""


class Options(LoopOptions, CommandOptions):
    """Options of ``omni run``."""

    experiment: str = option("straight_line", positional=True, metavar="EXPERIMENT")
    """a file of config/experiments/, or a path that ends in .yaml"""
    variant: tuple[str, ...] = option(())
    """run only this variant"""
    out: Path | None = option(None, metavar="DIR")
    """folder for the recordings and figures (default: bags/EXPERIMENT/TIME)"""
    ground: str | None = option(None, metavar="NAME|PICTURE")
    """a file of config/grounds/, or your own scan or photo (PNG, TIFF, JPEG) with --dpi"""
    dpi: float | None = option(None, above=0.0, maximum=50000.0)
    """dots per inch of the picture, or resolution at which a ground is rendered"""
    real_time: bool = option(False)
    """run the simulation at the pace of the wall clock instead of waiting for every reply of a
    node"""
    compression: str = option("none", choices=("none", "zstd", "lz4"))
    """compression of the recording; a recording of noisy lines becomes an eighth smaller"""
    fsync: bool = option(False)
    """wait for the disk at every flush, so that a power failure loses at most a second of data"""
    replace: tuple[str, ...] = option((), metavar="NODE=external")
    """do not start the node `brake_assist` or `linescan_odometry`, because your own node in the
    same ROS_DOMAIN_ID replaces it"""

    @property
    def external(self) -> frozenset[str]:
        """Names of the nodes that are not started, because a user's node replaces them."""
        return frozenset(words.partition("=")[0] for words in self.replace)

    def check_consistency(self) -> None:
        """Raise `ConfigurationError` if a node in ``--replace`` cannot be replaced."""
        for words in self.replace:
            check_choice("--replace", words, [f"{name}=external" for name in REPLACEABLE])


def run(options: Options, workspace: ExperimentWorkspace) -> command_report.Report:
    """Check the configuration, make the folder, run every variant, draw the figures, report."""
    from omni_runs.graph.fork_server import start_fork_server

    if options.swept:
        from omni_runs.sweep.command import run_sweep

        if options.real_time or options.replace:
            option = "--real-time" if options.real_time else "--replace"
            raise ConfigurationError(option, "a sweep runs in one process, without nodes")
        runs = _checked_configurations(options, workspace.checked_experiments())
        return run_sweep(options, runs, workspace)
    start_fork_server()  # imports the modules of the nodes while the configurations are checked
    runs = _checked_configurations(options, workspace.experiment_library())
    configurations = {variant: configuration for variant, _, configuration in runs}
    folder = _result_folder(options, workspace)
    results = _run_variants(configurations, folder, options, workspace)
    return _report(options.experiment, configurations, results, folder)


def _checked_configurations(
    options: Options, library: ExperimentLibrary
) -> list[tuple[str, dict[str, str], ExperimentConfiguration]]:
    """Return variant, swept values and configuration of each run, all checked before the first run.

    The swept values are texts, keyed by dotted key.
    """
    from omni_runs.ground_choice import ground_overrides, prepare_grounds
    from omni_runs.sweep.sweep import combinations
    from omni_sim.texture.cache import TextureCache

    for variant in options.variant:
        # A repeated name is probably a mistake for the name of another variant.
        if options.variant.count(variant) > 1:
            raise ConfigurationError("--variant", f"{variant!r} is given twice")
    ground = ground_overrides(options.ground, options.dpi)
    runs = [
        (variant, values, library.load(options.experiment, variant, [*ground, *overrides]))
        for values, overrides in combinations(options.changes)
        for variant in options.variant or library.variants(options.experiment, options.changes)
    ]
    for _, _, configuration in runs:
        configuration.check_drivable()
    prepare_grounds([configuration for _, _, configuration in runs], TextureCache.of_user())
    return runs


def _result_folder(options: Options, workspace: ExperimentWorkspace) -> Path:
    from omni_runs.experiment import short_name
    from omni_runs.graph.domain import reserved_domain
    from omni_runs.graph.run_folder import new_folder, time_in_name

    with reserved_domain():
        pass  # Fail before the folder is created; each run reserves a domain again.
    default = workspace.folder / "bags" / short_name(options.experiment) / time_in_name()
    return new_folder(options.out or default)


def _run_variants(
    configurations: Mapping[str, ExperimentConfiguration],
    folder: Path,
    options: Options,
    workspace: ExperimentWorkspace,
) -> list[VariantResult]:
    """Run each variant as a graph of node processes; return the results of all variants.

    Raises:
        WorkError: a run ended early; the message names the recordings that remain.
    """
    from omni_runs.experiment import short_name
    from omni_runs.graph.fork_server import Worker
    from omni_runs.graph.run_folder import write_summary
    from omni_runs.graph.run_variant import finish_runs, run_variant

    shares = dict.fromkeys(configurations, 0.0)
    results, name = {}, short_name(options.experiment)
    with closing(Worker()) as worker:
        # This check runs during the first run, because it would otherwise delay the start.
        check = cache(lambda: worker.begin(partial(remarks_on, list(configurations.values()))))
        note = cache(lambda: [*map(workspace.note, check()())])
        try:
            with interruption.clean_up_on_signals(), progress_bar(name) as show:

                def on_progress(variant: str, report: Mapping[str, float] | str) -> None:
                    if isinstance(report, str):
                        show(sum(shares.values()) / len(shares), report)
                        return
                    shares[variant] = report["share"]
                    words = f"{variant}, t = {report['time']:.2f} s, {report['speed']:.2f} m/s"
                    show(sum(shares.values()) / len(shares), words)
                    (note if any(shares.values()) else check)()
                    import_module("omni_runs.figures.top_view")  # would delay the end

                show(0.0, "starting the nodes")
                runs = [
                    run_variant(
                        configuration,
                        variant,
                        folder / variant,
                        lockstep=not options.real_time,
                        on_progress=partial(on_progress, variant),
                        recording={
                            "compression": options.compression,
                            "synchronize": options.fsync,
                        },
                        external=options.external,
                    )
                    for variant, configuration in configurations.items()
                ]
                for result in finish_runs(runs, _runs_at_once(options), worker.begin):
                    write_summary(_document(options.experiment, [result]), result.folder)
                    results[result.variant] = result
        except (InputError, WorkError) as error:
            with suppress(WorkError):  # the remarks matter less than this error
                note()
            raise WorkError("\n".join((str(error), *_left_behind(folder)))) from error
    return [results[variant] for variant in configurations]


def _runs_at_once(options: Options) -> int:
    """Return how many variants run at the same time.

    The number is 2, so that the nodes of a variant start while another variant runs. Some options,
    and a ROS domain that the user has chosen, require 1.
    """
    from omni_ros.environment import chosen_domain

    alone = options.real_time or options.replace or chosen_domain(os.environ) is not None
    return 1 if alone else 2


def _left_behind(folder: Path) -> Iterator[str]:
    """Yield a line that names the folder of a failed run, and one for each incomplete recording."""
    from omni_runs.graph.run_folder import unfinished_recordings

    yield f"what was recorded is in {folder}"
    for path in unfinished_recordings(folder):
        yield (
            f"{path.relative_to(folder)} is incomplete and has no index; ./omni bag recover "
            "copies its complete messages to a new recording"
        )


def _report(
    experiment: str,
    configurations: Mapping[str, ExperimentConfiguration],
    results: Sequence[VariantResult],
    folder: Path,
) -> command_report.Report:
    """Draw the figures and return the report; a user's own law is named in the titles.

    The figures are like Figures 24 and 31 of the dissertation, with a panel for each stop.
    """
    from omni_runs.figures.scene import Scene
    from omni_runs.figures.style import save_figure
    from omni_runs.figures.tables.comparison_table import ComparisonTable
    from omni_runs.figures.time_series import time_series
    from omni_runs.figures.top_view import top_view

    histories: dict[str, RunHistory] = {}
    columns: dict[str, Mapping[str, Metric]] = {}
    for result in results:
        assist = configurations[result.variant].brake_assist
        law = f" ({assist.law})" if assist.enabled and ":" in assist.law else ""
        histories |= {f"{name}{law}": stop for name, stop in result.stops.items()}
        columns |= {f"{name}{law}": metrics for name, metrics in result.metrics.items()}
    first = next(iter(configurations.values()))
    pictures = []
    for start in range(0, len(histories), _PANELS):
        shown = dict(islice(histories.items(), start, start + _PANELS))
        number = f"_{start // _PANELS + 1}" if start else ""
        figures = {
            "top_view": top_view(Scene.of(first), shown, title=first.description),
            "time_series": time_series(shown, title=first.description),
        }
        pictures += [
            save_figure(figure, folder / f"{name}{number}.png") for name, figure in figures.items()
        ]
    return command_report.Report(
        **_document(experiment, results),
        details={
            "folder": str(folder),
            "recordings": {result.variant: str(result.folder) for result in results},
            "figures": [str(picture) for picture in pictures],
        },
        text=(
            ComparisonTable(columns),
            *(f"figure     {picture}" for picture in pictures),
            f"recordings {folder}",
        ),
        problems=[problem for result in results if (problem := result.still_moving())],
    )


def _document(experiment: str, results: Sequence[VariantResult]) -> dict[str, Any]:
    from omni_runs.experiment import short_name
    from omni_runs.metrics import results_document

    by_stop = {name: metrics for result in results for name, metrics in result.metrics.items()}
    return results_document(short_name(experiment), by_stop)
