"""Grounds: periodic gray-level pictures of known size.

A ground is either a procedural material (`materials`), which is seamless when tiled and has any
resolution, or the user's own scan or photo (`picture`).
"""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from omni_sim.texture.configuration import (
    KINDS,  # noqa: F401 - earlier names
    PICTURE,
    TextureConfiguration,
)

GENERATION = 1
"""Version of the materials, part of a cached texture's name; to be increased whenever a material
is changed."""


_BAND = 128  # number of rows drawn at a time
_THREADS = 2


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
    from omni_sim.texture.materials import MATERIALS, Brush  # needs kernels, as no other use does

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
