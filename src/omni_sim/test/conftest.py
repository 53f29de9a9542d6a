"""The vehicles of the repository's configuration folder, for all tests of this package."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from omni_core.configuration import from_mapping
from omni_sim.vehicle.configuration import VehicleConfiguration

CONFIG = Path(__file__).parents[3] / "config"


def _vehicle(name: str) -> VehicleConfiguration:
    mapping = yaml.safe_load((CONFIG / "vehicles" / f"{name}.yaml").read_text())
    tire = CONFIG / "tires" / f"{mapping['tire']}.yaml"
    mapping["tire"] = yaml.safe_load(tire.read_text())
    return from_mapping(VehicleConfiguration, mapping)


@pytest.fixture(scope="session")
def forklift() -> VehicleConfiguration:
    """The Mecanum forklift with its load at the front left."""
    return _vehicle("mecanum_forklift")


@pytest.fixture(scope="session")
def robot() -> VehicleConfiguration:
    """The three-wheeled robot."""
    return _vehicle("three_wheel_robot")
