"""The identified vehicle compared with Table 2, and the search that found it."""

from __future__ import annotations

import dataclasses
import math
import re
import shutil
from pathlib import Path

import pytest

from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_studies.identification import table_2
from omni_studies.identification.identification import (
    QUANTITIES,
    assumption_violation,
    configure,
    cost,
    measure,
    parameters_of,
    rounded,
    search,
)
from omni_studies.identification.sensitivity import (
    ASSUMPTIONS,
    OTHERS,
    Sensitivity,
    sensitivities,
    under,
)
from omni_studies.identification.study import write_files

CONFIG = Path(__file__).resolve().parents[4] / "config"
PAGE = Path(table_2.__file__).with_name("README.md").read_text(encoding="utf-8")
MIDDLE = rounded([(quantity.low + quantity.high) / 2.0 for quantity in QUANTITIES])

Bases = dict[str, ExperimentConfiguration]


@pytest.fixture(scope="module")
def bases() -> Bases:
    library = ExperimentLibrary(CONFIG)
    return {
        case: library.load("turn_while_translate", case, [table_2.TWIST_ALONE])
        for case in table_2.CASES
    }


@pytest.fixture(scope="module")
def measured(bases: Bases) -> dict[str, float]:
    return measure(bases)


@pytest.fixture(scope="module")
def sensitivity(bases: Bases) -> Sensitivity:
    return sensitivities(bases, parameters_of(bases["k7"]))


@pytest.mark.parametrize("name", table_2.REFERENCES)
def test_identified_vehicle_gives_table_2(measured: dict[str, float], name: str) -> None:
    assert abs(measured[name] - table_2.REFERENCES[name]) <= table_2.tolerance(name)


def test_order_of_table_2_holds(measured: dict[str, float]) -> None:
    for quantity in ("orientation_change", "stopping_distance"):
        ours = sorted(table_2.CASES, key=lambda case: measured[f"{quantity}.{case}"])
        printed = sorted(table_2.CASES, key=lambda case: table_2.REFERENCES[f"{quantity}.{case}"])
        assert ours == printed


def test_numbers_do_not_hang_on_the_physics_step(bases: Bases, measured: dict[str, float]) -> None:
    fine = {
        case: dataclasses.replace(
            base, simulation=dataclasses.replace(base.simulation, physics_step=0.0001)
        )
        for case, base in bases.items()
    }
    for name, value in measure(fine).items():
        assert abs(value - measured[name]) < 0.5 * table_2.tolerance(name)


def test_tolerances_are_the_agreed_ones() -> None:
    assert table_2.tolerance("orientation_change.unassisted") == pytest.approx(4.19)
    assert table_2.tolerance("orientation_change.zero") == 2.0
    assert table_2.tolerance("stopping_distance.k1") == pytest.approx(0.279)


def test_cost_is_the_sum_of_squares_and_dear_far_away(
    bases: Bases, measured: dict[str, float]
) -> None:
    found = cost(bases, parameters_of(bases["k7"]))
    squares = sum(value**2 for value in table_2.deviations(measured).values())
    assert found == pytest.approx(squares)
    assert cost(bases, {**parameters_of(bases["k7"]), "speed": 3.0}) > 100.0
    # The load alone would tip the platform over.
    falls = {**MIDDLE, "body_mass": 0.1, "load_x": 0.8, "wheelbase": 1.0}
    assert math.isinf(cost(bases, falls))


def test_parameters_survive_the_configuration_and_its_files(bases: Bases, tmp_path: Path) -> None:
    configured = configure(bases["k1"], MIDDLE)
    assert parameters_of(configured) == MIDDLE
    vehicle, experiment = write_files(configured, CONFIG, tmp_path)
    shutil.copytree(CONFIG, tmp_path / "config")
    shutil.copy(vehicle, tmp_path / "config/vehicles")
    shutil.copy(experiment, tmp_path / "config/experiments")
    read = ExperimentLibrary(tmp_path / "config").load(
        "turn_while_translate", "k1", [table_2.TWIST_ALONE]
    )
    assert read == configured


def test_committed_files_are_what_the_study_writes(bases: Bases, tmp_path: Path) -> None:
    vehicle, experiment = write_files(bases["unassisted"], CONFIG, tmp_path)
    assert vehicle.read_text() == (CONFIG / "vehicles" / vehicle.name).read_text()
    assert experiment.read_text() == (CONFIG / "experiments" / experiment.name).read_text()


def test_identified_values_are_in_the_box_that_was_searched(bases: Bases) -> None:
    found = parameters_of(bases["k7"])
    for quantity in QUANTITIES:
        assert quantity.low <= found[quantity.name] <= quantity.high


def test_search_gets_better(bases: Bases) -> None:
    costs: list[float] = []
    first = search(bases, seed=3, generations=1, on_generation=lambda _, best: costs.append(best))
    assert cost(bases, first, 4) == pytest.approx(costs[-1])
    assert cost(bases, first) < cost(bases, MIDDLE)


def test_a_load_that_overhangs_or_a_wheel_beyond_its_tire_is_not_sound(bases: Bases) -> None:
    found = parameters_of(bases["k7"])
    overhang = found["load_y"] / (0.5 * found["track"]) - 1.0
    overload = 6099.0 / 6000.0 - 1.0  # front left, README.md of the package
    violation = assumption_violation(configure(bases["k7"], found).vehicle)
    assert violation == pytest.approx(overhang + overload, rel=1e-3)
    assert cost(bases, found, sound=True) > 100.0 * cost(bases, found)
    inside = {**found, "load_y": 0.3, "load_mass": 300.0}
    assert assumption_violation(configure(bases["k7"], inside).vehicle) == 0.0
    assert cost(bases, inside, sound=True) == cost(bases, inside)


@pytest.mark.parametrize("vehicle", OTHERS)
def test_a_sound_vehicle_gives_table_2_as_well(bases: Bases, vehicle: str) -> None:
    assert dict(OTHERS[vehicle]) == rounded([OTHERS[vehicle][one.name] for one in QUANTITIES])
    variants = {case: configure(base, OTHERS[vehicle]) for case, base in bases.items()}
    assert assumption_violation(variants["k7"].vehicle) == 0.0
    for name, value in measure(variants).items():
        assert abs(value - table_2.REFERENCES[name]) < 0.85 * table_2.tolerance(name)


def test_the_page_has_the_numbers_of_other_assumptions(
    bases: Bases, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Kernels of other tires and wheels take long to compile.
    quick = [one for one in ASSUMPTIONS if not re.search("Magic|linear|rollers", one.name)]
    monkeypatch.setattr("omni_studies.identification.sensitivity.ASSUMPTIONS", quick)
    rows = under(ExperimentLibrary(CONFIG), parameters_of(bases["k7"]))
    for one, numbers in zip(quick, rows, strict=True):
        line = re.search(rf"^\| {one.name} \|(.*)\|$", PAGE, re.M)
        assert line, one.name
        for cell, value in zip(line[1].split("|"), numbers.values(), strict=True):
            shown, low, high = map(float, re.findall(r"[\d.]+", cell))
            assert shown == pytest.approx(value, rel=0.03, abs=0.6), one.name
            assert low - 0.6 <= value <= high + 0.6


def test_refinement_is_reproducible_and_makes_the_largest_deviation_smaller(bases: Bases) -> None:
    found = parameters_of(bases["k7"])
    slower = {**found, "speed": found["speed"] - 0.15}
    better = search(bases, start=slower, seed=1, generations=1)
    assert search(bases, start=slower, seed=1, generations=1) == better
    assert cost(bases, better, 4) < cost(bases, slower, 4)


def test_distance_grows_with_the_square_of_the_speed(
    bases: Bases, sensitivity: Sensitivity, measured: dict[str, float]
) -> None:
    # d ~ v^2 on even ground; a patch that ends makes the growth differ, but not by its half.
    place = sensitivity.parameters.index("speed")
    speed = next(quantity for quantity in QUANTITIES if quantity.name == "speed")
    row = sensitivity.numbers.index("stopping_distance.unassisted")
    distance = measured["stopping_distance.unassisted"]
    expected = 2.0 * distance / parameters_of(bases["k7"])["speed"] * speed.step
    assert sensitivity.slope[row, place] == pytest.approx(expected, rel=0.5)


def test_slippery_ground_lengthens_every_stop(sensitivity: Sensitivity) -> None:
    place = sensitivity.parameters.index("friction")
    for row, number in enumerate(sensitivity.numbers):
        if number.startswith("stopping_distance"):
            assert sensitivity.slope[row, place] < 0.0
