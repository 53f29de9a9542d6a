"""The table contains the metrics, at any width of the terminal."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from omni_runs.figures.tables.comparison_table import ComparisonTable
from omni_runs.metrics import Metric

METRICS = {
    "unassisted": {
        "stopping_distance": Metric(9.0909, "m"),
        "orientation_change": Metric(80.04, "deg", reference=26.3, at_most=4.0),
        "brake_switchings": Metric(2.0, "1"),
        "brake_switchings.front_left": Metric(2.0, "1"),
        "twist_rmse": Metric(math.nan, "m/s", note="the odometry measured nothing"),
    },
    "assisted": {
        "stopping_distance": Metric(10.25, "m"),
        "orientation_change": Metric(1.96, "deg", at_most=4.0),
    },
}


def printed(metrics: dict[str, dict[str, Metric]], width: int = 80) -> list[str]:
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None).print(ComparisonTable(metrics))
    return [" ".join(line.split()) for line in stream.getvalue().splitlines()]


def test_values_stand_below_their_variants_in_order() -> None:
    lines = printed(METRICS)
    assert "unit unassisted assisted" in lines
    assert "stopping distance m 9.09 10.25" in lines
    assert "orientation change deg 80.0 ! (26.3) 2.0" in lines
    assert "brake switchings 2 -" in lines
    assert "front left 2 -" in lines
    assert "twist RMSE m/s - -" in lines
    assert "unassisted: the odometry measured nothing" in lines


def test_notes_use_the_width_of_the_terminal() -> None:
    note = "one remark of several words that a narrow table must not wrap"
    metrics = {"a": {"time": Metric(math.nan, "s", note=note)}}
    assert f"a: {note}" in printed(metrics)


@pytest.mark.parametrize("variants", [1, 3, 5])
def test_fits_a_narrow_terminal(variants: int) -> None:
    names = [f"enhanced_k{index}" for index in range(variants)]
    lines = printed(dict.fromkeys(names, METRICS["assisted"]))
    (row,) = (line for line in lines if line.startswith("stopping"))
    assert row.removeprefix("stopping ").removeprefix("distance ") == "m" + " 10.25" * variants


@pytest.mark.parametrize("width", [40, 60, 80, 120])
@pytest.mark.parametrize(
    "names", [["unassisted", "assisted"], ["a", "bc", "enhanced_k7", "d", "e"]]
)
def test_numbers_stay_whole_on_any_width(names: list[str], width: int) -> None:
    lines = printed(dict.fromkeys(names, METRICS["unassisted"]), width)
    words = " ".join(lines).split()
    for number in ("9.09", "80.0", "!", "(26.3)"):
        assert words.count(number) == len(names), number
    # Names wrap between their words only.
    assert {"stopping", "distance", "orientation", "switchings"} <= set(words)
    if len(names) == 2 and width > 40:
        assert any("9.09 9.09" in line for line in lines), "side by side"
    assert max(map(len, lines)) <= width


@pytest.mark.parametrize("variants", [4, 6])
def test_names_wrap_between_their_parts(variants: int) -> None:
    names = [f"small_stop/assisted_{index}" for index in range(variants)]
    words = " ".join(printed(dict.fromkeys(names, METRICS["assisted"]))).split()
    for part in ("stop/", "assisted_"):
        assert sum(part in word for word in words) == len(names), part


def test_markup_in_names_is_printed_as_it_is() -> None:
    assert any("[red]x" in line for line in printed({"[red]x": METRICS["assisted"]}))


def test_a_stop_of_eight_centimeters_is_shown_in_millimeters() -> None:
    short, shorter, long = (
        {"stopping_distance": Metric(distance, "m")} for distance in (0.112, 0.0803, 9.87)
    )
    (row,) = (line for line in printed({"a": short, "b": shorter}) if "distance" in line)
    assert row.split() == ["stopping", "distance", "mm", "112", "80"]
    (row,) = (line for line in printed({"a": shorter, "b": long}) if "distance" in line)
    assert row.split() == ["stopping", "distance", "m", "0.08", "9.87"]
