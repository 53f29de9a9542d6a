"""Trials of the odometry: estimated twists of a platform in uniform motion over a ground."""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.odometry import LineScanOdometry, OdometryConfiguration
from omni_platform.quantities import FloatArray
from omni_platform.sensors import sensor_matrix
from omni_tools.line_trials.rig import PERIOD, Rig


class TwistTrial(NamedTuple):
    """Estimates of the odometry in a uniform motion, one per batch.

    Attributes:
        twist: twist of the platform (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        estimate: estimated twist of each measured batch [m/s, m/s, rad/s], shape (m, 3).
        covariance: covariance that the odometry states for each estimate, in the squares of its
            units, shape (m, 3, 3).
        measured: share of the batches with a measurement, 0 to 1.
        ratio: ratio of the error of a camera's velocity to the stated standard deviation [1], for
            all cameras and batches with a measurement, shape (k,).
    """

    twist: FloatArray
    estimate: FloatArray
    covariance: FloatArray
    measured: float
    ratio: FloatArray

    @property
    def error(self) -> FloatArray:
        """Estimated minus true twist [m/s, m/s, rad/s], shape (m, 3)."""
        return self.estimate - self.twist

    @property
    def normalized_error_squared(self) -> FloatArray:
        """Normalized squared error ``e^T C^-1 e / 3``, whose expectation is 1, shape (m,)."""
        weighted = np.linalg.solve(self.covariance, self.error[:, :, None])[:, :, 0]
        return np.asarray(np.sum(self.error * weighted, axis=1) / 3.0)


def drive(
    configuration: OdometryConfiguration,
    rig: Rig,
    twist: FloatArray,
    batches: int,
    generator: np.random.Generator,
) -> TwistTrial:
    """Estimate a constant twist with the odometry, from a random position and heading.

    Args:
        configuration: configuration of the odometry, with its line cameras.
        rig: rig with these line cameras.
        twist: twist of the platform (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        batches: number of batches after the first line.
        generator: random generator for position and heading.
    """
    sensors = configuration.sensors
    start = np.array([*generator.uniform(0.0, PERIOD, 2), generator.uniform(0.0, 2.0 * math.pi)])
    odometry = LineScanOdometry(configuration)
    odometry.update(rig.expose(start, twist, {name: np.arange(1) for name in sensors}))
    truth = dict(zip(sensors, sensor_matrix(sensors) @ twist, strict=True))
    estimates, covariances, ratios = [], [], []
    for batch in rig.drive(start, twist, batches, first=1):
        estimate = odometry.update(batch)
        if estimate.measured:
            estimates.append(estimate.twist)
            covariances.append(estimate.covariance)
        for name, reading in estimate.readings.items():
            if reading.measured:
                ratios.append((reading.velocity - truth[name]) / math.sqrt(reading.variance))
    return TwistTrial(
        twist,
        np.array(estimates).reshape(-1, 3),
        np.array(covariances).reshape(-1, 3, 3),
        len(estimates) / batches,
        np.array(ratios),
    )
