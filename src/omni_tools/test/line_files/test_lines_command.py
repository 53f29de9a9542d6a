"""Files of cameras are imported, replayed and drawn, and they calibrate the cameras."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.odometry import LineScanOdometry
from omni_bringup.cli import main
from omni_core.signals import LineBatch
from omni_recording.decode import MessageDecoder
from omni_recording.folder import bag_messages, open_bag
from omni_runs.experiment import ExperimentLibrary
from omni_tools.line_trials.rig import Rig, ground, poses_at

WORKSPACE = Path(__file__).resolve().parents[4]
SAMPLE = WORKSPACE / "bags/small_stop/assisted"
TWIST = np.array([2.0, 0.5, 0.3])
LINES = 200


@pytest.fixture(autouse=True)
def workspace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMNI_WORKSPACE", str(WORKSPACE))


def omni(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments)])
    return int(ended.value.code or 0)


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    """Lines of three moving cameras, as arrays in files."""
    sensors = ExperimentLibrary(WORKSPACE / "config").sensors("three_generic")
    cameras = Rig(sensors, ground("cork"), 1.0, 1).array
    poses = poses_at(np.arange(LINES) / 2500.0, np.array([0.1, 0.1, 0.3]), TWIST)
    paths = {}
    for name, lines in cameras.render(dict.fromkeys(sensors, poses)).items():
        paths[name] = tmp_path / f"{name}.npy"
        np.save(paths[name], lines)
    return paths


def test_an_import_is_replayed_and_shown(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sources = [f"{name}={path}" for name, path in files.items()]
    bag = tmp_path / "bag"
    assert omni("lines", "import", *sources, "--out", bag, "--json") == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    assert metrics["lines.left"]["value"] == LINES
    assert omni("replay", bag, "--out", tmp_path / "replayed") == 0
    decoder = MessageDecoder()
    twists: list[Any] = [
        decoder.decode(message).twist.twist
        for message in bag_messages(open_bag(tmp_path / "replayed"))
        if message.channel.topic == "/odometry/twist"
    ]
    found = np.array([[t.linear.x, t.linear.y, t.angular.z] for t in twists])
    # The library gives the same twist for these lines.
    sensors = ExperimentLibrary(WORKSPACE / "config").sensors("three_generic")
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    lines = {name: np.load(path) for name, path in files.items()}
    expected = [
        odometry.update(
            {
                name: LineBatch(round(1e9 * (end - 1) / 2500.0), own[end - 25 : end])
                for name, own in lines.items()
            }
        ).twist
        for end in range(25, LINES + 1, 25)
    ]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(found, np.tile(TWIST, (len(found), 1)), atol=0.05)
    capsys.readouterr()
    picture = tmp_path / "seen.png"
    assert omni("lines", "show", bag, "--sensor", "front", "--out", picture, "--json") == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    assert metrics["velocity.front"]["value"] == pytest.approx(0.5 + 0.6 * 0.3, abs=0.02)
    assert metrics["measured_share.front"]["value"] == 1.0
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["left"], "lacks the name of a camera"),
        (["middle=x.npy"], "cameras: left, right, front"),
        (["left=nowhere.npy"], "no such file"),
        (["left=x.npy", "left=y.npy"], "given twice"),
        (["left=x.npy", "--rows", "a:b"], "neither a row nor FIRST:END"),
    ],
)
def test_what_cannot_be_imported_is_refused(
    words: list[str], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert omni("lines", "import", *words, "--out", tmp_path / "bag") == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_stamps_of_free_running_lines_give_the_line_rate(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    jitter = np.random.default_rng(2).uniform(-1e-4, 1e-4, LINES)
    np.save(tmp_path / "stamps.npy", 5.0 + np.arange(LINES) / 2400.0 + jitter)
    words = [f"left={files['left']}", "--stamps", tmp_path / "stamps.npy"]
    assert omni("lines", "import", *words, "--out", tmp_path / "bag", "--json") == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    assert metrics["duration.left"]["value"] == pytest.approx(LINES / 2400.0, rel=2e-3)
    first = next(iter(bag_messages(open_bag(tmp_path / "bag"))))
    assert first.log_ns == pytest.approx(5e9 + 23 / 2400.0 * 1e9, abs=1e6)


@pytest.mark.parametrize(
    ("times", "complaint"),
    [
        # an encoder at constant acceleration: equal distances
        (np.sqrt(np.arange(LINES) / 2500.0), "0.71 to 20 ms from line to line; .* an encoder"),
        (np.delete(np.arange(LINES + 5), range(90, 95)) / 2500.0, "lines were lost, or an encoder"),
        (np.arange(LINES - 1) / 2500.0, "has 199 times for 200 lines"),
        (np.arange(LINES) * -1e-3, "no constant rate"),
    ],
    ids=["encoder", "lost", "fewer", "backwards"],
)
def test_stamps_without_a_constant_rate_are_refused(
    times: np.ndarray,
    complaint: str,
    files: dict[str, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    np.savetxt(tmp_path / "stamps.csv", times)
    words = [f"left={files['left']}", "--stamps", tmp_path / "stamps.csv"]
    assert omni("lines", "import", *words, "--out", tmp_path / "bag") == 2
    assert re.search(complaint, capsys.readouterr().err.replace("\n", " "))
    assert not (tmp_path / "bag").exists()


def test_references_and_a_drive_become_tables_that_the_odometry_takes(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    white = np.full((20, 1024), 180, np.uint8)
    white[:, 100:200] = 90  # a smear of half the light
    np.save(tmp_path / "white.npy", white)
    sources = [f"{name}={path}" for name, path in files.items()]
    bag, tables = tmp_path / "bag", tmp_path / "tables"
    assert omni("lines", "import", *sources, "--out", bag) == 0
    capsys.readouterr()
    given = ["--white", f"left={tmp_path / 'white.npy'}", "--drive", bag]
    assert omni("lines", "reference", *given, "--out", tables, "--json") == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    assert metrics["gain_spread.left"]["value"] == pytest.approx(100 * white.std() / white.mean())
    assert metrics["gain_spread.right"]["value"] == 0.0
    assert all(metrics[f"pattern_spread.{name}"]["value"] > 0.0 for name in files)
    taken = f"odometry.flat_field_tables={tables}"
    assert omni("replay", bag, "--set", taken, "--out", tmp_path / "replayed") == 0
    # Without a folder, and of another camera, they are refused.
    assert omni("replay", bag, "--set", f"{taken}_none", "--out", tmp_path / "b") == 2
    assert "omni lines reference writes it" in capsys.readouterr().err
    np.savez(tables / "right.npz", mean=np.ones(3))
    assert omni("replay", bag, "--set", taken, "--out", tmp_path / "c") == 2
    assert "right.npz contains no tables of a camera" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "give --dark, --white or --drive"),
        (["--white", "right=dark.npy"], "right: the white reference is no brighter"),
        (["--dark", "dark.npy"], "lacks the name of a camera"),
    ],
)
def test_what_is_no_reference_is_refused(
    words: list[str],
    complaint: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("dark.npy", np.zeros((3, 64), np.uint8))
    assert omni("lines", "reference", *words, "--out", "tables") == 2
    assert complaint in capsys.readouterr().err


def test_a_recorded_stop_calibrates_the_cameras_that_it_shows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert omni("calibrate-sensors", SAMPLE, "--out", tmp_path, "--json") == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    # The drive is straight ahead, so the pitch of the cameras along it is observable.
    for name in ("left", "right"):
        assert metrics[f"length.{name}"]["value"] == pytest.approx(0.05, rel=1e-3)
        assert metrics[f"mirrored.{name}"]["value"] == 0.0
    found = ExperimentLibrary(WORKSPACE / "config").sensors(str(tmp_path / "sensors.yaml"))
    assert found["left"].length == pytest.approx(0.05, rel=1e-3)
    assert (tmp_path / "residuals.png").stat().st_size > 10_000


def test_an_import_without_a_known_motion_calibrates_nothing(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sources = [f"{name}={path}" for name, path in files.items()]
    assert omni("lines", "import", *sources, "--out", tmp_path / "bag") == 0
    assert omni("calibrate-sensors", tmp_path / "bag", "--out", tmp_path / "out") == 2
    assert "contains no motion to compare with" in capsys.readouterr().err
