"""The IMU message follows REP 145: gravity at rest, and a variance for every axis."""

from __future__ import annotations

import numpy as np
import pytest

from omni_core.signals import ImuSample
from omni_sim.messages import imu_message
from omni_sim.sensor_configuration import ImuConfiguration


def test_a_unit_at_rest_measures_gravity_upwards() -> None:
    message = imu_message(ImuSample(0, 0.0, np.zeros(2)), ImuConfiguration(), 10_000_000)
    assert message.linear_acceleration.z == pytest.approx(9.81, abs=0.01)
    assert message.orientation_covariance[0] == -1.0  # not measured
    for covariance in (message.angular_velocity_covariance, message.linear_acceleration_covariance):
        assert min(covariance[axis] for axis in (0, 4, 8)) > 0.0
