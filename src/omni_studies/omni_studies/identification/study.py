"""The study ``table2``, and the configuration files of an identified vehicle."""

import math
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from omni_core.configuration import Configuration, parameter, to_mapping
from omni_runs.experiment import ExperimentConfiguration
from omni_runs.metrics import Metric
from omni_studies.identification import figures, identification, sensitivity, table_2
from omni_studies.study import StudyResult, StudyRun

VEHICLE = "table_2_mecanum"
"""Name of the identified vehicle."""


class Options(Configuration):
    """Options of ``table2``: identification and assumptions."""

    identify: bool = parameter(False)
    """identify a vehicle that reproduces Table 2 (takes minutes), and write its configuration
    files next to the results"""
    sound: bool = parameter(False)
    """consider only vehicles whose load is between the wheels and whose wheel loads are within
    the range of the tire model"""
    assumptions: bool = parameter(False)
    """also vary the assumptions on tires, wheels and patches, one at a time, for this vehicle and
    two others that reproduce Table 2"""
    seed: int = parameter(1, minimum=0)
    """seed of the search"""
    generations: int = parameter(250, minimum=1, maximum=100_000)
    """limit on the number of generations of the search"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Compute the ten numbers of Table 2 and their sensitivities."""
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
    """Compute the numbers of Table 2 with each assumption changed, for all vehicles that fit.

    The tables ``assumptions.csv`` and ``vehicles.csv`` are written.

    Args:
        study: context of the study.
        parameters: the candidate, keyed by the names in `identification.QUANTITIES`.

    Returns:
        Lowest and highest value of each number for the candidate.
    """
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


def write_files(
    configuration: ExperimentConfiguration, config: Path, folder: Path
) -> tuple[Path, Path]:
    """Write vehicle and experiment of a candidate as modified copies of the files in ``config/``.

    Args:
        configuration: configuration of any variant of the candidate.
        config: folder of the files to copy, including their comments.
        folder: folder of the copies.

    Returns:
        Paths of the vehicle file and the experiment file.
    """
    values = to_mapping(configuration)
    return (
        _copied(config / f"vehicles/{VEHICLE}.yaml", values["vehicle"], folder),
        _copied(config / "experiments/turn_while_translate.yaml", values, folder),
    )


def _copied(source: Path, values: Mapping[str, Any], folder: Path) -> Path:
    """Copy a YAML file, replacing its numbers by those in `values`; return the path of the copy."""
    yaml = YAML()
    yaml.width = 110
    document = yaml.load(source)
    _replace(document, values)
    yaml.dump(document, folder / source.name)
    return folder / source.name


def _replace(document: MutableMapping[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in document.items():
        if isinstance(value, MutableMapping):
            _replace(value, values.get(key, {}))
        elif isinstance(value, float):
            document[key] = float(f"{values[key]:.10g}")
