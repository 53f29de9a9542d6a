"""Grounds from a user's own scan or photo.

A picture is used like the dissertation's scans (section 4.4): its pixels are texels of known size.
The user specifies the dots per inch on the ground, because files do not contain them reliably. The
largest square in the middle is converted to 8-bit gray levels (ITU-R 601). Along two edges, a strip
with about a sixteenth of the square's width is blended with the strip along the opposite edge. The
strip along the opposite edge is then cut off. The ground is therefore seamless when tiled.
"""

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from omni_core.configuration import ConfigurationError
from omni_sim.texture.configuration import BLOCK, FEWEST_TEXELS, INCH, MOST_TEXELS
from omni_sim.texture.texture import GroundTexture

_KEY = "picture"
_FORMATS = ("PNG", "TIFF", "JPEG", "BMP", "PPM", "WEBP")
_MOST_PIXELS = 1 << 29  # 58 cm square at 1000 dpi, 24 cm at 2400 dpi; in color 1.6 GB
_LEAST_SIZE = 0.02  # smallest edge length of the square [m]
_LEAST_CONTRAST = 0.3  # gray levels; standard deviation that rounding causes in a plain picture
# Exceptions that the decoders raise for damaged files.
_DAMAGE = (
    OSError, SyntaxError, ValueError, TypeError, EOFError, MemoryError, struct.error, zlib.error,
)  # fmt: skip


def read_picture(path: str, dpi: float) -> GroundTexture:
    """Read a picture and return the periodic ground that it shows.

    Args:
        path: PNG, TIFF, JPEG, BMP, PPM or WebP file, in gray or color, with 8 or 16 bits.
        dpi: dots per inch on the ground.

    Raises:
        ConfigurationError: the picture cannot be read, is too small or too large, or has no
            contrast.
    """
    gray, dot = _square(Path(path).expanduser(), INCH / dpi)
    period = (len(gray) * 15 // 16) // BLOCK * BLOCK
    _blend(gray, period)
    _blend(gray.T, period)
    gray = gray[:period, :period].copy()
    if float(np.std(gray[:: max(1, period // 1024)])) < _LEAST_CONTRAST:
        raise ConfigurationError(_KEY, f"{path} has a single gray level")
    return GroundTexture(gray, period * dot)


def _square(path: Path, dot: float) -> tuple[NDArray[np.uint8], float]:
    """Return the gray levels and texel size of the largest square in the middle of a picture.

    Args:
        path: file of the picture.
        dot: distance between two pixels of the picture on the ground [m].

    Returns:
        Gray levels, shape (n, n), and edge length of a texel [m]. If the picture has too many
        pixels, a texel is the mean of several pixels.
    """
    if not path.is_file():
        raise ConfigurationError(_KEY, f"there is no file {path}")
    limit = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None  # a scan of 20 cm at 2400 dpi exceeds the default limit
    try:
        with Image.open(path, formats=_FORMATS) as image:
            width, height = image.size
            _check_size(path, width, height, dot)
            gray = _gray(path, image)
    except ConfigurationError:
        raise
    except _DAMAGE as error:
        raise ConfigurationError(_KEY, f"cannot read {path}: {_one_line(error)}") from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    edge = min(gray.shape)
    top, left = (gray.shape[0] - edge) // 2, (gray.shape[1] - edge) // 2
    coarser = -(-edge // MOST_TEXELS)
    if coarser == 1:
        return gray[top : top + edge, left : left + edge].copy(), dot
    texels = edge // coarser
    square = np.empty((texels, texels), np.uint8)
    for row in range(texels):  # row by row, because all rows at once need much more memory
        first = top + row * coarser
        rows = gray[first : first + coarser, left : left + texels * coarser]
        square[row] = np.rint(rows.reshape(coarser, texels, coarser).mean(axis=(0, 2)))
    return square, dot * coarser


def _check_size(path: Path, width: int, height: int, dot: float) -> None:
    size = f"{path} has {width} x {height} px, {width * dot:.3g} x {height * dot:.3g} m"
    if width * height > _MOST_PIXELS:
        raise ConfigurationError(_KEY, f"{size}, more than {_MOST_PIXELS} px in all")
    edge = min(width, height)
    if edge < FEWEST_TEXELS or edge * dot < _LEAST_SIZE:
        remedy = "use a picture of a larger area"
        if edge >= FEWEST_TEXELS:
            remedy += f", or check dpi: {edge * INCH / _LEAST_SIZE:.0f} or fewer are needed"
        raise ConfigurationError(
            _KEY,
            f"{size}; both edges must have at least {FEWEST_TEXELS} px and {_LEAST_SIZE} m: "
            f"{remedy}",
        )


def _gray(path: Path, picture: Image.Image) -> NDArray[np.uint8]:
    """Return the picture as 8-bit gray levels, shape (height, width)."""
    if picture.mode.startswith("I"):  # 16 bits, which some files store as 32
        values = np.asarray(picture)
        if values.min() < 0 or values.max() > np.iinfo(np.uint16).max:
            raise ConfigurationError(_KEY, f"{path} has more than 16 bits")
        values = values.astype(np.uint16)
        # Computes v / 257, rounded, with 16 bits.
        gray: NDArray[np.uint8] = ((values - (values >> 8) + 128) >> 8).astype(np.uint8)
        return gray
    if picture.mode == "F":
        raise ConfigurationError(
            _KEY, f"{path} has floating-point gray levels; it must have 8 or 16 bits"
        )
    if picture.mode in {"P", "PA"}:
        picture = picture.convert("RGB")
    return np.asarray(picture.convert("L"), np.uint8)


def _blend(gray: NDArray[np.uint8], period: int) -> None:
    """Blend the columns from `period` on into the first columns, for a seamless texture."""
    overlap = gray.shape[1] - period
    share = ((np.arange(overlap) + 0.5) / overlap).astype(np.float32)
    after = gray[:, period:].astype(np.float32)
    gray[:, :overlap] = np.rint(after + share * (gray[:, :overlap] - after))


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
