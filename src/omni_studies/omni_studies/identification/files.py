"""The configuration files of an identified candidate: its vehicle and its experiment."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_loop.commented_yaml import commented_yaml, rounded
from omni_loop.experiment import ExperimentConfiguration
from omni_platform.configuration import to_mapping

VEHICLE = "table_2_mecanum"
"""Name of the identified vehicle."""

_MOUNT = ("x", "y", "roller_angle_deg", "radius")
_PATCH = ("x", "y", "length", "width", "heading_deg", "friction")
_MANEUVER = (
    "y", "heading_deg", "speed", "direction_deg", "yaw_rate_deg", "hold_world_direction",
    "brake_time",
)  # fmt: skip
_SOURCE = "found by ./omni study table2 --identify; see docs/identification.md."


def write_files(configuration: ExperimentConfiguration, folder: Path) -> tuple[Path, Path]:
    """Write vehicle and experiment of a candidate in the form of ``config/``.

    Args:
        configuration: any variant of the candidate.
        folder: folder for both files.

    Returns:
        Vehicle file and experiment file.
    """
    vehicle = folder / f"{VEHICLE}.yaml"
    vehicle.write_text(
        commented_yaml(
            _vehicle(configuration),
            f"The Mecanum platform that gives Table 2, {_SOURCE}\n"
            "Wheels, tire and the inertia of the wheels are assumed.",
            {
                "wheels": "order of Eq. (35); rollers form an X seen from above",
                "load": "a point",
                "drive": "only before the pedal is down",
            },
        ),
        encoding="utf-8",
    )
    experiment = folder / "turn_while_translate.yaml"
    experiment.write_text(
        commented_yaml(
            _experiment(configuration),
            "Braking out of a turn while translating, on a slippery patch (Figures 43 to 48, Table "
            f"2).\nMotion, ground and vehicle were {_SOURCE}\n"
            "At the start of braking base_link is at the origin and moves along y.",
        ),
        encoding="utf-8",
    )
    return vehicle, experiment


def _picked(values: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    return {key: values[key] for key in keys}


def _vehicle(configuration: ExperimentConfiguration) -> dict[str, Any]:
    vehicle = to_mapping(configuration.vehicle)
    return rounded(
        {
            "wheels": {name: _picked(mount, *_MOUNT) for name, mount in vehicle["wheels"].items()},
            **_picked(vehicle, "chassis_length", "chassis_width"),
            "body": _picked(vehicle["body"], "mass", "height", "yaw_inertia"),
            "load": _picked(vehicle["load"], "mass", "x", "y", "height"),
            "tire": "rill_table_1",
            "brake": _picked(vehicle["brake"], "max_torque"),
            "drive": _picked(vehicle["drive"], "max_torque", "stiffness"),
            **_picked(vehicle, "wheel_inertia"),
        }
    )


def _experiment(configuration: ExperimentConfiguration) -> dict[str, Any]:
    ground, maneuver = to_mapping(configuration.ground), to_mapping(configuration.maneuver)
    (patch,) = ground["patches"].values()
    laws: dict[str, dict[str, Any]] = {
        "unassisted": {"enabled": False},
        "zero": {"weighting": "zero"},
        "cosine": {"weighting": "cosine"},
        "k1": {"weighting": "enhanced", "k": 1},
        "k7": {"weighting": "enhanced", "k": 7},
    }
    return {
        "description": "Braking out of a turn-while-translate maneuver",
        "vehicle": VEHICLE,
        "ground": {
            "texture": {"kind": "cork"},
            "friction": ground["friction"],
            "patches": {"ice": rounded(_picked(patch, *_PATCH))},
        },
        "sensors": "three_generic",
        "feedback": "velocity_sensor",
        "maneuver": rounded(_picked(maneuver, *_MANEUVER), 10),
        "simulation": {"duration_limit": configuration.simulation.duration_limit},
        "variants": {name: {"brake_assist": law} for name, law in laws.items()},
    }
