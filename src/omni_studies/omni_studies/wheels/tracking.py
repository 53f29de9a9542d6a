"""Tracking of a reference motion over time."""

import dataclasses

import numpy as np

from omni_loop.history import RunHistory
from omni_platform.quantities import FloatArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tracking:
    """A driven maneuver and its reference, T stamps and N wheels.

    Attributes:
        wheel_names: wheel names in the order of the columns.
        time: [s], shape (T,).
        reference: desired x, y [m], yaw [rad] of `base_link` in the world frame, shape (T, 3).
        pose: driven x, y [m], yaw [rad] in the world frame, shape (T, 3).
        twist: twist of `base_link` in the body frame [m/s, m/s, rad/s], shape (T, 3).
        wheel_command: wheel speeds by inverse kinematics [rad/s], shape (T, N).
        wheel_speed: actual wheel speeds [rad/s], shape (T, N).
    """

    wheel_names: tuple[str, ...]
    time: FloatArray
    reference: FloatArray
    pose: FloatArray
    twist: FloatArray
    wheel_command: FloatArray
    wheel_speed: FloatArray

    @property
    def position_error(self) -> FloatArray:
        """Distance from the reference [m], shape (T,)."""
        offset = self.pose - self.reference
        return np.asarray(np.hypot(offset[:, 0], offset[:, 1]), dtype=np.float64)

    @property
    def heading_error(self) -> FloatArray:
        """Yaw less that of the reference [rad], shape (T,)."""
        return np.asarray(self.pose[:, 2] - self.reference[:, 2], dtype=np.float64)

    @property
    def wheel_error(self) -> FloatArray:
        """Wheel speeds less their commands [rad/s], shape (T, N)."""
        return np.asarray(self.wheel_speed - self.wheel_command, dtype=np.float64)

    def history(self) -> RunHistory:
        """Return the drive as a history without brakes and odometry, for the top view."""
        shape = self.wheel_speed.shape
        nothing = np.full(shape, np.nan)
        return RunHistory.from_samples(
            wheel_names=self.wheel_names,
            stamp_ns=np.round(1e9 * self.time).astype(np.int64),
            pose=self.pose,
            twist=self.twist,
            wheel_angle=nothing,
            wheel_speed=self.wheel_speed,
            brake_torque=np.zeros(shape),
            enable=nothing,
            error=nothing,
            pedal=np.zeros(shape[0]),
            estimate=np.full((shape[0], 3), np.nan),
            estimate_variance=np.full((shape[0], 3), np.nan),
        )
