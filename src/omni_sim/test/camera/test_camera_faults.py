"""Faults of the line cameras begin and end at their times, and affect only their camera."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError, from_mapping
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor
from omni_sim.camera.camera import LineCamera, LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.texture.texture import GroundTexture, generate_texture

SIZE = 0.05
CORK = generate_texture(TextureConfiguration(size=SIZE, texels=1024))
UNIFORM = GroundTexture(np.full((256, 256), 200, np.uint8), SIZE)
VIEW: dict[str, Any] = {"pixels": 100, "length": 0.01, "width": 0.004, "line_rate": 1000.0}
SENSORS = {
    "left": LineSensor(x=0.2, y=0.1, heading_deg=30.0, **VIEW),
    "right": LineSensor(x=0.2, y=-0.1, heading_deg=30.0, **VIEW),
}
POSES = np.tile([0.3, 0.1, 0.4], (40, 1))
DURING = slice(10, 25)  # lines between 0.0095 s and 0.0245 s, at 1000 lines/s


def cameras(texture: GroundTexture, **fault: Any) -> dict[str, LineCamera]:
    timed = {"time": 0.0095, "duration": 0.015, "camera": "left", **fault}
    configuration = from_mapping(CameraConfiguration, {"noise": 0.0, "faults": {"one": timed}})
    return LineCameraArray(SENSORS, texture, configuration, np.random.SeedSequence(1)).cameras


def lines(name: str = "left", texture: GroundTexture = UNIFORM, **fault: Any) -> FloatArray:
    return cameras(texture, **fault)[name].lines(POSES, 0).astype(float)


FAULTS = [
    {"kind": "dirt", "amplitude": 20.0},
    {"kind": "cover", "amplitude": 0.5},
    {"kind": "light", "amplitude": 0.5},
    {"kind": "flicker", "amplitude": 0.5},
    {"kind": "shadow", "amplitude": 0.5, "period": 0.01},
    {"kind": "bump", "amplitude": 0.2},
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: str(fault["kind"]))
def test_a_fault_changes_only_the_lines_of_its_camera_during_its_time(fault: Any) -> None:
    healthy = lines("right", CORK, kind="light", amplitude=0.0)
    np.testing.assert_array_equal(lines("right", CORK, **fault), healthy)
    faulty, clean = lines("left", CORK, **fault), lines("left", CORK, kind="light", amplitude=0.0)
    changed = np.flatnonzero((faulty != clean).any(axis=1))
    assert changed.min() >= DURING.start
    assert changed.max() < DURING.stop
    assert len(changed) >= 14  # a shadow and mains light begin at 0


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: str(fault["kind"]))
def test_the_lines_do_not_depend_on_the_batches(fault: Any) -> None:
    camera = cameras(CORK, **fault)["left"]
    parts = [camera.lines(POSES[i : i + 5], i) for i in range(0, 40, 5)]
    np.testing.assert_array_equal(np.concatenate(parts), camera.lines(POSES, 0))


def test_a_cover_is_opaque() -> None:
    covered = [cameras(ground, kind="cover", amplitude=0.3)["left"] for ground in (CORK, UNIFORM)]
    one, other = (camera.lines(POSES, 0)[DURING] for camera in covered)
    np.testing.assert_array_equal(one[:, 70:], other[:, 70:])
    assert not np.array_equal(one[:, :70], other[:, :70])


def test_mains_light_is_a_sine() -> None:
    flicker: dict[str, Any] = {"kind": "flicker", "amplitude": 0.2, "time": 0.0, "duration": 1.0}
    wanted = 200.0 * (1.0 + 0.2 * np.sin(2.0 * math.pi * np.arange(40) / 10.0))
    np.testing.assert_allclose(lines(**flicker)[:, 50], wanted, atol=0.5)


def test_a_shadow_moves_over_the_line_within_its_period() -> None:
    shaded = lines(kind="shadow", amplitude=0.5, time=0.0, duration=1.0, period=0.02) < 150.0
    # After a quarter of the period the edge is a quarter of the line from pixel 0.
    np.testing.assert_allclose(shaded.sum(axis=1)[[5, 10, 15]], [25, 50, 75], atol=1.0)
    assert shaded[25:, :89].all()  # the edge itself is 2 mm wide, a fifth of this line


def test_a_bump_turns_the_mounting_about_the_middle_of_the_view() -> None:
    turn, during = 0.2, POSES[DURING] + np.array([0.01, 0.0, 0.0])
    sensor = SENSORS["left"]
    heading = sensor.heading_deg + math.degrees(turn)
    turned = {"left": LineSensor(x=sensor.x, y=sensor.y, heading_deg=heading, **VIEW)}
    plain = CameraConfiguration(noise=0.0, exposure_time=5e-4)
    other = LineCameraArray(turned, CORK, plain, np.random.SeedSequence(1)).cameras["left"]
    faults = {"one": {"kind": "bump", "amplitude": turn}}
    configuration = {"noise": 0.0, "exposure_time": 5e-4, "faults": faults}
    bumped = LineCameraArray(
        SENSORS, CORK, from_mapping(CameraConfiguration, configuration), np.random.SeedSequence(1)
    ).cameras["left"]
    velocities = np.tile([1.0, -0.5, 2.0], (len(during), 1))
    np.testing.assert_allclose(
        bumped.ground(during, velocities, 3), other.ground(during, velocities), atol=0.02
    )


@pytest.mark.parametrize(
    ("fault", "word"),
    [
        ({"kind": "cover", "amplitude": 1.2}, "share"),
        ({"kind": "dirt", "amplitude": 2.5}, "specks"),
        ({"kind": "fog", "amplitude": 0.5}, "kind"),
    ],
)
def test_impossible_faults_are_refused(fault: Any, word: str) -> None:
    with pytest.raises(ConfigurationError, match=word):
        lines(**fault)
