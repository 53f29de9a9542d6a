"""A report opens without a network, plays, and shows only recorded values."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import Chromium, chromium
from omni_process import WORKSPACE, omni_here

from omni_bringup.cli import main
from omni_core.topics import MARKERS, WHEEL_FORCES
from omni_recording.definitions import find_message_definition
from omni_recording.folder import bag_messages, open_bag
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_recording.write import Rosbag2Writer
from omni_runs.history import RunHistory
from omni_runs.metrics import run_metrics
from omni_tools.report.document import report_page
from omni_tools.report.recording import ReportedRun, read_reported_run, read_wheel_forces

SAMPLE = WORKSPACE / "bags" / "small_stop" / "assisted"
MARKUP = "</script><script>hit = 1</script><img src=x onerror='hit = 1'>"
FOLDER = "<img src=x onerror='hit = 1'>"
SHIFT = 8


@pytest.fixture(scope="module")
def browser() -> Iterator[Chromium]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def sample() -> ReportedRun:
    return read_reported_run(SAMPLE, "assisted")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the sample and of a copy whose texts contain markup."""
    folder = tmp_path_factory.mktemp("report")
    copy = folder / FOLDER
    shutil.copytree(SAMPLE, copy)
    configuration = (copy / "configuration.yaml").read_text().splitlines(keepends=True)
    (described,) = (i for i, line in enumerate(configuration) if line.startswith("description:"))
    configuration[described] = f"description: {json.dumps(MARKUP)}\n"
    text = "".join(configuration).replace("mass: 250.0", "mass: 200.0")
    (copy / "configuration.yaml").write_text(text)
    file = folder / "pages" / "both.html"
    finished = omni_here(["report", str(copy), str(SAMPLE), "--out", str(file), "--json"])
    assert finished.returncode == 0, finished.stderr
    results = json.loads(finished.stdout)
    recorded = json.loads((SAMPLE / "summary.json").read_text())["metrics"]
    distance = recorded["stopping_distance.assisted"]["value"]
    assert results["metrics"]["stopping_distance.assisted"]["value"] == distance
    assert results["file"] == str(file)
    return file


@pytest.fixture
def opened(browser: Chromium, page: Path) -> Iterator[Chromium]:
    """The opened page; no request may leave it, and no error may occur."""
    browser.show(1280, 900)
    browser.open(page)
    yield browser
    assert [one for one in browser.requests if not one.startswith("data:")] == [page.as_uri()]
    assert browser.complaints == []


def clock(browser: Chromium) -> float:
    return number(browser.run("document.getElementById('clock').value").split()[0])


def number(text: str) -> float:
    return float(text.replace("\N{MINUS SIGN}", "-"))


def legend(browser: Chromium, plot: str) -> list[float]:
    """Return the values in the legend of a plot for the front run."""
    shown = f"[...document.querySelectorAll('#plot-{plot} .value')].map(e => e.textContent)"
    return [number(text) for text in browser.run(shown)]


def cursors(browser: Chromium) -> list[float]:
    """Return the position of each plot's cursor along its axis, 0 to 1."""
    found: list[float] = browser.run(
        "[...document.querySelectorAll('.curves')].map(box => {"
        "const [b, c] = [box, box.querySelector('.cursor')].map(e => e.getBoundingClientRect());"
        "return (c.left + 1 - b.left - MARGIN.left) / (b.width - MARGIN.left - MARGIN.right); })"
    )
    return found


def pictures(browser: Chromium) -> list[str]:
    """Return all drawn elements as texts for comparison."""
    drawn = "[...document.querySelectorAll('canvas')].map(canvas => canvas.toDataURL())"
    found: list[str] = browser.run(drawn)
    return found


def top_view(browser: Chromium) -> str:
    return str(browser.run("document.getElementById('top-view').toDataURL()"))


def test_it_plays_to_the_end_and_everything_follows(opened: Chromium, sample: ReportedRun) -> None:
    history = sample.history
    first, last = history.braking_time[[0, -1]].tolist()
    assert clock(opened) == pytest.approx(first, abs=0.005)
    seen = [top_view(opened)]
    opened.run("document.getElementById('speed').value = '0.1'")
    opened.press(" ", "Space")
    opened.wait(f"Number(document.getElementById('time').value) > {first + 0.05}")
    assert opened.run("document.getElementById('play').textContent") == "Pause"
    opened.click("#play")
    assert opened.run("document.getElementById('play').textContent") == "Play"
    seen.append(top_view(opened))
    now = clock(opened)
    assert first < now < last
    row = int(np.searchsorted(history.braking_time, now))
    assert legend(opened, "velocity")[0] == pytest.approx(history.twist[row, 0], abs=0.2)
    expected = (now - first) / (last - first)
    assert cursors(opened) == pytest.approx([expected] * 11, abs=0.01)
    opened.run("document.getElementById('speed').value = '2'")
    opened.click("#play")
    opened.wait("document.getElementById('play').textContent === 'Play'")
    assert clock(opened) == pytest.approx(last, abs=0.005)
    assert cursors(opened) == pytest.approx([1.0] * 11, abs=0.001)
    assert legend(opened, "velocity") == pytest.approx(history.twist[-1, :2], abs=0.0051)
    assert len({*seen, top_view(opened)}) == 3


def test_zooming_shows_the_plots_about_the_time(opened: Chromium, sample: ReportedRun) -> None:
    span = sample.history.braking_time[[0, -1]]
    opened.run("player.seek(0.5)")
    opened.press("+", "Equal")
    opened.press("+", "Equal")
    shown = opened.run("player.window")
    assert shown[1] - shown[0] == pytest.approx((span[1] - span[0]) / 5.0, rel=1e-5)
    assert sum(shown) / 2.0 == pytest.approx(0.5, abs=1e-5)
    assert cursors(opened) == pytest.approx([0.5] * 11, abs=0.01)
    opened.run(f"player.seek({span[1]})")  # the window follows
    assert cursors(opened) == pytest.approx([1.0] * 11, abs=0.01)
    opened.press("-", "Minus")
    opened.press("-", "Minus")
    assert opened.run("player.window") == pytest.approx(span.tolist(), abs=1e-5)


def test_a_drag_in_a_plot_moves_all_of_them(opened: Chromium, sample: ReportedRun) -> None:
    history = sample.history
    opened.click("#plot-load .curves", across=0.4)
    row = int(np.searchsorted(history.time, opened.run("player.time") - history.braking_time[0]))
    places = cursors(opened)
    assert places == pytest.approx([places[0]] * 11, abs=1e-3)
    assert legend(opened, "velocity") == pytest.approx(history.twist[row - 1, :2], abs=0.0051)
    assert legend(opened, "error") == pytest.approx(history.error[row - 1], abs=0.00051)
    on = [
        name.replace("_", " ")
        for name, enable in zip(history.wheel_names, history.enable[row - 1], strict=True)
        if enable > 0.5
    ]
    words = opened.run("document.getElementById('state').textContent")
    assert words.endswith(f"assisting · braking: {', '.join(on) or 'no wheel'}")


def test_it_is_used_by_keyboard_alone(opened: Chromium) -> None:
    start = clock(opened)
    for key, modifiers, steps in (
        ("ArrowRight", 0, 1),
        ("ArrowRight", SHIFT, 11),
        ("ArrowLeft", 0, 10),
    ):
        opened.press(key, modifiers=modifiers)
        assert clock(opened) == pytest.approx(start + steps * 0.01, abs=0.005)
    before = top_view(opened)
    opened.press("f")
    assert opened.run("document.getElementById('follow').checked")
    assert top_view(opened) != before
    opened.press("2")
    assert (
        opened.run("document.querySelector('#runs label:has(:checked)').textContent") == " assisted"
    )
    others = pictures(opened)
    opened.press("1")
    assert pictures(opened) != others
    opened.press("2")
    assert pictures(opened) == others
    # Tab reaches every control and every table that may be wider than the window, in order.
    reached = []
    for _ in range(12):
        opened.press("Tab")
        reached.append(opened.run("document.activeElement.id || document.activeElement.tagName"))
    tables = ["metrics", "DIV", "DIV", "differences", "all-values-summary"]
    assert reached == ["INPUT", "play", "time", "speed", "zoom", "follow", *tables, "BODY"]


def test_texts_of_a_recording_stay_texts(opened: Chromium) -> None:
    assert opened.run("document.getElementById('title').textContent").startswith(MARKUP)
    assert opened.run("document.title").startswith(MARKUP)
    headings = "[...document.querySelectorAll('#metrics thead th')].map(e => e.textContent)"
    assert opened.run(headings) == ["", "unit", FOLDER, "assisted"]
    assert opened.run("typeof hit") == "undefined"
    # One figure of camera lines per recording, and no picture from a text of a recording.
    assert opened.run("document.images.length") == 2
    assert opened.run("[...document.images].every(e => e.naturalWidth > 500)")
    heads = "[...document.querySelectorAll('#seen h3')].map(e => e.textContent)"
    assert opened.run(heads) == [FOLDER, "assisted"]
    rows = opened.run(
        "[...document.querySelectorAll('#differences tbody tr')]"
        ".map(row => [...row.cells].map(cell => cell.textContent))"
    )
    assert ["vehicle.load.mass", "200.0", "250.0"] in rows
    assert len(rows) == 2


def test_wheels_may_have_any_name(browser: Chromium, sample: ReportedRun, tmp_path: Path) -> None:
    history = dataclasses.replace(
        sample.history, wheel_names=(MARKUP, "{{SCRIPT}}", "<!--<script>", "\u2028'\"\\")
    )
    run = ReportedRun(name=MARKUP, history=history, metrics=run_metrics(history), notes=(MARKUP,))
    file = tmp_path / "hostile.html"
    file.write_text(report_page(MARKUP, [run]), encoding="utf-8")
    browser.open(file)
    names = browser.run("[...document.querySelectorAll('#plot-error li')].map(e => e.textContent)")
    for name, shown in zip(history.wheel_names, names, strict=True):
        assert shown.startswith(name)
    assert MARKUP in browser.run("document.getElementById('notes').textContent")
    assert browser.run("typeof hit") == "undefined"
    # Without a configuration there is no vehicle to draw, but the motion plays.
    assert browser.run("document.querySelectorAll('.plot').length") == 7
    before = top_view(browser)
    browser.press("ArrowRight", modifiers=SHIFT)
    assert top_view(browser) != before
    assert browser.requests == [file.as_uri()]
    assert browser.complaints == []


@pytest.mark.parametrize("place", [1e17, 3e38, 1e300, np.nan])
def test_numbers_beyond_all_measure_do_not_stop_the_page(
    browser: Chromium, sample: ReportedRun, tmp_path: Path, place: float
) -> None:
    history = dataclasses.replace(
        sample.history,
        pose=sample.history.pose + np.array((place, 0.0, 0.0)),
        error=np.full_like(sample.history.error, place),
    )
    file = tmp_path / "far.html"
    file.write_text(report_page("Far away", [dataclasses.replace(sample, history=history)]))
    browser.open(file)
    browser.press("f")
    browser.press("ArrowRight")
    assert clock(browser) == pytest.approx(history.braking_time[1], abs=0.005)
    assert browser.complaints == []


def luminance(color: str) -> float:
    """Return the relative luminance of ``#rrggbb``, as WCAG 2 defines it."""
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


@pytest.mark.parametrize("dark", [False, True])
def test_it_can_be_read_on_a_phone_by_day_and_night(
    browser: Chromium, page: Path, dark: bool
) -> None:
    browser.show(360, 740, dark=dark, phone=True)
    browser.open(page)
    assert browser.run("document.documentElement.scrollWidth") == 360
    colors = browser.run("readColors()")
    paper = luminance(colors["paper"])
    assert (paper < 0.05) == dark
    for name, least in (("ink", 7.0), ("quiet", 4.5), ("braking", 3.0)):
        low, high = sorted((paper, luminance(colors[name])))
        assert (high + 0.05) / (low + 0.05) > least, name
    heights = browser.run(
        "[...document.querySelectorAll('#player button, #player select, #player label')]"
        ".map(e => e.getBoundingClientRect().height)"
    )
    assert min(heights) >= 40  # [px] for a finger
    assert browser.complaints == []


def lasting(history: RunHistory, stamps: int) -> RunHistory:
    """Return a history with this number of stamps and repeated values."""
    longer: dict[str, Any] = {
        field.name: np.resize(array, (stamps, *array.shape[1:]))
        for field in dataclasses.fields(history)
        if isinstance(array := getattr(history, field.name), np.ndarray)
    }
    longer["stamp_ns"] = np.arange(stamps, dtype=np.int64) * 10_000_000
    return dataclasses.replace(history, **longer, assist_state=())


def test_ten_seconds_are_small_and_open_at_once(
    browser: Chromium, sample: ReportedRun, tmp_path: Path
) -> None:
    run = dataclasses.replace(sample, history=lasting(sample.history, 1001))
    file = tmp_path / "long.html"
    file.write_text(report_page("Ten seconds", [run]), encoding="utf-8")
    assert file.stat().st_size < 5e6
    browser.show(1280, 900)
    browser.open(file)
    assert browser.run("document.querySelectorAll('.plot').length") == 11
    assert browser.seconds_of_work < 2.0
    # A long run is thinned out instead.
    longer = dataclasses.replace(sample, history=lasting(sample.history, 30_000))
    assert len(report_page("Five minutes", [longer])) < 5e6


def test_the_forces_are_those_that_move_the_vehicle(sample: ReportedRun) -> None:
    # Newton: what the wheels exert together is mass times acceleration of the center of gravity.
    assert sample.forces is not None
    assert sample.configuration is not None
    vehicle, history = sample.configuration.vehicle, sample.history
    masses = vehicle.masses
    yaw = history.pose[:, 2]
    center = history.pose[:, :2] + np.column_stack(
        (
            np.cos(yaw) * masses.center[0] - np.sin(yaw) * masses.center[1],
            np.sin(yaw) * masses.center[0] + np.cos(yaw) * masses.center[1],
        )
    )
    # A force is that of an instant: the acceleration about it, by the periods on both sides.
    rows = np.searchsorted(history.stamp_ns, sample.forces.stamp_ns)[1:]
    rows = rows[rows < len(center) - 1]  # the last instant has no period behind it
    velocity = np.diff(center, axis=0) / np.diff(history.time)[:, np.newaxis]
    needed = masses.mass * (velocity[rows] - velocity[rows - 1])
    needed /= np.diff(history.time)[rows, np.newaxis]
    forces = sample.forces.values[1 : 1 + len(rows)].reshape(len(rows), -1, 2)
    total = np.sum(forces, axis=1)
    error = np.linalg.norm(total - needed, axis=1)
    # All brakes on, the vehicle rocks on its tires: nothing switches within those periods.
    rocking = history.time[rows] > 1.5
    assert np.max(np.abs(needed[rocking])) > 2500.0
    assert np.max(error[rocking]) < 30.0
    # Before, where brakes switch at the instant itself, a mean over both sides is half of each.
    steady = np.all(history.enable[rows] == history.enable[rows - 1], axis=1)
    braking = steady & (needed[:, 0] < -2000.0)
    assert np.count_nonzero(braking) > 5
    assert np.median(error[braking]) < 0.1 * np.median(-needed[braking, 0])


def test_a_recording_with_arrows_only_has_the_same_forces(
    sample: ReportedRun, tmp_path: Path
) -> None:
    messages = [m for m in bag_messages(open_bag(SAMPLE)) if m.channel.topic == MARKERS.path]
    definition = find_message_definition(MARKERS.type)
    topic = RecordedTopic(MARKERS.path, definition, RecordedQos(len(messages)))
    with Rosbag2Writer(tmp_path / "arrows", [topic]) as writer:
        for message in messages:
            writer.write(MARKERS.path, message.log_ns, message.data)
    wheels = len(sample.history.wheel_names)
    shown = read_wheel_forces(tmp_path / "arrows", wheels)
    recorded = read_wheel_forces(SAMPLE, wheels)
    assert shown is not None
    assert recorded is not None
    assert any(m.channel.topic == WHEEL_FORCES.path for m in bag_messages(open_bag(SAMPLE)))
    assert np.array_equal(shown.stamp_ns, recorded.stamp_ns)
    assert shown.values == pytest.approx(recorded.values, abs=1e-6)


def test_what_is_no_run_is_refused_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, words in (
        ([tmp_path], "not a rosbag2 recording"),
        ([SAMPLE, SAMPLE], "given twice"),
        ([SAMPLE, "--out", tmp_path / "page.txt"], "must end in .html"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["report", *map(str, arguments)])
        assert ended.value.code == 2
        problem = capsys.readouterr().err
        assert problem.startswith("omni report: ")
        assert words in problem
        assert len(problem.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
