"""Cameras render the ground below them; the noise depends only on the line number."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from exact_footprint import integrate_exactly
from numpy.typing import NDArray

from omni_core.configuration import ConfigurationError, from_mapping
from omni_core.sensors import LineSensor, sensor_matrix
from omni_sim.camera.camera import LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.texture.texture import GroundTexture, generate_texture

SIZE = 0.05
CORK = generate_texture(TextureConfiguration(size=SIZE, texels=1024))
UNIFORM = GroundTexture(np.full((256, 256), 100, np.uint8), SIZE)
SENSORS = {
    "left": LineSensor(x=0.1, y=0.5, heading_deg=0.0, pixels=101, length=0.01, width=0.004),
    "right": LineSensor(x=0.1, y=-0.5, heading_deg=180.0, pixels=128, length=0.01, width=0.004),
    "front": LineSensor(x=0.6, y=0.0, heading_deg=70.0, pixels=64, length=0.04, width=0.02),
}


def array(
    texture: GroundTexture = CORK,
    sensors: dict[str, LineSensor] | None = None,
    seed: int = 1,
    **camera: float,
) -> LineCameraArray:
    return LineCameraArray(
        sensors or SENSORS,
        texture,
        from_mapping(CameraConfiguration, camera),
        np.random.SeedSequence(seed),
    )


def path(count: int) -> NDArray[np.float64]:
    time = np.arange(count) / 2500.0
    return np.column_stack((9.0 * time, -2.0 * time, 0.3 + 1.5 * time))


def test_a_camera_sees_the_ground_below_its_place_on_the_body() -> None:
    pose = np.array([[1.7, -0.4, 0.9]])
    cameras = array().cameras
    for name, sensor in SENSORS.items():
        x = 1.7 + math.cos(0.9) * sensor.x - math.sin(0.9) * sensor.y
        y = -0.4 + math.sin(0.9) * sensor.x + math.cos(0.9) * sensor.y
        exact = integrate_exactly(
            CORK.gray,
            SIZE,
            (x, y, 0.9 + math.radians(sensor.heading_deg)),
            sensor.length,
            sensor.width,
            sensor.pixels,
        )
        error = cameras[name].grays(pose)[0] - exact
        assert np.std(exact) > 3.0
        assert np.sqrt(np.mean(error**2)) < 0.2


@pytest.mark.parametrize(("bit_depth", "scale", "kind"), [(8, 1, np.uint8), (16, 257, np.uint16)])
def test_noiseless_pixels_are_rounded_grays(
    bit_depth: int, scale: int, kind: type[np.generic]
) -> None:
    cameras = array(noise=0.0, bit_depth=bit_depth, gain=1.5, offset=-20.0)
    lines = cameras.render(dict.fromkeys(SENSORS, path(4)))
    for name, camera in cameras.cameras.items():
        assert lines[name].dtype == kind
        wanted = np.clip((1.5 * camera.grays(path(4)) - 20.0) * scale, 0, 255 * scale)
        assert np.abs(lines[name] - wanted).max() <= 0.5 + 1e-3 * scale


@pytest.mark.parametrize(("offset", "gray"), [(400.0, 1.0), (-400.0, 0.0)])
def test_brightness_is_clipped_to_the_range(offset: float, gray: float) -> None:
    for bit_depth, white in ((8, 255), (16, 65535)):
        lines = array(offset=offset, bit_depth=bit_depth).render({"left": path(3)})["left"]
        np.testing.assert_array_equal(lines, gray * white)


@pytest.mark.parametrize("deviation", [0.5, 1.0, 5.0])
def test_noise_is_white_and_normal(deviation: float) -> None:
    # At 16 bits quantization (1/257 gray levels) does not show.
    cameras = array(UNIFORM, noise=deviation, bit_depth=16)
    noise = cameras.render({"right": path(4000)})["right"] / 257.0 - 100.0
    count = noise.size
    assert abs(noise.mean()) < 5.0 * deviation / math.sqrt(count)
    assert noise.std() == pytest.approx(deviation, rel=5.0 / math.sqrt(2 * count))
    normal = noise / noise.std()
    assert abs(np.mean(normal**3)) < 5.0 * math.sqrt(6.0 / count)
    assert abs(np.mean(normal**4) - 3.0) < 5.0 * math.sqrt(24.0 / count) + 0.01
    assert np.mean(np.abs(normal) > 3.0) == pytest.approx(0.0027, rel=0.1)
    for shifted in (normal[1:] * normal[:-1], normal[:, 1:] * normal[:, :-1]):
        assert abs(shifted.mean()) < 5.0 / math.sqrt(shifted.size)


def test_sensors_and_seeds_have_noise_of_their_own() -> None:
    twins = {"one": SENSORS["right"], "two": SENSORS["right"]}
    both = array(UNIFORM, twins, noise=3.0).render(dict.fromkeys(twins, path(500)))
    other = array(UNIFORM, twins, seed=2, noise=3.0).render(dict.fromkeys(twins, path(500)))
    for first, second in ((both["one"], both["two"]), (both["one"], other["one"])):
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 5.0 / math.sqrt(first.size)


def test_noise_does_not_depend_on_which_other_sensors_there_are() -> None:
    alone = array(sensors={"front": SENSORS["front"]}).render({"front": path(9)})
    together = array().render(dict.fromkeys(SENSORS, path(9)))
    np.testing.assert_array_equal(alone["front"], together["front"])


@pytest.mark.parametrize("split", [[60], [1, 59], [25, 25, 10], [0, 7, 0, 53]])
def test_lines_do_not_depend_on_batches(split: list[int]) -> None:
    poses = path(60)
    whole = array().render(dict.fromkeys(SENSORS, poses))
    cameras = array()
    parts = [
        cameras.render(dict.fromkeys(SENSORS, part))
        for part in np.split(poses, np.cumsum(split)[:-1])
    ]
    for name, lines in whole.items():
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), lines)


def test_a_pose_that_is_no_number_is_refused() -> None:
    poses = path(20)
    poses[19, 2] = np.nan
    with pytest.raises(ValueError, match="finite"):
        array().render(dict.fromkeys(SENSORS, poses))


def test_coarse_pixels_use_a_coarser_level_and_look_the_same() -> None:
    sensor = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=64, length=0.05, width=0.0195)
    fine = generate_texture(TextureConfiguration(size=SIZE, texels=2048))
    camera = array(fine, {"coarse": sensor}).cameras["coarse"]
    assert camera.texels < 2048
    for heading in (0.0, 0.4, 1.1, 2.5):
        grays = camera.grays(np.array([[0.01, 0.02, heading]]))[0]
        exact = integrate_exactly(fine.gray, SIZE, (0.01, 0.02, heading), 0.05, 0.0195, 64)
        assert np.sqrt(np.mean((grays - exact) ** 2)) < 0.15


def test_a_camera_takes_as_many_texels_on_a_ground_of_any_resolution() -> None:
    sensor = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=128, length=0.05, width=0.0195)
    for texels, expected in ((1024, 1024), (4096, 2048), (5000, 2048), (6144, 2048)):
        ground = GroundTexture(np.zeros((texels, texels), np.uint8), 0.2)
        assert array(ground, {"one": sensor}).cameras["one"].texels == expected


_TURN_AROUND = """
import math
import sys
import numpy as np
from omni_core.sensors import LineSensor
from omni_sim.texture.texture import GroundTexture
from omni_sim.camera.camera import CameraConfiguration, LineCameraArray

texels = int(sys.argv[1])
gray = np.full((texels, texels), 100, np.uint8)
gray[::2] = 120
texture = GroundTexture(gray, texels * 0.0254 / 2400.0)
sensors = {
    "wide": LineSensor(x=0.0, y=0.0, heading_deg=0.0),
    "narrow": LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=335, width=0.0025),
}
seed = np.random.SeedSequence(1)
array = LineCameraArray(sensors, texture, CameraConfiguration(), seed)
poses = np.zeros((72, 3))
poses[:, 2] = np.linspace(0.0, 2.0 * math.pi, 72)
lines = array.render(dict.fromkeys(sensors, poses))
assert all(abs(float(line.mean()) - 110.0) < 1.0 for line in lines.values())
with open("/proc/self/status") as status:
    print(next(line for line in status if line.startswith("VmHWM:")).split()[1])
"""


def test_a_ground_of_2400_dpi_takes_less_than_a_gigabyte_at_every_heading() -> None:
    # Peak memory of a separate process, with the finest and the usual camera over 20 cm.
    texels = 18912
    peak = subprocess.run(
        [sys.executable, "-c", _TURN_AROUND, str(texels)],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ).stdout
    assert texels**2 < int(peak) * 1024 < 0.92e9


@pytest.mark.parametrize(
    ("changes", "field"),
    [({"length": 0.06}, "length"), ({"width": 0.06}, "width"), ({"width": 0.0004}, "width")],
)
def test_a_footprint_that_does_not_fit_the_ground_is_refused(
    changes: dict[str, float], field: str
) -> None:
    shape: dict[str, Any] = {"length": 0.05, "width": 0.02, **changes}
    sensor = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=64, **shape)
    with pytest.raises(ConfigurationError, match=rf"sensors\.odd\.{field}"):
        array(sensors={"odd": sensor})


def test_only_8_and_16_bits_are_accepted() -> None:
    with pytest.raises(ConfigurationError, match="bit_depth"):
        CameraConfiguration(bit_depth=12)


def test_the_shipped_placement_sees_every_motion() -> None:
    path_to = Path(__file__).parents[4] / "config" / "sensors" / "three_generic.yaml"
    mapping = yaml.safe_load(path_to.read_text(encoding="utf-8"))
    sensors = {name: from_mapping(LineSensor, entry) for name, entry in mapping.items()}
    assert len(sensors) == 3
    matrix = sensor_matrix(sensors)
    # Error of each component of the twist per error of a reading.
    gain = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    assert gain.max() < 2.0
    for sensor in sensors.values():
        assert abs(sensor.x) <= 0.8
        assert abs(sensor.y) <= 0.6
