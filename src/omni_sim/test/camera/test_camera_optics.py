"""Motion blur, magnification, shading, dirt and noise agree with optics and statistics."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from exact_footprint import integrate_exactly
from numpy.typing import NDArray

from omni_core.configuration import ConfigurationError, from_mapping
from omni_core.sensors import LineSensor
from omni_sim.camera.camera import LineCamera, LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.texture.texture import GroundTexture, generate_texture

SIZE = 0.05
CORK = generate_texture(TextureConfiguration(size=SIZE, texels=1024))
UNIFORM = GroundTexture(np.full((256, 256), 200, np.uint8), SIZE)
SENSOR = LineSensor(x=0.2, y=-0.1, heading_deg=30.0, pixels=100, length=0.01, width=0.004)
POSE = np.array([[0.3, 0.1, 0.4]])
PRESETS = Path(__file__).parents[4] / "config" / "sensors"


def camera(
    texture: GroundTexture = CORK, sensor: LineSensor = SENSOR, name: str = "one", **values: Any
) -> LineCamera:
    configuration = from_mapping(CameraConfiguration, values)
    seed = np.random.SeedSequence(1)
    return LineCameraArray({name: sensor}, texture, configuration, seed).cameras[name]


def exact(sharp: LineCamera, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = sharp.footprints(pose[np.newaxis])[0]
    place = (float(x), float(y), float(heading))
    return integrate_exactly(CORK.gray, SIZE, place, SENSOR.length, SENSOR.width, SENSOR.pixels)


@pytest.mark.parametrize(
    ("velocity", "exposure_time"),
    [((2.0, 0.5, 0.0), 2e-4), ((0.3, -4.0, 0.0), 2e-4), ((0.0, 0.0, 9.0), 3e-4)],
    ids=["along", "across", "turning"],
)
def test_a_moving_line_is_the_mean_over_its_exposure(
    velocity: tuple[float, float, float], exposure_time: float
) -> None:
    blurred = camera(exposure_time=exposure_time)
    rates = np.array([velocity])
    grays = blurred.grays(POSE, rates)[0]
    times = ((np.arange(120) + 0.5) / 120 - 0.5) * exposure_time
    mean = np.mean([exact(blurred, POSE[0] + t * rates[0]) for t in times], axis=0)
    sharp = camera().grays(POSE)[0]
    assert np.sqrt(np.mean((grays - mean) ** 2)) < 0.25
    assert np.sqrt(np.mean((sharp - mean) ** 2)) > 1.0


def test_blurred_lines_do_not_depend_on_batches() -> None:
    poses = np.repeat(POSE, 9, axis=0)
    rates = np.linspace(0.0, 8.0, 9)[:, np.newaxis] * np.array([[0.8, -0.5, 1.0]])
    blurred = camera(exposure_time=1e-4)
    whole = blurred.lines(poses, 0, rates)
    parts = [blurred.lines(poses[i : i + 1], i, rates[i : i + 1]) for i in range(9)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(whole[:1], camera().lines(POSE, 0))  # standing still


@pytest.mark.parametrize(("height_error", "scale"), [(0.02, 1.2), (-0.01, 0.9)])
def test_an_ordinary_lens_magnifies_with_its_height(height_error: float, scale: float) -> None:
    wider = dataclasses.replace(SENSOR, length=scale * SENSOR.length, width=scale * SENSOR.width)
    optics: dict[str, Any] = {"height_error": height_error, "working_distance": 0.1}
    ordinary = camera(lens="ordinary", **optics).grays(POSE)
    np.testing.assert_allclose(ordinary, camera(sensor=wider).grays(POSE), atol=0.05)
    telecentric = camera(lens="telecentric", **optics).grays(POSE)
    np.testing.assert_array_equal(telecentric, camera().grays(POSE))


def test_shading_falls_to_both_ends() -> None:
    grays = camera(UNIFORM, shading=0.3).grays(POSE)[0]
    place = np.linspace(-0.99, 0.99, 100)
    np.testing.assert_allclose(grays, 200.0 * (1.0 - 0.3 * place**2), rtol=1e-5)


def test_dirt_stays_where_it_is_and_is_every_sensors_own() -> None:
    dirty: dict[str, Any] = {"dirt_spots": 3, "dirt_size": 0.0005, "dirt_opacity": 0.6}
    places = np.concatenate((POSE, POSE + 0.2))
    one = camera(UNIFORM, **dirty).grays(places)
    other = camera(UNIFORM, name="two", **dirty).grays(POSE)[0]
    np.testing.assert_allclose(one[0], one[1], rtol=1e-5)
    assert not np.allclose(one[0], other)
    for grays in (one[0], other):
        assert grays.max() == pytest.approx(200.0)
        assert 0.39**3 * 200.0 < grays.min() < 0.6 * 200.0
        # Each shadow is as wide as 2.5 to 7.5 pixels.
        assert 3 <= np.count_nonzero(grays < 199.9) <= 3 * 9


@pytest.mark.parametrize("decibel", [34.15, 48.13])
def test_the_signal_to_noise_ratio_is_that_of_the_full_scale(decibel: float) -> None:
    noisy = camera(UNIFORM, signal_to_noise_db=decibel, noise=9.0, bit_depth=16)
    lines = noisy.lines(np.repeat(POSE, 400, axis=0), 0) / 257.0
    measured = 20.0 * math.log10(255.0 / float(np.std(lines)))
    assert measured == pytest.approx(decibel, abs=0.1)


def test_impossible_optics_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="exposure_time"):
        camera(exposure_time=1.01 / SENSOR.line_rate)
    with pytest.raises(ConfigurationError, match="height_error"):
        CameraConfiguration(lens="ordinary", height_error=-0.1, working_distance=0.1)
    with pytest.raises(ConfigurationError, match="length"):
        camera(lens="ordinary", height_error=0.9, working_distance=0.1, sensor=WIDE)


WIDE = dataclasses.replace(SENSOR, length=0.04)


@pytest.mark.parametrize(
    ("name", "pixels", "shape_factor", "line_rate"),
    [
        ("lis_770i", 335, 0.3125 / 6.006, 2985.0),
        ("s3901", 128, 2.5 / 6.4, 15600.0),
        ("generic", 1024, 0.4, 2500.0),
    ],
)
def test_presets_are_those_of_table_3(
    name: str, pixels: int, shape_factor: float, line_rate: float
) -> None:
    mapping = yaml.safe_load((PRESETS / f"{name}.yaml").read_text(encoding="utf-8"))
    sensors = [from_mapping(LineSensor, entry) for entry in mapping.values()]
    assert len(sensors) == 3
    for sensor in sensors:
        assert (sensor.pixels, sensor.line_rate, sensor.length) == (pixels, line_rate, 0.05)
        assert sensor.width / sensor.length == pytest.approx(shape_factor, abs=0.0025)


@pytest.mark.parametrize("blur_px", [0.3, 1.0, 4.0])
@pytest.mark.parametrize("period_px", [6.0, 16.0])
def test_defocus_has_the_transfer_function_of_a_gaussian(blur_px: float, period_px: float) -> None:
    """A sine of the wavelength L loses contrast by exp(-2 (pi s / L)^2), besides the pixel's sinc.

    The telecentric view keeps its length: the phase of the sine does not change at either end.
    """
    sensor = dataclasses.replace(SENSOR, x=0.0, y=0.0, heading_deg=0.0, pixels=200, length=0.025)
    period = period_px * sensor.pixel_pitch
    waves = round(SIZE / period)
    assert waves * period == pytest.approx(SIZE, rel=0.05)
    columns = 128.0 + 100.0 * np.sin(2.0 * np.pi * waves * np.arange(4096) / 4096)
    sine = GroundTexture(np.tile(np.rint(columns).astype(np.uint8), (4096, 1)), SIZE)
    aperture, height = 0.2, blur_px * sensor.pixel_pitch / 0.1
    sharp, blurred = (
        camera(sine, sensor, numerical_aperture=aperture, height_error=error).grays(
            np.zeros((1, 3))
        )
        for error in (0.0, height)
    )
    expected = math.exp(-2.0 * (math.pi * blur_px * sensor.pixel_pitch * waves / SIZE) ** 2)
    assert np.ptp(sharp) > 150.0
    np.testing.assert_allclose(blurred - 128.0, expected * (sharp - 128.0), atol=0.6)


def test_a_lens_in_focus_or_without_aperture_renders_the_same_bits() -> None:
    changes: tuple[dict[str, Any], ...] = ({"numerical_aperture": 0.1}, {"height_error": 0.01})
    for values in changes:
        np.testing.assert_array_equal(camera(**values).grays(POSE), camera().grays(POSE))
