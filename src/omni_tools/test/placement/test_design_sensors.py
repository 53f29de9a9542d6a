"""``./omni design-sensors``: written files, output and rejected options."""

from __future__ import annotations

import functools
import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from omni_bringup.cli import main
from omni_runs.experiment import ExperimentLibrary
from omni_runs.loop import run_closed_loop
from omni_tools.placement import design as sensor_design
from omni_tools.placement import figure as placement_figure
from omni_tools.placement.search import search
from omni_tools.placement.sensor_error import SensorError, SensorTrial
from omni_tools.vehicles.estimates import Measured, write_vehicle

CONFIG = Path(__file__).parents[4] / "config"
# A low line rate makes the test fast.
COARSE = ("--type", "three_coarse", "--speed", "3")


@pytest.fixture(autouse=True)
def workspace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMNI_WORKSPACE", str(CONFIG.parent))


def omni(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["design-sensors", *map(str, arguments)])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_designed_sensors_measure_in_an_experiment(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert omni("--vehicle", "three_wheel_robot", *COARSE, "--json", "--out", out) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((out / "summary.json").read_text())
    assert document["name"] == "design-sensors"
    metrics = document["metrics"]
    best = metrics["mean_error.best"]
    assert best["unit"] == "m/s"
    assert 0.0 < best["value"] < metrics["mean_error.three_coarse"]["value"]
    assert metrics["mean_error.radial"]["value"] is None
    assert "pass through one point" in metrics["singular.radial"]["note"]
    assert (out / "placements.png").read_bytes().startswith(b"\x89PNG")
    overrides = [
        f"sensors={out / 'sensors.yaml'}",
        "vehicle=three_wheel_robot",
        "maneuver.speed=2.0",
        "maneuver.brake_time=100.0",
        "simulation.duration_limit=0.1",
    ]
    configuration = ExperimentLibrary(CONFIG).load("straight_line", "assisted", overrides)
    for name, sensor in configuration.sensors.items():
        assert metrics[f"x.{name}"]["value"] == sensor.x
        assert metrics[f"heading.{name}"]["value"] == sensor.heading_deg
        assert sensor.pixels == 256
    history = run_closed_loop(configuration)
    assert all(history.measured[1:])
    assert abs(history.estimate[-1] - history.twist[-1]).max() < 0.05


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the slow parts: use a given error, search briefly, and draw an empty figure."""
    speed = np.array([3.0, 0.0])
    rms = np.array([0.002, 0.01])
    given = SensorTrial(SensorError(2e-6, 6e-4), speed, speed[::-1], rms, rms)
    monkeypatch.setattr(sensor_design, "measure_sensor_error", lambda *_: given)
    monkeypatch.setattr(sensor_design, "search", functools.partial(search, population=5))
    monkeypatch.setattr(placement_figure, "placement_figure", lambda *_: Figure())


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("given", ["three_wheel_robot", "a robot.yaml"])
def test_the_printed_command_runs_the_places_under_their_vehicle(
    given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robot = (CONFIG / "vehicles" / "three_wheel_robot.yaml").read_text()
    (tmp_path / "a robot.yaml").write_text(robot)
    assert omni("--vehicle", given, *COARSE, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out.splitlines()[-1]
    command = printed.removeprefix("use it: ").removesuffix(", or copy it into config/sensors")
    program, verb, *options = shlex.split(command)
    assert (program, verb, options[::2]) == ("./omni", "run", ["--set", "--set"])
    monkeypatch.chdir("/")
    library = ExperimentLibrary(CONFIG)
    configuration = library.load("straight_line", "assisted", options[1::2])
    assert configuration.vehicle == library.vehicle("three_wheel_robot")
    assert configuration.vehicle != library.load("straight_line", "assisted").vehicle
    assert configuration.sensors == library.sensors(str(tmp_path / "out" / "sensors.yaml"))


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("given", ["my robot", "my robot/vehicle.yaml"])
def test_the_printed_command_runs_the_stop_of_an_own_vehicle(
    given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    own = Measured(length=0.58, width=0.38, mass=30.0, wheel_radius=0.05)
    write_vehicle("my robot", own, tmp_path / "my robot")
    assert omni("--vehicle", given, *COARSE, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out.splitlines()[-1]
    command = printed.removeprefix("use it: ").removesuffix(", or copy it into config/sensors")
    _, _, experiment, _, placement = shlex.split(command)
    monkeypatch.chdir("/")
    library = ExperimentLibrary(CONFIG)
    configuration = library.load(experiment, "assisted", [placement])
    assert configuration.vehicle == library.vehicle(str(tmp_path / "my robot/vehicle.yaml"))
    assert configuration.sensors == library.sensors(str(tmp_path / "out" / "sensors.yaml"))
    # This stop is a few lengths of the vehicle long, and not that of a forklift.
    assert configuration.maneuver.speed**2 / (2.0 * 9.81) < 5.0 * own.length


@pytest.mark.usefixtures("quick")
def test_a_singular_placement_is_named_and_fails_the_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = "pixels: 256, length: 0.05, width: 0.02, line_rate: 1000.0"
    radial = tmp_path / "star.yaml"
    radial.write_text(
        f"a: {{x: 0.5, y: 0.0, heading_deg: 0.0, {camera}}}\n"
        f"b: {{x: 0.0, y: 0.4, heading_deg: 90.0, {camera}}}\n"
        f"c: {{x: -0.3, y: -0.3, heading_deg: 45.0, {camera}}}\n"
    )
    checks = ("--check", radial, "--check", "three_coarse")
    assert omni(*checks, "--speed", 3, "--out", tmp_path / "out") == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "star: singular: the axes of a, b, c pass through one point" in printed
    assert "three_coarse is not singular: its axes spread by 35 deg" in printed


@pytest.mark.usefixtures("quick")
def test_cameras_on_carriers_are_evaluated_at_the_steering_angles_of_each_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two fixed cameras measure v_x and yaw rate; sideways, the third one measures v_x, too."""
    camera = "pixels: 256, length: 0.05, width: 0.02, line_rate: 1000.0"
    wheel = "carrier: rear_left, carrier_x: -0.4, carrier_y: 0.3"
    placement = tmp_path / "mine.yaml"
    placement.write_text(
        f"left: {{x: 0.0, y: 0.25, heading_deg: 0.0, {camera}}}\n"
        f"right: {{x: 0.0, y: -0.25, heading_deg: 0.0, {camera}}}\n"
        f"turned: {{x: -0.25, y: 0.3, heading_deg: 90.0, {camera}, {wheel}}}\n"
    )
    checks = ("--vehicle", "swerve_robot", "--check", placement, "--speed", 3, "--yaw-rate", 2)
    assert omni(*checks, "--out", tmp_path / "out") == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "mine is not singular at steering angles of 0: its" in printed
    assert "mine in sideways motion (rear_left at -90 deg): it is singular: the axes" in printed
    # The wheel at (-0.4, 0.3) m moves toward atan(-0.4 * 2 / (3 - 0.3 * 2)) = -18 deg.
    assert "mine in turning motion (rear_left at -18 deg): its mean error is" in printed
    assert "too close to wheel" not in printed
    assert omni(*checks[2:], "--out", tmp_path / "out") == 2
    assert "carrier: 'rear_left' is not one of" in capsys.readouterr().err


@pytest.mark.usefixtures("quick")
def test_a_search_that_finds_no_room_has_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert omni("--clearance", 0.4, "--out", tmp_path / "out") == 1
    assert "--sensors: there is no room for 3 sensors" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--vehicle", "bicycle"), "vehicle: 'bicycle' is not known"),
        (("--sensors", "2"), "--sensors: 2 is out of range, must be at least 3"),
        (("--sensors", "9"), "at most 8"),
        (("--type", "lidar"), "sensors: 'lidar' is not known"),
        (("--check", "s3901", "--type", "generic"), "s3901 has another type of camera"),
        (("--speed", "99"), "--speed: 99 m/s must be above 0 and at most 19 m/s"),
        (("--mix", "0:0:0:0"), "--mix: '0:0:0:0' must be four shares"),
        (("--redundant",), "--redundant: requires at least four sensors"),
        (("--ground", "ice"), "--ground: 'ice' is not one of"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    arguments: tuple[str, ...], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert omni(*arguments, "--out", tmp_path / "out") == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert len(captured.err.splitlines()) == 1
    assert captured.out == ""
    assert not (tmp_path / "out").exists()
