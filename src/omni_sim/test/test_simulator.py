"""The simulator as a whole: time, lines, sensors and the end of a run."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from omni_core.configuration import ConfigurationError, from_mapping
from omni_core.sensors import LineSensor
from omni_sim.camera.camera import LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.configuration import (
    GroundConfiguration,
    SimulationConfiguration,
    SimulatorConfiguration,
)
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.run_progress import RunProgress
from omni_sim.sensor_configuration import VelocitySensorConfiguration
from omni_sim.simulator import Simulator
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration

CONFIG = Path(__file__).resolve().parents[3] / "config"
SMALL_GROUND = GroundConfiguration(texture=TextureConfiguration(kind="cork", size=0.1, texels=1024))
SENSORS = {
    "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0, pixels=128),
    "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0, pixels=128, line_rate=2985.0),
    "front": LineSensor(x=0.6, y=0.0, heading_deg=90.0, pixels=128),
}
ON = np.ones(4)


@pytest.fixture(scope="module")
def textures(tmp_path_factory: pytest.TempPathFactory) -> TextureCache:
    return TextureCache(tmp_path_factory.mktemp("textures"))


def configuration(**changes: Any) -> SimulatorConfiguration:
    vehicle = yaml.safe_load((CONFIG / "vehicles/mecanum_forklift.yaml").read_text())
    vehicle["tire"] = yaml.safe_load((CONFIG / f"tires/{vehicle['tire']}.yaml").read_text())
    values: dict[str, Any] = {
        "vehicle": from_mapping(VehicleConfiguration, vehicle),
        "ground": SMALL_GROUND,
        "sensors": SENSORS,
    }
    return SimulatorConfiguration(**(values | changes))


def test_every_line_comes_once_and_in_time(textures: TextureCache) -> None:
    simulator = Simulator(configuration(), textures)
    counts = dict.fromkeys(SENSORS, 0)
    for step in range(101):
        observation = simulator.observe()
        assert observation.stamp_ns == step * 10_000_000
        for name, batch in observation.line_batches.items():
            counts[name] += len(batch.lines)
            newest = counts[name] - 1
            assert batch.stamp_ns == round(newest * 1e9 / SENSORS[name].line_rate)
            assert 0 <= observation.stamp_ns - batch.stamp_ns < 1e9 / SENSORS[name].line_rate
        simulator.advance(ON)
    assert counts == {"left": 2501, "right": 2986, "front": 2501}


def test_observing_changes_nothing(textures: TextureCache) -> None:
    noisy = VelocitySensorConfiguration(linear_noise=0.15, yaw_rate_noise=0.15)
    looked_at, left_alone = (
        Simulator(configuration(velocity_sensor=noisy), textures) for _ in range(2)
    )
    for _ in range(5):
        first, second = looked_at.observe(), looked_at.observe()
        np.testing.assert_array_equal(first.velocity_sensor.value, second.velocity_sensor.value)
        for simulator in (looked_at, left_alone):
            simulator.advance(ON)
    a, b = looked_at.observe(), left_alone.observe()
    np.testing.assert_array_equal(a.pose, b.pose)
    for name in SENSORS:
        np.testing.assert_array_equal(a.line_batches[name].lines, b.line_batches[name].lines)


def test_a_line_is_taken_where_the_camera_is_at_that_instant(textures: TextureCache) -> None:
    """At a speed of one pitch per line, each line is the previous one shifted by a pixel."""
    sensor = dataclasses.replace(SENSORS["left"], line_rate=2500.0)
    speed = sensor.pixel_pitch * sensor.line_rate
    cameras = configuration().camera
    simulator = Simulator(
        configuration(
            sensors={"left": sensor},
            maneuver=ManeuverConfiguration(speed=speed, brake_time=10.0),
            camera=dataclasses.replace(cameras, noise=0.0),
        ),
        textures,
    )
    simulator.advance(ON)
    lines = simulator.observe().line_batches["left"].lines.astype(int)
    assert len(lines) == 25
    # In motion along the axis, the ground moves one pixel toward the start of the line.
    assert np.abs(lines[1:, :-1] - lines[:-1, 1:]).max() <= 2
    assert np.abs(np.diff(lines, axis=0)).max() > 10  # without the shift


def test_lines_are_blurred_by_the_way_during_their_exposure(textures: TextureCache) -> None:
    sensor = dataclasses.replace(SENSORS["front"], line_rate=2500.0)
    camera = CameraConfiguration(noise=0.0, exposure_time=3e-4)
    maneuver = ManeuverConfiguration(speed=5.0, direction_deg=60.0, brake_time=10.0)
    settings = configuration(sensors={"front": sensor}, maneuver=maneuver, camera=camera)
    simulator = Simulator(settings, textures)
    lines = [simulator.observe().line_batches["front"].lines]
    simulator.advance(ON)
    lines.append(simulator.observe().line_batches["front"].lines)

    # Rolling freely, the vehicle keeps its velocity.
    velocity = 5.0 * np.array([np.cos(np.pi / 3.0), np.sin(np.pi / 3.0), 0.0])
    poses = np.arange(26)[:, np.newaxis] / 2500.0 * velocity
    alone = LineCameraArray(
        {"front": sensor}, textures.texture(SMALL_GROUND.texture), camera, np.random.SeedSequence(1)
    ).cameras["front"]
    blurred = alone.lines(poses, 0, np.repeat(velocity[np.newaxis], 26, axis=0)).astype(float)
    sharp = alone.lines(poses, 0).astype(float)
    error = np.concatenate(lines) - blurred
    assert np.sqrt(np.mean(error**2)) < 0.5
    assert np.sqrt(np.mean((sharp - blurred) ** 2, axis=1)).min() > 1.0


def test_the_noise_of_the_velocity_sensor_has_the_covariance_it_claims() -> None:
    noisy = VelocitySensorConfiguration(linear_noise=0.15, yaw_rate_noise=0.3)
    simulator = Simulator(
        configuration(
            velocity_sensor=noisy,
            maneuver=ManeuverConfiguration(
                speed=5.0, direction_deg=30.0, yaw_rate_deg=60.0, brake_time=100.0
            ),
            simulation=SimulationConfiguration(render_lines=False),
        )
    )
    errors, claims = [], []
    for _ in range(2000):
        observation = simulator.observe()
        errors.append(observation.velocity_sensor.value - observation.twist)
        claims.append(np.diag(observation.velocity_sensor.covariance))
        simulator.advance(ON)
    np.testing.assert_allclose(
        np.mean(np.square(errors), axis=0), np.mean(claims, axis=0), rtol=0.1
    )


def test_a_period_that_is_no_multiple_of_the_step_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"control_period: 0\.0102 s is not a multiple"):
        SimulationConfiguration(control_period=0.0102)


def test_a_camera_that_is_too_slow_is_refused_by_name() -> None:
    slow = {"left": dataclasses.replace(SENSORS["left"], line_rate=150.0)}
    with pytest.raises(ConfigurationError, match=r"sensors\.left\.line_rate"):
        configuration(sensors=slow)


@pytest.mark.parametrize(
    ("limit", "outcome"), [(30.0, "stopped"), (1.0, "time limit")], ids=["stop", "limit"]
)
def test_a_run_ends_at_rest_or_at_its_limit(limit: float, outcome: str) -> None:
    chosen = configuration(
        maneuver=ManeuverConfiguration(speed=3.0, brake_time=0.2),
        simulation=SimulationConfiguration(
            render_lines=False, duration_limit=limit, settling_time=0.5
        ),
    )
    simulator, progress = Simulator(chosen), RunProgress(chosen)
    shares = []
    while not progress.finished:
        observation = simulator.observe()
        progress.update(observation)
        shares.append(progress.report()["share"])
        simulator.advance(ON)
    assert progress.outcome == outcome
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    if outcome == "stopped":
        assert math.hypot(*observation.twist[:2]) < chosen.simulation.rest_speed
        assert observation.stamp_ns * 1e-9 < 3.0
    else:
        assert observation.stamp_ns == 1_000_000_000


def test_the_progress_of_recorded_demands_is_that_of_their_time() -> None:
    table = {"time": (0.0, 1.0, 1.5, 3.0), "forward": (0.0, 2.0, 0.0, 0.0), "pedal": (0, 0, 1, 1)}
    table |= dict.fromkeys(("left", "turn"), 4 * (0.0,))
    chosen = configuration(
        maneuver=from_mapping(ManeuverConfiguration, {"demands": table}),
        simulation=SimulationConfiguration(render_lines=False, settling_time=0.2),
    )
    simulator, progress = Simulator(chosen), RunProgress(chosen)
    while not progress.finished:
        observation = simulator.observe()
        progress.update(observation)
        time = observation.stamp_ns * 1e-9
        expected = 1.0 if progress.finished else min(time / 3.0, 0.99)
        assert progress.report()["share"] == pytest.approx(expected, abs=1e-9)
        simulator.advance(ON)


def test_tipping_is_reported_and_timed() -> None:
    """With the center of gravity 5 m up and 6 m/s^2, the moment exceeds that of the weight."""
    upright = configuration().vehicle
    high = dataclasses.replace(
        upright, load=dataclasses.replace(upright.load, mass=2000.0, height=5.0)
    )
    no_lines = SimulationConfiguration(render_lines=False)
    maneuver = ManeuverConfiguration(brake_time=0.0)
    tipped = []
    for vehicle in (upright, high):
        simulator = Simulator(
            configuration(vehicle=vehicle, simulation=no_lines, maneuver=maneuver)
        )
        states = []
        for _ in range(100):
            simulator.advance(ON)
            states.append(simulator.tipping)
        tipped.append((simulator.tipping_time, sum(states)))
    assert tipped[0] == (0.0, 0)
    time, periods = tipped[1]
    assert time > 0.1
    assert 0.01 * (periods - 2) <= time <= 0.01 * (periods + 2)
