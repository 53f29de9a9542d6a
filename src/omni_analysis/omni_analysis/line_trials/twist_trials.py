"""Uniform motion over a ground: its poses, batches of rendered lines, what the odometry says.

The platform moves at a constant twist in its own frame, which is a circle or a straight line.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.odometry import LineBatch, LineScanOdometry, OdometryConfiguration
from omni_analysis.line_trials.trials import PERIOD
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor, sensor_matrix
from omni_sim.camera.camera import CameraConfiguration, LineCameraArray
from omni_sim.texture.texture import GroundTexture

BATCH_TIME = 0.01
"""Time of a batch of lines, one control period [s]."""


def batch_lines(line_rate: float) -> int:
    """Return how many lines a batch has at a line rate [1/s]."""
    return max(1, round(BATCH_TIME * line_rate))


def poses_at(elapsed: FloatArray, start: FloatArray, twist: FloatArray) -> FloatArray:
    """Return the poses of a platform that moves at a constant twist.

    Args:
        elapsed: times since the start [s], shape (m,).
        start: x, y [m] and yaw [rad], shape (3,).
        twist: (v_x, v_y [m/s], yaw rate [rad/s]) in the platform's frame, shape (3,).

    Returns:
        x, y [m], yaw [rad], shape (m, 3).
    """
    turned = twist[2] * elapsed
    # Mean direction and length of the chord; np.sinc(x) is sin(pi x) / (pi x).
    chord = elapsed * np.sinc(0.5 * turned / math.pi)
    yaw = start[2] + 0.5 * turned
    return np.column_stack(
        (
            start[0] + chord * (twist[0] * np.cos(yaw) - twist[1] * np.sin(yaw)),
            start[1] + chord * (twist[0] * np.sin(yaw) + twist[1] * np.cos(yaw)),
            start[2] + turned,
        )
    )


def cameras_over(
    texture: GroundTexture, sensors: Mapping[str, LineSensor], noise: float, seed: int
) -> LineCameraArray:
    """Return line cameras over a ground.

    Args:
        texture: the ground.
        sensors: the cameras by name.
        noise: standard deviation [grey levels].
        seed: of the noise.
    """
    configuration = CameraConfiguration(noise=noise)
    return LineCameraArray(sensors, texture, configuration, np.random.SeedSequence(seed))


def rendered(
    cameras: LineCameraArray,
    start: FloatArray,
    twist: FloatArray,
    lines: Mapping[str, NDArray[np.int64]],
    begin_ns: int = 0,
) -> dict[str, LineBatch]:
    """Return a batch of lines of every camera of a platform that moves at a constant twist.

    Args:
        cameras: see `cameras_over`.
        start: x, y [m] and yaw [rad] at line 0, shape (3,).
        twist: (v_x, v_y [m/s], yaw rate [rad/s]) in the platform's frame, shape (3,).
        lines: numbers of the lines by camera, shape (m,).
        begin_ns: stamp of line 0 [ns].
    """
    elapsed = {name: own / cameras.cameras[name].sensor.line_rate for name, own in lines.items()}
    greys = cameras.render({name: poses_at(own, start, twist) for name, own in elapsed.items()})
    return {
        name: LineBatch(begin_ns + round(1e9 * float(own[-1])), greys[name])
        for name, own in elapsed.items()
    }


@dataclasses.dataclass(frozen=True)
class TwistTrial:
    """What the odometry said over a uniform motion, batch by batch.

    Attributes:
        twist: of the platform (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        estimate: of it, where it was measured, shape (m, 3).
        covariance: stated with each, shape (m, 3, 3).
        measured: share of the batches that were measured, 0..1.
        ratio: error of each camera's velocity along its axis over the stated deviation, of every
            batch that it measured, shape (k,).
        together: whether all lines of that batch were matched together, shape (k,).
    """

    twist: FloatArray
    estimate: FloatArray
    covariance: FloatArray
    measured: float
    ratio: FloatArray
    together: NDArray[np.bool_]

    @property
    def error(self) -> FloatArray:
        """Estimated less true twist, shape (m, 3)."""
        return self.estimate - self.twist

    @property
    def normalised_error_squared(self) -> FloatArray:
        """Error squared over its expectation ``e^T C^-1 e / 3``, 1 in the mean, shape (m,)."""
        weighted = np.linalg.solve(self.covariance, self.error[:, :, None])[:, :, 0]
        normalised: FloatArray = np.sum(self.error * weighted, axis=1) / 3.0
        return normalised


def drive(
    configuration: OdometryConfiguration,
    cameras: LineCameraArray,
    twist: FloatArray,
    batches: int,
    generator: np.random.Generator,
) -> TwistTrial:
    """Move at a constant twist from a random place and heading and let the odometry measure it.

    Args:
        configuration: of the odometry, with its line cameras.
        cameras: these line cameras, see `cameras_over`.
        twist: of the platform (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        batches: how many, after the first line.
        generator: draws place and heading.
    """
    sensors = configuration.sensors
    start = np.array([*generator.uniform(0.0, PERIOD, 2), generator.uniform(0.0, 2.0 * math.pi)])
    odometry = LineScanOdometry(configuration)
    sizes = {name: batch_lines(sensor.line_rate) for name, sensor in sensors.items()}
    odometry.update(rendered(cameras, start, twist, {name: np.arange(1) for name in sensors}))
    truth = dict(zip(sensors, sensor_matrix(sensors) @ twist, strict=True))
    estimates, covariances, ratios, together = [], [], [], []
    for batch in range(batches):
        lines = {name: 1 + np.arange(batch * n, (batch + 1) * n) for name, n in sizes.items()}
        estimate = odometry.update(rendered(cameras, start, twist, lines))
        if estimate.measured:
            estimates.append(estimate.twist)
            covariances.append(estimate.covariance)
        for name, reading in estimate.readings.items():
            if reading.measured:
                ratios.append((reading.velocity - truth[name]) / math.sqrt(reading.variance))
                together.append(reading.batch_time > 0.0)
    return TwistTrial(
        twist,
        np.array(estimates).reshape(-1, 3),
        np.array(covariances).reshape(-1, 3, 3),
        len(estimates) / batches,
        np.array(ratios),
        np.array(together, np.bool_),
    )
