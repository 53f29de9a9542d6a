"""A user's scan becomes a seamless ground of the right size, or is rejected with the reason."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from omni_core.configuration import ConfigurationError
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import PICTURE, TextureConfiguration
from omni_sim.texture.picture import read_picture
from omni_sim.texture.texture import generate_texture

DPI = 520.0
CORK = generate_texture(TextureConfiguration(size=0.05, texels=1024)).gray[:700, :900].copy()
COLOR = np.dstack([CORK, CORK, CORK])
DEEP = CORK.astype(np.uint16) * 257


def chunk(kind: bytes, content: bytes) -> bytes:
    crc = struct.pack(">I", zlib.crc32(kind + content))
    return struct.pack(">I", len(content)) + kind + content + crc


def deep_color_png(path: Path) -> None:
    """Write 16-bit color, which Pillow reads but does not write."""
    rows = (COLOR.astype(np.uint16) * 257).astype(">u2")
    content = b"".join(b"\0" + row.tobytes() for row in rows)
    header = struct.pack(">IIBBBBB", CORK.shape[1], CORK.shape[0], 16, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(content, 1)), (b"IEND", b""))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts))


def write(path: Path, pixels: NDArray[np.generic]) -> str:
    Image.fromarray(pixels).save(path)
    return str(path)


@pytest.mark.parametrize("pixels", [CORK, DEEP, COLOR], ids=["gray", "16 bit", "color"])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_every_kind_of_file_shows_the_same_ground(
    tmp_path: Path, pixels: NDArray[np.generic], suffix: str
) -> None:
    texture = read_picture(write(tmp_path / f"scan{suffix}", pixels), DPI)
    period = len(texture.gray)
    assert texture.texel == pytest.approx(0.0254 / DPI)
    assert 0.9 * 700 < period < 700
    # Beyond the blended strips it is the square from the middle, texel for texel.
    np.testing.assert_array_equal(texture.gray[60:, 60:], CORK[60:period, 100 + 60 : 100 + period])


def test_16_bit_color_is_read(tmp_path: Path) -> None:
    deep_color_png(tmp_path / "deep.png")
    plain = read_picture(write(tmp_path / "plain.png", CORK), DPI)
    deep = read_picture(str(tmp_path / "deep.png"), DPI)
    np.testing.assert_array_equal(deep.gray, plain.gray)


def test_the_seam_is_like_any_other_line(tmp_path: Path) -> None:
    gray = read_picture(write(tmp_path / "scan.png", CORK), DPI).gray.astype(np.float64)
    for axis in (0, 1):
        steps = np.abs(np.diff(gray, axis=axis, append=gray.take([0], axis=axis)))
        by_line = steps.mean(axis=1 - axis)
        assert by_line[-1] < by_line.mean() + 5.0 * by_line.std()


def test_a_picture_comes_through_the_cache(tmp_path: Path) -> None:
    path = write(tmp_path / "scan.png", CORK)
    configuration = TextureConfiguration(kind=PICTURE, picture=path, dpi=DPI)
    texture = TextureCache(tmp_path / "cache").texture(configuration)
    np.testing.assert_array_equal(texture.gray, read_picture(path, DPI).gray)
    with pytest.raises(ValueError, match="no generator"):
        generate_texture(configuration)


def damaged(folder: Path, kind: str) -> str:
    path = folder / f"{kind}.png"
    if kind == "none":
        return str(path)
    pixels = {"small": CORK[:200], "plain": np.full_like(CORK, 9)}.get(kind, CORK)
    write(path, pixels)
    sound = path.read_bytes()
    path.write_bytes({"cut": sound[: len(sound) // 2], "text": b"hello"}.get(kind, sound))
    return str(path)


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("none", "no file"),
        ("cut", "cannot read"),
        ("text", "cannot read"),
        ("small", "at least 256 px"),
        ("plain", "single gray level"),
    ],
)
def test_what_is_no_ground_is_refused_with_the_reason(
    tmp_path: Path, kind: str, reason: str
) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        read_picture(damaged(tmp_path, kind), DPI)


def test_many_pixels_on_little_ground_are_too_small(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"0\.00741 m"):
        read_picture(write(tmp_path / "scan.png", CORK), 2400.0)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"kind": PICTURE, "dpi": 600.0}, "picture"),
        ({"kind": PICTURE, "picture": "scan.png"}, "dpi"),
        ({"kind": "cork", "picture": "scan.png"}, "picture"),
    ],
)
def test_a_picture_and_its_scale_go_together(values: dict[str, object], key: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        TextureConfiguration(**values)  # type: ignore[arg-type]
    assert error.value.key == key
