"""Layers of the procedural grounds: patterns whose details have a known size.

The grounds resemble those of Figures 59, 65 to 67 and 71, which the dissertation recorded with a
flatbed scanner. Some additional grounds are more difficult. Sizes are in meters, so the number of
texels changes only the resolution. All random values are drawn from the generator.

=============  =====================================================================================
cork           pressed granules of 2 mm
asphalt        chippings of 0.6 to 6 mm in dark binder
stone          coarse flat pieces of 12 mm with mineral grain
wood           a board with its grain along x: growth rings of 1.5 to 4.5 mm, fibers of 0.2 mm by
               40 mm, pores of 0.2 mm by 6 mm; like a bar code, it hardly changes along x
plastic        a smooth sheet: a faint molded grain of 0.25 to 2 mm and fainter mottles
metal          rolled sheet: faint grain of 0.2 mm and marks of 0.2 mm by 1.5 mm along x
walking_tile   concrete slabs with square studs every 20 mm and fine aggregate: periodic
dry_earth      clay in plates of 26 mm between open cracks, finer cracks every 8 mm, soil grain
worn_asphalt   asphalt polished by traffic: chippings and binder of nearly the same gray
concrete       troweled: mottles of a few centimeters, cement and sand grain, few pores
wet_concrete   concrete with wet patches, which are dark and without detail
gravel         rounded stones of 4 to 16 mm, one over the other, each with its own grain
sand           grains of 0.1 to 0.4 mm and faint ripples
grass          blades of 12 to 40 mm, in all directions
bark           ridges of 5 to 30 mm along x between dark furrows
brick          bricks of 100 x 67 mm in running bond, of little contrast, between mortar joints
cobble         stones of 50 mm with worn tops between wide dark joints
planks         boards of 50 mm with their grain along x between dark grooves
=============  =====================================================================================
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from omni_platform.quantities import FloatArray
from omni_sim.texture import patterns

Layers = list[patterns.Pattern]
Range = tuple[float, float]

_ASPHALT_COVERAGE = 3.0  # ratio of chipping area to ground area: 5 % binder remains visible


def _cork(size: float, generator: np.random.Generator) -> Layers:
    granules = _plates(size, generator, 0.002, ((138.0, 26.0), (60.0, 210.0)), (70.0, 0.00012))
    return [granules, *_octaves(size, generator, ((0.0008, 12.0), (0.00035, 11.0), (0.00018, 8.0)))]


def _stone(size: float, generator: np.random.Generator) -> Layers:
    grays, border = ((132.0, 22.0), (70.0, 200.0)), (62.0, 0.0006)
    pieces = _plates(size, generator, 0.012, grays, border, warp=(0.08, 0.004))
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
    # A ring begins with light early wood and darkens slowly; the next one begins within 0.1 mm.
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
    fibers = ((0.02, 0.2, 6.0), (0.0009, 0.07, 4.0), (0.0002, 0.04, 6.0))
    shape = _Shape((0.0015, 0.0045), (0.02, 0.035), (106.0, 10.0), direction=0.01)
    pores = _leaves(size, generator, 40000.0, shape, 0.00005)
    return [
        patterns.Rings(profile.astype(np.float32), bend),
        *(_noise(size, generator, *fiber) for fiber in fibers),
        pores,
    ]


def _plastic(size: float, generator: np.random.Generator) -> Layers:
    octaves = ((0.02, 0.6), (0.006, 0.6), (0.002, 0.9), (0.0005, 2.0), (0.00025, 3.0))
    return [patterns.Plain(142.0), *_octaves(size, generator, octaves)]


def _metal(size: float, generator: np.random.Generator) -> Layers:
    sheet = [(0.03, 0.1, 1.0), (0.00035, 0.004, 2.0)]
    sheet += [(0.00018, 0.0015, 3.5), (0.00018, 0.00025, 3.5)]
    return [patterns.Plain(148.0), *(_noise(size, generator, *grain) for grain in sheet)]


def _walking_tile(size: float, generator: np.random.Generator) -> Layers:
    cells = _per_period(size, 0.02)
    gray = generator.normal(150.0, 5.0, (cells, cells)).astype(np.float32)
    shape = _Shape((0.0002, 0.0005), (0.6, 1.0), (92.0, 14.0), (50.0, 130.0))
    holes = _leaves(size, generator, 0.04 / (math.pi * 0.00035**2), shape, 0.00006)
    cell = size / cells
    return [
        patterns.Studs(gray, 98.0, 0.007 / cell, 0.0013 / cell, 0.0015 / cell, 38.0),
        holes,
        *_octaves(size, generator, ((0.02, 4.0), (0.002, 5.0), (0.0006, 9.0), (0.00025, 7.0))),
    ]


def _dry_earth(size: float, generator: np.random.Generator) -> Layers:
    grays, limits = (146.0, 9.0), (90.0, 255.0)
    plates = _plates(
        size, generator, 0.026, (grays, limits), (20.0, 0.0016), warp=(0.14, 0.3 * 0.026)
    )
    cracks = _plates(
        size, generator, 0.008, ((255.0, 0.0), limits), (75.0, 0.0006), warp=(0.14, 0.3 * 0.008)
    )
    octaves = ((0.015, 7.0), (0.004, 6.0), (0.0012, 6.0), (0.0005, 7.0), (0.0002, 6.0))
    darkening = dataclasses.replace(cracks, darken=True)
    return [plates, darkening, *_octaves(size, generator, octaves)]


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
    shape = _Shape((0.006, 0.02), (0.04, 0.1), (105.0, 28.0), (30.0, 210.0))
    blades = _leaves(size, generator, 1.6 / (math.pi * 0.012**2 * 0.07), shape, 0.0001)
    octaves = ((0.01, 6.0), (0.0006, 4.0), (0.0002, 3.0))
    return [patterns.Plain(40.0), blades, *_octaves(size, generator, octaves)]


def _bark(size: float, generator: np.random.Generator) -> Layers:
    shape = _Shape((0.008, 0.03), (0.06, 0.18), (60.0, 14.0), (20.0, 100.0), direction=0.12)
    furrows = _leaves(size, generator, 1.2 / (math.pi * 0.02 * 0.003), shape, 0.0006)
    ridges = [(0.004, 0.03, 16.0), (0.0012, 0.008, 12.0)]
    ridges += [(0.0005, 0.002, 9.0), (0.0003, 0.0003, 7.0)]
    noise = (_noise(size, generator, *ridge) for ridge in ridges)
    return [patterns.Plain(120.0), furrows, *noise]


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
    """Return the integer number of cells in a period whose spacing is nearest to `spacing` [m]."""
    return max(1, round(size / spacing))


class _Shape(NamedTuple):
    """Distribution of the shapes and gray levels of ellipses.

    Attributes:
        radius: smallest and largest long semi-axis [m].
        ratio: smallest and largest ratio of the semi-axes [1].
        gray: mean and standard deviation of the gray levels.
        limits: limits of the gray levels.
        direction: standard deviation of the direction about x [rad], infinite for a uniform one.
    """

    radius: Range
    ratio: Range
    gray: Range
    limits: Range = (-math.inf, math.inf)
    direction: float = math.inf


def _leaves(
    size: float, generator: np.random.Generator, density: float, shape: _Shape, softness: float
) -> patterns.Leaves:
    """Return random ellipses with a density [1/m^2] and the width of their soft edges [m]."""
    place = generator.uniform(0.0, 1.0, (round(density * size**2), 2))
    radius = generator.uniform(*shape.radius, len(place))
    return _painted(size, generator, np.column_stack((place, radius / size)), shape, softness)


def _stones(
    size: float,
    generator: np.random.Generator,
    radii: Range,
    coverage: float,
    gray: Range,
    flattest: float,
    limits: Range = (20.0, 225.0),
) -> patterns.Leaves:
    """Return ellipses whose radii follow the scale-invariant power law r^-3.

    Args:
        size: period [m].
        generator: source of positions, sizes and gray levels.
        radii: smallest and largest long semi-axis [m].
        coverage: ratio of the total area of the ellipses to that of the ground [1].
        gray: mean and standard deviation of their gray levels.
        flattest: smallest ratio of the semi-axes [1].
        limits: limits of the gray levels.
    """
    least, greatest = radii
    mean_area = 2.0 * math.pi * math.log(greatest / least) / (1.0 / least**2 - 1.0 / greatest**2)
    share = generator.uniform(size=round(coverage * size**2 / mean_area))
    radius = 1.0 / np.sqrt(1.0 / least**2 + share * (1.0 / greatest**2 - 1.0 / least**2))
    places = np.column_stack((generator.uniform(0.0, 1.0, (len(radius), 2)), radius / size))
    return _painted(size, generator, places, _Shape(radii, (flattest, 1.0), gray, limits), 0.0001)


def _painted(
    size: float, generator: np.random.Generator, places: FloatArray, shape: _Shape, softness: float
) -> patterns.Leaves:
    """Return ellipses; `places` are their x, y and long semi-axes [periods], shape (n, 3)."""
    ratio = generator.uniform(*shape.ratio, len(places))
    if math.isinf(shape.direction):
        direction = generator.uniform(0.0, math.pi, len(places))
    else:
        direction = generator.normal(0.0, shape.direction, len(places))
    gray = generator.normal(*shape.gray, len(places)).clip(*shape.limits)
    return patterns.Leaves(np.column_stack((places, ratio, direction, gray)), softness / size)


def _plates(
    size: float,
    generator: np.random.Generator,
    spacing: float,
    gray: tuple[Range, Range],
    border: Range,
    warp: Range = (0.0, 1.0),
) -> patterns.Cells:
    """Return Voronoi cells around the jittered points of a grid.

    Args:
        size: period [m].
        generator: source of points, gray levels and warp.
        spacing: spacing of the grid [m].
        gray: mean and standard deviation of the gray levels, and their limits.
        border: gray level of the borders, and width over which they fade [m].
        warp: largest displacement that bends the borders [cells], and node spacing of the warp [m].
    """
    cells, nodes = _per_period(size, spacing), _per_period(size, warp[1])
    shades = generator.normal(*gray[0], (cells, cells)).clip(*gray[1])
    points = generator.uniform(0.08, 0.92, (cells, cells, 2))
    bend = np.zeros((2, 1, 1))
    if warp[0] > 0.0:
        bend = generator.uniform(-warp[0], warp[0], (2, nodes, nodes))
    return patterns.Cells(
        points.astype(np.float32),
        shades.astype(np.float32),
        border_gray=border[0],
        border=border[1] * cells / size,
        warp=bend.astype(np.float32),
    )


def _octaves(
    size: float, generator: np.random.Generator, octaves: tuple[tuple[float, float], ...]
) -> list[patterns.Noise]:
    """Return layers of smooth noise, given spacings [m] and deviations [gray levels]."""
    return [_noise(size, generator, spacing, spacing, gray) for spacing, gray in octaves]


def _noise(
    size: float,
    generator: np.random.Generator,
    spacing_y: float,
    spacing_x: float,
    deviation: float,
) -> patterns.Noise:
    """Return a random lattice whose interpolation has the given standard deviation.

    Args:
        size: period [m].
        generator: source of the values.
        spacing_y: approximate distance between nodes along y [m].
        spacing_x: approximate distance between nodes along x [m].
        deviation: standard deviation of the interpolated values [gray levels].
    """
    cells = _per_period(size, spacing_y), _per_period(size, spacing_x)
    lattice: FloatArray = generator.uniform(-1.0, 1.0, cells)
    # Uniform values on +/- 1 have the variance 1/3; the interpolation keeps about 0.52 of it.
    lattice *= deviation * math.sqrt(3.0 / 0.52)
    return patterns.Noise(lattice.astype(np.float32))
