"""The table of conditions agrees with the kernels and pages that use it."""

from pathlib import Path

import pytest

from omni_brake_assist.conditions import (
    ASSISTING,
    CONDITIONS,
    DEAD_RECKONING,
    DISABLED,
    ERROR,
    NO_EFFECT,
    OK,
    AssistState,
    states_table,
)

README = Path(__file__).parents[1] / "README.md"


def test_every_state_has_a_condition_and_one_level() -> None:
    for state in AssistState:
        assert len({row.level for row in CONDITIONS if row.state is state}) == 1


@pytest.mark.parametrize("code", [DISABLED, NO_EFFECT, DEAD_RECKONING, ASSISTING])
def test_the_number_of_a_condition_is_its_row(code: int) -> None:
    names = {DISABLED: "disabled", NO_EFFECT: "no_effect"}
    names |= {DEAD_RECKONING: "dead_reckoning", ASSISTING: "assisting"}
    assert CONDITIONS[code].state.value == names[code]


def test_a_fault_is_above_ok_and_silence_is_an_error() -> None:
    assert not AssistState.DEAD_RECKONING.is_fault
    assert AssistState.IMPLAUSIBLE_FEEDBACK.is_fault
    assert AssistState.NO_DEMAND.level == ERROR
    assert AssistState.INACTIVE.level == OK


def test_the_readme_prints_the_table() -> None:
    text = README.read_text(encoding="utf-8")
    assert f"<!-- states -->\n{states_table()}<!-- /states -->" in text
