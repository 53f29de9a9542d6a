"""Grounds: periodic grey-level pictures of known physical size.

Eight procedural materials (`ground_materials`), all seamless when tiled, at any resolution, and
the user's own scan or photo (`ground_picture`).
"""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from omni_platform.configuration import Configuration, ConfigurationError, parameter
from omni_sim.ground_materials import MATERIALS

KINDS = tuple(MATERIALS)
PICTURE = "picture"

GENERATION = 1
"""Version of the procedures, part of a cached texture's identity: raise it with every change."""

_BAND = 128  # rows drawn at a time
_THREADS = 2


@dataclasses.dataclass(frozen=True, kw_only=True)
class TextureConfiguration(Configuration):
    """Look of the ground: a material, or a picture of the user's."""

    kind: str = parameter("cork", description="Kind of ground", choices=(*KINDS, PICTURE))
    size: float = parameter(
        0.2,
        description="Period of a material's texture in x and y; a picture has its own",
        unit="m",
        minimum=0.05,
        maximum=1.0,
    )
    texels: int = parameter(
        4096,
        description="Texels per period in x and y of a material; 18912 on 0.200152 m are 2400 dpi",
        unit="1",
        minimum=256,
        maximum=20480,
    )
    seed: int = parameter(1, description="Seed of a material's pattern", minimum=0)
    picture: str = parameter("", description="File of the kind picture, PNG, TIFF or JPEG")
    dpi: float = parameter(
        0.0,
        description="Dots per inch of the picture on the ground; required with a picture",
        minimum=0.0,
        maximum=50000.0,
    )

    def check_consistency(self) -> None:
        """Refuse a picture without its scale, and a picture that would not be looked at.

        Raises:
            ConfigurationError: names the key.
        """
        if self.kind != PICTURE:
            for name in ("picture", "dpi"):
                if getattr(self, name):
                    raise ConfigurationError(name, f"goes with the kind {PICTURE}, not {self.kind}")
        elif not self.picture:
            raise ConfigurationError("picture", f"the kind {PICTURE} needs the name of a file")
        elif self.dpi <= 0.0:
            raise ConfigurationError(
                "dpi", "a picture needs its dots per inch on the ground, such as 2400 of a scan"
            )


@dataclasses.dataclass(frozen=True, eq=False)
class GroundTexture:
    """A periodic ground, seen from above.

    Attributes:
        grey: 8-bit grey levels, shape (n, n): row index along y, column index along x; texel
            (0, 0) has its corner at the origin of the world.
        size: period along x and y [m].
    """

    grey: NDArray[np.uint8]
    size: float

    def __post_init__(self) -> None:
        shape, kind = self.grey.shape, self.grey.dtype
        if len(shape) != 2 or shape[0] != shape[1] or shape[0] == 0 or kind != np.uint8:
            raise ValueError(f"a texture is square and uint8, not {kind} of shape {shape}")
        if not (math.isfinite(self.size) and self.size > 0.0):
            raise ValueError(f"the period of a texture must be above 0 m, not {self.size}")

    @property
    def texel(self) -> float:
        """Edge of a texel [m]."""
        return self.size / len(self.grey)


def generate_texture(configuration: TextureConfiguration) -> GroundTexture:
    """Return the material that a configuration describes.

    Raises:
        ValueError: the configuration is that of a picture.
    """
    if configuration.kind == PICTURE:
        raise ValueError("a picture is read, not generated")
    generator = np.random.default_rng(np.random.SeedSequence(configuration.seed))
    layers = MATERIALS[configuration.kind](configuration.size, generator)
    texels = configuration.texels
    grey = np.empty((texels, texels), np.uint8)

    def draw(first: int) -> None:
        rows = grey[first : first + _BAND]
        band = np.empty(rows.shape, np.float32)
        for layer in layers:
            layer.draw(band, first)
        np.rint(band, out=band)
        np.clip(band, 0.0, 255.0, out=band)
        rows[:] = band

    with ThreadPoolExecutor(_THREADS, "texture") as pool:
        list(pool.map(draw, range(0, texels, _BAND)))
    return GroundTexture(grey, configuration.size)
