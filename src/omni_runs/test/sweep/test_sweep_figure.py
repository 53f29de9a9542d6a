"""The figure of a sweep shows each run, in its unit, and connects only values that are ordered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from matplotlib.lines import Line2D

from omni_runs.metrics import Metric
from omni_runs.sweep.figure import sweep_figure
from omni_runs.sweep.sweep import SHOWN, SweptRun

UNITS = dict(zip(SHOWN, ("m", "deg", "m", "s"), strict=True))


def runs(key: str, values: Sequence[str], variants: Sequence[str]) -> list[SweptRun]:
    """Return runs whose metrics depend on the value only, so that variants are equal."""
    return [
        SweptRun(variant, {key: value}, {q: Metric(1.0 + index, UNITS[q]) for q in SHOWN})
        for index, value in enumerate(values)
        for variant in variants
    ]


def _x(line: Line2D) -> list[float]:
    return [float(x) for x in np.asarray(line.get_xdata())]


def _y(line: Line2D) -> list[float]:
    return [float(y) for y in np.asarray(line.get_ydata())]


@pytest.mark.parametrize(
    ("key", "values"), [("vehicle.load.mass", ["0", "250"]), ("ground", ["cork", "bark"])]
)
def test_no_marker_touches_the_frame(key: str, values: list[str]) -> None:
    for axes in sweep_figure(runs(key, values, ["a", "b"]), "").axes:
        for line in axes.get_lines():
            top = axes.transData.inverted().transform((0.0, line.get_markersize()))[1]
            radius = 0.5 * (top - axes.transData.inverted().transform((0.0, 0.0))[1])
            assert max(_y(line)) + radius < axes.get_ylim()[1]
            left, right = axes.get_xlim()
            assert left < min(_x(line))
            assert max(_x(line)) < right


def test_the_axis_has_the_unit_of_the_swept_key() -> None:
    figure = sweep_figure(runs("vehicle.load.mass", ["0", "250"], ["a"]), "")
    assert figure.axes[-1].get_xlabel() == "vehicle.load.mass [kg]"


def test_words_have_no_line_between_them() -> None:
    figure = sweep_figure(runs("brake_assist.enabled", ["true", "false"], ["a"]), "")
    assert {line.get_linestyle() for line in figure.axes[0].get_lines()} == {"None"}


def test_equal_series_are_all_visible() -> None:
    by_size = sweep_figure(runs("vehicle.load.mass", ["0", "250"], ["a", "b"]), "").axes[0]
    first, second = by_size.get_lines()
    assert second.get_linewidth() < first.get_linewidth()
    assert second.get_markersize() < first.get_markersize()
    by_place = sweep_figure(runs("ground", ["cork", "bark"], ["a", "b"]), "").axes[0]
    first, second = by_place.get_lines()
    assert set(_x(first)).isdisjoint(_x(second))
