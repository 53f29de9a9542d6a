"""Messages of the simulator, read back like a viewer does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_core.sensors import LineSensor
from omni_ros.line_images import camera_info
from omni_sim.configuration import (
    GroundConfiguration,
    SimulationConfiguration,
    SimulatorConfiguration,
)
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.messages import ground_truth, scene_markers, wheel_forces
from omni_sim.simulator import Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration


@pytest.fixture(scope="module")
def configuration(forklift: VehicleConfiguration) -> SimulatorConfiguration:
    patch = FrictionPatch(x=3.0, y=1.0, length=2.0, width=1.0, heading_deg=90.0, friction=0.2)
    return SimulatorConfiguration(
        vehicle=forklift,
        ground=GroundConfiguration(patches={"ice": patch}),
        sensors={},
        maneuver=ManeuverConfiguration(speed=2.0, direction_deg=-30.0, yaw_rate_deg=30.0),
        simulation=SimulationConfiguration(render_lines=False),
    )


def test_a_pixel_of_the_camera_is_found_on_the_ground() -> None:
    sensor = LineSensor(x=0.0, y=0.5, heading_deg=0.0, pixels=335, length=0.05, width=0.02)
    info = camera_info("left", sensor.pixels, sensor.length, sensor.width)
    projection = np.array(info.p).reshape(3, 4)
    # One meter above it a pinhole camera of this scale sees the ends of the field of view
    # at the outer edges of the first and the last pixel.
    ends = [projection @ [x, 0.0, 1.0, 1.0] for x in (-0.025, 0.025)]
    assert [end[0] for end in ends] == pytest.approx([-0.5, 334.5])
    assert (info.width, info.height, info.header.frame_id) == (335, 1, "left")


def test_the_truth_survives_its_quaternion(configuration: SimulatorConfiguration) -> None:
    simulator = Simulator(configuration)
    for _ in range(100):
        simulator.advance(np.zeros(4))
    observation = simulator.observe()
    message = ground_truth(observation)
    turn = message.pose.pose.orientation
    yaw = 2.0 * math.atan2(turn.z, turn.w)
    position = message.pose.pose.position
    assert abs(yaw) > 0.1
    assert (position.x, position.y, yaw) == pytest.approx(tuple(observation.pose))
    assert message.twist.twist.linear.y == observation.twist[1]
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")


def test_the_arrows_show_the_published_wheel_forces(configuration: SimulatorConfiguration) -> None:
    simulator = Simulator(configuration)
    for _ in range(80):  # the vehicle turns and brakes
        simulator.advance(np.ones(4))
    observation = simulator.observe()
    message = wheel_forces(tuple(configuration.vehicle.wheels), observation)
    markers = scene_markers(configuration, observation).markers
    arrows = [marker.points for marker in markers if marker.ns == "wheel_forces"]
    shown = [(head.x - tail.x, head.y - tail.y) for tail, head in arrows]
    forces = np.array([(wrench.force.x, wrench.force.y) for wrench in message.wrench])
    assert np.max(np.abs(forces)) > 500.0
    assert forces * 1e-4 == pytest.approx(np.array(shown))
    assert message.header.frame_id == markers[0].header.frame_id == "odom"
    assert message.joint_names == [*configuration.vehicle.wheels]


def test_the_scene_shows_every_wheel_load_and_patch(configuration: SimulatorConfiguration) -> None:
    observation = Simulator(configuration).observe()
    markers = scene_markers(configuration, observation).markers
    count = {name: sum(m.ns == name for m in markers) for name in {m.ns for m in markers}}
    assert count == {
        "platform": 1,
        "load": 1,
        "wheels": 4,
        "wheel_forces": 4,
        "velocity": 1,
        "friction_patches": 1,
    }
    # A viewer replaces a marker by (namespace, id): each must be there once.
    assert len({(m.ns, m.id) for m in markers}) == len(markers)
    (velocity,) = (m for m in markers if m.ns == "velocity")
    tail, head = velocity.points
    arrow = math.degrees(math.atan2(head.y - tail.y, head.x - tail.x))
    assert arrow == pytest.approx(-30.0)
