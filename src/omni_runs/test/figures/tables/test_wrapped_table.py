"""At any usual width, no name and no number is cut or broken within a word."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from omni_core.commands.wrapped_table import WrappedTable

NUMBERS = {
    "distance\n[m]": ["10.25", "9.09"],
    "rotation\n[deg]": ["80.0 !", "-"],
    "deviation\n[mm]": ["123", "5"],
    "time\n[s]": ["1.50", "12.25"],
}
SHORT = {"mass": ["0", "250"]}
SWEPT = {
    "enabled": ["true", "false"],
    "law": ["sliding_mode", "allocation"],
    "kind": ["on_off", "proportional"],
    "variant": ["unassisted", "assisted"],
}
LONG = {
    "vehicle": ["/home/anna/a_folder/of_a_robot/vehicle.yaml", "mecanum_forklift"],
    "proportional_gain_of_the_observer": ["0.25", "1"],
    "[red]": ["my_module:MyLaw", "a-law-with-a-long-name"],
}


def printed(table: WrappedTable, width: int) -> str:
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None).print(table)
    return stream.getvalue()


@pytest.mark.parametrize("names", [SHORT, SWEPT, LONG])
@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_cell_is_cut_or_broken(names: dict[str, list[str]], width: int) -> None:
    text = printed(WrappedTable(names, NUMBERS), width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    words = text.split()
    for heading, cells in NUMBERS.items():
        for part in (*heading.split("\n"), *" ".join(cells).split()):
            assert part in words, part
    for cell in (*names, *(cell for cells in names.values() for cell in cells)):
        whole = cell.replace("_", "_ ").replace("/", "/ ").replace("-", "- ").split()
        for part in whole:  # a name may wrap between its parts only
            assert any(part in word for word in words), part


def test_a_wide_terminal_shows_one_row_for_each_case() -> None:
    rows = printed(WrappedTable(SWEPT, NUMBERS), 100).splitlines()
    assert rows[-1].split() == [
        *("false", "allocation", "proportional", "assisted"),
        *("9.09", "-", "5", "12.25"),
    ]


def test_columns_that_do_not_fit_follow_below() -> None:
    numbers = {f"quantity_{index}": [f"{index}.25", "3"] for index in range(12)}
    text = printed(WrappedTable(SHORT, numbers), 60)
    assert max(map(len, text.splitlines())) <= 60
    assert text.count("mass") > 1
    for index in range(12):
        assert f"{index}.25" in text.split()
