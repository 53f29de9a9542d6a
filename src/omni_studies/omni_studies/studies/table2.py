"""Table 2: orientation change and stopping distance under every control law.

Without options it runs the identified vehicle of ``config/``; ``--identify`` repeats the search,
``--assumptions`` varies the assumptions.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass

from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, parameter
from omni_studies.identification import table_2
from omni_studies.identification.assumptions import ASSUMPTIONS, EXPERIMENT, under
from omni_studies.identification.figures import sensitivity_map, trade_off, weighting_functions
from omni_studies.identification.files import write_files
from omni_studies.identification.identification import (
    GENERATIONS,
    configure,
    measure,
    parameters_of,
    search,
)
from omni_studies.identification.sensitivity import Sensitivity, sensitivities
from omni_studies.study import StudyResult, StudyRun


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Identification and assumptions."""

    identify: bool = parameter(False)
    """seek the vehicle that gives Table 2 (minutes); its configuration files are written beside the
    results"""
    sound: bool = parameter(False)
    """seek only among vehicles whose load stands over the area between the wheels and whose wheels
    carry no more than the tire is known for"""
    assumptions: bool = parameter(False)
    """also run the vehicle with other tires, wheels and patches, one change at a time"""
    seed: int = parameter(1, minimum=0)
    """of the search"""
    generations: int = parameter(GENERATIONS, minimum=1)
    """generations of the search at most"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Compute the ten numbers and their sensitivities."""
    bases = {
        case: study.experiments.load(EXPERIMENT, case, [table_2.TWIST_ALONE])
        for case in table_2.CASES
    }
    if options.identify:
        done = 0

        def on_generation(_generation: int, cost: float) -> None:
            nonlocal done
            done += 1
            share = min(done / options.generations, 1.0)
            study.report(share, f"generation {done}, cost {cost:.2f}")

        found = search(
            bases,
            seed=options.seed,
            generations=options.generations,
            sound=options.sound,
            on_generation=on_generation,
        )
        bases = {case: configure(base, found) for case, base in bases.items()}
        study.written.extend(write_files(bases[table_2.CASES[0]], study.folder))
    measured = measure(bases)
    parameters = parameters_of(bases[table_2.CASES[0]])
    sensitivity = sensitivities(bases, parameters)
    _write(measured, parameters, sensitivity, study)
    metrics = table_2.metrics(measured)
    if options.assumptions:
        metrics |= _change_assumptions(study, parameters)
    # Infinite for a vehicle that does not stop.
    worst = max(
        abs(d) if math.isfinite(d) else math.inf for d in table_2.deviations(measured).values()
    )
    metrics["largest_deviation.all"] = Metric(worst, "1", at_most=1.0, note="in tolerances")
    return study.result(metrics)


def _change_assumptions(study: StudyRun, parameters: Mapping[str, float]) -> dict[str, Metric]:
    """Write the ten numbers for every assumption, and return their ranges."""
    rows: list[dict[str, float]] = []
    for numbers in under(study.experiments, parameters):
        study.report(len(rows) / len(ASSUMPTIONS), ASSUMPTIONS[len(rows)].name)
        rows.append(numbers)
    columns = {name: [row[name] for row in rows] for name in table_2.REFERENCES}
    changed = [each.name for each in ASSUMPTIONS]
    study.columns("assumptions.csv", {"changed": changed, **columns})
    return {
        f"{name.replace('.', f'_{end}.')}": Metric(pick(values), table_2.unit(name))
        for name, values in columns.items()
        for end, pick in (("low", min), ("high", max))
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _write(
    measured: Mapping[str, float],
    parameters: Mapping[str, float],
    sensitivity: Sensitivity,
    study: StudyRun,
) -> None:
    names = list(table_2.REFERENCES)
    document = {
        "parameters": dict(parameters),
        "change_per_step": {
            number: dict(zip(sensitivity.parameters, map(_finite, row.tolist()), strict=True))
            for number, row in zip(sensitivity.numbers, sensitivity.slope, strict=True)
        },
    }
    table = {
        "number": names,
        "unit": [table_2.unit(name) for name in names],
        "value": [measured[name] for name in names],
        "dissertation": [table_2.REFERENCES[name] for name in names],
        "deviation": [measured[name] - table_2.REFERENCES[name] for name in names],
        "tolerance": [table_2.tolerance(name) for name in names],
    }
    study.written.append(study.folder / "identification.json")
    study.written[-1].write_text(json.dumps(document, indent=2, allow_nan=False) + "\n")
    study.columns("table_2.csv", table)
    study.columns("sensitivity.csv", sensitivity.columns())
    study.figure("trade_off.png", trade_off(measured))
    study.figure("weighting.png", weighting_functions())
    study.figure("sensitivity.png", sensitivity_map(sensitivity))
