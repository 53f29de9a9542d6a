"""No right file is corrected, and the cause of a mistake is among those that are named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from made_commissioning import MISTAKES, Case, omni, right_case, wrong_case

from omni_core.kinematics import PlatformKinematics
from omni_tools.commissioning.causes import Stated
from omni_tools.commissioning.mistakes import corrected
from omni_tools.commissioning.signals import Motions


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


def test_a_swap_is_found_while_the_vehicle_turns_about_the_center_of_its_wheels() -> None:
    x, y, turn = 0.03, -0.04, 1.5
    wheels = {
        name: dataclasses.replace(mount, x=mount.x + x, y=mount.y + y)
        for name, mount in omni(4, 0.0, 0.1, 0.04).items()
    }
    motion = np.diag([1.9, 1.9, turn])
    motion[2, :2] = y * turn, -x * turn
    angle = PlatformKinematics.of(wheels).wheel_speeds(motion)[:, [0, 3, 2, 1]]
    force = 0.3 * np.sign(np.diag(np.diag(motion)))[:, :2]
    motions = Motions(angle, motion, motion[:, 2], force, slice(0, 0))
    found = Case(wheels, motions, Stated(np.array([1.9, 1.9, turn])), "swap").findings()
    assert [one.name for one in found.mistakes] == ["wheels wheel_1 and wheel_3 are swapped"]
