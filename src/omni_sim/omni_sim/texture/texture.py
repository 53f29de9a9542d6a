"""Grounds: periodic gray-level pictures of known size.

A ground is either a procedural material (`materials`), which is seamless when tiled and has any
resolution, or the user's own scan or photo (`picture`).
"""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_sim.texture.materials import MATERIALS, Brush

KINDS = tuple(MATERIALS)
PICTURE = "picture"

GENERATION = 1
"""Version of the materials, part of a cached texture's name; to be increased whenever a material
is changed."""

INCH = 0.0254
"""Length of an inch [m]."""

BLOCK = 32
"""If the number of texels per period follows from dpi, it is a multiple of this number. Blocks of
texels can then be merged into coarser texels."""

MOST_TEXELS = 20480
"""Limit on the number of texels per period, which limits the memory."""

FEWEST_TEXELS = 256
"""Minimum number of texels per period."""

_BAND = 128  # number of rows drawn at a time
_THREADS = 2


class TextureConfiguration(Configuration):
    """Texture of the ground: a material, or a user's picture."""

    kind: str = parameter("cork", choices=(*KINDS, PICTURE))
    """Kind of ground"""
    size: float = parameter(0.2, unit="m", minimum=0.05, maximum=1.0)
    """Period of a material's texture in x and y; a picture determines its own period"""
    texels: int = parameter(4096, unit="1", minimum=256, maximum=8192)
    """Number of texels per period of a material, in x and y"""
    seed: int = parameter(1, minimum=0)
    """Seed of a material's pattern"""
    picture: str = parameter("")
    """File of the ground if `kind` is `picture`: PNG, TIFF or JPEG"""
    dpi: float = parameter(0.0, minimum=0.0, maximum=50000.0)
    """Dots per inch on the ground. Required for a picture. For a material, 0 means that `texels`
    sets the resolution; a larger value replaces `texels`, and the period is rounded up to a
    multiple of 32 dots"""

    def check_consistency(self) -> None:
        """Check that the options of a picture are complete and that the texels are not too many.

        Raises:
            ConfigurationError: a value is invalid; the message names the parameter.
        """
        if self.kind != PICTURE:
            if self.picture:
                raise ConfigurationError(
                    "picture", f"is only valid for the kind {PICTURE}, not {self.kind}"
                )
            if self.dpi > 0.0 and not FEWEST_TEXELS <= self.extent[0] <= MOST_TEXELS:
                raise ConfigurationError(
                    "dpi",
                    f"{self.dpi:g} dpi give {self.extent[0]} texels over {self.size:g} m, not "
                    f"{FEWEST_TEXELS} to {MOST_TEXELS}",
                )
        elif not self.picture:
            raise ConfigurationError("picture", f"the kind {PICTURE} needs the name of a file")
        elif self.dpi <= 0.0:
            raise ConfigurationError(
                "dpi", "a picture needs its dots per inch on the ground, such as 2400 for a scan"
            )

    @property
    def extent(self) -> tuple[int, float]:
        """Number of texels per period of a material, and the period [m]."""
        if self.dpi == 0.0:
            return self.texels, self.size
        texel = INCH / self.dpi
        # An excess of less than a hundredth of a texel is a rounding error.
        texels = math.ceil((self.size / texel - 0.01) / BLOCK) * BLOCK
        return texels, texels * texel


@dataclasses.dataclass(frozen=True, eq=False)
class GroundTexture:
    """A periodic ground, seen from above.

    Attributes:
        gray: 8-bit gray levels, shape (n, n), with row index along y and column index along x; the
            corner of texel (0, 0) is at the origin of the world.
        size: period along x and y [m].
    """

    gray: NDArray[np.uint8]
    size: float

    def __post_init__(self) -> None:
        shape, kind = self.gray.shape, self.gray.dtype
        if len(shape) != 2 or shape[0] != shape[1] or shape[0] == 0 or kind != np.uint8:
            raise ValueError(f"a texture is square and uint8, not {kind} of shape {shape}")
        if not (math.isfinite(self.size) and self.size > 0.0):
            raise ValueError(f"the period of a texture must be above 0 m, not {self.size}")

    @property
    def texel(self) -> float:
        """Edge length of a texel [m]."""
        return self.size / len(self.gray)


def generate_texture(configuration: TextureConfiguration) -> GroundTexture:
    """Return the texture of the material that a configuration describes.

    Raises:
        ValueError: the configuration names a picture.
    """
    if configuration.kind == PICTURE:
        raise ValueError("the kind picture has no generator")
    generator = np.random.default_rng(np.random.SeedSequence(configuration.seed))
    texels, size = configuration.extent
    layers = MATERIALS[configuration.kind](Brush(size, generator))
    gray = np.empty((texels, texels), np.uint8)

    def draw(first: int) -> None:
        rows = gray[first : first + _BAND]
        band = np.empty(rows.shape, np.float32)
        for layer in layers:
            layer.draw(band, first)
        np.rint(band, out=band)
        np.clip(band, 0.0, 255.0, out=band)
        rows[:] = band

    with ThreadPoolExecutor(_THREADS, "texture") as pool:
        list(pool.map(draw, range(0, texels, _BAND)))
    return GroundTexture(gray, size)
