"""Experiments of section 3.6, with every variant run in one process: Figures 30 to 48, Table 2.

A figure of the dissertation is written to ``figure_<number>.png``, and its data to
``figure_<number>.csv``. The dissertation's assistant uses only the twist, whereas this assistant
also compares the twist with IMU and wheel speeds. If an experiment uses these sensors, the assisted
variant is repeated without them, as ``<variant>_twist_alone``.

``table2`` brakes the identified vehicle of ``config/``. ``--identify`` repeats the search for this
vehicle; ``--assumptions`` changes one assumption at a time.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_figures.run_figures import scene_of
from omni_figures.time_series import time_series, while_braking
from omni_figures.top_view import top_view
from omni_loop import compiled, loop
from omni_loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_loop.history import RunHistory
from omni_loop.metrics import Metric, run_metrics
from omni_loop.options import LoopOptions
from omni_platform.configuration import Configuration, parameter
from omni_platform.quantities import FloatArray
from omni_studies.identification import figures, identification, sensitivity, table_2
from omni_studies.identification.files import VEHICLE, write_files
from omni_studies.study import StudyResult, StudyRun

CASES = {
    "straight_line": "Emergency braking of the vehicle of Table 2, straight ahead: "
    "Figures 30 to 32",
    "three_wheel_diagonal": "The three-wheeled robot stops from a diagonal motion: Figures 33 "
    "to 35",
    "ice_patch": "Braking with a front wheel on ice: Figures 36 to 38",
    "ice_patch_noisy": "Braking on ice with noisy feedback, Eqs. (60), (61): Figures 39 to 42",
    "turn_while_translate": "Braking from a turn-while-translate maneuver, with every "
    "weighting: Figures 43 to 48",
    "table2": "Table 2: orientation change and stopping distance with each control law",
}

_QUANTITIES = (
    "orientation_change",
    "stopping_distance",
    "lateral_deviation",
    "stopping_time",
    "peak_yaw_rate",
    "brake_switchings",
)
_ALONE = "_twist_alone"
_TWIST_ALONE = "brake_assist.fault_detection=false"
_LABELS = ("$v_x$ [m/s]", "$v_y$ [m/s]", r"$\omega$ [rad/s]")


@dataclasses.dataclass(frozen=True)
class ExperimentRuns:
    """Variants of an experiment after their runs.

    Attributes:
        configurations: configurations by variant.
        histories: runs by variant.
    """

    configurations: Mapping[str, ExperimentConfiguration]
    histories: Mapping[str, RunHistory]

    @property
    def metrics(self) -> dict[str, Metric]:
        """Metrics of all variants, with the largest error, by ``<quantity>.<variant>``."""
        by_variant = {name: run_metrics(history) for name, history in self.histories.items()}
        metrics = {
            f"{quantity}.{name}": by_variant[name][quantity]
            for quantity in _QUANTITIES
            for name in by_variant
        }
        for name, history in self.histories.items():
            metrics[f"largest_error.{name}"] = Metric(largest_error(history), "m/s")
        width = next(iter(self.configurations.values())).vehicle.chassis_width
        metrics["width.vehicle"] = Metric(width, "m")
        return metrics


def largest_error(history: RunHistory) -> float:
    """Return the largest magnitude of any ``s_i`` while braking [m/s]."""
    return float(np.max(np.abs(history.error[history.brake_start :])))


def run_experiment(
    library: ExperimentLibrary, experiment: str, overrides: Sequence[str]
) -> ExperimentRuns:
    """Run every variant of an experiment in one process.

    With the velocity sensor the fast loop is used; with optical feedback, the loop with cameras.

    Args:
        library: library with the experiment.
        experiment: name of the experiment.
        overrides: ``dotted.key=value`` texts, applied to every variant.

    Raises:
        ConfigurationError: a name, key or value is invalid.
    """
    configurations = {
        variant: library.load(experiment, variant, overrides)
        for variant in library.variants(experiment, overrides)
    }
    for variant, configuration in list(configurations.items()):
        assistant = configuration.brake_assist
        if assistant.enabled and assistant.fault_detection and not configuration.uses_lines:
            alone = library.load(experiment, variant, (*overrides, _TWIST_ALONE))
            configurations[variant + _ALONE] = alone
    histories: dict[str, RunHistory] = {}
    for variant, configuration in configurations.items():
        run = loop.run_closed_loop if configuration.uses_lines else compiled.run_fast_loop
        histories[variant] = run(configuration)
    return ExperimentRuns(configurations, histories)


def table_2_vehicle(library: ExperimentLibrary, vehicle: str = VEHICLE) -> list[str]:
    """Return the overrides that turn ``straight_line`` into the dissertation's experiment.

    The overrides set the identified vehicle and ground, and a velocity sensor.

    Args:
        library: library with the experiments.
        vehicle: name of a vehicle to use instead of the identified one.
    """
    ground = library.load("turn_while_translate", "unassisted").ground
    return [f"vehicle={vehicle}", f"ground.friction={ground.friction}", "feedback=velocity_sensor"]


Options = LoopOptions


class _StraightLine(LoopOptions):
    """Options of ``straight_line``: vehicle and overrides of the experiment."""

    vehicle: str = parameter(VEHICLE)
    """a file of config/vehicles/, a path, or the folder of a vehicle"""


class _Table2(Configuration):
    """Options of ``table2``: identification and assumptions."""

    identify: bool = parameter(False)
    """identify a vehicle that reproduces Table 2 (takes minutes), and write its configuration
    files next to the results"""
    sound: bool = parameter(False)
    """consider only vehicles whose load is between the wheels and whose wheel loads are within
    the range of the tire model"""
    assumptions: bool = parameter(False)
    """also vary the assumptions on tires, wheels and patches, one at a time, for this vehicle
    and two others that reproduce the table"""
    seed: int = parameter(1, minimum=0)
    """seed of the search"""
    generations: int = parameter(250, minimum=1, maximum=100_000)
    """largest number of generations of the search"""


OPTIONS = {"straight_line": _StraightLine, "table2": _Table2}


def run(options: LoopOptions, study: StudyRun) -> StudyResult:
    """Run an experiment and draw its figures."""
    changes = options.changes
    if isinstance(options, _StraightLine):
        changes = [*table_2_vehicle(study.experiments, options.vehicle), *changes]
    runs = run_experiment(study.experiments, study.case, changes)
    for number, drawing in _FIGURES[study.case].items():
        study.plot(f"figure_{number}", drawing(runs))
    return study.result(runs.metrics)


def _table_2(options: _Table2, study: StudyRun) -> StudyResult:
    """Compute the ten numbers of the table and their sensitivities."""
    bases = {
        case: study.experiments.load(sensitivity.EXPERIMENT, case, [table_2.TWIST_ALONE])
        for case in table_2.CASES
    }
    if options.identify:
        done = 0

        def on_generation(_generation: int, cost: float) -> None:
            nonlocal done
            done += 1
            share = min(done / options.generations, 1.0)
            study.report(share, f"generation {done}, cost {cost:.2f}")

        found = identification.search(
            bases,
            seed=options.seed,
            generations=options.generations,
            sound=options.sound,
            on_generation=on_generation,
        )
        bases = {case: identification.configure(base, found) for case, base in bases.items()}
        config = study.experiments.folder
        study.written.extend(write_files(bases[table_2.CASES[0]], config, study.folder))
    measured = identification.measure(bases)
    parameters = identification.parameters_of(bases[table_2.CASES[0]])
    slopes = sensitivity.sensitivities(bases, parameters)
    columns = slopes.columns()
    study.table("sensitivity.csv", columns, zip(*columns.values(), strict=True), 6)
    study.figure("trade_off.png", figures.trade_off(measured))
    study.figure("weighting.png", figures.weighting_functions())
    study.figure("sensitivity.png", figures.sensitivity_map(slopes))
    metrics = table_2.metrics(measured)
    if options.assumptions:
        metrics |= _change_assumptions(study, parameters)
    # A vehicle that does not stop has an infinite deviation.
    worst = max(
        abs(d) if math.isfinite(d) else math.inf for d in table_2.deviations(measured).values()
    )
    metrics["largest_deviation.all"] = Metric(worst, "1", note="in tolerances")
    return study.result(metrics)


def _change_assumptions(study: StudyRun, parameters: Mapping[str, float]) -> dict[str, Metric]:
    """Write the numbers of all vehicles and assumptions; return the first vehicle's ranges."""
    vehicles = {"identified": parameters, **sensitivity.OTHERS}
    names, changed = list(table_2.REFERENCES), [each.name for each in sensitivity.ASSUMPTIONS]
    found = np.empty((len(vehicles), len(changed), len(names)))
    for i, vehicle in enumerate(vehicles.values()):
        for j, numbers in enumerate(sensitivity.under(study.experiments, vehicle)):
            share = (i * len(changed) + j) / (len(vehicles) * len(changed))
            study.report(share, f"{list(vehicles)[i]}: {changed[j]}")
            found[i, j] = [numbers[name] for name in names]
    tables = {"": found[0], "low ": found.min(axis=0), "high ": found.max(axis=0)}
    heads = ["changed", *(end + name for end in tables for name in names)]
    rows = zip(changed, *np.hstack(list(tables.values())).T, strict=True)
    study.table("assumptions.csv", heads, rows, 6)
    columns = [[*vehicle.values(), *found[i, 0]] for i, vehicle in enumerate(vehicles.values())]
    rows = zip([*parameters, *names], *columns, strict=True)
    study.table("vehicles.csv", ("number", *vehicles), rows, 6)
    return {
        f"{name.replace('.', f'_{end}.')}": Metric(float(values[k]), table_2.unit(name))
        for k, name in enumerate(names)
        for end, values in (("low", found[0].min(axis=0)), ("high", found[0].max(axis=0)))
    }


RUNS = {"table2": _table_2}

Drawing = Callable[[ExperimentRuns], Figure]
"""Draws one figure of the dissertation."""


def _over_time(variant: str) -> Drawing:
    """Draw velocity, yaw rate and errors of one variant over time."""
    return lambda runs: time_series(
        {variant: runs.histories[variant]}, title=runs.configurations[variant].description
    )


def _from_above(*variants: str) -> Drawing:
    """Draw snapshots of some variants, seen from above."""

    def drawing(runs: ExperimentRuns) -> Figure:
        configuration = runs.configurations[variants[0]]
        histories = {variant: runs.histories[variant] for variant in variants}
        return top_view(scene_of(configuration), histories, title=configuration.description)

    return drawing


def _compared_errors(runs: ExperimentRuns) -> Figure:
    """Draw the errors s_i of the assisted runs with and without sensor noise."""
    plain, noisy = runs.histories["assisted"], runs.histories["noisy"]
    labels = [f"{wheel.replace('_', ' ')}\n$s_i$ [m/s]" for wheel in noisy.wheel_names]
    errors = {
        "no noise": (plain, while_braking(plain, plain.error)),
        "noisy feedback": (noisy, while_braking(noisy, noisy.error)),
    }
    return _over_one_another(errors, "Errors with and without noise", labels)


def _compared_velocities(runs: ExperimentRuns) -> Figure:
    """Draw the velocities of the assisted runs with and without sensor noise."""
    plain, noisy = runs.histories["assisted"], runs.histories["noisy"]
    twists = {"no noise": (plain, plain.twist), "noisy feedback": (noisy, noisy.twist)}
    return _over_one_another(twists, "Velocities with and without noise", _LABELS)


def _measured(runs: ExperimentRuns) -> Figure:
    """Draw the noisy feedback and the true motion."""
    history = runs.histories["noisy"]
    feedback = history.feedback if isinstance(history, compiled.FastRun) else history.estimate
    twists = {"original": (history, history.twist), "noisy": (history, feedback)}
    return _over_one_another(twists, "Noise on the feedback", _LABELS)


def _over_one_another(
    runs: Mapping[str, tuple[RunHistory, FloatArray]],
    title: str,
    labels: Sequence[str],
    before: float = 0.2,
) -> Figure:
    """Draw values (T, K) of two runs over time, one row of axes for each of the K labels.

    The time axis starts at `before` [s] before braking.
    """
    size, x = (9.0, 1.0 + 2.6 * len(labels)), "time since braking [s]"
    figure, grid = style.panels(title, len(labels), size=size, x=x, y=labels, sharex=True)
    # The second line is thin, so that the first one remains visible.
    looks: tuple[dict[str, Any], ...] = (
        {"color": style.BLUE, "linewidth": 2.2, "zorder": 3},
        {"color": style.VERMILLION, "linewidth": 0.9, "zorder": 4},
    )
    for row, axes in enumerate(grid[:, 0]):
        axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
        axes.axvline(0.0, color=style.BLACK, linestyle=":", linewidth=1.2)
        for (name, (history, values)), look in zip(runs.items(), looks, strict=True):
            axes.plot(history.braking_time, values[:, row], label=name, **look)
    times = [history.braking_time for history, _ in runs.values()]
    grid[0, 0].set_xlim(max(-before, min(t[0] for t in times)), max(t[-1] for t in times))
    grid[0, 0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.6)
    return figure


_FIGURES: Mapping[str, Mapping[int, Drawing]] = {
    "straight_line": {
        30: _from_above("unassisted", "assisted"),
        31: _over_time("unassisted"),
        32: _over_time("assisted"),
    },
    "three_wheel_diagonal": {
        33: _from_above("unassisted", "assisted"),
        34: _over_time("unassisted"),
        35: _over_time("assisted"),
    },
    "ice_patch": {
        36: _from_above("unassisted", "assisted"),
        37: _over_time("unassisted"),
        38: _over_time("assisted"),
    },
    "ice_patch_noisy": {
        39: _from_above("unassisted", "assisted", "noisy"),
        40: _measured,
        41: _compared_errors,
        42: _compared_velocities,
    },
    "turn_while_translate": {
        43: _from_above("unassisted", "zero", "cosine"),
        44: _over_time("unassisted"),
        45: _over_time("zero"),
        46: _over_time("cosine"),
        47: _from_above("cosine", "k1", "k7"),
        48: _over_time("k1"),
    },
}
