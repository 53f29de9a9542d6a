"""The launch files start the same nodes as the command line; the test needs no `launch`."""

from __future__ import annotations

import ast
import runpy
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
import yaml

from omni_bringup.graph import nodes as graph
from omni_bringup.graph.launch_plan import ARGUMENTS, installed_config, launch_plan
from omni_bringup.graph.process_group import NodeProcess, ProcessError
from omni_loop.experiment import ExperimentLibrary
from omni_platform.configuration import ConfigurationError

PACKAGE = Path(__file__).parents[2]
CONFIG = PACKAGE.parents[1] / "config"
MODES = ("lockstep", "real_time", "drive")


def arguments(**changes: str) -> dict[str, str]:
    defaults = {name: default for name, (default, _) in ARGUMENTS.items()}
    return defaults | {"config": str(CONFIG)} | changes


def described(nodes: Sequence[NodeProcess]) -> Mapping[str, Any]:
    """Return package, executable, parameters and remappings of each node."""
    found = {}
    for node in nodes:
        ros, flag, path, *rest = node.arguments
        assert (ros, flag) == ("--ros-args", "--params-file")
        found[node.name] = (
            node.package,
            node.executable,
            yaml.safe_load(Path(path).read_text()),
            rest,
        )
    return found


@pytest.fixture(autouse=True)
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.mark.parametrize("file", sorted((PACKAGE / "launch").glob("*.py")), ids=lambda f: f.name)
def test_every_launch_file_is_sound_and_the_runs_share_one_text(file: Path) -> None:
    text = file.read_text()
    tree = ast.parse(text)
    assert compile(tree, str(file), "exec")
    assert "generate_launch_description" in {
        node.name for node in tree.body if isinstance(node, ast.FunctionDef)
    }
    mode = file.name.removesuffix(".launch.py")
    assert (mode in MODES) == (f'run_description("{mode}")' in text)


@pytest.mark.parametrize("mode", ["lockstep", "real_time"])
def test_a_run_gets_the_parameters_of_the_command_line(mode: str, tmp_path: Path) -> None:
    scratch, bag = tmp_path / "scratch", tmp_path / "bag"
    scratch.mkdir()
    configuration = ExperimentLibrary(CONFIG).load("straight_line", "assisted", ["seed=7"])
    nodes = graph.Nodes(configuration, scratch, lockstep=mode == "lockstep")
    expected = [
        nodes.recorder(bag),
        nodes.odometry(),
        nodes.brake_assist(),
        nodes.simulator(),
    ]
    planned = launch_plan(mode, arguments(out=str(bag), overrides="seed=7")).nodes
    assert described(planned) == described(expected)
    simulator = described(planned)["simulator"][2]["/**"]["ros__parameters"]
    assert (simulator["mode"], simulator["driver"], simulator["seed"]) == (mode, "scripted", 7)


@pytest.mark.parametrize("out", ["", "bag"])
def test_a_drive_gets_the_parameters_of_the_command_line(out: str, tmp_path: Path) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    configuration = ExperimentLibrary(CONFIG).load("small_stop", "assisted")
    folder = Path(out).resolve() if out else None
    planned = launch_plan("drive", arguments(experiment="small_stop", out=out)).nodes
    assert described(planned) == described(graph.Nodes(configuration, scratch).of_drive({}, folder))
    assert [node.name for node in planned][-4:] == [
        "driver",
        "linescan_odometry",
        "brake_assist",
        "simulator",
    ]


def test_a_run_without_a_folder_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"^out: is required"):
        launch_plan("lockstep", arguments())


def test_the_configuration_is_installed_for_launches_from_anywhere() -> None:
    for folder in ("vehicles", "experiments", "hardware"):
        installed = {file.name for file in (installed_config() / folder).iterdir()}
        assert installed == {file.name for file in (CONFIG / folder).glob("*.yaml")}


def test_a_run_that_was_stopped_before_it_began_says_so(tmp_path: Path) -> None:
    out = tmp_path / "bag"
    plan = launch_plan("lockstep", arguments(out=str(out)))
    out.mkdir()  # by the recorder
    with pytest.raises(ProcessError, match="simulator was stopped before it began"):
        plan.finish()
    assert (out / "configuration.yaml").is_file()


def test_a_folder_with_a_recording_is_refused_before_anything_starts(tmp_path: Path) -> None:
    (tmp_path / "bag_0.mcap").touch()
    with pytest.raises(ConfigurationError, match=r"out: .* is not an empty folder"):
        launch_plan("lockstep", arguments(out=str(tmp_path)))


def test_a_namespace_holds_for_every_node(tmp_path: Path) -> None:
    plan = launch_plan("lockstep", arguments(out=str(tmp_path / "bag"), namespace="robot1"))
    for node in plan.nodes:
        assert list(node.arguments[-2:]) == ["-r", "__ns:=/robot1"]


@pytest.mark.parametrize("file", sorted((PACKAGE / "launch").glob("*.py")), ids=lambda f: f.name)
def test_a_misspelled_argument_is_refused(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("", ".actions", ".event_handlers", ".events"):
        monkeypatch.setitem(sys.modules, f"launch{name}", MagicMock())
    for name in ("launch_ros", "launch_ros.actions"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "omni_bringup", file.name])
    runpy.run_path(str(file))["generate_launch_description"]()
    del sys.modules["omni_bringup.launching"]  # it has imported the replacements
    start = sys.modules["launch.actions"].OpaqueFunction.call_args.kwargs["function"]
    with pytest.raises(ConfigurationError, match="did you mean 'namespace'"):
        start(SimpleNamespace(argv=["namespac:=robot1"], launch_configurations={}))
