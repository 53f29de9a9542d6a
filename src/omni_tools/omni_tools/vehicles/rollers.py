"""Arrangement of a platform's rollers, and detection of a roller angle with the wrong sign.

With a wrong sign of one roller angle, the platform can still move in all three degrees of freedom,
but with wrong kinematics. The error violates symmetry: if two wheels are mirror images of each
other, their rollers must also be mirror images.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_platform.geometry import PlatformGeometry, WheelMount
from omni_platform.kinematics import (
    PlatformKinematics,
    UnusablePlatformError,
    smallest_singular_value,
)

_MIRRORS = (np.array([1.0, -1.0]), np.array([-1.0, 1.0]))  # about the x axis, the y axis


class Rollers(NamedTuple):
    """Arrangement of the rollers of a platform.

    Attributes:
        shape: ``X`` or ``O``, the shape formed by the rollers on top of the wheels, seen from
            above; the rollers on the ground form the other shape. ``mixed`` if the rollers form
            neither shape, empty if no roller is oblique.
        smallest_singular_value: smallest singular value of ``M``, Eq. (33), with lengths divided by
            the platform's radius [1].
        yaw_lever: smallest distance of a roller axis on the ground from the platform center [m].
    """

    shape: str
    smallest_singular_value: float
    yaw_lever: float

    @classmethod
    def of(cls, wheels: Mapping[str, WheelMount]) -> Rollers:
        """Return the arrangement of the rollers of the given wheels."""
        kinematics = PlatformKinematics.of(wheels)
        geometry = kinematics.geometry
        lever = float(np.min(np.abs(kinematics.matrix[:, 2])))
        return cls(_shape(geometry), smallest_singular_value(kinematics.matrix, geometry), lever)


def roller_remarks(wheels: Mapping[str, WheelMount], poor: float = 0.5) -> tuple[str, ...]:
    """Return a sentence about roller angles with implausible signs; empty if there are none.

    Args:
        wheels: wheels of a platform.
        poor: the arrangement is implausible if its smallest singular value is less than this
            multiple of the value with all roller angles reversed [1].
    """
    rollers = Rollers.of(wheels)
    suspects = _broken_symmetry(wheels)
    if suspects:
        name, *others = suspects
        angle = wheels[name].roller_angle_deg
        return (
            f"wheels.{name}.roller_angle_deg: {angle:g} deg breaks the symmetry of the rollers"
            + (f" (or {', '.join(others)} does)" if others else "")
            + f"; symmetric rollers on the other wheels have {-angle:g} deg",
        )
    opposite = {name: _flipped(mount) for name, mount in wheels.items()}
    try:
        best = Rollers.of(opposite).smallest_singular_value
    except UnusablePlatformError:
        return ()
    if rollers.smallest_singular_value < poor * best:
        return (
            f"wheels: the lever arms of the roller axes about the center are only "
            f"{rollers.yaw_lever:.2g} m, so the wheels can hardly rotate the vehicle (seen from "
            f"above the rollers form {rollers.shape}; smallest singular value "
            f"{rollers.smallest_singular_value:.2g}, but {best:.2g} with the opposite roller "
            "angles); negate every roller_angle_deg, unless the wheels are mounted in this way",
        )
    if rollers.shape == "mixed" and len(wheels) == 4:
        return (
            "wheels: the rollers form neither X nor O seen from above; mirror the roller angles of "
            "the front wheels on the rear wheels, unless the wheels are mounted in this way",
        )
    return ()


def _shape(geometry: PlatformGeometry) -> str:
    """Return `Rollers.shape`, the shape that the rollers on top of the wheels form."""
    quadrant = np.sign(geometry.position[:, 0] * geometry.position[:, 1])
    slope = geometry.active[:, 0] * geometry.active[:, 1]
    signs = (np.sign(slope) * quadrant)[(quadrant != 0.0) & (np.abs(slope) > 0.05)]
    if not signs.size:
        return ""
    return "X" if np.all(signs < 0.0) else "O" if np.all(signs > 0.0) else "mixed"


def _broken_symmetry(wheels: Mapping[str, WheelMount]) -> tuple[str, ...]:
    """Return the wheels whose roller angle, if reversed, would make the arrangement symmetric."""
    if _mirrors_fit(wheels):
        return ()
    return tuple(name for name in wheels if _mirrors_fit({**wheels, name: _flipped(wheels[name])}))


def _mirrors_fit(
    wheels: Mapping[str, WheelMount], offset: float = 0.05, angle: float = math.radians(10.0)
) -> bool:
    """Return whether the rollers have the same mirror symmetries as the wheel positions.

    Args:
        wheels: wheels of a platform.
        offset: allowed difference of positions, divided by the radius of the platform [1].
        angle: allowed angle between the roller axis of a wheel and that of its mirror image [rad];
            a wrong sign causes an angle of 90 deg.
    """
    geometry = PlatformGeometry.from_wheels(wheels)
    near = offset * float(np.max(np.linalg.norm(geometry.position, axis=1)))
    for mirror in _MIRRORS:
        images = geometry.position * mirror
        distance = np.linalg.norm(images[:, np.newaxis] - geometry.position, axis=2)
        partner = np.argmin(distance, axis=1)
        rows = np.arange(len(partner))
        if np.any(distance[rows, partner] > near):
            continue
        axes, others = geometry.active * mirror, geometry.active[partner]
        along = np.abs(np.sum(axes * others, axis=1))
        if np.any((along < math.cos(angle)) & (partner != rows)):
            return False
    return True


def _flipped(mount: WheelMount) -> WheelMount:
    return dataclasses.replace(mount, roller_angle_deg=-mount.roller_angle_deg)
