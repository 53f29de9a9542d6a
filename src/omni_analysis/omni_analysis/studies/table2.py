"""Table 2: orientation change and stopping distance under every control law.

Without options it runs the identified vehicle of ``config/``; ``--identify`` seeks it anew,
``--assumptions`` changes what was not sought.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from omni_analysis.figures.data_table import write_columns
from omni_analysis.figures.style import save_figure
from omni_analysis.identification import table_2
from omni_analysis.identification.assumptions import ASSUMPTIONS, EXPERIMENT, under
from omni_analysis.identification.figures import sensitivity_map, trade_off, weighting_functions
from omni_analysis.identification.files import write_files
from omni_analysis.identification.identification import (
    GENERATIONS,
    configure,
    measure,
    parameters_of,
    search,
)
from omni_analysis.identification.sensitivity import Sensitivity, sensitivities
from omni_analysis.studies import StudyResult, StudyRun, claim
from omni_platform.configuration import Configuration, parameter


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Whether the vehicle is sought."""

    identify: bool = parameter(
        False,
        description="seek the vehicle that gives Table 2 (minutes); its configuration files are "
        "written beside the results",
    )
    sound: bool = parameter(
        False,
        description="seek only among vehicles whose load stands over the area between the wheels "
        "and whose wheels carry no more than the tire is known for",
    )
    assumptions: bool = parameter(
        False,
        description="also run the vehicle with other tires, wheels and patches, one change at a "
        "time",
    )
    seed: int = parameter(1, description="of the search", minimum=0)
    generations: int = parameter(
        GENERATIONS, description="generations of the search at most", minimum=1
    )


def run(options: Options, study: StudyRun) -> StudyResult:
    """Measure the ten numbers and how they depend on what was identified."""
    bases = {case: study.experiments.load(EXPERIMENT, case) for case in table_2.CASES}
    files: list[Path] = []
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
        files += write_files(bases[table_2.CASES[0]], study.folder)
    measured = measure(bases)
    parameters = parameters_of(bases[table_2.CASES[0]])
    sensitivity = sensitivities(bases, parameters)
    files += _write(measured, parameters, sensitivity, study.folder)
    bands: tuple[str, ...] = ()
    if options.assumptions:
        files.append(study.folder / "assumptions.csv")
        bands = _change_assumptions(study, parameters, files[-1])
    deviations = table_2.deviations(measured)
    worst = max(deviations, key=lambda name: _magnitude(deviations[name]))
    within = sum(abs(deviation) <= 1.0 for deviation in deviations.values())
    findings = (
        claim(
            "One vehicle gives the ten numbers of Table 2",
            f"{within} of {len(deviations)} are within their tolerance; the farthest is {worst}, "
            f"{_magnitude(deviations[worst]):.2f} of its tolerance beside the dissertation's",
            holds=within == len(deviations),
        ),
        *_trade_off(measured),
        *bands,
    )
    return StudyResult(table_2.metrics(measured), tuple(files), findings)


def _change_assumptions(
    study: StudyRun, parameters: Mapping[str, float], path: Path
) -> tuple[str, ...]:
    """Write the ten numbers under every assumption, and say how far apart they are."""
    rows: list[dict[str, float]] = []
    for numbers in under(study.experiments, parameters):
        study.report(len(rows) / len(ASSUMPTIONS), ASSUMPTIONS[len(rows)].name)
        rows.append(numbers)
    columns = {name: [row[name] for row in rows] for name in table_2.REFERENCES}
    write_columns(path, {"changed": [each.name for each in ASSUMPTIONS], **columns})
    cases = ", ".join(
        f"{case} {min(turned):.0f} to {max(turned):.0f} deg and {min(way):.1f} to {max(way):.1f} m"
        for case in table_2.CASES
        for turned, way in [
            (columns[f"orientation_change.{case}"], columns[f"stopping_distance.{case}"])
        ]
    )
    return (f"With what was assumed changed, one thing at a time: {cases}",)


def _trade_off(measured: Mapping[str, float]) -> Iterator[str]:
    """Say whether the weightings come in the order that section 3.5 gives them."""
    cases = [case for case in table_2.CASES if case != "unassisted"]
    turned = [measured[f"orientation_change.{case}"] for case in cases]
    distance = [measured[f"stopping_distance.{case}"] for case in cases]
    free = measured["orientation_change.unassisted"]
    yield claim(
        "Every control law keeps the orientation better than no assistant",
        f"{min(turned):.1f} to {max(turned):.1f} deg against {free:.1f} deg",
        holds=max(turned) < free,
    )
    best, shortest = cases[turned.index(min(turned))], cases[distance.index(min(distance))]
    yield claim(
        "Orientation is paid for by distance",
        f"{best} turns least, by {min(turned):.1f} deg in {distance[cases.index(best)]:.2f} m; "
        f"{shortest} stops shortest, in {min(distance):.2f} m by "
        f"{turned[cases.index(shortest)]:.1f} deg",
        holds=best != shortest,
    )


def _magnitude(deviation: float) -> float:
    """Return the magnitude, infinite for a vehicle that does not stop."""
    return abs(deviation) if math.isfinite(deviation) else math.inf


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _write(
    measured: Mapping[str, float],
    parameters: Mapping[str, float],
    sensitivity: Sensitivity,
    folder: Path,
) -> list[Path]:
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
    identification = folder / "identification.json"
    identification.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n")
    return [
        write_columns(folder / "table_2.csv", table),
        write_columns(folder / "sensitivity.csv", sensitivity.columns()),
        identification,
        save_figure(trade_off(measured), folder / "trade_off.png"),
        save_figure(weighting_functions(), folder / "weighting.png"),
        save_figure(sensitivity_map(sensitivity), folder / "sensitivity.png"),
    ]
