"""``./omni run``: run an experiment over the ROS graph, record it and measure it.

Run every variant of an experiment over real ROS processes, record it to a rosbag2 folder, print
the results and draw the figures.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from omni_analysis.loop.options import LoopOptions
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED
from omni_bringup.interruption import clean_up_on_signals
from omni_bringup.noting import say_notes
from omni_platform.command_options import json_option, option
from omni_platform.configuration import ConfigurationError, did_you_mean, parameter

if TYPE_CHECKING:
    from omni_analysis.loop.experiment import ExperimentConfiguration, ExperimentLibrary
    from omni_bringup.graph.run_variant import Progress, VariantResult

REPLACEABLE = ("brake_assist", "linescan_odometry")
"""Nodes whose place a node of the user's own may take."""


@dataclass(frozen=True, kw_only=True)
class Options(LoopOptions):
    """Options of ``omni run``."""

    experiment: str = option(
        "straight_line",
        positional=True,
        metavar="EXPERIMENT",
        description="a file of config/experiments/, or a path that ends in .yaml",
    )
    variant: tuple[str, ...] = parameter((), description="run only this variant")
    out: Path | None = option(
        None,
        metavar="DIR",
        description="folder of the recordings and figures (default: bags/EXPERIMENT/TIME)",
    )
    ground: str | None = option(
        None,
        metavar="NAME|PICTURE",
        description="a file of config/grounds/, or your own scan or photo (PNG, TIFF, JPEG) with "
        "--dpi",
    )
    dpi: float | None = parameter(
        None, description="dots per inch of the picture on the ground, or to draw the ground in"
    )
    real_time: bool = parameter(
        False,
        description="pace the simulation to the wall clock instead of waiting for every reply",
    )
    compression: str = parameter(
        "none",
        choices=("none", "zstd", "lz4"),
        description="of the recording; noisy lines shrink by about an eighth",
    )
    fsync: bool = parameter(
        False,
        description="wait for the disk at every flush, so that a power cut too loses at most a "
        "second",
    )
    replace: tuple[str, ...] = option(
        (),
        metavar="NODE=external",
        description="do not start brake_assist or linescan_odometry; a node of your own in the "
        "same ROS_DOMAIN_ID answers",
    )
    json: bool = json_option()

    @property
    def external(self) -> frozenset[str]:
        """Nodes that are not started."""
        return frozenset(words.partition("=")[0] for words in self.replace)

    def check_consistency(self) -> None:
        """Refuse the replacement of what cannot be replaced."""
        for words in self.replace:
            node, _, by = words.partition("=")
            if node not in REPLACEABLE or by != "external":
                known = [f"{name}=external" for name in REPLACEABLE]
                hint = did_you_mean(words, known)
                raise ConfigurationError(
                    "--replace", f"{words!r} must be one of {', '.join(known)}{hint}"
                )


def run(options: Options, workspace: Path) -> int:
    """Run an experiment as the command line asks and return the exit code."""
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_analysis.loop.sweep import is_swept
    from omni_bringup.sweep import run_sweep

    if any(map(is_swept, options.changes)):
        return run_sweep(options, workspace)
    from omni_analysis.loop.recorded_run import BagError
    from omni_bringup.graph.domain import NoFreeDomainError, reserved_domain
    from omni_bringup.graph.nodes import RecordingOptions
    from omni_bringup.graph.process_group import ProcessError
    from omni_bringup.graph.run_folder import unfinished_recordings, write_summary
    from omni_bringup.graph.run_variant import RunError, run_variant

    clean_up_on_signals()
    try:
        configurations = _compose(ExperimentLibrary(workspace / "config"), options)
        with reserved_domain():
            pass  # better refused before there is a folder; each run reserves its own
        folder = _result_folder(options, workspace)
    except (ConfigurationError, NoFreeDomainError) as error:
        print(f"omni run: {error}", file=sys.stderr)
        return EXIT_REFUSED
    results = []
    # Said once the first run is under way, which would begin a sixth of a second later.
    note = cache(lambda: say_notes(configurations.values(), "omni run"))
    try:
        for variant, configuration in configurations.items():
            with _progress(variant) as on_progress:
                result = run_variant(
                    configuration,
                    variant,
                    folder / variant,
                    lockstep=not options.real_time,
                    on_progress=_both(on_progress, note),
                    recording=RecordingOptions(options.compression, options.fsync),
                    external=options.external,
                )
            write_summary(_document(options.experiment, [result]), result.folder)
            results.append(result)
    except (RunError, ProcessError, NoFreeDomainError, BagError) as error:
        note()
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
    # Not before the run, which would begin a second later.
    from omni_analysis.figures.run_figures import draw_run_figures

    histories = {result.variant: result.history for result in results}
    try:
        pictures = draw_run_figures(configurations, histories, folder)
    except OSError as error:
        print(f"omni run: cannot write the figures to {folder}: {error}", file=sys.stderr)
        return EXIT_FAILED
    if options.json:
        places = {
            "folder": str(folder),
            "recordings": {result.variant: str(result.folder) for result in results},
            "figures": [str(picture) for picture in pictures],
        }
        document = _document(options.experiment, results) | places
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        _print_results(results, pictures, folder)
    return _verdict(results)


def _both(on_progress: Progress, note: Callable[[], None]) -> Progress:
    def follow(report: Mapping[str, float]) -> None:
        on_progress(report)
        note()

    return follow


def _verdict(results: list[VariantResult]) -> int:
    from omni_bringup.graph.run_variant import RunError

    try:
        for result in results:
            result.check_rest()
    except RunError as error:
        print(f"omni run: {error}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK


def _compose(library: ExperimentLibrary, options: Options) -> dict[str, ExperimentConfiguration]:
    """Check the configuration of every variant before anything starts."""
    from omni_analysis.loop.ground_choice import ground_overrides, prepare_grounds
    from omni_sim.texture.cache import TextureCache

    variants = options.variant or library.variants(options.experiment)
    for variant in options.variant:
        # The second may have been meant to be another.
        if options.variant.count(variant) > 1:
            raise ConfigurationError("--variant", f"{variant!r} is given twice")
    overrides = (*ground_overrides(options.ground, options.dpi), *options.changes)
    configurations = {
        variant: library.load(options.experiment, variant, overrides) for variant in variants
    }
    for configuration in configurations.values():
        configuration.check_drivable()
    prepare_grounds(configurations.values(), TextureCache.of_user())
    return configurations


def _result_folder(options: Options, workspace: Path) -> Path:
    from omni_bringup.graph.run_folder import check_unused, time_in_name

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
    from omni_analysis.loop.metrics import results_document

    by_variant = {result.variant: result.metrics for result in results}
    return results_document(Path(experiment).stem, by_variant)


@contextmanager
def _progress(variant: str) -> Iterator[Progress]:
    """Show a progress bar on standard error, and lines where that is no terminal."""
    if not sys.stderr.isatty():
        from omni_bringup.progress_bar import progress_lines

        say = progress_lines(variant)
        yield lambda report: say(
            report["share"], f"t = {report['time']:.2f} s, {report['speed']:.2f} m/s"
        )
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

    from omni_analysis.figures.comparison_table import comparison_table

    console = Console()
    console.print(comparison_table({result.variant: result.metrics for result in results}))
    for picture in pictures:
        console.print(f"figure     {picture}", soft_wrap=True, highlight=False)
    console.print(f"recordings {folder}", soft_wrap=True, highlight=False)
