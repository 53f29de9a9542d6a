"""A pixel is the mean of the ground over its rotated footprint, at any heading."""

from __future__ import annotations

import math

import numpy as np
import pytest
from exact_footprint import integrate_exactly
from numpy.typing import NDArray

from omni_sim.camera.footprint.integral import integrate_lines
from omni_sim.camera.footprint.padding import PaddedTexture
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.texture.texture import GroundTexture, generate_texture

SIZE = 0.05
TEXELS = 1024
LENGTH = 0.0125
WIDTH = 0.02
PIXELS = 256
HEADINGS_DEG = (
    0.0,
    0.05,
    1.0,
    20.0,
    44.9,
    45.0,
    45.1,
    90.0,
    133.0,
    180.0,
    200.0,
    260.0,
    300.0,
    -7.0,
)

CORK = generate_texture(TextureConfiguration(size=SIZE, texels=TEXELS))
PADDED = PaddedTexture.build(CORK, 0.05)


def line(
    x: float, y: float, heading: float, texture: PaddedTexture = PADDED
) -> NDArray[np.float64]:
    centers = np.array([[x, y, heading]])
    lines = integrate_lines(texture, centers, LENGTH, WIDTH, PIXELS)
    return np.asarray(lines[0], dtype=np.float64)


def rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
def test_lines_agree_with_the_exact_integral(heading_deg: float) -> None:
    heading = math.radians(heading_deg)
    for x, y in ((0.0123, 0.0456), (-0.3011, 0.0001)):
        exact = integrate_exactly(CORK.gray, SIZE, (x, y, heading), LENGTH, WIDTH, PIXELS)
        assert np.std(exact) > 3.0
        assert rms(line(x, y, heading) - exact) < 0.1


@pytest.mark.parametrize(
    ("length", "width", "pixels"), [(0.05, 0.0005, 1024), (0.04, 0.05, 77), (0.003, 0.002, 333)]
)
def test_footprints_of_any_shape_agree_with_the_exact_integral(
    length: float, width: float, pixels: int
) -> None:
    for heading in (0.0, 0.4, 2.3, -0.9):
        center = (0.02, 0.047, heading)
        got = integrate_lines(PADDED, np.array([center]), length, width, pixels)[0]
        exact = integrate_exactly(CORK.gray, SIZE, center, length, width, pixels)
        # Texels are misplaced by up to an eighth, which matters more if fewer are averaged.
        assert rms(got - exact) < 0.08 * max(1.0, 0.02 / width)


def test_the_exact_integral_agrees_with_dense_sampling() -> None:
    x, y, heading, pixels = 0.013, 0.031, 0.7, 8
    exact = integrate_exactly(CORK.gray, SIZE, (x, y, heading), 0.0004, 0.003, pixels)
    u = (np.arange(pixels * 200) + 0.5) / (pixels * 200) * 0.0004 - 0.0002
    v = (np.arange(2000) + 0.5) / 2000 * 0.003 - 0.0015
    p_x = x + u[:, None] * math.cos(heading) - v * math.sin(heading)
    p_y = y + u[:, None] * math.sin(heading) + v * math.cos(heading)
    column, row = (np.floor(p / CORK.texel).astype(int) % TEXELS for p in (p_x, p_y))
    sampled = CORK.gray[row, column].reshape(pixels, -1).mean(axis=1)
    np.testing.assert_allclose(exact, sampled, atol=0.02)


@pytest.mark.parametrize("gray", [0, 77, 128, 255])
def test_a_uniform_ground_gives_its_own_gray(gray: int) -> None:
    uniform = GroundTexture(np.full((256, 256), gray, np.uint8), SIZE)
    padded = PaddedTexture.build(uniform, LENGTH)
    centers = np.column_stack(
        (np.linspace(-1.0, 1.0, 91), np.linspace(0.3, -0.2, 91), np.linspace(0.0, 6.3, 91))
    )
    lines = integrate_lines(padded, centers, LENGTH, WIDTH, PIXELS)
    np.testing.assert_array_equal(lines, gray)


def test_the_sides_of_a_step_are_weighed_by_area() -> None:
    # Dark left half, bright right half: a pixel's gray is the share of its area that is bright.
    step = np.zeros((TEXELS, TEXELS), np.uint8)
    step[:, TEXELS // 2 :] = 200
    padded = PaddedTexture.build(GroundTexture(step, SIZE), 0.01)
    for heading_deg in HEADINGS_DEG:
        center = (0.5 * SIZE, 0.01, math.radians(heading_deg))
        got = integrate_lines(padded, np.array([center]), 0.01, 0.01, 64)[0]
        # A tenth of a texel of the 205 across, times the contrast of 200.
        assert got.mean() == pytest.approx(100.0, abs=0.1)
        exact = integrate_exactly(step, SIZE, center, 0.01, 0.01, 64)
        assert rms(got - exact) < 0.3


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
def test_a_wave_is_attenuated_by_the_sinc_of_both_sides(heading_deg: float) -> None:
    # Box integral of cos(k . p): cos at the center of the pixel times sinc x sinc.
    heading = math.radians(heading_deg)
    waves_x, waves_y = 2, 1
    place = (np.arange(TEXELS) + 0.5) / TEXELS
    phase = 2.0 * math.pi * (waves_x * place[None, :] + waves_y * place[:, None])
    wave = GroundTexture(np.rint(128.0 + 100.0 * np.cos(phase)).astype(np.uint8), SIZE)
    padded = PaddedTexture.build(wave, LENGTH)
    k = 2.0 * math.pi / SIZE * np.array([waves_x, waves_y])
    axis = np.array([math.cos(heading), math.sin(heading)])
    across = np.array([-axis[1], axis[0]])
    pitch, width = LENGTH / PIXELS, WIDTH
    u = (np.arange(PIXELS) + 0.5) * pitch - 0.5 * LENGTH
    center = np.array([0.011, 0.027])
    sinc = np.sinc(k @ axis * pitch / (2 * math.pi)) * np.sinc(k @ across * width / (2 * math.pi))
    expected = 128.0 + 100.0 * sinc * np.cos(k @ center + u * (k @ axis))
    got = integrate_lines(padded, np.array([[*center, heading]]), LENGTH, width, PIXELS)[0]
    assert rms(got - expected) < 0.1


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
def test_moving_by_one_pitch_shifts_the_line_by_one_pixel(heading_deg: float) -> None:
    heading = math.radians(heading_deg)
    pitch = LENGTH / PIXELS
    here = line(0.021, 0.008, heading)
    there = line(0.021 + pitch * math.cos(heading), 0.008 + pitch * math.sin(heading), heading)
    assert rms(there[:-1] - here[1:]) < 0.15
    assert rms(there - here) > 0.5  # the gray levels do change


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
def test_the_ground_repeats_after_its_period(heading_deg: float) -> None:
    heading = math.radians(heading_deg)
    here = line(0.012, 0.034, heading)
    for x, y in ((SIZE, 0.0), (0.0, SIZE), (-3 * SIZE, 5 * SIZE)):
        # Only the rounding of the position differs, less than the fixed point resolves usually.
        np.testing.assert_allclose(line(0.012 + x, 0.034 + y, heading), here, atol=0.1)
    np.testing.assert_allclose(line(0.012, 0.034, heading + 2 * math.pi), here, atol=0.1)


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
def test_half_a_turn_reverses_the_line(heading_deg: float) -> None:
    heading = math.radians(heading_deg)
    here = line(0.012, 0.034, heading)
    np.testing.assert_allclose(line(0.012, 0.034, heading + math.pi)[::-1], here, atol=0.1)


def test_every_heading_is_continuous() -> None:
    # No jump where the transposed texture is used or the order of the rows is reversed.
    for seam in np.arange(8) * math.pi / 4:
        before, behind = (line(0.02, 0.03, seam + sign * 1e-7) for sign in (-1.0, 1.0))
        assert rms(before - behind) < 0.1


def test_random_footprints_stay_inside_the_texture() -> None:
    generator = np.random.default_rng(3)
    small = generate_texture(TextureConfiguration(size=SIZE, texels=256))
    padded = PaddedTexture.build(small, SIZE)
    for _ in range(300):
        length, width = generator.uniform(0.002, SIZE, 2)
        center = (*generator.uniform(-1.0, 1.0, 2), generator.uniform(-7.0, 7.0))
        pixels = int(generator.integers(16, 300))
        got = integrate_lines(padded, np.array([center]), length, width, pixels)[0]
        assert small.gray.min() - 1.0 <= got.min() <= got.max() <= small.gray.max() + 1.0


def levels(texture: PaddedTexture) -> NDArray[np.int64]:
    padded = texture.rows.reshape(texture.texels, texture.stride)
    return padded[:, : texture.texels].astype(np.int64) + texture.middle


@pytest.mark.parametrize("texels", [512, 341, 256, 300])
def test_coarse_texels_are_the_means_of_their_areas(texels: int) -> None:
    # The integral over a coarse texel is a difference of the integral at its edges.
    fine = CORK.gray.astype(np.float64)
    edges = np.arange(texels + 1) * TEXELS / texels
    for axis in (0, 1):
        integral = np.insert(np.cumsum(fine, axis=axis), 0, 0.0, axis=axis)
        whole = np.minimum(edges.astype(int), TEXELS - 1)
        part = (edges - whole).reshape((-1, 1) if axis == 0 else (1, -1))
        before = np.take(integral, whole, axis=axis)
        at_edges = before + part * (np.take(integral, whole + 1, axis=axis) - before)
        fine = np.diff(at_edges, axis=axis) * texels / TEXELS
    coarse = levels(PaddedTexture.build(CORK, 0.05, texels))
    assert np.abs(coarse - fine).max() <= 0.5 + 1e-9
    assert coarse.mean() == pytest.approx(CORK.gray.mean(), abs=0.01)


@pytest.mark.parametrize("kind", ["asphalt", "wood"])
def test_coarse_texels_show_the_ground_as_it_is_in_full(kind: str) -> None:
    # Across the grain of wood, at 90 deg, a line is a bar code: nothing is averaged.
    ground = generate_texture(TextureConfiguration(kind=kind, size=SIZE, texels=TEXELS))
    coarse = PaddedTexture.build(ground, 0.05, TEXELS // 2)
    for heading_deg in (0.0, 20.0, 90.0, 133.0):
        centers = np.array([(x, 0.3 * x, math.radians(heading_deg)) for x in (0.011, 0.024, 0.03)])
        exact = [
            integrate_exactly(ground.gray, SIZE, tuple(center), 0.04, 0.0195, 102)
            for center in centers
        ]
        got = integrate_lines(coarse, centers, 0.04, 0.0195, 102)
        assert rms(np.asarray(got - exact, dtype=np.float64)) < 0.15


def test_wide_footprints_of_coarse_texels_do_not_overflow() -> None:
    half = np.zeros((2048, 2048), np.uint8)
    half[:, 1024:] = 255
    coarse = PaddedTexture.build(GroundTexture(half, SIZE), SIZE, 1500)
    centers = np.array([(0.25 * SIZE, 0.0, 0.0), (0.75 * SIZE, 0.01, 0.0)])
    black, white = integrate_lines(coarse, centers, 0.4 * SIZE, SIZE, 16)
    np.testing.assert_allclose(black, 0.0, atol=1e-3)
    np.testing.assert_allclose(white, 255.0, atol=1e-3)


def test_the_turned_texture_is_the_transposed_one_and_both_go_on_periodically() -> None:
    for texels in (TEXELS, 300):
        texture = PaddedTexture.build(CORK, 0.05, texels)
        rows = texture.rows.reshape(texels, texture.stride)
        columns = texture.columns.reshape(texels, texture.stride)
        wrapped = np.arange(texture.stride) % texels
        np.testing.assert_array_equal(rows, rows[:, wrapped])
        np.testing.assert_array_equal(columns, rows[:, :texels].T[:, wrapped])


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_poses_that_are_no_numbers_are_refused(value: float) -> None:
    for place in range(3):
        center = np.zeros((1, 3))
        center[0, place] = value
        with pytest.raises(ValueError, match="finite"):
            integrate_lines(PADDED, center, LENGTH, WIDTH, PIXELS)


def test_footprints_that_do_not_suit_the_texture_are_refused() -> None:
    with pytest.raises(ValueError, match="longer"):
        integrate_lines(PADDED, np.zeros((1, 3)), 0.06, WIDTH, PIXELS)
    with pytest.raises(ValueError, match="narrower"):
        integrate_lines(PADDED, np.zeros((1, 3)), LENGTH, 0.0004, PIXELS)
