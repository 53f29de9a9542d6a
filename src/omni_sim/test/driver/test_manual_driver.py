"""Without demands the vehicle brakes; steps of the stick change the velocity gradually."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_sim.configuration import SimulationConfiguration, SimulatorConfiguration
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.driver.manual import DemandInbox, ManualDriver, ManualDriverConfiguration
from omni_sim.simulator import Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration

FORWARD = np.array([3.0, 0.0, 0.0])


def test_silence_is_full_braking() -> None:
    inbox = DemandInbox(timeout=0.3)
    assert inbox.demand(0.0)[0] == 1.0
    inbox.take_twist(FORWARD, 10.0)
    assert inbox.demand(10.0)[0] == 1.0  # a command without a pedal is no driver
    inbox.take_pedal(0.0, 10.0)
    assert inbox.demand(10.2)[0] == 0.0
    np.testing.assert_array_equal(inbox.demand(10.2)[1], FORWARD)
    pedal, twist = inbox.demand(10.31)
    assert pedal == 1.0
    np.testing.assert_array_equal(twist, 0.0)


def test_a_velocity_alone_drives_who_has_no_pedal() -> None:
    inbox = DemandInbox(timeout=0.3, pedal_required=False)
    assert inbox.demand(0.0)[0] == 1.0
    inbox.take_twist(FORWARD, 1.0)
    assert inbox.demand(1.2)[0] == 0.0
    np.testing.assert_array_equal(inbox.demand(1.2)[1], FORWARD)
    assert inbox.demand(1.31)[0] == 1.0  # no command: full braking
    inbox.take_pedal(0.5, 2.0)
    inbox.take_twist(FORWARD, 2.2)
    assert inbox.demand(2.2)[0] == 0.5
    inbox.take_twist(FORWARD, 3.0)
    assert inbox.demand(3.0)[0] == 1.0  # the pedal is no longer received


def test_a_pedal_alone_keeps_the_vehicle_from_braking_but_not_going() -> None:
    inbox = DemandInbox(timeout=0.3)
    inbox.take_twist(FORWARD, 0.0)
    inbox.take_pedal(0.0, 1.0)
    pedal, twist = inbox.demand(1.0)
    assert pedal == 0.0
    np.testing.assert_array_equal(twist, 0.0)


@pytest.mark.parametrize("pedal", [math.nan, -0.1, 1.1, math.inf])
def test_an_unreadable_pedal_is_full_braking(pedal: float) -> None:
    inbox = DemandInbox(timeout=0.3)
    inbox.take_pedal(pedal, 0.0)
    assert inbox.demand(0.0)[0] == 1.0


def test_a_command_that_is_no_number_is_rest() -> None:
    inbox = DemandInbox(timeout=0.3)
    inbox.take_pedal(0.0, 0.0)
    inbox.take_twist(np.array([math.nan, 1.0, 0.0]), 0.0)
    np.testing.assert_array_equal(inbox.demand(0.0)[1], 0.0)


def driver() -> ManualDriver:
    limits = ManualDriverConfiguration(acceleration=2.0, yaw_acceleration=3.0)
    return ManualDriver(limits, ManeuverConfiguration(x=1.0, heading_deg=90.0))


def test_it_starts_at_rest_and_braked_where_the_maneuver_starts() -> None:
    one = driver()
    np.testing.assert_allclose(one.start_pose, [1.0, 0.0, math.pi / 2])
    np.testing.assert_array_equal(one.start_twist, 0.0)
    assert one.demand(0, 0.0)[0] == 1.0


def test_the_command_reaches_its_target_within_the_acceleration() -> None:
    one, period, target = driver(), 0.01, np.array([3.0, -4.0, 0.6])
    before = one.demand(0, 0.0)[1]
    for _ in range(249):
        one.steer(0.0, target, np.zeros(3), period)
        now = one.demand(0, 0.0)[1]
        assert np.hypot(*(now - before)[:2]) <= 2.0 * period * (1.0 + 1e-12)
        assert abs(now[2] - before[2]) <= 3.0 * period * (1.0 + 1e-12)
        before = now
    # 5 m/s at 2 m/s^2 take 2.5 s.
    assert np.hypot(*before[:2]) == pytest.approx(2.0 * 2.49)
    one.steer(0.0, target, np.zeros(3), period)
    np.testing.assert_allclose(one.demand(0, 0.0)[1], target)


def test_after_braking_the_drive_takes_up_the_velocity_that_is_left() -> None:
    one, left = driver(), np.array([2.0, 0.3, -0.1])
    one.steer(0.5, FORWARD, left, 0.01)
    assert one.demand(0, 0.0)[0] == 0.5
    np.testing.assert_array_equal(one.demand(0, 0.0)[1], left)
    one.steer(0.0, left, np.zeros(3), 0.01)
    np.testing.assert_array_equal(one.demand(0, 0.0)[1], left)


def test_the_vehicle_goes_where_it_is_steered_and_stops_when_braked(
    forklift: VehicleConfiguration,
) -> None:
    configuration = SimulatorConfiguration(
        vehicle=forklift, sensors={}, simulation=SimulationConfiguration(render_lines=False)
    )
    limits = ManualDriverConfiguration()
    one = ManualDriver(limits, configuration.maneuver)
    simulator = Simulator(configuration, driver=one)
    start, sideways = simulator.observe().pose, np.array([0.0, 1.0, 0.0])
    for pedal, steps in ((0.0, 150), (1.0, 100)):
        for _ in range(steps):
            one.steer(pedal, sideways, simulator.observe().twist, 0.01)
            simulator.advance(np.ones(len(configuration.vehicle.wheels)))
        if not pedal:
            np.testing.assert_allclose(simulator.observe().twist, sideways, atol=0.05)
    stopped = simulator.observe()
    np.testing.assert_allclose(stopped.twist, 0.0, atol=0.01)
    # 0.4 s of acceleration and 1.1 s at 1 m/s before the brakes.
    assert 1.2 < np.hypot(*(stopped.pose - start)[:2]) < 1.7
