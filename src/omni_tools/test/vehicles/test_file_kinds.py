"""Each file of the configuration folder has the kind of its folder, by its keys alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from omni_core.configuration import ConfigurationError
from omni_runs.workspace import ExperimentWorkspace
from omni_runs.yaml_files import read_mapping
from omni_tools.vehicles import show_command
from omni_tools.vehicles.file_kinds import possible_kinds

CONFIG = Path(__file__).resolve().parents[4] / "config"
KINDS = ("vehicles", "grounds", "sensors", "experiments", "tires")


@pytest.mark.parametrize("kind", KINDS)
def test_every_file_has_the_kind_of_its_folder(kind: str) -> None:
    files = sorted((CONFIG / kind).glob("*.yaml"))
    assert files
    for file in files:
        assert possible_kinds(read_mapping(file, "file")) == [kind], file


@pytest.mark.parametrize(
    ("tree", "kinds"),
    [
        ({}, []),
        ({"nonsense": 1}, []),
        ({"model": "linear", "stifness": 1.0}, ["tires"]),
        ({"left": {"x": 0.0, "y": 0.1, "heding_deg": 0.0}}, ["sensors"]),
    ],
)
def test_a_misspelled_key_does_not_hide_the_kind(tree: dict[str, Any], kinds: list[str]) -> None:
    assert possible_kinds(tree) == kinds


@pytest.mark.parametrize("name", ["mecanum_agv", "wheel_twist_agv"])
def test_a_file_of_the_nodes_of_a_vehicle_is_not_shown(name: str) -> None:
    file = CONFIG / "hardware" / f"{name}.yaml"
    with pytest.raises(ConfigurationError, match="nodes of a real vehicle, for"):
        show_command.run(show_command.Options(name=str(file)), ExperimentWorkspace(CONFIG.parent))
