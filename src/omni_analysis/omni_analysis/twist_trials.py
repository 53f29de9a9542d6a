"""Trials of the whole odometry: rendered lines of several cameras in uniform motion, the twist.

The platform moves at a constant twist in its own frame, which is a circle or a straight line, over
a ground from a random place and heading.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.odometry import LineBatch, LineScanOdometry, OdometryConfiguration
from omni_analysis.line_trials import PERIOD
from omni_platform.sensors import LineSensor
from omni_sim.ground_texture import GroundTexture
from omni_sim.line_camera import CameraConfiguration, LineCameraArray

FloatArray = NDArray[np.float64]

BATCH_PERIOD = 0.01
"""Duration of a batch of lines [s], rounded to whole lines."""


@dataclasses.dataclass(frozen=True)
class TwistTrial:
    """What the odometry said over a uniform motion, batch by batch.

    Attributes:
        twist: of the platform (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        estimate: of it, where it was measured, shape (m, 3).
        covariance: stated with each, shape (m, 3, 3).
        measured: share of the batches that were measured, 0..1.
    """

    twist: FloatArray
    estimate: FloatArray
    covariance: FloatArray
    measured: float

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
    return LineCameraArray(sensors, texture, configuration, np.random.SeedSequence(seed), threads=1)


def drive(
    configuration: OdometryConfiguration,
    cameras: LineCameraArray,
    twist: FloatArray,
    batches: int,
    generator: np.random.Generator,
) -> TwistTrial:
    """Move at a constant twist and let the odometry measure it.

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
    sizes = {name: max(1, round(s.line_rate * BATCH_PERIOD)) for name, s in sensors.items()}
    estimates, covariances = [], []
    for batch in range(-1, batches):
        poses, stamps = {}, {}
        for name, sensor in sensors.items():
            size = sizes[name]
            line = (
                np.arange(batch * size + 1, (batch + 1) * size + 1) if batch >= 0 else np.zeros(1)
            )
            poses[name] = poses_at(line / sensor.line_rate, start, twist)
            stamps[name] = round(1e9 * float(line[-1]) / sensor.line_rate)
        lines = cameras.render(poses)
        estimate = odometry.update({name: LineBatch(stamps[name], lines[name]) for name in sensors})
        if batch >= 0 and estimate.measured:
            estimates.append(estimate.twist)
            covariances.append(estimate.covariance)
    return TwistTrial(
        twist,
        np.array(estimates).reshape(-1, 3),
        np.array(covariances).reshape(-1, 3, 3),
        len(estimates) / batches,
    )


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


def tangential(radius: float, prototype: LineSensor, count: int = 3) -> Mapping[str, LineSensor]:
    """Return line cameras evenly on a circle, each along its tangent.

    Args:
        radius: of the circle [m].
        prototype: what each sees.
        count: how many.
    """
    sensors = {}
    for i in range(count):
        angle = 2.0 * math.pi * i / count
        sensors[f"camera_{i}"] = dataclasses.replace(
            prototype,
            x=radius * math.cos(angle),
            y=radius * math.sin(angle),
            heading_deg=math.degrees(angle) + 90.0 - 360.0 * (angle > math.pi),
        )
    return sensors
