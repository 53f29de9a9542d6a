"""Options and results that the benchmarks share."""

import argparse
import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from omni_core.sensors import LineSensor
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary

BLIND = ("feedback=velocity_sensor", "simulation.render_lines=false")
_CONFIG = Path(__file__).resolve().parents[1] / "config"

Metrics = dict[str, tuple[Any, ...]]
"""Value, unit and, if there is one, limit of each metric, keyed by ``quantity.case``."""


def options(words: str | None, **defaults: Any) -> argparse.Namespace:
    """Return the options that are given on the command line.

    Args:
        words: docstring of the benchmark, whose first line becomes the help text.
        **defaults: default value of each option other than ``--json``, keyed by the option's name;
            an option with the default False is a flag.
    """
    parser = argparse.ArgumentParser(description=(words or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    for name, default in defaults.items():
        kind: Any = {"action": "store_true"} if default is False else {"type": type(default)}
        words = f"default: {default}"
        parser.add_argument(f"--{name.replace('_', '-')}", default=default, help=words, **kind)
    return parser.parse_args()


def load(experiment: str, variant: str, *changes: str) -> ExperimentConfiguration:
    """Return a variant of an experiment of this workspace."""
    return ExperimentLibrary(_CONFIG).load(experiment, variant, changes)


def camera(name: str) -> LineSensor:
    """Return the first camera of a file of ``config/sensors/``, placed at the vehicle's center."""
    mounted = ExperimentLibrary(_CONFIG).camera(name)
    return dataclasses.replace(mounted, x=0.0, y=0.0, heading_deg=0.0)


def fastest(action: Callable[[], object], repeats: int) -> float:
    """Run an action several times, and return the shortest CPU time of one run [s]."""

    def spent() -> float:
        begun = time.process_time()
        action()
        return time.process_time() - begun

    return min(spent() for _ in range(repeats))


def publish(name: str, metrics: Metrics, *, as_json: bool) -> None:
    """Print metrics as rows or as one JSON document."""
    if as_json:
        entries = {
            key: dict(zip(("value", "unit", "limit"), entry, strict=False))
            for key, entry in metrics.items()
        }
        print(json.dumps({"name": name, "metrics": entries}, indent=2, allow_nan=False))
        return
    for key, (value, unit, *limit) in metrics.items():
        note = f"  (limit {limit[0]:g})" if limit else ""
        print(f"{key:46} {value:12.4g} {unit}{note}")
