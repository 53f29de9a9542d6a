"""``./omni run``: every variant of an experiment, recorded, measured and drawn."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from omni_analysis.figures.comparison_table import comparison_table
from omni_analysis.figures.run_figures import draw_run_figures
from omni_analysis.loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_analysis.loop.ground_choice import ground_overrides, prepare_grounds
from omni_analysis.loop.metrics import results_document
from omni_analysis.loop.recorded_run import BagError
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED
from omni_bringup.graph.domain import NoFreeDomainError, reserved_domain
from omni_bringup.graph.nodes import RecordingOptions
from omni_bringup.graph.process_group import ProcessError
from omni_bringup.graph.run_folder import (
    check_unused,
    time_in_name,
    unfinished_recordings,
    write_summary,
)
from omni_bringup.graph.run_variant import Progress, RunError, VariantResult, run_variant
from omni_platform.configuration import ConfigurationError
from omni_sim.texture.cache import TextureCache


def run(options: argparse.Namespace, workspace: Path) -> int:
    """Run an experiment as the command line asks and return the exit code."""
    library = ExperimentLibrary(workspace / "config")
    try:
        configurations = _compose(library, options)
        with reserved_domain():
            pass  # better refused before there is a folder; each run reserves its own
        folder = _result_folder(options, workspace)
    except (ConfigurationError, NoFreeDomainError) as error:
        print(f"omni run: {error}", file=sys.stderr)
        return EXIT_REFUSED
    results = []
    try:
        for variant, configuration in configurations.items():
            with _progress(variant) as on_progress:
                result = run_variant(
                    configuration,
                    variant,
                    folder / variant,
                    lockstep=not options.real_time,
                    on_progress=on_progress,
                    recording=RecordingOptions(options.compression, options.fsync),
                )
            write_summary(_document(options.experiment, [result]), result.folder)
            results.append(result)
    except (RunError, ProcessError, NoFreeDomainError, BagError) as error:
        print(f"omni run: {error}", file=sys.stderr)
        print(f"omni run: what was recorded is in {folder}", file=sys.stderr)
        for path in unfinished_recordings(folder):
            print(
                f"omni run: {path.relative_to(folder)} was not finished: what was recorded can be "
                "streamed from its beginning, but tools that need its index refuse it",
                file=sys.stderr,
            )
        return EXIT_FAILED
    except OSError as error:
        print(f"omni run: cannot write to {folder}: {error.strerror}", file=sys.stderr)
        return EXIT_FAILED
    histories = {result.variant: result.history for result in results}
    try:
        pictures = draw_run_figures(configurations, histories, folder)
    except OSError as error:
        print(f"omni run: cannot write the figures to {folder}: {error}", file=sys.stderr)
        return EXIT_FAILED
    if options.json:
        print(json.dumps(_document(options.experiment, results), indent=2, allow_nan=False))
    else:
        _print_results(results, pictures, folder)
    return EXIT_OK


def _compose(
    library: ExperimentLibrary, options: argparse.Namespace
) -> dict[str, ExperimentConfiguration]:
    """Check the configuration of every variant before anything starts."""
    variants = options.variant or library.variants(options.experiment)
    for variant in options.variant:
        # The second may have been meant to be another.
        if options.variant.count(variant) > 1:
            raise ConfigurationError("--variant", f"{variant!r} is given twice")
    overrides = (*ground_overrides(options.ground, options.dpi), *options.overrides)
    configurations = {
        variant: library.load(options.experiment, variant, overrides) for variant in variants
    }
    for configuration in configurations.values():
        configuration.check_drivable()
    prepare_grounds(configurations.values(), TextureCache.of_user())
    return configurations


def _result_folder(options: argparse.Namespace, workspace: Path) -> Path:
    if options.out is not None:
        folder: Path = options.out
        check_unused(folder)
    else:
        folder = workspace / "bags" / Path(options.experiment).stem / time_in_name()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError("--out", f"cannot make {folder}: {error.strerror}") from None
    return folder.resolve()


def _document(experiment: str, results: list[VariantResult]) -> dict[str, object]:
    by_variant = {result.variant: result.metrics for result in results}
    return results_document(Path(experiment).stem, by_variant)


@contextmanager
def _progress(variant: str) -> Iterator[Progress]:
    """Show a progress bar on standard error where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description:<12}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("t = {task.fields[time]:.2f} s, {task.fields[speed]:.2f} m/s"),
    )
    with Bar(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(variant, total=1.0, time=0.0, speed=0.0)

        def on_progress(report: Mapping[str, float]) -> None:
            bar.update(task, completed=report["share"], time=report["time"], speed=report["speed"])

        yield on_progress


def _print_results(results: list[VariantResult], pictures: list[Path], folder: Path) -> None:
    from rich.console import Console

    console = Console()
    console.print(comparison_table({result.variant: result.metrics for result in results}))
    for picture in pictures:
        console.print(f"figure     {picture}", soft_wrap=True, highlight=False)
    console.print(f"recordings {folder}", soft_wrap=True, highlight=False)
