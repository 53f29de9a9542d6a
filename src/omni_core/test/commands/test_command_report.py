"""A command without a result reports this as text, by its exit code, and as JSON if requested."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from xml.etree import ElementTree

import pytest

from omni_bringup.cli import main
from omni_core.commands.command_report import Report, write_text
from omni_tools.vehicles import show_command as show

WORKSPACE = Path(__file__).parents[4]


@pytest.fixture(autouse=True)
def workspace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMNI_WORKSPACE", str(WORKSPACE))


@pytest.mark.parametrize(
    ("words", "name", "problem"),
    [
        (["run", "--json", "strait_line"], "run", "'strait_line' is not known"),
        (["run", "--jsn", "--json"], "run", "unrecognized arguments: --jsn"),
        (["run", "--vehicle", "x", "--json"], "run", "--vehicle; --set KEY=VALUE changes"),
        (["run", "--json", "--set", "vehicle.load.mass=-1"], "run", "-1 kg is out of range"),
        (["bag", "info", "nowhere", "--json"], "bag_info", "nowhere: there is no such"),
        (["ros-params", "no.yaml", "--out", "x", "--json"], "ros-params", "cannot read no.yaml"),
        (
            ["report", "nowhere", "--out", "/proc/x.html", "--json"],
            "report",
            "cannot write to /proc",
        ),
        (["study", "tabel2", "--json"], "study", "'tabel2' is not one of"),
        (["limit", "--out", "x", "--json"], "limit", "can only be used with --best"),
    ],
)
def test_a_refusal_is_json_where_json_is_asked_for(
    words: list[str],
    name: str,
    problem: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert ended.value.code == document["exit_code"] == 2
    assert document["name"] == name
    assert problem in document["error"]
    assert problem in printed.err


@pytest.mark.parametrize(
    "words",
    [
        ["run", "{}"],
        ["run", "small_stop", "--set", "{}=1"],
        ["run", "--{}"],
        ["show", "{}"],
        ["bag", "info", "{}"],
        ["study", "{}"],
        ["{}"],
    ],
)
def test_a_very_long_word_is_refused_and_not_repeated_in_full(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*(word.format("x" * 3000) for word in words), "--json"])
    printed = capsys.readouterr()
    error = json.loads(printed.out)["error"]
    assert ended.value.code == 2
    for text in (error, printed.err):
        assert "x" * 20 in text
        assert "x" * 256 not in text


def test_a_long_path_is_named_completely(capsys: pytest.CaptureFixture[str]) -> None:
    path = "/".join(["nowhere", *["a folder of this project"] * 20, "vehicle.yaml"])
    with pytest.raises(SystemExit):
        main(["show", path.replace(" ", "_")])
    assert "/vehicle.yaml" in capsys.readouterr().err


def test_a_failed_write_is_a_failure_and_no_refusal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as ended:
        main(["show", "cork", "--out", str(tmp_path / "file/below.png"), "--json"])
    assert ended.value.code == 1
    assert "cannot access" in json.loads(capsys.readouterr().out)["error"]


def test_a_full_disk_is_reported_with_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # without a name, as from write()

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match=r"No space left .*report\.html"):
        write_text(tmp_path / "report.html", "text")


_MEASURED = ["--length", "1", "--width", "0.6", "--mass", "200", "--wheel-radius", "0.1"]


@pytest.mark.parametrize("folder", ["file/below", "/proc/below"])
@pytest.mark.parametrize(
    "command",
    [
        ["drive", "--port", "0"],
        ["new-vehicle", "mine", *_MEASURED],
        ["nav2-polygons"],
        ["replay", "bags/small_stop/assisted"],
        ["ros-params", "mecanum_agv"],
        ["run", "small_stop"],
        ["study", "table2"],
    ],
    ids=lambda words: words[0],
)
def test_a_folder_that_cannot_be_made_is_refused_before_any_work(
    command: list[str],
    folder: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(WORKSPACE)
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as ended:
        main([*command, "--out", str(tmp_path / folder)])
    assert ended.value.code == 2
    assert f"--out: cannot make {tmp_path / folder}" in capsys.readouterr().err


@pytest.mark.parametrize("existed", [False, True])
def test_impossible_numbers_leave_no_file_and_no_new_folder(
    existed: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    if existed:
        folder.mkdir()
    with pytest.raises(SystemExit) as ended:
        main(["new-vehicle", "mine", *_MEASURED, "--wheel-radius", "1e-3", "--out", str(folder)])
    assert ended.value.code == 2
    assert "check them and their units" in capsys.readouterr().err
    assert list(tmp_path.rglob("*")) == ([folder] if existed else [])


def test_a_number_of_threads_that_is_none_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "0")
    with pytest.raises(SystemExit) as ended:
        main(["list"])
    assert ended.value.code == 2
    problem = "NUMBA_NUM_THREADS: '0' is not a whole number above 0; unset it"
    assert capsys.readouterr().err == f"omni list: {problem}\n"


def test_a_drive_does_not_overwrite_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["drive", "--port", "0", "--out", str(tmp_path)])
    assert ended.value.code == 2
    assert f"{tmp_path} exists; choose another" in capsys.readouterr().err


@pytest.mark.parametrize("configuration", ["mecanum_agv", "small_stop", "mine"])
def test_parameters_are_written_for_a_name_or_folder(
    configuration: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for command in (["new-vehicle", "mine", *_MEASURED], ["ros-params", configuration]):
        with pytest.raises(SystemExit) as ended:
            main([*command, *(["--out", "parameters"] if command[0] == "ros-params" else [])])
        assert ended.value.code in (None, 0)
    assert (tmp_path / "parameters/brake_assist.yaml").is_file()
    robot = ElementTree.parse(tmp_path / "parameters/robot.urdf")
    assert robot.find("link[@name='imu']") is not None


@pytest.mark.parametrize(
    ("configuration", "problem"),
    [("small_stob", "did you mean 'small_stop'"), ("mine/vehicle.yaml", "describes no sensors")],
)
def test_what_is_no_configuration_is_refused_with_a_remedy(
    configuration: str,
    problem: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(["new-vehicle", "mine", *_MEASURED])
    with pytest.raises(SystemExit) as ended:
        main(["ros-params", configuration, "--out", "parameters"])
    assert ended.value.code == 2
    assert problem in capsys.readouterr().err
    assert not (tmp_path / "parameters").exists()


def test_new_files_are_listed_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["new-vehicle", "mine", *_MEASURED, "--out", str(tmp_path / "mine"), "--json"])
    assert ended.value.code in (None, 0)
    document = json.loads(capsys.readouterr().out)
    assert all(Path(path).is_file() for path in document["files"])
    assert document["metrics"]["load.front_left"]["unit"] == "N"
    with pytest.raises(SystemExit) as ended:
        main(["show", str(tmp_path / "mine"), "--out", str(tmp_path / "mine.png"), "--json"])
    assert ended.value.code in (None, 0)
    said = capsys.readouterr()
    assert json.loads(said.out)["facts"]["wheel loads"]
    assert "breaks the symmetry" not in said.err
    assert (tmp_path / "mine.png").is_file()


def test_a_shown_vehicle_names_its_wheels_without_rollers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["show", "steered_forklift", "--out", str(tmp_path / "mine.png"), "--json"])
    facts = json.loads(capsys.readouterr().out)["facts"]
    assert facts["without rollers"] == "rear_left, front_left, front_right, rear_right"
    assert facts["steered"].startswith("rear_left to 75 deg at up to 60 deg/s, rear_right to")
    assert "rollers" not in facts


def test_output_of_a_library_does_not_enter_the_json_document(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def run(*_: object) -> Report:
        os.write(1, b"an error of the middleware\n")
        return Report(details={"found": "nothing"})

    monkeypatch.setattr(show, "run", run)
    with pytest.raises(SystemExit):
        main(["show", "mecanum_forklift", "--json"])
    output = capfd.readouterr()
    assert json.loads(output.out)["found"] == "nothing"
    assert "an error of the middleware" in output.err


def test_a_shown_vehicle_with_a_wrong_roller_angle_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (Path(__file__).parents[4] / "config/vehicles/mecanum_forklift.yaml").read_text()
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(text.replace("roller_angle_deg: 45", "roller_angle_deg: -45", 1))
    with pytest.raises(SystemExit) as ended:
        main(["show", str(wrong), "--kind", "vehicles", "--out", str(tmp_path / "wrong.png")])
    assert ended.value.code in (None, 0)
    assert "rear_left.roller_angle_deg: -45 deg breaks the symmetry" in capsys.readouterr().err
