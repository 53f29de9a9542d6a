"""Results of ``./omni study feedback``, from which a warning for a real vehicle follows."""

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core.configuration import ConfigurationError
from omni_sim.twist_sources import SOURCES

_QUANTITIES = ("harm", "distance_ratio_p95", "rotation_p95", "rotation_unassisted_p95")


def conditions_of(assistant: BrakeAssistConfiguration, imu: bool) -> dict[str, Any]:
    """Return the brakes that the assistant assumes, and whether there is an IMU, keyed by name."""
    brake = {f"brake.{key}": value for key, value in dataclasses.asdict(assistant.brake).items()}
    return {"imu": imu, "minimum_dwell_time": assistant.minimum_dwell_time, **brake}


def harm_sentence(vehicle: str, law: str, source: str, found: Mapping[str, float]) -> str:
    """Return the sentence that assistance with a source of the twist does more harm than good.

    Args:
        vehicle: name of the vehicle.
        law: name of the control law.
        source: source of the twist, a key of `SOURCES`.
        found: statistics of the stops: ratios of distances [1] and rotations [deg], keyed by name.
    """
    return (
        f"{vehicle}: with {SOURCES[source].label} and {law}, assistance does more harm than good "
        f"(95th percentile: {found['distance_ratio_p95']:.2f} times the distance, "
        f"{found['rotation_p95']:.1f} deg; "
        f"without {found['rotation_unassisted_p95']:.1f} deg)"
    )


def warning_of(
    summary: Path, vehicle: str, source: str, assistant: BrakeAssistConfiguration, imu: bool
) -> str:
    """Return a warning if assistance does more harm than good; otherwise an empty text.

    Args:
        summary: ``summary.json`` of a run of this study.
        vehicle: name of the vehicle.
        source: source of the twist.
        assistant: configuration of the assistant, with the law and the brakes of the vehicle.
        imu: whether the vehicle has an IMU.

    Raises:
        ConfigurationError: the file does not contain this vehicle with these brakes, with or
            without an IMU, or not this law and source.
    """
    law, wanted = assistant.law, conditions_of(assistant, imu)
    found = {}
    try:
        document = json.loads(summary.read_text(encoding="utf-8"))
        if (measured := document["conditions"][vehicle]) != wanted:
            raise LookupError(f"its stops have {dict(measured.items() - wanted.items())}")
        for quantity in _QUANTITIES:
            value = document["metrics"][f"{quantity}.{vehicle}_{law}_{source}"]["value"]
            found[quantity] = math.inf if value is None else value
    except OSError as error:
        problem = (
            f"cannot be read ({error.strerror}); run ./omni study feedback --vehicle FOLDER, or "
            "name the summary.json of such a run as --feedback"
        )
        raise ConfigurationError(str(summary), problem) from None
    except (ValueError, LookupError, TypeError) as error:
        problem = (
            f"has no stops of {vehicle} with {source} and {law} ({error}); "
            f"run ./omni study feedback --vehicle FOLDER{'' if imu else ' --without-imu'}"
        )
        raise ConfigurationError(str(summary), problem) from None
    return harm_sentence(vehicle, law, source, found) if found["harm"] else ""
