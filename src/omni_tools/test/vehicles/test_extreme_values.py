"""Every number of an experiment is used or rejected with a sentence, at any magnitude."""

import contextlib
import math
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    ParameterInfo,
    declared_parameters,
    element_configuration,
    is_configuration,
    without_none,
)
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.history import FastRun, RunHistory
from omni_runs.loop import run_closed_loop
from omni_runs.plausibility import RemarkingLibrary

CONFIG = Path(__file__).parents[4] / "config"


def numbers(configuration: Configuration, above: str = "") -> Iterator[tuple[str, ParameterInfo]]:
    """Yield the dotted key of each number, with its bounds."""
    for name, declared, info in declared_parameters(type(configuration)):
        key, kind, value = f"{above}{name}", without_none(declared), getattr(configuration, name)
        if is_configuration(kind):
            yield from numbers(value, f"{key}.")
        elif element_configuration(kind) is not None:
            for element in value:
                yield from numbers(value[element], f"{key}.{element}.")
        elif kind in (int, float):
            yield key, info


@pytest.mark.parametrize("value", ["1e308", "-1e308", "5e-324", ".nan", ".inf"])
def test_extreme_numbers_are_used_or_refused(value: str) -> None:
    remarks: list[str] = []
    library = RemarkingLibrary(CONFIG, remarks.append)
    experiments = {
        key: name  # the last of the experiments that have this number
        for name in ("straight_line", "flow_sensors")
        for key, _ in numbers(library.load(name, "assisted"))
    }
    assert len(experiments) > 400
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for key, experiment in experiments.items():
            with contextlib.suppress(ConfigurationError):
                library.load(experiment, "assisted", [f"{key}={value}"]).check_drivable()


SHORT = (
    *("feedback=velocity_sensor", "simulation.render_lines=false"),
    *("simulation.duration_limit=0.06", "maneuver.brake_time=0.02"),
)
# The time that a run takes, values that must be the same twice, and what such a run does not read.
LEFT_OUT = (
    *("simulation.duration_limit", "simulation.physics_step", "brake_assist.wheels"),
    *("camera", "flow", "odometry", "sensors", "ground.texture"),
)


# The fast loop gives the same bits and would have to be compiled for rollers. The assistant and the
# sensors are those of the first case.
@pytest.mark.parametrize(
    ("wheels", "stop", "parts"),
    [
        ("single", run_fast_loop, ("",)),
        ("rollers", run_closed_loop, ("vehicle.", "ground.", "maneuver.", "simulation.")),
    ],
)
def test_a_stop_with_a_number_at_its_bound_is_computed(
    wheels: str,
    stop: Callable[[ExperimentConfiguration], FastRun | RunHistory],
    parts: tuple[str, ...],
) -> None:
    library = ExperimentLibrary(CONFIG)
    changes = [*SHORT, f"vehicle.wheel_model={wheels}"]
    keys = list(numbers(library.load("straight_line", "assisted", changes)))
    computed = 0
    for key, info in keys:
        least = math.nextafter(0.0, 1.0) if info.above == 0.0 else info.minimum
        for value in (least, info.maximum):
            if value is None or key.startswith(LEFT_OUT) or not key.startswith(parts):
                continue
            with contextlib.suppress(ConfigurationError):
                loaded = library.load("straight_line", "assisted", [*changes, f"{key}={value!r}"])
                run = stop(loaded)
                assert np.isfinite(run.pose).all(), f"{key}={value}"
                computed += 1
    assert computed > 150
