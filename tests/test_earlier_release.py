"""What a user of commit a41be7f2 has still works, or is refused with the remedy.

``tests/earlier_release/extract.py`` has taken the files of that folder from this commit: the public
names of the renamed packages, the commands of the pages, all configurations, parameter files, a
law, an odometry, a notebook and a recording.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from omni_process import WORKSPACE, omni_here, run_notebook

from linescan_odometry import odometry_node
from linescan_odometry.configuration import OdometryConfiguration
from omni_brake_assist import brake_assist_node
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_bringup.cli import parse_command_line
from omni_recording.plan import RecorderConfiguration
from omni_ros.flat_parameters import unflatten
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary, recorded_experiment
from omni_runs.graph.hardware import read_hardware
from omni_runs.loop import run_closed_loop
from omni_runs.recorded_run import read_run
from omni_vehicle.brake_adapter import BrakeAdapterConfiguration
from omni_vehicle.brake_adapter_node import TopicsConfiguration
from omni_vehicle.controller_switch import SwitchConfiguration

HERE = WORKSPACE / "tests/earlier_release"
RECORDING = HERE / "recording"
FILES = json.loads((HERE / "files.json").read_text("utf-8"))
COMMANDS = (HERE / "commands.txt").read_text("utf-8").splitlines()
# Functions that other modules of the package used; no page named them.
PRIVATE_NOW = {
    "omni_loop.recorded_run": {"cut", "demand"},
    "omni_figures.tables.comparison_table": {"in_small_units"},
}
# Modules about private names of numba, which are now in another one; no page named them.
GONE = {"omni_platform.compilation.calls", "omni_platform.compilation.machine_code"}
# Objects that the pages named, besides those of the renamed packages.
OF_PAGES = """
linescan_odometry.camera.camera_node.main linescan_odometry.measurements.SensorReading
linescan_odometry.measurements.TwistEstimate linescan_odometry.odometry.LineBatch
linescan_odometry.odometry.LineScanOdometry linescan_odometry.odometry.OdometryConfiguration
omni_brake_assist.brake_assist.BrakeAssist omni_brake_assist.laws.law.Motion
omni_sim.vehicle.vehicle.Vehicle omni_tools.limit.bounds omni_tools.two_sensors
"""
NODES = {  # configurations that each node declares as its parameters
    "brake_adapter": (BrakeAdapterConfiguration, TopicsConfiguration, SwitchConfiguration),
    "brake_assist": (BrakeAssistConfiguration, brake_assist_node.TimingConfiguration),
    "linescan_odometry": (OdometryConfiguration, odometry_node.InterfaceConfiguration),
    "recorder": (RecorderConfiguration,),
}
IMPORTS = """
import pkgutil, sys, warnings
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for name in sys.stdin.read().split():
        pkgutil.resolve_name(name)
import omni_core.sensors, omni_platform.sensors
assert omni_platform.sensors is omni_core.sensors  # each class exists once
print(*(one.message for one in caught if one.category is FutureWarning), sep="\\n")
"""


def test_old_names_are_imported_with_a_warning_that_gives_the_new_one() -> None:
    wanted = OF_PAGES.split()
    for module, *names in map(str.split, (HERE / "names.txt").read_text("utf-8").splitlines()):
        kept = set(names) - PRIVATE_NOW.get(module, set())
        wanted += [module, *(f"{module}.{name}" for name in kept)] if module not in GONE else []
    command = [sys.executable, "-c", IMPORTS]
    text = " ".join(wanted)
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=True)
    for old, new in {
        "omni_platform": "omni_core",
        "omni_loop": "omni_runs",
        "omni_figures": "omni_runs.figures",
        "omni_tools.limit.bounds": "omni_runs.limit.bounds",
        "linescan_odometry.camera": "omni_vehicle.camera",
    }.items():
        assert f"{old} is now {new}, and the old name will be" in done.stdout


@pytest.mark.parametrize("line", [one for one in COMMANDS if not one.startswith("exec ")])
def test_the_command_line_accepts(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        parse_command_line(shlex.split(line))
    except SystemExit as ended:
        refused = ended.code and "arguments are required" not in capsys.readouterr().err
    else:
        refused = False
    assert not refused


@pytest.mark.parametrize("change", sorted({
    word for line in COMMANDS for word in shlex.split(line)
    if re.fullmatch(r"\w+([.]\w+)+=.*", word) and not re.search(r"[.]yaml|csv|tables|,\d", word)
    and line.startswith(("run", "study"))
}))  # fmt: skip
def test_an_experiment_takes_the_changes_of_the_pages(change: str) -> None:
    library = ExperimentLibrary(WORKSPACE / "config")
    plain = ["feedback=velocity_sensor", "simulation.render_lines=false"]
    library.load("ice_patch", overrides=[*plain, "vehicle.brake.kind=proportional", change])


def test_programs_of_the_pages_exist() -> None:
    modules = [line.split()[3] for line in COMMANDS if line.startswith("exec python -m ")]
    assert [name for name in modules if importlib.util.find_spec(name) is None] == []
    files = [word for line in COMMANDS for word in line.split()
             if word.startswith(("benchmarks/", "tests/", "requirements/"))]  # fmt: skip
    assert [name for name in files if not (WORKSPACE / name).exists()] == []
    for package, executable in (("linescan_odometry", "camera"), ("omni_bringup", "driver")):
        assert (WORKSPACE / f".cache/install/lib/{package}/{executable}").exists()


def test_a_module_runs_under_its_old_name() -> None:
    command = [sys.executable, "-m", "linescan_odometry.camera.camera_node"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "linescan_odometry.camera is now omni_vehicle.camera" in done.stderr
    assert done.stderr.endswith("sensor: is required and has no value\n")


@pytest.mark.parametrize(("name", "command"), [
    ("drive", "./omni drive"), ("lockstep", "./omni run"), ("real_time", "./omni run"),
])  # fmt: skip
def test_a_launch_file_names_the_command(name: str, command: str) -> None:
    place = WORKSPACE / f".cache/install/share/omni_bringup/launch/{name}.launch.py"
    spec = importlib.util.spec_from_file_location(name, place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.raises(RuntimeError, match=f"removed: use {command}"):
        module.generate_launch_description()


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of the earlier release."""
    folder = tmp_path_factory.mktemp("earlier")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", [one for one in FILES if re.match("config/exp|my_robot/e", one)])
def test_an_experiment_is_read(earlier: Path, name: str) -> None:
    library = ExperimentLibrary(earlier / "config")
    path = str(earlier / name)
    for variant in library.variants(path):
        library.load(path, variant)


@pytest.mark.parametrize("name", [one for one in FILES if one.startswith("config/")])
def test_a_part_of_an_experiment_is_read(earlier: Path, name: str) -> None:
    library = ExperimentLibrary(earlier / "config")
    path = str(earlier / name)
    match name.split("/")[1]:
        case "vehicles":
            library.vehicle(path)
        case "sensors":
            library.sensors(path)
        case "tires":
            library.tire(path)
        case "grounds":
            library.load("small_stop", overrides=[f"ground={path}"])
        case "hardware":
            read_hardware(path, library)


@pytest.mark.parametrize("name", [one for one in FILES if one.startswith("parameters/")])
def test_a_node_accepts_its_parameter_file(name: str) -> None:
    values = yaml.safe_load(FILES[name])["/**"]["ros__parameters"]
    values |= {"folder": "bag"} if Path(name).stem == "recorder" else {}  # given with -p
    for cls in NODES[Path(name).stem]:
        unflatten(cls, lambda key, _kind, default, _info: values.pop(key, default))
    assert not values  # every parameter is known


def test_a_recording_is_checked_measured_and_replayed(tmp_path: Path) -> None:
    configuration = recorded_experiment(RECORDING / "configuration.yaml")
    assert configuration.brake_assist.k == 7
    metrics = json.loads((RECORDING / "summary.json").read_text())["metrics"]
    distance = read_run(RECORDING).stopping_distance
    assert distance == pytest.approx(metrics["stopping_distance.assisted"]["value"], rel=1e-9)
    for words in (
        ["bag", "check", RECORDING],
        ["compare", RECORDING],
        ["report", RECORDING, "--out", tmp_path / "report.html"],
        ["replay", RECORDING, "--out", tmp_path / "replayed"],
    ):
        done = omni_here([str(word) for word in words])
        assert done.returncode == 0, done.stderr


def test_a_law_and_an_odometry_brake(earlier: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(earlier))
    library = ExperimentLibrary(earlier / "config")
    plain = ["feedback=velocity_sensor", "simulation.render_lines=false"]
    law = "brake_assist.law=my_law:BrakeTheSpin"
    braked = run_fast_loop(library.load("straight_line", "assisted", [*plain, law]))
    free = run_fast_loop(library.load("straight_line", "unassisted", plain))
    assert abs(braked.orientation_change) < 0.3 * abs(free.orientation_change)
    short = ["feedback=my_odometry:CorrelationOdometry", "simulation.duration_limit=0.2"]
    run = run_closed_loop(library.load("small_stop", "assisted", short))
    assert abs(run.estimate[-1] - run.twist[-1]).max() < 0.2


def test_a_notebook_runs(earlier: Path) -> None:
    done = run_notebook(FILES["own_law.ipynb"], earlier)
    assert done.returncode == 0, done.stderr
