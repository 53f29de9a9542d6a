"""Sweeps: an experiment with several values of one or more keys, run in one process.

The override ``vehicle.load.mass=0,100,250`` causes three runs; several such overrides cause a run
for each combination. The results are bit-identical to those of runs over the ROS graph.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from omni_core.configuration import ConfigurationError
from omni_runs import experiment, history
from omni_runs.metrics import Metric
from omni_runs.options import is_swept
from omni_runs.stops import named_stops, stop_metrics
from omni_runs.yaml_files import load_yaml

MOST = 1000
"""Limit on the number of runs of a sweep."""

SHOWN = {
    "stopping_distance": "distance",
    "orientation_change": "rotation",
    "lateral_deviation": "deviation",
    "stopping_time": "time",
}
"""Short label of each quantity in the table of a sweep; the figure shows the same quantities."""


@dataclasses.dataclass(frozen=True)
class SweptRun:
    """One stop of a parameter sweep; most runs have only one.

    Attributes:
        variant: variant of the experiment, followed by ``/stop_<N>`` if its run has several stops.
        values: value of each swept key as a text, keyed by the dotted key.
        metrics: metrics of the stop, keyed by quantity.
    """

    variant: str
    values: Mapping[str, str]
    metrics: Mapping[str, Metric]


def combinations(overrides: Iterable[str]) -> Iterator[tuple[dict[str, str], tuple[str, ...]]]:
    """Yield a pair for each combination: the values of the swept keys, and all overrides.

    The values are texts, keyed by dotted key.

    Raises:
        ConfigurationError: a value is missing, or there are more than `MOST` combinations.
    """
    choices: list[list[tuple[str, str, str]]] = []
    for text in overrides:
        if not is_swept(text):
            choices.append([("", "", text)])
            continue
        key, _, value = text.partition("=")
        values = [part.strip() for part in value.split(",")]
        if not all(values):
            raise ConfigurationError(key, f"{value[:80]!r} lacks a value between commas")
        choices.append([(key.strip(), one, f"{key}={one}") for one in values])
    if (count := math.prod(map(len, choices))) > MOST:
        raise ConfigurationError("--set", f"gives {count} combinations, more than {MOST}")
    for chosen in itertools.product(*choices):
        yield {key: one for key, one, _ in chosen if key}, tuple(text for *_, text in chosen)


def short_keys(keys: Iterable[str]) -> dict[str, str]:
    """Return the shortest unambiguous end of each dotted key, such as ``mass``, keyed by key."""
    parts = {key: key.split(".") for key in keys}
    short = {}
    for key, own in parts.items():
        others = [other for name, other in parts.items() if name != key]
        counts = range(1, len(own) + 1)
        count = next((n for n in counts if all(o[-n:] != own[-n:] for o in others)), len(own))
        short[key] = ".".join(own[-count:])
    return short


def sweep(
    configurations: Sequence[tuple[str, Mapping[str, str], experiment.ExperimentConfiguration]],
    report: Callable[[float, str], None],
) -> list[SweptRun]:
    """Run all combinations of a sweep; return their stops in the order of `configurations`.

    Args:
        configurations: variant, values of the swept keys, and configuration of each run.
        report: function that is called with the completed share (0 to 1) and a text.
    """
    results = []
    for done, (variant, values, configuration) in enumerate(configurations):
        words = ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in values.items())
        report(done / len(configurations), f"{variant}, {words}")
        stops = named_stops(_run(configuration), variant)
        results += [SweptRun(name, values, stop_metrics(stop)) for name, stop in stops.items()]
    return results


def _run(configuration: experiment.ExperimentConfiguration) -> history.RunHistory:
    # Imported here, so that commands without a sweep start faster.
    from omni_runs import compiled, loop

    if configuration.feedback == "velocity_sensor" and not configuration.simulation.render_lines:
        return compiled.run_fast_loop(configuration)
    return loop.run_closed_loop(configuration)


def number(text: str) -> float | None:
    """Return the number in a text; None if the text is not a number."""
    value = load_yaml(text)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
