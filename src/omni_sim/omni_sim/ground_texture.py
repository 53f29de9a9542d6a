"""Procedural grounds: periodic grey-level pictures with structure of known physical size.

Three of the dissertation's grounds (Figures 59 and 67), all seamless when tiled: `cork`, granules
of 2 mm; `stone`, coarse flat pieces of 12 mm with mineral grain; `asphalt`, chippings of 0.6 to
6 mm in dark binder. Sizes are in metres, so the number of texels is only the resolution at which
the same ground is looked at. Everything follows from the seed.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from omni_platform.configuration import Configuration, parameter
from omni_sim.texture_patterns import add_noise, dead_leaves, voronoi

KINDS = ("cork", "asphalt", "stone")

GENERATION = 1
"""Version of the procedures, part of a cached texture's identity: raise it with every change."""

_ASPHALT_COVERAGE = 3.0  # times that the chippings would cover the ground: 5 % binder is left


@dataclasses.dataclass(frozen=True, kw_only=True)
class TextureConfiguration(Configuration):
    """Look of the ground."""

    kind: str = parameter("cork", description="Kind of ground", choices=KINDS)
    size: float = parameter(
        0.2, description="Period of the texture in x and y", unit="m", minimum=0.05, maximum=1.0
    )
    texels: int = parameter(
        4096, description="Texels per period in x and y", unit="1", minimum=256, maximum=8192
    )
    seed: int = parameter(1, description="Seed of the pattern", minimum=0)


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
    """Return the ground that a configuration describes."""
    generator = np.random.default_rng(np.random.SeedSequence(configuration.seed))
    picture = _PROCEDURES[configuration.kind](configuration.texels, configuration.size, generator)
    np.rint(picture, out=picture)
    np.clip(picture, 0.0, 255.0, out=picture)
    return GroundTexture(picture.astype(np.uint8), configuration.size)


def _cork(texels: int, size: float, generator: np.random.Generator) -> NDArray[np.float32]:
    cells = _per_period(size, 0.002)
    grey = generator.normal(138.0, 26.0, (cells, cells)).clip(60.0, 210.0)
    picture = voronoi(
        texels,
        _jittered(generator, cells),
        grey.astype(np.float32),
        border_grey=70.0,
        border=0.00012 * cells / size,
        warp=np.zeros((2, 1, 1), np.float32),
    )
    _add_octaves(picture, size, generator, ((0.0008, 12.0), (0.00035, 11.0), (0.00018, 8.0)))
    return picture


def _stone(texels: int, size: float, generator: np.random.Generator) -> NDArray[np.float32]:
    cells = _per_period(size, 0.012)
    grey = generator.normal(132.0, 22.0, (cells, cells)).clip(70.0, 200.0)
    waves = _per_period(size, 0.004)
    picture = voronoi(
        texels,
        _jittered(generator, cells),
        grey.astype(np.float32),
        border_grey=62.0,
        border=0.0006 * cells / size,
        warp=generator.uniform(-0.08, 0.08, (2, waves, waves)).astype(np.float32),
    )
    octaves = ((0.005, 10.0), (0.0015, 10.0), (0.0005, 9.0), (0.0002, 7.0))
    _add_octaves(picture, size, generator, octaves)
    return picture


def _asphalt(texels: int, size: float, generator: np.random.Generator) -> NDArray[np.float32]:
    # Radii by the power law r^-3, for which every scale covers as much ground as any other.
    least, greatest = 0.0003, 0.003
    mean_area = 2.0 * math.pi * math.log(greatest / least) / (1.0 / least**2 - 1.0 / greatest**2)
    count = round(_ASPHALT_COVERAGE * size**2 / mean_area)
    share = generator.uniform(size=count)
    radius = 1.0 / np.sqrt(1.0 / least**2 + share * (1.0 / greatest**2 - 1.0 / least**2))
    leaves = np.column_stack(
        (
            generator.uniform(0.0, 1.0, (count, 2)),
            radius / size,
            generator.uniform(0.55, 1.0, count),
            generator.uniform(0.0, math.pi, count),
            generator.normal(128.0, 34.0, count).clip(45.0, 225.0),
        )
    )
    picture = np.full((texels, texels), 48.0, np.float32)
    dead_leaves(picture, leaves, 0.00006 / size)
    _add_octaves(picture, size, generator, ((0.0008, 10.0), (0.0003, 10.0), (0.00018, 7.0)))
    return picture


_PROCEDURES = {"cork": _cork, "asphalt": _asphalt, "stone": _stone}


def _per_period(size: float, spacing: float) -> int:
    """Return how many cells of about `spacing` [m] make up a period, as a whole number."""
    return max(1, round(size / spacing))


def _jittered(generator: np.random.Generator, cells: int) -> NDArray[np.float32]:
    """Return one point in every cell of a grid, as its place within the cell (cells, cells, 2)."""
    return generator.uniform(0.08, 0.92, (cells, cells, 2)).astype(np.float32)


def _add_octaves(
    picture: NDArray[np.float32],
    size: float,
    generator: np.random.Generator,
    octaves: tuple[tuple[float, float], ...],
) -> None:
    """Add smooth noise of several spacings [m] and standard deviations [grey levels]."""
    for spacing, deviation in octaves:
        cells = _per_period(size, spacing)
        lattice = generator.uniform(-1.0, 1.0, (cells, cells))
        # Uniform on +/- 1 has the variance 1/3; the interpolation keeps about 0.52 of it.
        lattice *= deviation * math.sqrt(3.0 / 0.52)
        add_noise(picture, lattice.astype(np.float32))
