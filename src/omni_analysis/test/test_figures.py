"""Figures show every variant at one scale, with units, and no text on top of other text."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text

from omni_analysis.figure_style import save_figure
from omni_analysis.run_history import RunHistory
from omni_analysis.scene import GroundPatch, Scene, placed, rectangle
from omni_analysis.time_series import time_series
from omni_analysis.top_view import top_view
from omni_platform.geometry import WheelMount

MakeHistory = Callable[..., RunHistory]
NAMES = ("unassisted", "assisted", "zero", "cosine", "enhanced_k7")


def star(wheels: int) -> dict[str, WheelMount]:
    """Return wheels around a circle, rolling along it."""
    angles = {f"wheel_{index}": math.tau * index / wheels for index in range(wheels)}
    return {
        name: WheelMount(
            x=0.5 * math.cos(angle),
            y=0.5 * math.sin(angle),
            heading_deg=math.degrees(angle) - 90.0,
            roller_angle_deg=0.0,
        )
        for name, angle in angles.items()
    }


def scene(wheels: int = 4) -> Scene:
    patches = (
        GroundPatch.rectangle(8.0, 1.0, 3.0, 1.0, 20.0, 0.3),
        GroundPatch.disc(11.0, -1.0, 0.5, 0.6),
    )
    return Scene(1.6, 1.2, star(wheels), (0.1, 0.1), (0.4, 0.3), patches)


def runs(
    make_history: MakeHistory, count: int, wheels: int, heading: float
) -> dict[str, RunHistory]:
    return {
        name: make_history(
            heading=heading,
            turn=0.4 * index,
            wheel_names=tuple(star(wheels)),
            deceleration=4 + index,
        )
        for index, name in enumerate(NAMES[:count])
    }


def overlapping_texts(figure: Figure) -> list[tuple[str, str]]:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    # Ticks beyond the limits of their axis exist, but are not drawn.
    beyond = {
        id(label)
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in axis.get_major_ticks()
        for label in (tick.label1, tick.label2)
        if not min(axis.get_view_interval()) <= tick.get_loc() <= max(axis.get_view_interval())
    }
    texts = [
        (item.get_text(), item.get_window_extent(renderer))
        for item in figure.findobj(Text)
        if isinstance(item, Text) and item.get_visible() and id(item) not in beyond
    ]
    return [
        (a, b)
        for (a, box_a), (b, box_b) in itertools.combinations(texts, 2)
        if box_a.width > 0 < box_b.width and box_a.padded(-1).overlaps(box_b.padded(-1))
    ]


@pytest.mark.parametrize("heading", [0.0, 1.0, math.pi / 2.0], ids=["along", "skew", "across"])
@pytest.mark.parametrize(("count", "wheels"), [(1, 3), (2, 4), (5, 6)])
def test_top_view_panels_share_one_undistorted_scale(
    make_history: MakeHistory, count: int, wheels: int, heading: float
) -> None:
    histories = runs(make_history, count, wheels, heading)
    figure = top_view(scene(wheels), histories, title="an experiment")
    assert overlapping_texts(figure) == []
    assert len(figure.axes) == count
    first = figure.axes[0]
    for axes, (name, history) in zip(figure.axes, histories.items(), strict=True):
        assert axes.get_title(loc="left").startswith(name)
        assert axes.get_xlim() == first.get_xlim()
        assert axes.get_ylim() == first.get_ylim()
        box = axes.get_window_extent()
        assert box.width / np.ptp(axes.get_xlim()) == pytest.approx(
            box.height / np.ptp(axes.get_ylim()), rel=1e-6
        )
        chassis = placed(rectangle(1.6, 1.2), history.pose[-1])
        assert np.all(chassis[:, 0] > axes.get_xlim()[0])
        assert np.all(chassis[:, 0] < axes.get_xlim()[1])
        assert np.all(chassis[:, 1] > axes.get_ylim()[0])
        assert np.all(chassis[:, 1] < axes.get_ylim()[1])
    assert "[m]" in figure.axes[-1].get_xlabel()
    assert "[m]" in first.get_ylabel()


@pytest.mark.parametrize(("count", "wheels"), [(1, 3), (2, 4), (5, 6)])
def test_time_series_rows_share_one_scale(
    make_history: MakeHistory, count: int, wheels: int
) -> None:
    figure = time_series(runs(make_history, count, wheels, 0.0), title="an experiment")
    assert overlapping_texts(figure) == []
    assert len(figure.axes) == 4 * count
    for row in range(4):
        panels = figure.axes[row::4]
        assert len({axes.get_ylim() for axes in panels}) == 1
        assert len({axes.get_xlim() for axes in panels}) == 1
    units = [axes.get_ylabel().rpartition("[")[2] for axes in figure.axes[:3]]
    assert units == ["m/s]", "rad/s]", "m/s]"]


def test_released_brakes_leave_gaps_in_the_strip(make_history: MakeHistory) -> None:
    enable = np.ones((301, 4))
    enable[100:150, 1] = 0.0  # released from 1.0 to 1.5 s
    figure = time_series({"a": make_history(enable=enable)})
    strips = [collection.get_paths() for collection in figure.axes[3].collections]
    spans = [[(path.get_extents().x0, path.get_extents().x1) for path in strip] for strip in strips]
    assert [len(span) for span in spans] == [1, 2, 1, 1]
    np.testing.assert_allclose(spans[1], [(0.5, 1.0), (1.5, 3.0)], atol=1e-9)


def test_runs_without_odometry_rest_or_braking_are_drawn(make_history: MakeHistory) -> None:
    names = tuple(star(4))
    histories = {
        "blind": make_history(wheel_names=names, estimate=np.full((301, 3), np.nan)),
        "moving": make_history(wheel_names=names, rest=-0.5),
        "coasting": make_history(wheel_names=names, pedal=np.zeros(301)),
        "standing": make_history(
            wheel_names=names, pose=np.zeros((301, 3)), twist=np.zeros((301, 3))
        ),
    }
    for name, history in histories.items():
        assert overlapping_texts(top_view(scene(), {name: history})) == []
        assert overlapping_texts(time_series({name: history})) == []
    together = top_view(scene(), histories)
    titles = [axes.get_title(loc="left") for axes in together.axes]
    assert "rest" in titles[1]
    assert "pedal" in titles[2]


def test_nothing_to_draw_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        top_view(scene(), {})
    with pytest.raises(ValueError, match="at least one"):
        time_series({})


def test_files_are_readable_and_repeat_to_the_byte(
    tmp_path: Path, make_history: MakeHistory
) -> None:
    for suffix in ("png", "svg"):
        paths = [
            save_figure(
                top_view(scene(), runs(make_history, 2, 4, 0.0)), tmp_path / f"{copy}.{suffix}"
            )
            for copy in "ab"
        ]
        assert paths[0].read_bytes() == paths[1].read_bytes()
    assert 1200 <= imread(tmp_path / "a.png").shape[1] <= 1600
    assert ElementTree.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")
    with pytest.raises(ValueError, match=r"\.png or \.svg"):
        save_figure(Figure(), tmp_path / "a.jpg")


def test_patches_are_where_they_are_said_to_be() -> None:
    corners = np.array(GroundPatch.rectangle(2.0, 3.0, 4.0, 1.0, 90.0, 0.5).outline)
    np.testing.assert_allclose(sorted(corners.tolist()), [(1.5, 1), (1.5, 5), (2.5, 1), (2.5, 5)])
    ring = np.array(GroundPatch.disc(1.0, -1.0, 2.0, 0.5).outline)
    np.testing.assert_allclose(np.hypot(ring[:, 0] - 1.0, ring[:, 1] + 1.0), 2.0)


def test_reading_and_measuring_load_no_drawing_library() -> None:
    code = (
        "import sys, omni_analysis.metrics, omni_analysis.bag_reader, omni_analysis.scene;"
        "print(sorted({'matplotlib', 'rich', 'rosbags', 'mcap', 'rclpy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
