"""Arrangement of a platform's rollers, and detection of wrong angles of rollers and wheels.

With a wrong sign of one roller angle, the platform can still move in all three degrees of freedom,
but with wrong kinematics. The error violates symmetry: if two wheels are mirror images of each
other, their rollers must also be mirror images. The positions need not be exact mirror images,
because only the better of two signs is sought. Three wheels have equal roller angles.

Angles in radians are nearly parallel directions if they are read as degrees, so that the wheels can
hardly move the platform in one direction. As radians, they would be a usual arrangement.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from omni_core import kinematics
from omni_core.configuration import ConfigurationError
from omni_core.geometry import PlatformGeometry, WheelMount

# An arrangement is implausible if its smallest singular value is less than this multiple of the
# value with all roller angles reversed, or with angles in radians [1].
_POOR = 0.5
# Fields of a wheel that may be in radians, with the limit on their values in radians.
_LARGEST_RADIANS = {"roller_angle_deg": math.pi / 2.0, "heading_deg": 2.0 * math.pi}
_IN_RADIANS = (("roller_angle_deg",), ("heading_deg",), ("roller_angle_deg", "heading_deg"))
_MIRRORS = (np.array([1.0, -1.0]), np.array([-1.0, 1.0]))  # about the x axis, the y axis


class Rollers(NamedTuple):
    """Arrangement of the rollers of a platform.

    Attributes:
        shape: ``X`` or ``O``, the shape formed by the rollers on top of the wheels, seen from
            above; the rollers on the ground form the other shape. ``mixed`` if the rollers form
            neither shape, empty if no roller is oblique.
        smallest_singular_value: smallest singular value of ``M``, Eq. (33), with lengths divided by
            the platform's radius [1].
        yaw_lever: smallest distance of a roller axis on the ground from the center of the wheels
            [m].
    """

    shape: str
    smallest_singular_value: float
    yaw_lever: float

    @classmethod
    def of(cls, wheels: Mapping[str, WheelMount]) -> Rollers:
        """Return the arrangement of the rollers of the given wheels."""
        platform = kinematics.PlatformKinematics.of(wheels)
        matrix, geometry = platform.matrix, platform.geometry
        smallest = kinematics.smallest_singular_value(matrix, geometry)
        lever = geometry.seen_from(geometry.center).lever
        return cls(_shape(geometry), smallest, float(np.min(np.abs(lever))))


def roller_remarks(wheels: Mapping[str, WheelMount]) -> tuple[str, ...]:
    """Return a sentence about angles in radians or with implausible signs; empty if none are."""
    return _remarks(tuple(wheels.items()))


@lru_cache(maxsize=64)
def _remarks(named: tuple[tuple[str, WheelMount], ...]) -> tuple[str, ...]:
    wheels = dict(named)
    rollers = Rollers.of(wheels)
    for fields in _IN_RADIANS:
        value = _singular_value_in_radians(wheels, fields)
        if rollers.smallest_singular_value < _POOR * value:
            return (
                f"wheels: {' and '.join(fields)} look like radians, because the wheels can hardly "
                "move the vehicle in one of its directions (smallest singular value of the "
                f"kinematics {rollers.smallest_singular_value:.2g}, but {value:.2g} with these "
                "numbers in radians); enter degrees, such as 45 instead of 0.785",
            )
    suspects = _wrong_angles(wheels)
    if suspects:
        (name, fitting), *others = suspects.items()
        angle = wheels[name].roller_angle_deg
        return (
            f"wheels.{name}.roller_angle_deg: {angle:g} deg breaks the symmetry of the rollers"
            + (f" (or {', '.join(other for other, _ in others)} does)" if others else "")
            + f"; {fitting:g} deg would be symmetric to the rollers on the other wheels",
        )
    opposite = {name: _flipped(mount) for name, mount in wheels.items()}
    try:
        best = Rollers.of(opposite).smallest_singular_value
    except kinematics.UnusablePlatformError:
        return ()
    if rollers.smallest_singular_value < _POOR * best:
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
    quadrant = np.sign(np.prod(geometry.position - geometry.center, axis=1))
    slope = geometry.active[:, 0] * geometry.active[:, 1]
    signs = (np.sign(slope) * quadrant)[(quadrant != 0.0) & (np.abs(slope) > 0.05)]
    if not signs.size:
        return ""
    return "X" if np.all(signs < 0.0) else "O" if np.all(signs > 0.0) else "mixed"


def _singular_value_in_radians(wheels: Mapping[str, WheelMount], fields: Sequence[str]) -> float:
    """Return `Rollers.smallest_singular_value` for numbers in radians; 0 if they cannot be.

    Args:
        wheels: wheels of a platform.
        fields: fields of the wheels whose numbers are taken as radians.
    """
    for field in fields:
        largest = max(abs(getattr(mount, field)) for mount in wheels.values())
        if not 0.0 < largest <= _LARGEST_RADIANS[field]:
            return 0.0
    in_degrees = {
        name: dataclasses.replace(
            mount, **{field: math.degrees(getattr(mount, field)) for field in fields}
        )
        for name, mount in wheels.items()
    }
    try:
        return Rollers.of(in_degrees).smallest_singular_value
    except ConfigurationError:
        return 0.0


def _wrong_angles(wheels: Mapping[str, WheelMount], step: float = 10.0) -> dict[str, float]:
    """Return wheels with a wrong roller angle, and the angle that would be symmetric [deg].

    If one error explains the asymmetry in several ways, all wheels that it may concern are
    returned.

    Args:
        wheels: wheels of a platform.
        step: difference of roller angles that is not an error of measurement [deg].
    """
    if len(wheels) > 3 and not _mirrors_fit(wheels):
        flipped = {name: _flipped(mount) for name, mount in wheels.items()}
        fits = [name for name in wheels if _mirrors_fit({**wheels, name: flipped[name]})]
        return {name: flipped[name].roller_angle_deg for name in fits}
    wrong = {}
    for name, mount in wheels.items():
        others = np.array([wheels[other].roller_angle_deg for other in wheels if other != name])
        # A roller axis has no direction: angles that differ by 180 deg are equal.
        away = np.abs((mount.roller_angle_deg - others + 90.0) % 180.0 - 90.0)
        apart = np.abs((others - others[0] + 90.0) % 180.0 - 90.0)
        if np.max(apart) < step < np.min(away):
            wrong[name] = float(others[0])
    return wrong


def _mirrors_fit(wheels: Mapping[str, WheelMount]) -> bool:
    """Return whether the roller angles are mirror-symmetric.

    No wheel may match its mirror partner better with the sign of its roller angle reversed.
    The mirror image of a wheel is the wheel nearest to its position reflected about the x or y axis
    through the center of all wheels.
    """
    geometry = PlatformGeometry.from_wheels(wheels)
    reversed_angles = {name: _flipped(mount) for name, mount in wheels.items()}
    opposite = PlatformGeometry.from_wheels(reversed_angles).active
    position, rows = geometry.position - geometry.center, np.arange(len(wheels))
    for mirror in _MIRRORS:
        distance = np.linalg.norm((position * mirror)[:, np.newaxis] - position, axis=2)
        partner = np.argmin(distance, axis=1)
        paired = (partner[partner] == rows) & (partner != rows)
        axes = geometry.active * mirror
        given, other = (
            np.abs(np.sum(axes * active[partner], axis=1)) for active in (geometry.active, opposite)
        )
        if np.any(paired & (given < other - 1e-9)):
            return False
    return True


def _flipped(mount: WheelMount) -> WheelMount:
    return dataclasses.replace(mount, roller_angle_deg=-mount.roller_angle_deg)
