"""Figures show every variant at one scale, with units, and no element covers another."""

from __future__ import annotations

import dataclasses
import itertools
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path as FilePath
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import FancyArrowPatch, Polygon
from matplotlib.path import Path
from matplotlib.text import Text

from omni_core.configuration import ConfigurationError
from omni_core.geometry import WheelMount
from omni_core.quantities import FloatArray
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures.scene import GroundPatch, Scene, overlap, placed, rectangle
from omni_runs.figures.style import save_figure
from omni_runs.figures.time_series import time_series
from omni_runs.figures.top_view import top_view
from omni_runs.history import RunHistory
from omni_sim.ground.configuration import FrictionPatch

MakeHistory = Callable[..., RunHistory]
NAMES = ("unassisted", "assisted", "zero", "cosine", "enhanced_k7")


def star(wheels: int) -> dict[str, WheelMount]:
    """Return wheels on a circle that roll along it."""
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


def _patch(*numbers: float, shape: str = "rectangle") -> GroundPatch:
    """Return a patch from x, y, length, width and heading [deg]."""
    values = dict(zip(("x", "y", "length", "width", "heading_deg"), numbers, strict=True))
    return GroundPatch.of(FrictionPatch(shape=shape, friction=0.3, **values))


def scene(wheels: int = 4) -> Scene:
    patches = (
        _patch(8.0, 1.0, 3.0, 1.0, 20.0),
        _patch(11.0, -1.0, 1.0, 1.0, 0.0, shape="ellipse"),
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
        panels = figure.axes[row * count : (row + 1) * count]
        assert len({axes.get_ylim() for axes in panels}) == 1
        assert len({axes.get_xlim() for axes in panels}) == 1
    units = [axes.get_ylabel().rpartition("[")[2] for axes in figure.axes[: 3 * count : count]]
    assert units == ["m/s]", "rad/s]", "m/s]"]


def test_released_brakes_leave_gaps_in_the_strip(make_history: MakeHistory) -> None:
    enable = np.ones((301, 4))
    enable[100:150, 1] = 0.0  # released from 1.0 to 1.5 s
    enable[:, 2] = 0.5
    figure = time_series({"a": make_history(enable=enable)})
    strips = [collection.get_paths() for collection in figure.axes[3].collections]
    spans = [[(path.get_extents().x0, path.get_extents().x1) for path in strip] for strip in strips]
    assert [len(span) for span in spans] == [1, 2, 1, 1]
    np.testing.assert_allclose(spans[1], [(0.0, 0.5), (1.0, 2.5)], atol=1e-9)  # pedal at 0.5 s
    heights = [strip[0].get_extents().height for strip in strips]
    np.testing.assert_allclose(heights, [0.7, 0.7, 0.35, 0.7], atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 0.3, 0.03], ids=["same", "smaller", "tiny"])
def test_errors_get_their_own_scale_only_where_sharing_hides_them(
    make_history: MakeHistory, scale: float
) -> None:
    large = make_history()
    figure = time_series({"large": large, "other": make_history(error=scale * large.error)})
    left, right = figure.axes[4:6]
    shared = left.get_ylim() == right.get_ylim()
    assert shared == (scale > 0.1)
    filled = 2.0 * scale * np.max(np.abs(large.error)) / np.ptp(right.get_ylim())
    assert filled > 0.2
    # A panel with another scale is marked, and its values can be read.
    assert any("own scale" in text.get_text() for text in right.texts) == (not shared)
    assert not any("own scale" in text.get_text() for text in left.texts)
    assert right.yaxis.get_tick_params()["labelleft"] == (not shared)
    assert left.yaxis.get_tick_params()["labelleft"]
    for row in (0, 1, 3):
        assert figure.axes[2 * row].get_ylim() == figure.axes[2 * row + 1].get_ylim()


def test_both_figures_count_time_from_the_pedal(make_history: MakeHistory) -> None:
    histories = {
        "early": make_history(brakes_at=0.5),
        "late": make_history(brakes_at=1.5, deceleration=4.0),
    }
    figure = time_series(histories)
    for panels in (figure.axes[::2], figure.axes[1::2]):
        assert panels[-1].get_xlabel() == "time since braking [s]"
        time, speed = np.asarray(panels[0].lines[1].get_xydata()).T
        braking = time[speed < 10.0 - 1e-9]
        assert 0.0 < braking[0] < 0.011  # the first stamp after the pedal
    seen = top_view(scene(), histories)
    assert "time since braking" in [text.get_text() for text in seen.legends[0].get_texts()]
    for axes, stop in zip(seen.axes, (2.0, 2.5), strict=True):
        labels = [text.get_text() for text in axes.texts]
        assert "0 s" in labels
        assert max(float(label.removesuffix(" s")) for label in labels) == pytest.approx(
            stop, abs=0.03
        )
    coasting = time_series({"coasting": make_history(pedal=np.zeros(301))})
    assert coasting.axes[3].get_xlabel() == "time since the start [s]"


def drawn_chassis(axes: Axes) -> list[FloatArray]:
    """Return the corners of the drawn chassis [m], from the first snapshot to the last."""
    sides = [1.2, 1.6, 1.2, 1.6]
    corners = [
        np.asarray(patch.get_xy())[:4]
        for patch in sorted(axes.patches, key=lambda patch: patch.zorder)
        if isinstance(patch, Polygon) and len(patch.get_xy()) == 5
    ]
    edges = [np.hypot(*(np.roll(points, 1, axis=0) - points).T) for points in corners]
    return [p for p, edge in zip(corners, edges, strict=True) if np.allclose(edge, sides)]


def covered_share(a: FloatArray, b: FloatArray) -> float:
    """Return the share of rectangle a that is inside rectangle b, by counting points."""
    u, v = (grid.reshape(-1, 1) for grid in np.meshgrid(*2 * [np.linspace(0.0, 1.0, 41)]))
    points = a[0] + u * (a[1] - a[0]) + v * (a[3] - a[0])
    inside = np.ones(len(points), dtype=bool)
    for along in (b[1] - b[0], b[3] - b[0]):
        part = (points - b[0]) @ along / (along @ along)
        inside &= (part > 0.0) & (part < 1.0)
    return float(np.mean(inside))


@pytest.mark.parametrize("turn", [0.0, 1.0, 7.0], ids=["straight", "turned", "more than once"])
@pytest.mark.parametrize("heading", [0.0, math.pi / 2.0], ids=["along", "across"])
def test_no_snapshot_label_or_arrow_hides_another_snapshot(
    make_history: MakeHistory, turn: float, heading: float
) -> None:
    histories = {
        "long": make_history(turn=turn, heading=heading, deceleration=4.0),
        "short": make_history(turn=-turn, heading=heading, deceleration=9.0),
    }
    figure = top_view(scene(), histories)
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
    for axes, history in zip(figure.axes, histories.values(), strict=True):
        snapshots = drawn_chassis(axes)
        assert len(snapshots) >= 3
        start = history.brake_start
        for corners, index in ((snapshots[0], start), (snapshots[-1], -1)):
            np.testing.assert_allclose(np.mean(corners, axis=0), history.pose[index, :2], atol=1e-9)
        for a, b in itertools.permutations(snapshots, 2):
            assert covered_share(a, b) == 0.0
        centers = np.mean(snapshots, axis=1)
        for arrow in (patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)):
            drawn = np.asarray(arrow.get_path().vertices)
            own = int(np.argmin(np.hypot(*(centers - drawn[0]).T)))
            for corners in snapshots[:own] + snapshots[own + 1 :]:
                assert not np.any(Path(corners[[0, 1, 2, 3, 0]]).contains_points(drawn))
        assert len(axes.texts) == len(snapshots)
        for text in axes.texts:
            box = text.get_window_extent()
            for corners in snapshots:
                outline = Path(axes.transData.transform(corners[[0, 1, 2, 3, 0]]))
                assert not outline.intersects_bbox(box)


def test_stops_far_apart_are_drawn_as_large_as_a_single_one(make_history: MakeHistory) -> None:
    run = make_history()
    away = run.pose + np.array([500.0, -300.0, 0.0])
    (alone,) = top_view(scene(), {"a": run}).axes
    figure = top_view(scene(), {"a": run, "b": make_history(pose=away)})
    for axes, x in zip(figure.axes, (0.0, 500.0), strict=True):
        assert np.ptp(axes.get_xlim()) < 1.5 * np.ptp(alone.get_xlim())
        for corners in drawn_chassis(axes):
            low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
            assert np.all((corners > low) & (corners < high))
        assert np.min(np.abs(np.subtract(axes.get_xlim(), x))) < 50.0


def test_outlines_overlap_where_they_share_a_point() -> None:
    square = rectangle(2.0, 2.0)
    for angle in (0.0, 0.3, math.pi / 2.0):
        assert overlap(square, placed(square, (1.9, 0.0, angle)))
        assert not overlap(square, placed(square, (2.5, 0.0, angle)))
        line = np.array([(-0.1, 0.0), (0.1, 0.0)])
        assert overlap(square, placed(line, (0.5, 0.5, angle)))  # wholly inside
        assert overlap(placed(line, (1.0, 1.0, angle)), placed(line, (1.0, 1.0, angle + 1.0)))
        ahead = placed(placed(line, (0.3, 0.0, 0.0)), (0.0, 0.0, angle))
        assert not overlap(placed(line, (0.0, 0.0, angle)), ahead)  # on one line, separate
    # Only their bounding boxes overlap.
    assert not overlap(square, placed(square, (1.8, 1.8, math.pi / 4.0)))


@pytest.mark.parametrize("heading", [0.0, 2.0, math.pi / 2.0], ids=["along", "skew", "across"])
def test_wheels_and_load_outside_the_chassis_are_in_the_picture(
    make_history: MakeHistory, heading: float
) -> None:
    load = (3.0, 0.5)
    wide = {name: dataclasses.replace(wheel, y=3.0 * wheel.y) for name, wheel in star(3).items()}
    vehicle = Scene(1.6, 1.2, wide, None, load)
    history = make_history(heading=heading, turn=1.0, wheel_names=tuple(wide))
    (axes,) = top_view(vehicle, {"a": history}).axes
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    hubs = [(wheel.x, wheel.y) for wheel in wide.values()]
    for corners in (snapshots := drawn_chassis(axes)):
        center = np.mean(corners, axis=0)
        forward, left = (corners[0] - corners[1]) / 1.6, (corners[0] - corners[3]) / 1.2
        for x, y in (*hubs, load):
            point = center + x * forward + y * left
            assert np.all(point > low + 0.1)
            assert np.all(point < high - 0.1)
    # In each snapshot a line connects load and chassis, here at the front edge.
    lines = [np.asarray(line.get_xydata()) for line in axes.lines]
    lengths = [np.hypot(*(line[1] - line[0])) for line in lines if len(line) == 2]
    assert np.count_nonzero(np.isclose(lengths, 3.0 - 0.8)) == len(snapshots)


@pytest.mark.parametrize("vehicle", ["mecanum_forklift", "three_wheel_robot"])
def test_the_chassis_of_each_vehicle_fits_its_wheels(vehicle: str) -> None:
    library = ExperimentLibrary(FilePath(__file__).resolve().parents[4] / "config")
    drawn = Scene.of(library.load("straight_line", "assisted", [f"vehicle={vehicle}"]))
    half = np.array([drawn.chassis_length, drawn.chassis_width]) / 2.0
    for wheel, outline in zip(drawn.wheels.values(), drawn.wheel_outlines, strict=True):
        np.testing.assert_allclose(np.mean(outline, axis=0), (wheel.x, wheel.y), atol=1e-12)
        assert np.all(np.abs(outline) <= half + 0.1)  # a wheel may protrude slightly
        assert np.all(np.abs((wheel.x, wheel.y)) < half)


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
    tmp_path: FilePath, make_history: MakeHistory
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
    corners = np.array(_patch(2.0, 3.0, 4.0, 1.0, 90.0).outline)
    np.testing.assert_allclose(sorted(corners.tolist()), [(1.5, 1), (1.5, 5), (2.5, 1), (2.5, 5)])
    ring = np.array(_patch(1.0, -1.0, 4.0, 4.0, 0.0, shape="ellipse").outline)
    np.testing.assert_allclose(np.hypot(ring[:, 0] - 1.0, ring[:, 1] + 1.0), 2.0)


def test_reading_and_measuring_load_no_drawing_library() -> None:
    code = (
        "import sys, omni_runs.metrics, omni_runs.recorded_run;"
        "import omni_runs.figures.scene;"
        "print(sorted({'matplotlib', 'rich', 'rosbags', 'mcap', 'rclpy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", ["picture", "picture.pdf"])
def test_a_picture_of_another_format_is_refused(name: str, tmp_path: FilePath) -> None:
    with pytest.raises(ConfigurationError, match=r"must end in \.png or \.svg"):
        save_figure(Figure(), tmp_path / name)
