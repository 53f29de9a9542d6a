"""What the files of a robot say of a vehicle, with their contradictions and gaps."""

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omni_core.quantities import FloatArray, plain
from omni_tools.robot_files.controllers import DIFFERENT, MECANUM

_LISTED = 4  # names in a sentence
PARALLEL = 5.0  # limit on the angle between the axles of Mecanum wheels [deg]
INVALID = re.compile(r"[^A-Za-z0-9_]")


@dataclasses.dataclass
class Described:
    """Vehicle that the files describe; None or empty what they lack.

    Attributes:
        kind: `MECANUM` or `OMNI`.
        wheels: wheels in base_link, keyed by joint; without a radius if it is unknown.
        chassis: smallest and largest x and y of the chassis [m], shape (2, 2).
        mass: mass [kg].
        center: center of gravity in base_link, with its height above the ground, NaN if it is
            unknown [m], shape (3,).
        yaw_inertia: moment of inertia about the vertical through the center of gravity [kg m^2].
        wheel_inertia: mean moment of inertia of a wheel about its axis [kg m^2].
        imu: pose of the IMU in base_link, shape (4, 4).
        cameras: position [m] and heading [deg] of cameras that look at the ground, by name.
        sources: where a value comes from, keyed by key of the vehicle's file.
        contradictions: sentences on values that differ between the files.
        questions: sentences on what the files lack, with the question to answer.
    """

    kind: str = MECANUM
    wheels: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    chassis: FloatArray | None = None
    mass: float | None = None
    center: FloatArray | None = None
    yaw_inertia: float | None = None
    wheel_inertia: float | None = None
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
        values |= {"mass": self.mass} if self.mass else {}
        values |= {"wheel_radius": max(self.radii)} if self.radii else {}
        length, width = np.ptp(self._extent, axis=0)
        return {**values, "length": rounded(length), "width": rounded(width)}

    @property
    def body(self) -> dict[str, float]:
        """Values of the body in the vehicle's file, except its mass."""
        values: dict[str, float] = {}
        if self.center is not None:
            x, y, height = map(rounded, np.round(self.center, 6).tolist())
            values = {"x": x, "y": y} | ({} if math.isnan(height) else {"height": height})
        if self.yaw_inertia is not None:
            values["yaw_inertia"] = rounded(self.yaw_inertia)
        return values

    @property
    def chassis_center(self) -> FloatArray:
        """Center of the chassis in base_link [m], shape (2,)."""
        return np.asarray(self._extent.mean(axis=0))

    @property
    def _extent(self) -> FloatArray:
        """Extent of the chassis, or around the wheels if it is unknown [m], shape (2, 2)."""
        if self.chassis is not None:
            return self.chassis
        places = np.array([(wheel["x"], wheel["y"]) for wheel in self.wheels.values()])
        center = places.mean(axis=0)
        half = np.max(np.abs(places - center), axis=0) + max(self.radii, default=0.0)
        return np.array([center - half, center + half])

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
