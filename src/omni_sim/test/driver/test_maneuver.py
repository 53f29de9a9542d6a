"""The scripted driver's pedal and command."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.driver.scripted import ScriptedDriver

SECOND = 1_000_000_000


def test_pedal_goes_down_at_the_brake_time_and_the_command_ends() -> None:
    driver = ScriptedDriver(ManeuverConfiguration(speed=3.0, brake_time=0.5, pedal=0.8))
    assert driver.demand(SECOND // 2 - 1, 0.0)[0] == 0.0
    assert driver.demand(SECOND // 2, 0.0)[0] == 0.8
    np.testing.assert_allclose(driver.demand(SECOND // 2 - 1, 0.0)[1], [3.0, 0.0, 0.0])
    np.testing.assert_array_equal(driver.demand(SECOND // 2, 0.0)[1], np.zeros(3))


def test_pedal_ramps() -> None:
    driver = ScriptedDriver(ManeuverConfiguration(brake_time=1.0, pedal_ramp_time=0.2, pedal=0.5))
    assert driver.demand(SECOND, 0.0)[0] == 0.0
    assert driver.demand(SECOND + SECOND // 20, 0.0)[0] == pytest.approx(0.125)
    assert driver.demand(SECOND + SECOND // 5, 0.0)[0] == 0.5
    assert driver.demand(3 * SECOND, 0.0)[0] == 0.5


def test_start_is_the_configured_one() -> None:
    driver = ScriptedDriver(
        ManeuverConfiguration(
            x=1.0, y=2.0, heading_deg=90.0, speed=2.0, direction_deg=30.0, yaw_rate_deg=-180.0
        )
    )
    np.testing.assert_allclose(driver.start_pose, [1.0, 2.0, math.pi / 2])
    np.testing.assert_allclose(driver.start_twist, [math.sqrt(3.0), 1.0, -math.pi])
    np.testing.assert_allclose(driver.demand(0, math.pi / 2)[1], driver.start_twist)


@pytest.mark.parametrize("hold", [False, True])
def test_direction_is_held_in_the_world_or_in_the_body(hold: bool) -> None:
    driver = ScriptedDriver(
        ManeuverConfiguration(
            heading_deg=40.0, speed=2.0, direction_deg=20.0, hold_world_direction=hold
        )
    )
    yaw = 1.3
    v = driver.demand(0, yaw)[1]
    world = math.atan2(v[1], v[0]) + yaw
    assert np.linalg.norm(v[:2]) == pytest.approx(2.0)
    assert world == pytest.approx(math.radians(60.0) if hold else math.radians(20.0) + yaw)
