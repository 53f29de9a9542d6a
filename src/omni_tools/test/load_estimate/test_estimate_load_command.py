"""``./omni estimate-load``: recordings of the graph give a vehicle file for other commands."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from omni_process import omni, omni_here

from omni_runs.experiment import ExperimentLibrary

ROOT = Path(__file__).parents[4]
DRIVE = ["--set", "feedback=velocity_sensor", "--set", "simulation.render_lines=false"]
# Half the steps show the load as well.
DRIVE += ["--set", "simulation.control_period=0.02"]
DRIVE += ["--set", "maneuver.speed=2", "--set", "maneuver.brake_time=5"]
DRIVE += ["--set", "maneuver.pedal=0.06", "--variant", "unassisted"]
TWIST = ["--twist", "ground_truth/odom"]


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return recordings of the forklift without load and with the load of its file."""
    folder = tmp_path_factory.mktemp("drives")
    for name, mass in (("empty", 0), ("loaded", 250)):
        words = ["run", "straight_line", *DRIVE, "--set", f"vehicle.load.mass={mass}"]
        done = omni_here([*words, "--out", str(folder / name)])
        assert done.returncode == 0, done.stderr
    return {name: folder / name / "unassisted" for name in ("empty", "loaded")}


def test_a_recorded_drive_gives_a_vehicle_with_its_load(
    drives: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "carrying.yaml"
    words = ["estimate-load", str(drives["loaded"]), "--vehicle", "mecanum_forklift", *TWIST]
    words += ["--empty", str(drives["empty"]), "--out", str(out), "--speed", "10", "--json"]
    done = omni(words)
    assert done.returncode == 0, done.stderr
    metrics = json.loads(done.stdout)["metrics"]
    for key, true in (("mass.load", 250.0), ("forward.load", 0.65), ("left.load", 0.5)):
        found = metrics[key]
        assert abs(found["value"] - true) < 3.0 * found["standard_error"], key
        assert found["standard_error"] < 0.2 * true
    assert abs(metrics["rotation.unassisted"]["value"]) > 5.0
    vehicle = ExperimentLibrary(ROOT / "config").vehicle(str(out))
    assert vehicle.load.mass == pytest.approx(metrics["mass.load"]["value"], abs=0.01)
    assert vehicle.wheels == ExperimentLibrary(ROOT / "config").vehicle("mecanum_forklift").wheels
    assert yaml.safe_load(out.read_text())["load"]["height"] == 0.5


def test_a_load_that_swerves_is_reported(drives: dict[str, Path], tmp_path: Path) -> None:
    words = ["estimate-load", str(drives["loaded"]), "--vehicle", "mecanum_forklift", *TWIST]
    words += ["--out", str(tmp_path / "v.yaml"), "--max-rotation", "1"]
    fast, slow = (omni([*words, "--speed", speed]).stdout for speed in ("10", "0.2"))
    assert "warning: a stop without the assistant from 10 m/s" in fast
    assert "warning" not in slow
    assert "of free rolling and" in slow


def test_what_does_not_suffice_is_refused(drives: dict[str, Path], tmp_path: Path) -> None:
    bag = str(ROOT / "bags/small_stop/assisted")
    for words, reason, code in (
        ([str(tmp_path / "none")], "none", 2),
        ([bag, *TWIST], "3 s of free rolling", 2),
        ([str(drives["loaded"]), "--twist", "odometry/twist"], "odometry/twist", 2),
        ([str(drives["loaded"]), *TWIST, "--empty", str(drives["loaded"])], "empty vehicle", 2),
    ):
        done = omni(["estimate-load", *words, "--vehicle", "mecanum_forklift"])
        assert done.returncode == code, done.stderr
        assert reason in done.stderr
        assert "Traceback" not in done.stderr
    robot = omni(["estimate-load", str(drives["loaded"]), *TWIST, "--vehicle", "three_wheel_robot"])
    assert robot.returncode == 2
    assert "is it a drive of this vehicle?" in robot.stderr
