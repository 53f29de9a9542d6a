"""Placements of line cameras side by side: the best one, given ones and the classical ones."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.twist import check_placement
from omni_analysis.line_trials import View
from omni_analysis.mounting_area import MountingArea
from omni_analysis.placement_error import (
    ConditionNumber,
    MeanError,
    after_failure,
    closeness,
    poses_of,
)
from omni_analysis.sensor_error import placed_sensor
from omni_platform.configuration import ConfigurationError
from omni_platform.sensors import LineSensor

FloatArray = NDArray[np.float64]

MINIMUM_LEVER = OdometryConfiguration.minimum_lever
"""Effective lever below which the odometry refuses a placement by default [m]."""

_RING_STEP = 0.005  # of the radius [m]
_SECTORS = (
    "front", "front_left", "left", "rear_left", "rear", "rear_right", "right", "front_right",
)  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False)
class JudgedPlacement:
    """A placement and what it comes to.

    Attributes:
        name: of the placement.
        sensors: its cameras.
        mean_error: E [m/s], infinite if it is singular.
        deviation: standard deviations of v_x, v_y [m/s] and yaw rate [rad/s], RMS over the
            mix of motions, shape (3,).
        by_motion: E in each motion alone [m/s].
        without: E without each camera [m/s], shape (N,).
        condition: condition number of the sensor matrix in SI units.
        spread_deg: angle by which the axes spread, see `placement_error.closeness` [deg].
        lever: effective lever for the yaw rate [m].
        singular: why the odometry refuses it, empty if it does not.
        mounting: why it cannot be mounted on the chassis, empty if it can.
    """

    name: str
    sensors: Mapping[str, LineSensor]
    mean_error: float
    deviation: FloatArray
    by_motion: Mapping[str, float]
    without: FloatArray
    condition: float
    spread_deg: float
    lever: float
    singular: str
    mounting: str

    @property
    def worst_without(self) -> float:
        """E after the failure of the camera that is missed most [m/s]; infinite for three."""
        return float(np.max(self.without))


def judge(
    name: str, sensors: Mapping[str, LineSensor], criterion: MeanError, area: MountingArea
) -> JudgedPlacement:
    """Say what a placement comes to on a chassis.

    Args:
        name: of the placement.
        sensors: its cameras, of the criterion's type.
        criterion: gives the error.
        area: gives the places where cameras can be mounted.
    """
    poses = poses_of(sensors)
    mix = criterion.mix
    variance = np.einsum("mii->mi", criterion.covariance(poses))
    squared = variance @ np.array([1.0, 1.0, criterion.gyration**2])
    by_motion = {
        motion: math.sqrt(float(np.average(squared[own], weights=mix.share[own])))
        for motion in dict.fromkeys(mix.names)
        for own in [np.array([other == motion for other in mix.names])]
    }
    condition = ConditionNumber()
    spread, lever = closeness(sensors)
    return JudgedPlacement(
        name,
        sensors,
        criterion.mean_error(poses),
        np.sqrt(mix.share @ variance),
        by_motion,
        after_failure(criterion, poses),
        float(condition.value(condition.information(poses).sum(axis=0))),
        spread,
        lever,
        singularity(sensors),
        area.problem(tuple(sensors), poses),
    )


def singularity(sensors: Mapping[str, LineSensor]) -> str:
    """Return why the odometry refuses a placement, empty if it does not."""
    try:
        check_placement(sensors, MINIMUM_LEVER)
    except ConfigurationError as error:
        return error.problem
    return ""


def named(poses: FloatArray, view: View) -> dict[str, LineSensor]:
    """Return cameras on the lattice of 1 mm and 1 deg, named by where they sit.

    An axis has no sense of its own: headings are those within -90 and 90 deg, so that a camera
    that looks forward measures forward motion as positive.

    Args:
        poses: x, y [m] and heading [rad], shape (N, 3).
        view: what each camera sees.
    """
    half = np.max(np.abs(poses[:, :2]), axis=0) + 1e-9
    angle = np.arctan2(poses[:, 1] / half[1], poses[:, 0] / half[0])
    sector = np.round(angle / (math.pi / 4.0)).astype(int) % len(_SECTORS)
    sensors: dict[str, LineSensor] = {}
    for index in np.lexsort((angle, sector)):
        name = _SECTORS[sector[index]]
        number = 2
        while name in sensors:
            name = f"{_SECTORS[sector[index]]}_{number}"
            number += 1
        x, y = (round(float(value), 3) + 0.0 for value in poses[index, :2])
        heading = 90.0 - (90.0 - round(math.degrees(poses[index, 2]))) % 180.0
        sensors[name] = placed_sensor(view, x, y, heading)
    return sensors


def ring(count: int, radius: float, turn: float, start: float = 0.0) -> FloatArray:
    """Return cameras at equal angles on a circle about base_link, shape (count, 3).

    Args:
        count: of cameras.
        radius: of the circle [m].
        turn: of the axes from radial [rad]; a right angle is tangential.
        start: direction of the first camera [rad].
    """
    angle = start + math.tau * np.arange(count) / count
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), angle + turn))


def classical(area: MountingArea, count: int) -> dict[str, FloatArray]:
    """Return poses at equal angles on the largest circle that has room for tangential cameras.

    Args:
        area: the chassis.
        count: of cameras.

    Returns:
        ``tangential``, and at the same places the singular ``radial`` and ``parallel``.
    """
    largest = max(area.reach)
    radius, start = min(area.reach), 0.0
    for step in range(int(largest / _RING_STEP)):
        tried = [(largest - step * _RING_STEP, s) for s in (0.0, 0.5 * math.pi, math.pi)]
        fitting = [r for r in tried if np.all(area.fits(ring(count, r[0], 0.5 * math.pi, r[1])))]
        if fitting:
            radius, start = fitting[0]
            break
    tangential, radial = ring(count, radius, 0.5 * math.pi, start), ring(count, radius, 0.0, start)
    parallel = radial.copy()
    parallel[:, 2] = 0.0
    return {"tangential": tangential, "radial": radial, "parallel": parallel}
