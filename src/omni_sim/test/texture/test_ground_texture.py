"""Grounds are seamless, reproducible, of physical size, and unchanged by the cache."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from omni_core.configuration import ConfigurationError, from_mapping
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import KINDS, TextureConfiguration
from omni_sim.texture.materials import MATERIALS
from omni_sim.texture.texture import GroundTexture, generate_texture

SIZE = 0.05


def ground(kind: str, texels: int = 1024, seed: int = 1) -> NDArray[np.float64]:
    configuration = TextureConfiguration(kind=kind, size=SIZE, texels=texels, seed=seed)
    return generate_texture(configuration).gray.astype(np.float64)


def test_every_declared_kind_can_be_painted() -> None:
    assert set(KINDS) == set(MATERIALS)


@pytest.mark.parametrize("kind", KINDS)
def test_the_seam_is_like_any_other_line(kind: str) -> None:
    gray = ground(kind)
    for axis in (0, 1):
        steps = np.abs(np.diff(gray, axis=axis, append=gray.take([0], axis=axis)))
        by_line = steps.mean(axis=1 - axis)
        assert by_line[-1] < by_line.mean() + 5.0 * by_line.std()


@pytest.mark.parametrize("kind", KINDS)
def test_texels_are_resolution_only(kind: str) -> None:
    fine, coarse = ground(kind, 1024), ground(kind, 512)
    mean = fine.reshape(512, 2, 512, 2).mean(axis=(1, 3))
    assert np.corrcoef(mean.ravel(), coarse.ravel())[0, 1] > 0.97


@pytest.mark.parametrize("kind", KINDS)
def test_the_seed_decides_everything(kind: str) -> None:
    first, again, other = ground(kind), ground(kind), ground(kind, seed=2)
    np.testing.assert_array_equal(first, again)
    # The positions of studs do not depend on the seed; plastic has few mottles in 5 cm.
    laid = {"walking_tile": 0.95, "brick": 0.9, "planks": 0.6, "carpet": 0.8, "slabs": 0.99}
    laid |= {"tile": 0.99}
    limit = {"plastic": 0.6, **laid}.get(kind, 0.3)
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < limit


@pytest.mark.parametrize("kind", KINDS)
def test_contrast_uses_the_range_without_clipping(kind: str) -> None:
    gray = ground(kind)
    dark = {"grass": 90.0, "bark": 70.0, "carpet": 70.0, "wet_asphalt": 25.0}
    assert dark.get(kind, 100.0) < gray.mean() < {"tile": 185.0, "slabs": 215.0}.get(kind, 160.0)
    faint = kind in {"plastic", "metal", "sealed_concrete", "epoxy"}
    least = {"worn_asphalt": 10.0, "concrete": 13.0}.get(kind, 15.0)
    assert 1.0 < gray.std() < 6.0 if faint else gray.std() > least
    clipped = {"dry_earth": 0.01, "bark": 0.01, "wet_asphalt": 0.02, "flake_epoxy": 0.01}
    assert np.mean((gray == 0.0) | (gray == 255.0)) < clipped.get(kind, 1e-3)


@pytest.mark.parametrize("kind", ["cork", "asphalt", "stone"])
def test_standard_grounds_stay_what_they_were(kind: str) -> None:
    # Recordings and figures of all versions depend on them.
    gray = ground(kind).astype(np.uint8)
    digest = {"cork": 0x965032A8, "asphalt": 0xC6AFA54F, "stone": 0x3CDC908C}
    assert zlib.crc32(gray.data) == digest[kind]


def test_wood_is_a_bar_code() -> None:
    # For a camera 20 mm wide, the grain along x has no contrast along x.
    gray = ground("wood")
    wide = 1024 * 20 // 50
    across_grain, along_grain = gray[:, :wide].mean(axis=1), gray[:wide].mean(axis=0)
    assert across_grain.std() > 8.0
    assert np.diff(along_grain).std() < 0.03 * np.diff(across_grain).std()


def test_a_walking_tile_repeats_every_20_mm() -> None:
    gray = generate_texture(TextureConfiguration(kind="walking_tile", size=0.1, texels=1000)).gray
    row = gray - gray.mean(axis=1, keepdims=True)
    shifted = [float(np.mean(row * np.roll(row, shift, axis=1))) for shift in (0, 100, 200)]
    assert shifted[2] > 0.5 * shifted[0]
    assert shifted[1] < 0.0


def test_edges_of_a_walking_tile_are_lit_from_the_upper_left() -> None:
    gray = generate_texture(TextureConfiguration(kind="walking_tile", size=0.1, texels=1000)).gray
    for axis in (0, 1):
        profile = gray.mean(axis=1 - axis).reshape(-1, 200).mean(axis=0)
        assert profile[:100].max() > profile[50:100].mean() + 3.0
        assert profile[100:].min() < profile[:10].mean() - 3.0


@pytest.mark.parametrize("kind", KINDS)
def test_dots_per_inch_take_the_place_of_texels(kind: str) -> None:
    configuration = TextureConfiguration(kind=kind, size=SIZE, dpi=300.0)
    texture = generate_texture(configuration)
    assert texture.texel == pytest.approx(0.0254 / 300.0, rel=1e-12)
    assert SIZE <= texture.size < SIZE + 32 * texture.texel


def test_the_resolution_of_the_dissertation_fits() -> None:
    texels, size = TextureConfiguration(dpi=2400.0).extent
    assert texels >= 18896
    assert size == pytest.approx(texels * 0.0254 / 2400.0)
    with pytest.raises(ConfigurationError, match="dpi"):
        TextureConfiguration(dpi=4800.0)


def test_structure_grows_from_cork_to_stone() -> None:
    def correlation_length(gray: NDArray[np.float64]) -> int:
        spectrum = np.abs(np.fft.fft2(gray - gray.mean())) ** 2
        along_x = np.fft.ifft2(spectrum).real[0]
        return int(np.argmax(along_x < 0.5 * along_x[0]))

    assert correlation_length(ground("stone")) > 1.5 * correlation_length(ground("cork"))


def test_shipped_grounds_are_valid() -> None:
    folder = Path(__file__).parents[4] / "config" / "grounds"
    kinds = set()
    for path in folder.glob("*.yaml"):
        mapping = yaml.safe_load(path.read_text(encoding="utf-8"))
        kinds.add(from_mapping(TextureConfiguration, mapping["texture"]).kind)
    assert kinds >= set(KINDS)


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="kind"):
        TextureConfiguration(kind="lawn")


def test_a_texture_must_be_square_and_8_bit() -> None:
    with pytest.raises(ValueError, match="square"):
        GroundTexture(np.zeros((4, 5), np.uint8), SIZE)
    with pytest.raises(ValueError, match="uint8"):
        GroundTexture(np.zeros((4, 4), np.uint16), SIZE)


CONFIGURATION = TextureConfiguration(size=SIZE, texels=256)


def refuse(_: TextureConfiguration) -> GroundTexture:
    raise AssertionError("the texture should have come from the cache")


def test_a_cached_texture_is_not_generated_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = TextureCache(tmp_path / "new").texture(CONFIGURATION)
    monkeypatch.setattr("omni_sim.texture.texture.generate_texture", refuse)
    read = TextureCache(tmp_path / "new").texture(CONFIGURATION)
    np.testing.assert_array_equal(read.gray, made.gray)
    assert read.size == SIZE
    with pytest.raises(AssertionError):
        TextureCache(tmp_path / "new").texture(TextureConfiguration(size=SIZE, texels=256, seed=2))


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "text", "other"])
def test_a_damaged_file_is_replaced(tmp_path: Path, damage: str) -> None:
    cache = TextureCache(tmp_path)
    made = cache.texture(CONFIGURATION)
    path = cache.path(CONFIGURATION)
    sound = path.read_bytes()
    flipped = bytearray(sound)
    flipped[len(sound) // 2] ^= 1
    other = TextureConfiguration(size=SIZE, texels=512)
    cache.texture(other)
    damaged = {
        "cut": sound[: len(sound) // 2],
        "flipped": bytes(flipped),
        "empty": b"",
        "text": b"not a texture",
        "other": cache.path(other).read_bytes(),  # sound, but of another shape
    }
    path.write_bytes(damaged[damage])
    np.testing.assert_array_equal(cache.texture(CONFIGURATION).gray, made.gray)
    assert path.read_bytes() == sound
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        cache.path(c).name for c in (CONFIGURATION, other)
    )


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way", encoding="utf-8")
    texture = TextureCache(blocked / "below").texture(CONFIGURATION)
    np.testing.assert_array_equal(texture.gray, generate_texture(CONFIGURATION).gray)
