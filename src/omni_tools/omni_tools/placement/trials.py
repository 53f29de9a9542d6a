"""Measurement of the twist error of camera placements on rendered lines."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from linescan_odometry.odometry import LineScanOdometry, OdometryConfiguration
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_platform.sensors import LineSensor
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import BATCH_TIME, PERIOD, Rig, batch_lines
from omni_tools.placement.error import MotionMix
from omni_tools.placement.sensor_error import ORIENTATIONS


class PlacementTrial(NamedTuple):
    """Twist errors of a placement on rendered lines.

    Attributes:
        error: estimated minus true twist of each batch [m/s, m/s, rad/s], shape (b, 3), one array
            for each motion of the mix.
        share: share of time of each motion [1], shape (M,).
        unmeasured: share of the batches without a twist, 0 to 1.
    """

    error: tuple[FloatArray, ...]
    share: FloatArray
    unmeasured: float

    @property
    def deviation(self) -> FloatArray:
        """RMS errors of v_x, v_y [m/s] and yaw rate [rad/s] over the mix, shape (3,)."""
        squared = np.array([np.mean(error**2, axis=0) for error in self.error])
        return np.asarray(np.sqrt(self.share @ squared))

    def mean_error(self, gyration: float) -> float:
        """Return the RMS error over the platform's points and the mix [m/s].

        Args:
            gyration: RMS distance of the points from base_link [m].
        """
        return float(np.linalg.norm(self.deviation * (1.0, 1.0, gyration)))


def drive_mix(
    sensors: Mapping[str, LineSensor],
    mix: MotionMix,
    texture: GroundTexture,
    noise: float,
    batches: int,
    seed: int,
    report: Callable[[float], None] = lambda _share: None,
) -> PlacementTrial:
    """Simulate a placement over a ground and estimate its twist from the rendered lines.

    Each batch begins at a random position on the ground, in one of several random orientations.

    Args:
        sensors: the placement, not singular.
        mix: mix of motions.
        texture: the ground.
        noise: standard deviation [gray levels of 8 bit].
        batches: batches of each motion in each orientation.
        seed: seed of positions, orientations and noise.
        report: called with the completed share (0 to 1).
    """
    generator = np.random.default_rng(seed)
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    rig = Rig(sensors, texture, noise, seed)
    lines = {name: np.arange(batch_lines(s.line_rate) + 1) for name, s in sensors.items()}
    errors, total = [], 0
    for index, twist in enumerate(mix.twist):
        report(index / len(mix.twist))
        yaws = np.repeat(generator.uniform(0.0, math.tau, ORIENTATIONS), batches)
        own = []
        for yaw in yaws:
            start = np.append(generator.uniform(0.0, PERIOD, 2), yaw)
            # The stamps are far apart, so that lines of different batches are not compared.
            begin_ns = round(SECOND_NS * total * 4.0 * BATCH_TIME)
            total += 1
            estimate = odometry.update(rig.expose(start, twist, lines, begin_ns))
            if estimate.measured:
                own.append(estimate.twist - twist)
        errors.append(np.array(own).reshape(-1, 3))
    report(1.0)
    measured = sum(len(error) for error in errors)
    return PlacementTrial(tuple(errors), mix.share, 1.0 - measured / total)
