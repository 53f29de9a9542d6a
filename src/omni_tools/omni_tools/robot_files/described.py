"""What the files of a robot say of a vehicle, with their contradictions and gaps."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omni_core.quantities import FloatArray, plain
from omni_tools.robot_files.controllers import DIFFERENT, MECANUM

KEYS = {"mass": "body.mass", "length": "chassis_length", "width": "chassis_width"}
"""Keys of the vehicle's file for values that the user may measure."""

_LISTED = 4  # names in a sentence
_MIDDLE = 1e-4  # offset of the chassis that is not entered [m]
PARALLEL = 5.0  # limit on the angle between the axles of Mecanum wheels [deg]
INVALID = re.compile(r"[^A-Za-z0-9_]")


@dataclasses.dataclass
class Described:
    """Vehicle that the files describe.

    Attributes:
        kind: `MECANUM` or `OMNI`.
        wheels: wheels in base_link, keyed by joint; without a radius if it is unknown.
        values: known values of the body, the wheels and the chassis, keyed by key of the vehicle's
            file; the center of gravity and the middle of the chassis are in base_link.
        imu: pose of the IMU in base_link, shape (4, 4); None if there is none.
        cameras: position [m] and heading [deg] of cameras that look at the ground, by name.
        sources: where a value comes from, keyed by key of the vehicle's file.
        contradictions: sentences on values that differ between the files.
        questions: sentences on what the files lack, with the question to answer.
    """

    kind: str = MECANUM
    wheels: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    values: dict[str, float] = dataclasses.field(default_factory=dict)
    imu: FloatArray | None = None
    cameras: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    sources: dict[str, str] = dataclasses.field(default_factory=dict)
    contradictions: list[str] = dataclasses.field(default_factory=list)
    questions: list[str] = dataclasses.field(default_factory=list)

    @property
    def radii(self) -> list[float]:
        """Known radii of the wheels [m]."""
        return [values["radius"] for values in self.wheels.values() if "radius" in values]

    @property
    def lists(self) -> dict[str, list[str]]:
        """Sentences on contradictions and on missing values, for the JSON document."""
        return {"contradictions": self.contradictions, "missing": self.questions}

    @property
    def measured(self) -> dict[str, Any]:
        """Values of `Measured` that the files contain, or that follow from the wheels."""
        values: dict[str, Any] = {"kind": self.kind, "wheels": len(self.wheels)}
        values |= {"wheel_radius": max(self.radii)} if self.radii else {}
        return values | {one: self.values[key] for one, key in KEYS.items() if key in self.values}

    def enter(self, source: str, values: Mapping[str, float]) -> None:
        """Enter known values, keyed by key of the vehicle's file."""
        self.values |= {key: rounded(value) for key, value in values.items()}
        self.sources |= dict.fromkeys(values, source)

    def enter_chassis(self, source: str, corners: FloatArray | None = None) -> None:
        """Enter size and middle of a chassis with N corners [m], shape (N, 2).

        Without corners, it surrounds the wheels.
        """
        if corners is None:
            places = np.array([(wheel["x"], wheel["y"]) for wheel in self.wheels.values()])
            center = places.mean(axis=0)
            half = np.max(np.abs(places - center), axis=0) + max(self.radii, default=0.0)
            corners = np.array([center - half, center + half])
        length, width = np.ptp(corners, axis=0).tolist()
        middle = (0.5 * (corners.min(axis=0) + corners.max(axis=0))).tolist()
        moved = {
            f"chassis_{x}": at for x, at in zip("xy", middle, strict=True) if abs(at) > _MIDDLE
        }
        self.enter(source, {"chassis_length": length, "chassis_width": width, **moved})

    def differ(self, what: str, values: Mapping[str, float], used: str, remedy: str) -> None:
        """List values of a length [m], keyed by source, if they differ from the used one."""
        away = [abs(value - values[used]) for value in values.values()]
        if max(away) > DIFFERENT * abs(values[used]) + 1e-9:
            texts = [f"{plain(value, 4)} m in {source}" for source, value in values.items()]
            self.contradictions.append(f"{what}: {', '.join(texts)}; used: {used}; {remedy}")


def some(names: Sequence[str]) -> str:
    """Return the first names of a list as text."""
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")


def rounded(value: float) -> float:
    """Return a length, mass or inertia with five significant digits, without a negative zero."""
    return float(f"{round(value, 9):.5g}") + 0.0  # without the rounding errors of a sum
