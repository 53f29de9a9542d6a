"""Dead reckoning: pose of the vehicle, integrated from measured twists."""

import dataclasses
import math

import numpy as np

from omni_core.quantities import FloatArray
from omni_core.signals import UNMEASURED_VARIANCE


@dataclasses.dataclass(frozen=True, eq=False)
class Pose:
    """Planar pose of the vehicle relative to its pose at the start of the integration.

    Attributes:
        stamp_ns: stamp of the newest integrated twist [ns].
        value: x, y [m] and yaw [rad], shape (3,).
        covariance: covariance of x, y and yaw in the squares of these units, shape (3, 3);
            every integrated twist adds to it.
    """

    stamp_ns: int
    value: FloatArray
    covariance: FloatArray


class PoseIntegrator:
    """Integrates measured twists to a pose of the vehicle.

    Between two stamps the platform moves on an arc with the twist of the newer stamp, since this
    twist is the mean over the batch that ends there. An unmeasured twist is integrated as zero. In
    a time t without a measurement, the vehicle may move by ``v_max t``, where ``v_max`` is its
    maximum speed. Such a gap therefore adds ``v_max^2 t^2`` to the variance of the position, and
    the corresponding term with the maximum yaw rate to the variance of the yaw. At each stamp in
    the gap, the growth of these terms since the previous stamp is added.
    """

    def __init__(self, maximum_speed: float = 20.0, maximum_yaw_rate: float = 10.0) -> None:
        """Start at the origin with zero covariance.

        Args:
            maximum_speed: maximum speed of the vehicle [m/s].
            maximum_yaw_rate: maximum yaw rate of the vehicle [rad/s].
        """
        self._pose = Pose(0, np.zeros(3), np.zeros((3, 3)))
        self._started = False
        self._largest = np.array([maximum_speed, maximum_speed, maximum_yaw_rate]) ** 2
        self._gap = 0.0  # s, since the last measured twist

    def update(self, stamp_ns: int, twist: FloatArray, covariance: FloatArray) -> Pose:
        """Integrate a twist and return the new pose.

        Args:
            stamp_ns: stamp of the twist [ns]; a twist that is not newer than the last is ignored.
            twist: v_x, v_y [m/s] and yaw rate [rad/s] in `base_link`, shape (3,).
            covariance: covariance of the twist, shape (3, 3).
        """
        before = self._pose
        dt = max(stamp_ns - before.stamp_ns, 0) * 1e-9
        if not self._started:
            self._started, dt = True, 0.0
        elif dt == 0.0:
            return before
        if covariance[0, 0] >= UNMEASURED_VARIANCE:
            covariance = np.diag(self._largest) * (1.0 + 2.0 * self._gap / dt if dt else 0.0)
            self._gap += dt
        else:
            self._gap = 0.0
        step = np.where(np.isfinite(twist), twist, 0.0) * dt
        x, y, yaw = before.value
        # The chord of the arc is rotated by half the rotation and shorter than the arc.
        chord = np.sinc(step[2] / (2.0 * math.pi))
        middle = yaw + step[2] / 2.0
        c, s = chord * math.cos(middle), chord * math.sin(middle)
        d_x, d_y = c * step[0] - s * step[1], s * step[0] + c * step[1]
        value = np.array([x + d_x, y + d_y, math.remainder(yaw + step[2], 2.0 * math.pi)])
        by_pose = np.array([[1.0, 0.0, -d_y], [0.0, 1.0, d_x], [0.0, 0.0, 1.0]])
        by_twist = dt * np.array([[c, -s, -d_y / 2.0], [s, c, d_x / 2.0], [0.0, 0.0, 1.0]])
        spread = by_pose @ before.covariance @ by_pose.T + by_twist @ covariance @ by_twist.T
        self._pose = Pose(max(stamp_ns, before.stamp_ns), value, spread)
        return self._pose
