"""Heave, pitch and roll of the chassis move the fields of view as geometry requires."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from omni_core.sensors import FlowSensor, LineSensor
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.configuration import (
    GroundConfiguration,
    SimulationConfiguration,
    SimulatorConfiguration,
)
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.flow_sensor import FlowConfiguration
from omni_sim.ground.configuration import BumpConfiguration, ElevationConfiguration
from omni_sim.simulator import Simulator
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.vehicle.configuration import SuspensionConfiguration, VehicleConfiguration
from omni_sim.vehicle.suspension import swaying

CORK = TextureConfiguration(kind="cork", size=0.1, texels=1024)
ON = np.ones(4)


def simulator(
    vehicle: VehicleConfiguration, cache: TextureCache, *, stiffness: float = 0.0, **changes: Any
) -> Simulator:
    springs = SuspensionConfiguration(stiffness=stiffness)
    settings: dict[str, Any] = {
        "vehicle": dataclasses.replace(vehicle, suspension=springs),
        "ground": GroundConfiguration(texture=CORK),
        "sensors": {"a": LineSensor(x=0.5, y=0.2, heading_deg=0.0, pixels=128)},
        "flow_sensors": {"f": FlowSensor(x=-0.3, y=0.1, heading_deg=0.0)},
        "flow": FlowConfiguration(resolution=0.0, noise=1e-12, scale=0.0),
        "camera": CameraConfiguration(noise=0.0),
        "maneuver": ManeuverConfiguration(speed=5.0, brake_time=0.05),
        "simulation": SimulationConfiguration(duration_limit=3.0),
    }
    return Simulator(SimulatorConfiguration(**(settings | changes)), cache)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> TextureCache:
    return TextureCache(tmp_path_factory.mktemp("textures"))


def test_a_view_follows_the_foot_of_the_line_of_sight() -> None:
    """Camera and axis are rotated about the center of gravity and intersected with the ground."""
    height, tilt, yaw = 0.4, np.array((0.02, -0.03)), 0.8
    normal = np.array((-tilt[0], -tilt[1], 1.0)) / math.sqrt(1.0 + float(tilt @ tilt))
    # The shortest turn that takes the vertical to the normal.
    axis = np.cross((0.0, 0.0, 1.0), normal)
    cross = np.array(((0.0, -axis[2], axis[1]), (axis[2], 0.0, -axis[0]), (-axis[1], axis[0], 0.0)))
    turn = np.eye(3) + cross + cross @ cross / (1.0 + normal[2])
    for mounted in ((0.0, 0.0, 0.3), (0.7, 0.4, 0.05), (-0.5, 0.2, 1.0)):
        place = np.array(mounted)
        camera = turn @ (place - (0.0, 0.0, height)) + (0.0, 0.0, height)
        foot = camera - normal * (camera[2] / normal[2])
        moved = foot[:2] - place[:2]
        ride = np.array((0.0, *tilt, 0.0, 0.0, 0.0))
        still = np.tile((1.0, 2.0, yaw, 0.0, 0.0, 0.0), (3, 1))
        shift = (swaying(still, ride, ride, height, 0.01) - still)[:, :2]
        cos, sin = math.cos(yaw), math.sin(yaw)
        expected = np.array((cos * moved[0] - sin * moved[1], sin * moved[0] + cos * moved[1]))
        np.testing.assert_allclose(shift, np.tile(expected, (3, 1)), atol=2e-3 * height)


def test_between_stamps_the_rates_are_those_of_the_shifts() -> None:
    before = np.array((0.0, 0.01, -0.02, 0.0, 0.3, 0.1))
    after = np.array((0.0, 0.014, -0.017, 0.0, 0.5, 0.6))
    steps = 2000
    still = np.zeros((steps + 1, 6))
    still[:, 2] = 0.3
    swayed = swaying(still, before, after, 0.5, 0.01)
    rates = np.diff(swayed[:, :2], axis=0) / (0.01 / steps)
    np.testing.assert_allclose(rates, 0.5 * (swayed[1:, 3:5] + swayed[:-1, 3:5]), atol=1e-4)
    for row, ride in ((0, before), (-1, after)):
        c, s = math.cos(0.3), math.sin(0.3)
        turned = np.array(((c, -s), (s, c)))
        np.testing.assert_allclose(swayed[row, :2], 0.5 * turned @ ride[1:3], atol=1e-15)
        np.testing.assert_allclose(swayed[row, 3:5], 0.5 * turned @ ride[4:], atol=1e-13)


def test_a_nose_dive_is_seen_as_a_motion_of_the_ground(
    forklift: VehicleConfiguration, cache: TextureCache
) -> None:
    """The flow sensor measures the path of the vehicle plus height times pitch angle."""
    parts = {n: dataclasses.replace(getattr(forklift, n), x=0.0, y=0.0) for n in ("body", "load")}
    subject = simulator(dataclasses.replace(forklift, **parts), cache, stiffness=1e5)
    start, seen, dives = subject.observe().pose[0], 0.0, []
    for _ in range(30):
        subject.advance(ON)
        seen += 0.01 * float(subject.observe().flows["f"].velocity[0])
        dives.append(float(subject.vehicle.ride[1]))
    assert min(dives) < -0.005
    expected = subject.vehicle.masses.height * dives[-1]
    assert seen - (subject.observe().pose[0] - start) == pytest.approx(expected, abs=1e-6)


def test_a_stiff_vehicle_sees_what_it_saw(
    forklift: VehicleConfiguration, cache: TextureCache
) -> None:
    """On flat ground, with any lens, sway does not change the gray levels."""
    lenses = [CameraConfiguration(lens=lens) for lens in ("telecentric", "ordinary")]
    subjects = [simulator(forklift, cache, camera=camera) for camera in lenses]
    for _ in range(5):
        telecentric, ordinary = (s.observe().line_batches["a"].lines for s in subjects)
        np.testing.assert_array_equal(telecentric, ordinary)
        for subject in subjects:
            subject.advance(ON)


def test_over_a_hollow_an_ordinary_lens_sees_more(
    forklift: VehicleConfiguration, cache: TextureCache
) -> None:
    """A camera between the wheels, over ground that is 2 cm lower than under the wheels."""
    hollow = ElevationConfiguration(
        bumps={"hollow": BumpConfiguration(x=0.5, y=0.2, radius=0.25, height=-0.02)}
    )
    subject = simulator(
        forklift,
        cache,
        ground=GroundConfiguration(texture=CORK, elevation=hollow),
        maneuver=ManeuverConfiguration(speed=0.001, brake_time=0.0),
        camera=CameraConfiguration(lens="ordinary", working_distance=0.1, noise=0.0),
    )
    subject.advance(ON)
    assert subject.vehicle.clearance(0.5, 0.2) == pytest.approx(0.02, abs=1e-4)
    wide = simulator(
        forklift,
        cache,
        maneuver=ManeuverConfiguration(speed=0.001, brake_time=0.0),
        camera=CameraConfiguration(
            lens="ordinary", working_distance=0.1, height_error=0.02, noise=0.0
        ),
    )
    wide.advance(ON)
    seen, expected = (s.observe().line_batches["a"].lines[-1] for s in (subject, wide))
    np.testing.assert_allclose(seen.astype(float), expected.astype(float), atol=2.0)
