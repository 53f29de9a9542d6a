"""No right file is corrected, and the cause of a mistake is among those that are named."""

from __future__ import annotations

import pytest
from made_commissioning import MISTAKES, right_case, wrong_case

from omni_tools.commissioning.mistakes import corrected


def test_no_file_of_forty_right_robots_is_corrected() -> None:
    for seed in range(1000, 1040):
        found = right_case(seed).findings()
        assert corrected({}, found) == {}, (seed, found.mistakes)


def test_the_cause_of_forty_single_mistakes_is_named() -> None:
    cases = {seed: wrong_case(seed) for seed in range(1000, 1040)}
    assert len({case.cause.split()[0] for case in cases.values()}) > len(MISTAKES) // 3
    assert [seed for seed, case in cases.items() if not case.named()] == []


def test_a_measured_position_leaves_the_slip() -> None:
    for seed in range(1000, 1020):
        case = right_case(seed)
        found = case._replace(stated=case.stated._replace(placed=True)).findings()
        parts = (part for group in found.undecided for part in group)
        assert not {"lever", "place"} & {cause.key.split()[0] for part in parts for cause in part}


@pytest.mark.parametrize("seed", range(3))
def test_a_class_names_the_measurement_that_distinguishes_its_causes(seed: int) -> None:
    for group in right_case(2000 + seed).findings().undecided:
        assert all(cause.check for part in group for cause in part)
