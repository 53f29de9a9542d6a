"""The layers of the procedural grounds, patterns with structure of known size.

The grounds of Figures 59, 65 to 67 and 71, as scanned by the dissertation's flatbed scanner, and
more difficult ones. Sizes are in meters, so the number of texels only changes the resolution. All
random values are drawn from the generator.

=============  =====================================================================================
cork           pressed granules of 2 mm
asphalt        chippings of 0.6 to 6 mm in dark binder
stone          coarse flat pieces of 12 mm with mineral grain
wood           a board with its grain along x: growth rings of 1.5 to 4.5 mm, fibres of 0.2 mm by
               40 mm, pores of 0.2 mm by 6 mm; like a bar code, next to nothing changes along x
plastic        a smooth sheet: a faint molded grain of 0.25 to 2 mm and fainter mottles
metal          rolled sheet: faint grain of 0.2 mm and marks of 0.2 mm by 1.5 mm along x
walking_tile   concrete slabs with square studs every 20 mm and fine aggregate: periodic
dry_earth      clay in plates of 26 mm between open cracks, finer cracks every 8 mm, soil grain
worn_asphalt   asphalt polished by traffic: chippings and binder of nearly the same gray
concrete       trowelled: mottles of some centimeters, cement and sand grain, few pores
wet_concrete   the same with wet patches, dark and without detail
gravel         rounded stones of 4 to 16 mm, one over the other, each with its own grain
sand           grains of 0.1 to 0.4 mm and faint ripples
grass          blades of 12 to 40 mm, in all directions
bark           ridges of 5 to 30 mm along x between dark furrows
brick          bricks of 100 x 67 mm in running bond, of little contrast, between mortar joints
cobble         stones of 50 mm with worn tops between wide dark joints
planks         boards of 50 mm with their grain along x between dark grooves
=============  =====================================================================================
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from omni_sim.texture import patterns

Layers = list[patterns.Pattern]

_ASPHALT_COVERAGE = 3.0  # times that the chippings would cover the ground: 5 % binder is left


def _cork(size: float, generator: np.random.Generator) -> Layers:
    cells = _per_period(size, 0.002)
    gray = generator.normal(138.0, 26.0, (cells, cells)).clip(60.0, 210.0)
    granules = patterns.Cells(
        _jittered(generator, cells),
        gray.astype(np.float32),
        border_gray=70.0,
        border=0.00012 * cells / size,
        warp=np.zeros((2, 1, 1), np.float32),
    )
    octaves = ((0.0008, 12.0), (0.00035, 11.0), (0.00018, 8.0))
    return [granules, *_octaves(size, generator, octaves)]


def _stone(size: float, generator: np.random.Generator) -> Layers:
    cells = _per_period(size, 0.012)
    gray = generator.normal(132.0, 22.0, (cells, cells)).clip(70.0, 200.0)
    waves = _per_period(size, 0.004)
    pieces = patterns.Cells(
        _jittered(generator, cells),
        gray.astype(np.float32),
        border_gray=62.0,
        border=0.0006 * cells / size,
        warp=generator.uniform(-0.08, 0.08, (2, waves, waves)).astype(np.float32),
    )
    octaves = ((0.005, 10.0), (0.0015, 10.0), (0.0005, 9.0), (0.0002, 7.0))
    return [pieces, *_octaves(size, generator, octaves)]


def _asphalt(size: float, generator: np.random.Generator) -> Layers:
    chippings = _stones(
        size, generator, (0.0003, 0.003), _ASPHALT_COVERAGE, (128.0, 34.0), 0.55, (45.0, 225.0)
    )
    octaves = ((0.0008, 10.0), (0.0003, 10.0), (0.00018, 7.0))
    chippings = patterns.Leaves(chippings.leaves, 0.00006 / size)
    return [patterns.Plain(48.0), chippings, *_octaves(size, generator, octaves)]


def _wood(size: float, generator: np.random.Generator) -> Layers:
    # Light early wood darkens slowly over a ring, then begins anew within a tenth of a millimeter.
    rings = _per_period(size, 0.003)
    width = generator.uniform(0.5, 1.5, rings)
    ends = np.cumsum(width) / width.sum()
    place = (np.arange(8192) + 0.5) / 8192
    ring = np.searchsorted(ends, place)
    phase = 1.0 - (ends[ring] - place) / (width[ring] / width.sum())
    depth = generator.uniform(25.0, 60.0, rings)[ring]
    sharp = np.clip((1.0 - phase) * (width[ring] / width.sum()) * size / 0.0002, 0.0, 1.0)
    profile = 168.0 - depth * phase**2.0 * sharp
    bend = (
        _noise(size, generator, 0.03, 0.2, 0.0012 / size),
        _noise(size, generator, 0.012, 0.1, 0.0003 / size),
    )
    fibres = ((0.02, 0.2, 6.0), (0.0009, 0.07, 4.0), (0.0002, 0.04, 6.0))
    count = round(40000.0 * size**2)
    pores = np.column_stack(
        (
            generator.uniform(0.0, 1.0, (count, 2)),
            generator.uniform(0.0015, 0.0045, count) / size,
            generator.uniform(0.02, 0.035, count),
            generator.normal(0.0, 0.01, count),
            generator.normal(106.0, 10.0, count),
        )
    )
    return [
        patterns.Rings(profile.astype(np.float32), bend),
        *(_noise(size, generator, *fibre) for fibre in fibres),
        patterns.Leaves(pores, 0.00005 / size),
    ]


def _plastic(size: float, generator: np.random.Generator) -> Layers:
    octaves = ((0.02, 0.6), (0.006, 0.6), (0.002, 0.9), (0.0005, 2.0), (0.00025, 3.0))
    return [patterns.Plain(142.0), *_octaves(size, generator, octaves)]


def _metal(size: float, generator: np.random.Generator) -> Layers:
    return [
        patterns.Plain(148.0),
        _noise(size, generator, 0.03, 0.1, 1.0),
        _noise(size, generator, 0.00035, 0.004, 2.0),
        _noise(size, generator, 0.00018, 0.0015, 3.5),
        _noise(size, generator, 0.00018, 0.00025, 3.5),
    ]


def _walking_tile(size: float, generator: np.random.Generator) -> Layers:
    cells = _per_period(size, 0.02)
    gray = generator.normal(150.0, 5.0, (cells, cells)).astype(np.float32)
    pits = round(0.04 * size**2 / (math.pi * 0.00035**2))
    holes = np.column_stack(
        (
            generator.uniform(0.0, 1.0, (pits, 2)),
            generator.uniform(0.0002, 0.0005, pits) / size,
            generator.uniform(0.6, 1.0, pits),
            generator.uniform(0.0, math.pi, pits),
            generator.normal(92.0, 14.0, pits).clip(50.0, 130.0),
        )
    )
    cell = size / cells
    return [
        patterns.Studs(gray, 98.0, 0.007 / cell, 0.0013 / cell, 0.0015 / cell, 38.0),
        patterns.Leaves(holes, 0.00006 / size),
        *_octaves(size, generator, ((0.02, 4.0), (0.002, 5.0), (0.0006, 9.0), (0.00025, 7.0))),
    ]


def _dry_earth(size: float, generator: np.random.Generator) -> Layers:
    def plates(
        spacing: float, crack: float, gray: tuple[float, float], crack_gray: float, *, darken: bool
    ) -> patterns.Cells:
        cells, waves = _per_period(size, spacing), _per_period(size, 0.3 * spacing)
        shades = generator.normal(*gray, (cells, cells)).clip(90.0, 255.0)
        return patterns.Cells(
            _jittered(generator, cells),
            shades.astype(np.float32),
            border_gray=crack_gray,
            border=crack * cells / size,
            warp=generator.uniform(-0.14, 0.14, (2, waves, waves)).astype(np.float32),
            darken=darken,
        )

    octaves = ((0.015, 7.0), (0.004, 6.0), (0.0012, 6.0), (0.0005, 7.0), (0.0002, 6.0))
    return [
        plates(0.026, 0.0016, (146.0, 9.0), 20.0, darken=False),
        plates(0.008, 0.0006, (255.0, 0.0), 75.0, darken=True),
        *_octaves(size, generator, octaves),
    ]


def _worn_asphalt(size: float, generator: np.random.Generator) -> Layers:
    chippings = _stones(size, generator, (0.0005, 0.004), 2.0, (116.0, 6.0), 0.55)
    octaves = ((0.02, 1.5), (0.002, 2.5), (0.0008, 4.0), (0.0003, 6.0), (0.00018, 4.0))
    return [patterns.Plain(104.0), chippings, *_octaves(size, generator, octaves)]


def _concrete(size: float, generator: np.random.Generator) -> Layers:
    octaves = ((0.03, 6.0), (0.008, 4.0), (0.002, 5.0), (0.0006, 7.0), (0.00025, 6.0))
    pores = _stones(size, generator, (0.0002, 0.0012), 0.02, (85.0, 12.0), 0.6)
    return [patterns.Plain(150.0), pores, *_octaves(size, generator, octaves)]


def _wet_concrete(size: float, generator: np.random.Generator) -> Layers:
    dry = _concrete(size, generator)
    patches = _stones(size, generator, (0.012, 0.035), 0.35, (88.0, 3.0), 0.5)
    return [
        *dry,
        patterns.Leaves(patches.leaves, 0.0015 / size),
        *_octaves(size, generator, ((0.0003, 3.0),)),
    ]


def _gravel(size: float, generator: np.random.Generator) -> Layers:
    stones = _stones(size, generator, (0.002, 0.008), 3.0, (125.0, 28.0), 0.55)
    octaves = ((0.004, 7.0), (0.001, 6.0), (0.0003, 6.0))
    return [patterns.Plain(45.0), stones, *_octaves(size, generator, octaves)]


def _sand(size: float, generator: np.random.Generator) -> Layers:
    octaves = ((0.03, 3.0), (0.006, 2.0), (0.0004, 10.0), (0.0002, 14.0), (0.00012, 10.0))
    return [patterns.Plain(150.0), *_octaves(size, generator, octaves)]


def _grass(size: float, generator: np.random.Generator) -> Layers:
    count = round(1.6 * size**2 / (math.pi * 0.012**2 * 0.07))
    blades = np.column_stack(
        (
            generator.uniform(0.0, 1.0, (count, 2)),
            generator.uniform(0.006, 0.02, count) / size,
            generator.uniform(0.04, 0.1, count),
            generator.uniform(0.0, math.pi, count),
            generator.normal(105.0, 28.0, count).clip(30.0, 210.0),
        )
    )
    octaves = ((0.01, 6.0), (0.0006, 4.0), (0.0002, 3.0))
    return [
        patterns.Plain(40.0),
        patterns.Leaves(blades, 0.0001 / size),
        *_octaves(size, generator, octaves),
    ]


def _bark(size: float, generator: np.random.Generator) -> Layers:
    count = round(1.2 * size**2 / (math.pi * 0.02 * 0.003))
    furrows = np.column_stack(
        (
            generator.uniform(0.0, 1.0, (count, 2)),
            generator.uniform(0.008, 0.03, count) / size,
            generator.uniform(0.06, 0.18, count),
            generator.normal(0.0, 0.12, count),
            generator.normal(60.0, 14.0, count).clip(20.0, 100.0),
        )
    )
    ridges = (
        (0.004, 0.03, 16.0),
        (0.0012, 0.008, 12.0),
        (0.0005, 0.002, 9.0),
        (0.0003, 0.0003, 7.0),
    )
    return [
        patterns.Plain(120.0),
        patterns.Leaves(furrows, 0.0006 / size),
        *(_noise(size, generator, *ridge) for ridge in ridges),
    ]


def _brick(size: float, generator: np.random.Generator) -> Layers:
    rows, columns = 2 * _per_period(size, 0.1333), _per_period(size, 0.1)
    gray = generator.normal(118.0, 8.0, (rows, columns)).astype(np.float32)
    octaves = ((0.02, 4.0), (0.003, 3.0), (0.0007, 3.0), (0.00025, 3.0))
    pits = _stones(size, generator, (0.0003, 0.0015), 0.01, (80.0, 10.0), 0.6)
    bricks = patterns.Bond(gray, 158.0, 0.008 / size, 0.0012 / size, staggered=True)
    return [bricks, pits, *_octaves(size, generator, octaves)]


def _cobble(size: float, generator: np.random.Generator) -> Layers:
    cells, waves = _per_period(size, 0.05), _per_period(size, 0.015)
    stones = patterns.Cells(
        generator.uniform(0.3, 0.7, (cells, cells, 2)).astype(np.float32),
        generator.normal(125.0, 15.0, (cells, cells)).astype(np.float32),
        border_gray=45.0,
        border=0.007 * cells / size,
        warp=generator.uniform(-0.05, 0.05, (2, waves, waves)).astype(np.float32),
    )
    octaves = ((0.012, 6.0), (0.002, 4.0), (0.0006, 5.0), (0.0002, 4.0))
    return [stones, *_octaves(size, generator, octaves)]


def _planks(size: float, generator: np.random.Generator) -> Layers:
    gray = generator.normal(0.0, 9.0, (_per_period(size, 0.05), 1)).astype(np.float32)
    boards = patterns.Bond(gray, -75.0, 0.003 / size, 0.0006 / size, staggered=False)
    return [*_wood(size, generator), patterns.Added(boards)]


MATERIALS: Mapping[str, Callable[[float, np.random.Generator], Layers]] = {
    layers.__name__.removeprefix("_"): layers
    for layers in (
        _cork, _asphalt, _stone, _wood, _plastic, _metal, _walking_tile, _dry_earth, _worn_asphalt,
        _concrete, _wet_concrete, _gravel, _sand, _grass, _bark, _brick, _cobble, _planks,
    )
}  # fmt: skip
"""Layers of each ground, lowest first, for a period [m] and a random generator."""


def _per_period(size: float, spacing: float) -> int:
    """Return the integer number of cells of about `spacing` [m] in a period."""
    return max(1, round(size / spacing))


def _stones(
    size: float,
    generator: np.random.Generator,
    radii: tuple[float, float],
    coverage: float,
    gray: tuple[float, float],
    flattest: float,
    limits: tuple[float, float] = (20.0, 225.0),
) -> patterns.Leaves:
    """Return ellipses of scale-invariant sizes: radii by the power law r^-3.

    Args:
        size: period [m].
        generator: generator of places, sizes and grays.
        radii: least and greatest long half axis [m].
        coverage: their total area over that of the ground [1].
        gray: mean and standard deviation of their gray levels.
        flattest: least ratio of the axes.
        limits: limits of the gray levels.
    """
    least, greatest = radii
    mean_area = 2.0 * math.pi * math.log(greatest / least) / (1.0 / least**2 - 1.0 / greatest**2)
    count = round(coverage * size**2 / mean_area)
    share = generator.uniform(size=count)
    radius = 1.0 / np.sqrt(1.0 / least**2 + share * (1.0 / greatest**2 - 1.0 / least**2))
    leaves = np.column_stack(
        (
            generator.uniform(0.0, 1.0, (count, 2)),
            radius / size,
            generator.uniform(flattest, 1.0, count),
            generator.uniform(0.0, math.pi, count),
            generator.normal(*gray, count).clip(*limits),
        )
    )
    return patterns.Leaves(leaves, 0.0001 / size)


def _jittered(generator: np.random.Generator, cells: int) -> NDArray[np.float32]:
    """Return one point in every cell of a grid, as its place within the cell (cells, cells, 2)."""
    return generator.uniform(0.08, 0.92, (cells, cells, 2)).astype(np.float32)


def _octaves(
    size: float, generator: np.random.Generator, octaves: tuple[tuple[float, float], ...]
) -> list[patterns.Noise]:
    """Return smooth noise of several spacings [m] and standard deviations [gray levels]."""
    return [_noise(size, generator, spacing, spacing, gray) for spacing, gray in octaves]


def _noise(
    size: float,
    generator: np.random.Generator,
    spacing_y: float,
    spacing_x: float,
    deviation: float,
) -> patterns.Noise:
    return patterns.Noise(_lattice(size, generator, spacing_y, spacing_x, deviation))


def _lattice(
    size: float,
    generator: np.random.Generator,
    spacing_y: float,
    spacing_x: float,
    deviation: float,
) -> NDArray[np.float32]:
    """Return random values whose interpolation has a standard deviation.

    Args:
        size: period [m].
        generator: generator of the values.
        spacing_y: about the distance of two nodes along y [m].
        spacing_x: the same along x.
        deviation: deviation of the interpolated values.
    """
    cells = _per_period(size, spacing_y), _per_period(size, spacing_x)
    lattice: NDArray[np.float64] = generator.uniform(-1.0, 1.0, cells)
    # Uniform on +/- 1 has the variance 1/3; the interpolation keeps about 0.52 of it.
    lattice *= deviation * math.sqrt(3.0 / 0.52)
    return lattice.astype(np.float32)
