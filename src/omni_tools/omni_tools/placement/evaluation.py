"""Evaluation of a placement of line cameras."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.twist.least_squares import check_placement
from omni_platform.configuration import ConfigurationError
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_tools.placement import error as errors
from omni_tools.placement.mounting_area import MountingArea

MINIMUM_LEVER = OdometryConfiguration.minimum_lever
"""Effective lever arm below which the odometry rejects a placement by default [m]."""


class EvaluatedPlacement(NamedTuple):
    """A placement and its errors.

    Attributes:
        name: name of the placement.
        sensors: cameras by name.
        mean_error: mean twist error E [m/s]; infinite if the placement is singular.
        deviation: standard deviations of v_x, v_y [m/s] and yaw rate [rad/s], RMS over the
            mix of motions, shape (3,).
        by_motion: E of each motion [m/s].
        without: E after the failure of each camera [m/s], shape (N,); infinite if the placement of
            the other cameras is singular.
        condition: condition number of the sensor matrix in SI units [1].
        spread_deg: angle by which the axes spread, see `error.closeness` [deg].
        lever: effective lever arm for the yaw rate [m].
        singular: reason why the odometry rejects the placement; empty if it does not.
        mounting: reason why the cameras cannot be mounted on the chassis; empty if they can.
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
        """Largest mean twist error E after a failure of one camera [m/s]; infinite for three."""
        return float(np.max(self.without))

    @property
    def missed_most(self) -> str:
        """Name of the camera whose failure increases the error most."""
        return tuple(self.sensors)[int(np.argmax(self.without))]


def evaluate(
    name: str, sensors: Mapping[str, LineSensor], criterion: errors.MeanError, area: MountingArea
) -> EvaluatedPlacement:
    """Evaluate a placement on a chassis.

    Args:
        name: name of the placement.
        sensors: cameras by name, of the criterion's type.
        criterion: criterion that computes the error.
        area: area in which cameras can be mounted.
    """
    poses = errors.poses_of(sensors)
    mix = criterion.mix
    variance = np.einsum("mii->mi", criterion.covariance(poses))
    squared = variance @ np.array([1.0, 1.0, criterion.gyration**2])
    by_motion = {
        motion: math.sqrt(float(np.average(squared[own], weights=mix.share[own])))
        for motion in dict.fromkeys(mix.names)
        for own in [np.array([other == motion for other in mix.names])]
    }
    condition = errors.ConditionNumber()
    spread, lever = errors.closeness(sensors)
    without = errors.after_failure(criterion, poses)
    for index, missing in enumerate(sensors):
        if singularity({name: own for name, own in sensors.items() if name != missing}):
            without[index] = math.inf
    return EvaluatedPlacement(
        name,
        sensors,
        criterion.mean_error(poses),
        np.sqrt(mix.share @ variance),
        by_motion,
        without,
        float(condition.value(condition.information(poses).sum(axis=0))),
        spread,
        lever,
        singularity(sensors),
        area.problem(tuple(sensors), poses),
    )


def singularity(sensors: Mapping[str, LineSensor]) -> str:
    """Return the reason why the odometry rejects a placement; empty if it does not."""
    try:
        check_placement(sensors, MINIMUM_LEVER)
    except ConfigurationError as error:
        return error.problem
    return ""
