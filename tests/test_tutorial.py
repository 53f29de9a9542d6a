"""All commands of the tutorials work with values from a measuring tape."""

from __future__ import annotations

import io
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from omni_process import WORKSPACE, omni
from PIL import Image

from omni_bringup.cli import main
from omni_runs.experiment import ExperimentLibrary

TUTORIALS = sorted((WORKSPACE / "docs/tutorials").glob("*.md"))
SENSORS = {"new-vehicle": "sensors.yaml", "design-sensors": "places/sensors.yaml"}
"""Files of cameras in the folder of the robot, by the command that writes them"""


def commands(page: Path) -> list[list[str]]:
    """Return the commands of a page as words after ``./omni``."""
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line]
    assert all(line.startswith("./omni ") for line in lines), page.name
    return [shlex.split(line)[1:] for line in lines]


def picture_of_a_floor() -> Image.Image:
    """Picture of a floor: speckles of 1 to 2 mm with uneven light."""
    rng = np.random.default_rng(3)
    speckles = Image.fromarray(rng.integers(40, 220, (200, 280), dtype=np.uint8))
    picture = np.asarray(speckles.resize((2800, 2000), Image.Resampling.BICUBIC), dtype=np.float64)
    light = np.linspace(0.8, 1.0, picture.shape[1])
    grain = rng.normal(0.0, 6.0, picture.shape)
    return Image.fromarray(np.clip(light * picture + grain, 0, 255).astype(np.uint8))


def forces_of_a_tire(path: Path) -> None:
    """Write forces of a small wheel at loads of 40 to 140 N, with noise."""
    rng = np.random.default_rng(7)
    slip, load = rng.uniform(-0.8, 0.8, 300), rng.choice([40.0, 90.0, 140.0], 300)
    force = 0.8 * load * np.sin(1.5 * np.arctan(12.0 * slip)) + rng.normal(0.0, 1.0, 300)
    np.savetxt(
        path, np.column_stack((slip, load, force)), delimiter=",", header="slip,load,force",
        comments="",
    )  # fmt: skip


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_every_command_of_the_page_works(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture_of_a_floor().save(tmp_path / "my_floor.png")
    forces_of_a_tire(tmp_path / "my_tire.csv")
    monkeypatch.chdir(tmp_path)
    recommended: list[str] = []
    for words in commands(page):
        if "my_robot/tuned" in words:  # the page continues with the recommended setting
            assert recommended
            assert {word for word in words if word.startswith("brake_assist.")} <= set(recommended)
        # A drive of a quarter of the steps shows check-vehicle the same.
        fewer = ["--set", "simulation.control_period=0.04"] if "commissioning" in words else []
        finished = omni([*words, *fewer])
        assert finished.returncode == 0, f"{shlex.join(words)}: {finished.stderr}"
        assert "note:" not in finished.stderr + finished.stdout, shlex.join(words)
        if words[0] in SENSORS:  # cameras with fewer pixels and lines, for the drives
            sensors = tmp_path / "my_robot" / SENSORS[words[0]]
            text = sensors.read_text()
            for quantity, value, less in (("pixels", "1024", "256"), ("line_rate", "2500", "1000")):
                assert text.count(f"{quantity}: {value}") == 3
                text = text.replace(f"{quantity}: {value}", f"{quantity}: {less}")
            sensors.write_text(text)
        if words[:2] == ["study", "tuning"]:
            recommended = finished.stdout.replace(";", " ").split()


def test_a_person_on_a_terminal_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = ["0.6", "wide", "0.5", "40", "0.06", "round", "kiwi", "", "5", ""]
    terminal = io.StringIO("\n".join(answers) + "\n")
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMNI_WORKSPACE", str(WORKSPACE))
    with pytest.raises(SystemExit) as ended:
        main(["new-vehicle", "mine"])
    said = capsys.readouterr()
    assert ended.value.code == 0, said.err
    assert "Please enter a number" in said.err
    assert "Please select one of the available options" in said.err
    vehicle = ExperimentLibrary(WORKSPACE / "config").vehicle(str(tmp_path / "mine/vehicle.yaml"))
    assert len(vehicle.wheels) == 3
    assert vehicle.load.mass == 5.0
    assert vehicle.drive.max_torque == vehicle.brake.max_torque
    assert {mount.roller_angle_deg for mount in vehicle.wheels.values()} == {0.0}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["rum"], "did you mean 'run'"),
        (["study", "tabel2"], "did you mean 'table2'"),
        (["study", "tuning", "--max-rotatoin", "3"], "did you mean '--max-rotation'"),
        (["show", "mecanum_forklyft"], "did you mean 'mecanum_forklift'"),
        (["list", "vehicle"], "did you mean 'vehicles'"),
        (["run", "--variant", "asisted"], "did you mean 'assisted'"),
        (["study", "accuracy", "--metric", "pearsn"], "did you mean 'pearson'"),
        (["show", "tabel2"], "did you mean 'table2'"),
        (["run", "--replace", "brake_asist=external"], "did you mean 'brake_assist=external'"),
        (["replay", str(WORKSPACE / "bags/small_stop/assisted"), "--nodes", "brake_asist"],
         "did you mean 'brake_assist'"),
        (["new-vehicle", "mine", "--length", "1"], ": --width: is required"),
        (["new-vehicle", "mine", "--wheel-radius", "9", "--length", "1", "--width", "1",
          "--mass", "9"], ": --wheel-radius"),
    ],
)  # fmt: skip
def test_a_misspelled_name_is_answered_with_the_likely_one(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMNI_WORKSPACE", str(WORKSPACE))
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
