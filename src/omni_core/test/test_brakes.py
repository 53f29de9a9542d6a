"""Typical brakes replace kind and timing of the brakes; a power limits the torque."""

import numpy as np
import pytest

from omni_core.brakes import TYPICAL, BrakeConfiguration, typical_changes
from omni_core.configuration import to_mapping


@pytest.mark.parametrize("brakes", TYPICAL)
def test_no_timing_of_other_brakes_stays(brakes: str) -> None:
    slow = BrakeConfiguration(dead_time=0.3, release_time=0.4, time_constant=0.2, max_torque=5.0)
    values = to_mapping(slow)
    for change in typical_changes(brakes):
        key, _, value = change.removeprefix("vehicle.brake.").partition("=")
        values[key] = value if key == "kind" else float(value)
    assert BrakeConfiguration(**values) == BrakeConfiguration(max_torque=5.0, **TYPICAL[brakes])


def test_a_torque_is_limited_only_above_the_power() -> None:
    torque, speed = np.array([0.0, 5.0, 5.0, 5.0]), np.array([9.0, 0.0, 10.0, -40.0])
    limited = BrakeConfiguration(max_power=100.0).limited(torque, speed)
    np.testing.assert_allclose(limited, [0.0, 5.0, 5.0, 2.5])
    np.testing.assert_array_equal(BrakeConfiguration().limited(torque, speed), torque)
