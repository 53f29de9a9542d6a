"""Runs of an experiment's variants over the ROS graph: start, progress, end, results.

A run is a generator that yields while it waits for its processes, so several runs can proceed at
the same time.
"""

import contextlib
import dataclasses
import functools
import math
import tempfile
import time
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from omni_core.configuration import WorkError
from omni_ros.environment import node_environment
from omni_runs.experiment import ExperimentConfiguration
from omni_runs.graph import nodes as graph
from omni_runs.graph import process_group as processes
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.run_folder import write_configuration
from omni_runs.history import RunHistory
from omni_runs.metrics import Metric, still_rolls
from omni_runs.recorded_run import read_run
from omni_runs.stops import drive_metrics, named_stops, stop_metrics

Progress = Callable[[Mapping[str, float] | str], None]


class RunError(WorkError):
    """A run failed; its recording up to the failure is kept."""


@dataclasses.dataclass(frozen=True)
class VariantResult:
    """Results of the finished run of one variant.

    Attributes:
        variant: name of the variant.
        folder: rosbag2 folder of the recording.
        history: time histories, read back from the recording.
        stops: part of the history for each stop, keyed by the name of the stop.
        metrics: metrics by quantity, keyed by the name of the stop; if there are several stops, the
            entry of the variant has the metrics of the whole run.
    """

    variant: str
    folder: Path
    history: RunHistory
    stops: Mapping[str, RunHistory]
    metrics: Mapping[str, Mapping[str, Metric]]

    def still_moving(self) -> str:
        """Return a warning if the vehicle still rolls with the pedal down, or an empty text."""
        if not still_rolls(self.history):
            return ""
        return (
            f"{self.variant}: the pedal is down and the vehicle still moves at "
            f"{self.history.time[-1]:.2f} s, the end of the run (simulation.duration_limit)"
        )


Run = Generator[None, None, Callable[[], VariantResult]]
"""Generator that performs a run; each step handles new reports and processes that have ended.

It returns a function that reads the recording of the run and computes the results.
"""

Begin = Callable[[Callable[[], VariantResult]], Callable[[], VariantResult]]
"""Function that begins a call, and returns a function that awaits its result"""


def finish_runs(
    runs: Iterable[Run], at_once: int = 1, begin: Begin = lambda results: results
) -> Iterator[VariantResult]:
    """Advance runs until they end, and yield the result of each run.

    The results of a run are computed while the nodes of the next run start. If a run fails or the
    iterator is closed, all processes of the other runs are ended.

    Args:
        runs: generators from `run_variant` that have not started.
        at_once: number of simultaneous runs.
        begin: function that begins to compute the results, such as `fork_server.Worker.begin`; by
            default, they are computed in this process.

    Raises:
        RunError: a run failed; of several failures, the first one is raised.
    """
    waiting, running = list(runs), list[Run]()
    with contextlib.ExitStack() as stack:

        def start_next() -> None:
            if waiting:
                running.append(stack.enter_context(contextlib.closing(waiting.pop(0))))
                next(running[-1])

        for _ in range(at_once):
            start_next()
        while running:
            for run in tuple(running):
                try:
                    next(run)
                except StopIteration as end:
                    running.remove(run)
                    results = begin(end.value)
                    try:
                        start_next()
                    finally:  # the results of a finished run are kept if the next one cannot start
                        yield results()
            time.sleep(0.05)


def run_variant(
    configuration: ExperimentConfiguration,
    variant: str,
    folder: Path,
    *,
    lockstep: bool = True,
    on_progress: Progress = lambda _: None,
    recording: Mapping[str, Any] = graph.PLAIN,
    external: Collection[str] = (),
) -> Run:
    """Run one variant as a graph of node processes in its own ROS domain, and record it.

    Args:
        configuration: configuration of the whole loop.
        variant: name of the variant, for the results.
        folder: rosbag2 folder to be created.
        lockstep: whether the nodes wait for each other in each step, so that a run is
            reproducible bit by bit; otherwise the steps follow the wall clock.
        on_progress: function that is called with time [s], speed [m/s] and completed share (0 to 1)
            during the run, and before it with a text on what the nodes do.
        recording: parameters of the recorder.
        external: names of nodes that are not started, because a user's node replaces them.

    Returns:
        The run, to be passed to `finish_runs`.

    Raises:
        RunError: a node ended, stopped sending or lost data; the message names it.
    """
    with reserved_domain() as domain, tempfile.TemporaryDirectory(prefix="omni-") as scratch:
        nodes = graph.Nodes(configuration, Path(scratch), lockstep)
        try:
            with processes.ProcessGroup(node_environment(domain)) as group:
                started = [group.start(node) for node in nodes.of_run(folder, recording, external)]
                recorder, simulator = started[0], started[-1]
                yield from group.await_begin(recorder, folder)
                write_beside_bag(configuration, folder, recorder)
                report = yield from group.follow(simulator, on_progress)
                check_report(report)
            group.raise_if_failed()  # the nodes end before the recorder
            processes.check_counts(recorder.new_reports(), report["sent"])
        except processes.ProcessError as error:
            # A node that waits for a halted node stops sending too, so the halted node is reported
            # as the cause.
            raise RunError(group.first_halt(besides=simulator) or str(error)) from None
    return functools.partial(measured, report, variant, folder, configuration)


def measured(
    report: Mapping[str, Any], variant: str, folder: Path, configuration: ExperimentConfiguration
) -> VariantResult:
    """Return the results of the finished run of one variant.

    Args:
        report: last report of the simulator.
        variant: name of the variant.
        folder: rosbag2 folder of the run.
        configuration: configuration of the whole loop.
    """
    from omni_runs.limit.bounds import limit_share  # needs kernels, unlike the rest of this module

    # `wall` is the wall-clock time from the first to the last step, without the start-up.
    real_time_factor = report["time"] / report["wall"] if report["wall"] > 0.0 else math.nan
    history = dataclasses.replace(read_run(folder), real_time_factor=real_time_factor)
    stops = named_stops(history, variant)
    whole = {"real_time_factor": Metric(real_time_factor, "1")}
    for limit in ("overload", "tipping"):
        time_beyond, warning = report["limits"].get(limit, (0.0, ""))
        whole[f"{limit}_time"] = Metric(time_beyond, "s", note=warning)
    if len(stops) > 1:
        whole = drive_metrics(history, len(stops)) | whole
    metrics = {variant: whole}
    for name, stop in stops.items():
        measures = stop_metrics(stop)
        distance = measures["stopping_distance"].value
        measures["limit_share"] = limit_share(stop, configuration, distance)
        metrics[name] = measures | metrics.get(name, {})
    return VariantResult(variant, folder, history, stops, metrics)


def write_beside_bag(
    configuration: ExperimentConfiguration, folder: Path, recorder: processes.RunningProcess
) -> None:
    """Wait until the recorder has created the folder, then save the configuration in it."""
    while not folder.is_dir():
        if processes.wait_for(recorder) is not None:
            raise processes.ProcessError(processes.describe_end(recorder))
    try:
        write_configuration(configuration, folder)
    except OSError as error:
        raise processes.ProcessError(f"cannot write to {folder}: {error.strerror}") from None


def check_report(report: Mapping[str, Any], longest_silence: float = 1.0) -> None:
    """Check, by the simulator's last report, that the run finished and all nodes kept sending.

    Args:
        report: last report of the simulator.
        longest_silence: limit on the time without a message from a node [s]; pauses on a busy
            machine are shorter.

    Raises:
        ProcessError: a node stopped sending, or the run did not finish.
    """
    if report["finished"] == "running":
        raise processes.ProcessError(
            f"the simulator was stopped at {report['time']:.2f} s, before the end of the run"
        )
    silence, node = max(((time, node) for node, time in report["silence"].items()), default=(0, ""))
    if silence > longest_silence:  # the longest silence began first and caused the others
        raise processes.ProcessError(
            f"{node} published nothing for {silence:.1f} s: the vehicle braked on all wheels"
        )
