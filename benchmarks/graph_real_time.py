"""Measure the speed of the whole graph compared with the same loop in one process.

The graph has four processes and three cameras of 1024 px at 2500 lines/s, and everything is
recorded. For each variant of the standard experiment, the graph and the single process run in turn.
The benchmark prints the simulated time divided by the elapsed time of both, without start-up and
shutdown, and the ratio of the two.
"""

import statistics
import tempfile
import time
from pathlib import Path

import output

from omni_runs.experiment import ExperimentConfiguration
from omni_runs.graph.run_variant import finish_runs, run_variant
from omni_runs.loop import run_closed_loop
from omni_sim.simulator import Simulator


def graph_factor(configuration: ExperimentConfiguration, variant: str) -> float:
    """Return the real-time factor of a run over the graph."""
    with tempfile.TemporaryDirectory() as folder:
        (result,) = finish_runs([run_variant(configuration, variant, Path(folder) / variant)])
    return result.history.real_time_factor


def process_factor(configuration: ExperimentConfiguration) -> float:
    """Return the real-time factor of the same run in this process."""
    simulator = Simulator(configuration)
    start = time.perf_counter()
    history = run_closed_loop(configuration, simulator)
    return float(history.time[-1]) / (time.perf_counter() - start)


def main() -> None:
    """Run the comparison and print its metrics."""
    options = output.options(__doc__, repeats=5)
    metrics: output.Metrics = {}
    for variant in ("unassisted", "allocation", "assisted"):
        configuration = output.load("straight_line", variant)
        process_factor(configuration)  # loads the kernels
        pairs = [
            (graph_factor(configuration, variant), process_factor(configuration))
            for _ in range(options.repeats)
        ]
        graph, process = (statistics.median(column) for column in zip(*pairs, strict=True))
        ratio = statistics.median(p / g for g, p in pairs)
        metrics[f"real_time_factor.{variant}"] = graph, "1"
        metrics[f"real_time_factor_of_one_process.{variant}"] = process, "1"
        metrics[f"time_over_one_process.{variant}"] = ratio, "1"
    output.publish("graph_real_time", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
