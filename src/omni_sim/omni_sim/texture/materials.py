"""Layers of the procedural grounds: patterns whose details have a known size.

The grounds resemble those in Figures 59, 65 to 67 and 71 of the dissertation, which were recorded
with a flatbed scanner. Some additional grounds are more difficult. Sizes are in meters, so the
number of texels changes only the resolution. All random values are drawn from the generator.

===============  ===================================================================================
cork             pressed granules of 2 mm
asphalt          chippings of 0.6 to 6 mm in dark binder
stone            coarse flat pieces of 12 mm with mineral grain
wood             a board with its grain along x: growth rings of 1.5 to 4.5 mm, fibers of 0.2 mm by
                 40 mm, pores of 0.2 mm by 6 mm; like a bar code, it hardly changes along x
plastic          a smooth sheet: a faint molded grain of 0.25 to 2 mm and fainter mottles
metal            rolled sheet: faint grain of 0.2 mm and marks of 0.2 mm by 1.5 mm along x
walking_tile     concrete slabs with square studs every 20 mm and fine aggregate: periodic
dry_earth        clay in plates of 26 mm between open cracks, finer cracks every 8 mm, soil grain
worn_asphalt     asphalt polished by traffic: chippings and binder of nearly the same gray
concrete         troweled surface: mottles of a few centimeters, cement and sand grain, few pores
wet_concrete     concrete with wet patches, which are dark and without detail
gravel           rounded stones of 4 to 16 mm that overlap, each with its own grain
sand             grains of 0.1 to 0.4 mm and faint ripples
grass            blades of 12 to 40 mm, in all directions
bark             ridges of 5 to 30 mm along x between dark furrows
brick            bricks of 100 x 67 mm and little contrast in running bond, with mortar joints
cobble           stones of 50 mm with worn tops between wide dark joints
planks           boards of 50 mm with their grain along x between dark grooves
carpet           loops in a grid of 2.5 mm, 10 in an inch, with fibers: periodic
terrazzo         polished marble chips of 1.6 to 9.5 mm, the sizes 0 to 2 of the trade, in cement
slabs            concrete slabs of 100 mm with joints of 4 mm and painted stripes of 50 mm along x
tile             glazed tiles of 50 mm with joints of 3 mm: hardly any detail except the joints
wet_asphalt      asphalt under a film of water: dark, with glints that saturate the camera
sealed_concrete  polished and sealed concrete, with less contrast than the noise of a camera
epoxy            a plain coating of epoxy resin, as smooth
flake_epoxy      epoxy with vinyl flakes of 1.6 to 6.4 mm (1/16 to 1/4 inch)
===============  ===================================================================================
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from omni_core.quantities import FloatArray
from omni_sim.texture import patterns

Layers = list[patterns.Pattern]
Range = tuple[float, float]

_ASPHALT_COVERAGE = 3.0  # ratio of chipping area to ground area: 5 % binder remains visible


class _Shape(NamedTuple):
    """Distribution of the shapes and gray levels of ellipses.

    Attributes:
        radius: minimum and maximum of the long semi-axis [m].
        ratio: minimum and maximum of short divided by long semi-axis [1].
        gray: mean and standard deviation of the gray levels.
        limits: lower and upper limit on the gray levels.
        direction: standard deviation of the angle between long axis and x [rad], infinite for a
            uniform distribution.
    """

    radius: Range
    ratio: Range
    gray: Range
    limits: Range = (-math.inf, math.inf)
    direction: float = math.inf


class Brush(NamedTuple):
    """Paints random patterns over one period of a texture.

    Attributes:
        size: period [m].
        generator: source of all random values.
    """

    size: float
    generator: np.random.Generator

    def cells(self, spacing: float) -> int:
        """Return the number of cells per period with a spacing near `spacing` [m]."""
        return max(1, round(self.size / spacing))

    def leaves(self, density: float, shape: _Shape, softness: float) -> patterns.Leaves:
        """Return random ellipses with a density [1/m^2] and edges of the width `softness` [m]."""
        place = self.generator.uniform(0.0, 1.0, (round(density * self.size**2), 2))
        radius = self.generator.uniform(*shape.radius, len(place))
        return self._painted(np.column_stack((place, radius / self.size)), shape, softness)

    def stones(
        self,
        radii: Range,
        coverage: float,
        gray: Range,
        flattest: float,
        limits: Range = (20.0, 225.0),
    ) -> patterns.Leaves:
        """Return ellipses whose radii follow the scale-invariant power law r^-3.

        Args:
            radii: minimum and maximum of the long semi-axis [m].
            coverage: ratio of the total area of the ellipses to the area of the ground [1].
            gray: mean and standard deviation of the ellipses' gray levels.
            flattest: minimum of short divided by long semi-axis [1].
            limits: lower and upper limit on the gray levels.
        """
        least, greatest = radii
        inverse, drop = 1.0 / least**2, 1.0 / least**2 - 1.0 / greatest**2
        mean_area = 2.0 * math.pi * math.log(greatest / least) / drop
        share = self.generator.uniform(size=round(coverage * self.size**2 / mean_area))
        radius = 1.0 / np.sqrt(inverse + share * (1.0 / greatest**2 - 1.0 / least**2))
        centers = self.generator.uniform(0.0, 1.0, (len(radius), 2))
        places = np.column_stack((centers, radius / self.size))
        return self._painted(places, _Shape(radii, (flattest, 1.0), gray, limits), 0.0001)

    def _painted(self, places: FloatArray, shape: _Shape, softness: float) -> patterns.Leaves:
        """Return ellipses; `places` are their x, y and long semi-axes [periods], shape (n, 3)."""
        generator, count = self.generator, len(places)
        ratio = generator.uniform(*shape.ratio, count)
        if math.isinf(shape.direction):
            direction = generator.uniform(0.0, math.pi, count)
        else:
            direction = generator.normal(0.0, shape.direction, count)
        gray = generator.normal(*shape.gray, count).clip(*shape.limits)
        leaves = np.column_stack((places, ratio, direction, gray))
        return patterns.Leaves(leaves, softness / self.size)

    def plates(
        self, spacing: float, gray: tuple[Range, Range], border: Range, warp: Range = (0.0, 1.0)
    ) -> patterns.Cells:
        """Return Voronoi cells around the jittered points of a grid.

        Args:
            spacing: spacing of the grid [m].
            gray: mean and standard deviation of the gray levels, and their limits.
            border: gray level of the borders, and width over which they fade [m].
            warp: limit on the random displacement that bends the borders [cells], and spacing of
                the nodes at which this displacement is drawn [m].
        """
        cells, nodes = self.cells(spacing), self.cells(warp[1])
        shades = self.generator.normal(*gray[0], (cells, cells)).clip(*gray[1])
        points = self.generator.uniform(0.08, 0.92, (cells, cells, 2))
        bend = np.zeros((2, 1, 1))
        if warp[0] > 0.0:
            bend = self.generator.uniform(-warp[0], warp[0], (2, nodes, nodes))
        return patterns.Cells(
            points.astype(np.float32),
            shades.astype(np.float32),
            border_gray=border[0],
            border=border[1] * cells / self.size,
            warp=bend.astype(np.float32),
        )

    def octaves(self, octaves: tuple[tuple[float, float], ...]) -> list[patterns.Noise]:
        """Return a layer of noise for each pair of spacing [m] and deviation [gray levels]."""
        return [self.noise(spacing, spacing, gray) for spacing, gray in octaves]

    def noise(self, spacing_y: float, spacing_x: float, deviation: float) -> patterns.Noise:
        """Return a lattice of random values, between which the pattern is interpolated.

        Args:
            spacing_y: approximate distance between nodes along y [m].
            spacing_x: approximate distance between nodes along x [m].
            deviation: standard deviation of the interpolated values [gray levels].
        """
        lattice = self.generator.uniform(-1.0, 1.0, (self.cells(spacing_y), self.cells(spacing_x)))
        # Uniform values on +/- 1 have the variance 1/3, of which the interpolation retains about
        # 0.52.
        lattice *= deviation * math.sqrt(3.0 / 0.52)
        return patterns.Noise(lattice.astype(np.float32))


def _cork(brush: Brush) -> Layers:
    granules = brush.plates(0.002, ((138.0, 26.0), (60.0, 210.0)), (70.0, 0.00012))
    return [granules, *brush.octaves(((0.0008, 12.0), (0.00035, 11.0), (0.00018, 8.0)))]


def _stone(brush: Brush) -> Layers:
    grays, border = ((132.0, 22.0), (70.0, 200.0)), (62.0, 0.0006)
    pieces = brush.plates(0.012, grays, border, warp=(0.08, 0.004))
    octaves = ((0.005, 10.0), (0.0015, 10.0), (0.0005, 9.0), (0.0002, 7.0))
    return [pieces, *brush.octaves(octaves)]


def _asphalt(brush: Brush) -> Layers:
    chippings = brush.stones((0.0003, 0.003), _ASPHALT_COVERAGE, (128.0, 34.0), 0.55, (45.0, 225.0))
    octaves = ((0.0008, 10.0), (0.0003, 10.0), (0.00018, 7.0))
    chippings = patterns.Leaves(chippings.leaves, 0.00006 / brush.size)
    return [patterns.Plain(48.0), chippings, *brush.octaves(octaves)]


def _wood(brush: Brush) -> Layers:
    # A ring begins with light early wood and darkens slowly; the next one begins within 0.1 mm.
    rings = brush.cells(0.003)
    width = brush.generator.uniform(0.5, 1.5, rings)
    ends = np.cumsum(width) / width.sum()
    place = (np.arange(8192) + 0.5) / 8192
    ring = np.searchsorted(ends, place)
    phase = 1.0 - (ends[ring] - place) / (width[ring] / width.sum())
    depth = brush.generator.uniform(25.0, 60.0, rings)[ring]
    sharp = np.clip((1.0 - phase) * (width[ring] / width.sum()) * brush.size / 0.0002, 0.0, 1.0)
    profile = 168.0 - depth * phase**2.0 * sharp
    bend = (
        brush.noise(0.03, 0.2, 0.0012 / brush.size),
        brush.noise(0.012, 0.1, 0.0003 / brush.size),
    )
    fibers = ((0.02, 0.2, 6.0), (0.0009, 0.07, 4.0), (0.0002, 0.04, 6.0))
    shape = _Shape((0.0015, 0.0045), (0.02, 0.035), (106.0, 10.0), direction=0.01)
    pores = brush.leaves(40000.0, shape, 0.00005)
    return [
        patterns.Rings(profile.astype(np.float32), bend),
        *(brush.noise(*fiber) for fiber in fibers),
        pores,
    ]


def _plastic(brush: Brush) -> Layers:
    octaves = ((0.02, 0.6), (0.006, 0.6), (0.002, 0.9), (0.0005, 2.0), (0.00025, 3.0))
    return [patterns.Plain(142.0), *brush.octaves(octaves)]


def _metal(brush: Brush) -> Layers:
    sheet = [(0.03, 0.1, 1.0), (0.00035, 0.004, 2.0)]
    sheet += [(0.00018, 0.0015, 3.5), (0.00018, 0.00025, 3.5)]
    return [patterns.Plain(148.0), *(brush.noise(*grain) for grain in sheet)]


def _walking_tile(brush: Brush) -> Layers:
    cells = brush.cells(0.02)
    gray = brush.generator.normal(150.0, 5.0, (cells, cells)).astype(np.float32)
    shape = _Shape((0.0002, 0.0005), (0.6, 1.0), (92.0, 14.0), (50.0, 130.0))
    holes = brush.leaves(0.04 / (math.pi * 0.00035**2), shape, 0.00006)
    cell = brush.size / cells
    return [
        patterns.Studs(gray, 98.0, 0.007 / cell, 0.0013 / cell, 0.0015 / cell, 38.0),
        holes,
        *brush.octaves(((0.02, 4.0), (0.002, 5.0), (0.0006, 9.0), (0.00025, 7.0))),
    ]


def _dry_earth(brush: Brush) -> Layers:
    grays, limits = (146.0, 9.0), (90.0, 255.0)
    plates = brush.plates(0.026, (grays, limits), (20.0, 0.0016), warp=(0.14, 0.3 * 0.026))
    cracks = brush.plates(0.008, ((255.0, 0.0), limits), (75.0, 0.0006), warp=(0.14, 0.3 * 0.008))
    octaves = ((0.015, 7.0), (0.004, 6.0), (0.0012, 6.0), (0.0005, 7.0), (0.0002, 6.0))
    darkening = dataclasses.replace(cracks, darken=True)
    return [plates, darkening, *brush.octaves(octaves)]


def _worn_asphalt(brush: Brush) -> Layers:
    chippings = brush.stones((0.0005, 0.004), 2.0, (116.0, 6.0), 0.55)
    octaves = ((0.02, 1.5), (0.002, 2.5), (0.0008, 4.0), (0.0003, 6.0), (0.00018, 4.0))
    return [patterns.Plain(104.0), chippings, *brush.octaves(octaves)]


def _concrete(brush: Brush) -> Layers:
    octaves = ((0.03, 6.0), (0.008, 4.0), (0.002, 5.0), (0.0006, 7.0), (0.00025, 6.0))
    pores = brush.stones((0.0002, 0.0012), 0.02, (85.0, 12.0), 0.6)
    return [patterns.Plain(150.0), pores, *brush.octaves(octaves)]


def _wet_concrete(brush: Brush) -> Layers:
    dry = _concrete(brush)
    patches = brush.stones((0.012, 0.035), 0.35, (88.0, 3.0), 0.5)
    return [
        *dry,
        patterns.Leaves(patches.leaves, 0.0015 / brush.size),
        *brush.octaves(((0.0003, 3.0),)),
    ]


def _gravel(brush: Brush) -> Layers:
    stones = brush.stones((0.002, 0.008), 3.0, (125.0, 28.0), 0.55)
    octaves = ((0.004, 7.0), (0.001, 6.0), (0.0003, 6.0))
    return [patterns.Plain(45.0), stones, *brush.octaves(octaves)]


def _sand(brush: Brush) -> Layers:
    octaves = ((0.03, 3.0), (0.006, 2.0), (0.0004, 10.0), (0.0002, 14.0), (0.00012, 10.0))
    return [patterns.Plain(150.0), *brush.octaves(octaves)]


def _grass(brush: Brush) -> Layers:
    shape = _Shape((0.006, 0.02), (0.04, 0.1), (105.0, 28.0), (30.0, 210.0))
    blades = brush.leaves(1.6 / (math.pi * 0.012**2 * 0.07), shape, 0.0001)
    octaves = ((0.01, 6.0), (0.0006, 4.0), (0.0002, 3.0))
    return [patterns.Plain(40.0), blades, *brush.octaves(octaves)]


def _bark(brush: Brush) -> Layers:
    shape = _Shape((0.008, 0.03), (0.06, 0.18), (60.0, 14.0), (20.0, 100.0), direction=0.12)
    furrows = brush.leaves(1.2 / (math.pi * 0.02 * 0.003), shape, 0.0006)
    ridges = [(0.004, 0.03, 16.0), (0.0012, 0.008, 12.0)]
    ridges += [(0.0005, 0.002, 9.0), (0.0003, 0.0003, 7.0)]
    noise = (brush.noise(*ridge) for ridge in ridges)
    return [patterns.Plain(120.0), furrows, *noise]


def _brick(brush: Brush) -> Layers:
    rows, columns = 2 * brush.cells(0.1333), brush.cells(0.1)
    gray = brush.generator.normal(118.0, 8.0, (rows, columns)).astype(np.float32)
    octaves = ((0.02, 4.0), (0.003, 3.0), (0.0007, 3.0), (0.00025, 3.0))
    pits = brush.stones((0.0003, 0.0015), 0.01, (80.0, 10.0), 0.6)
    bricks = patterns.Bond(gray, 158.0, 0.008 / brush.size, 0.0012 / brush.size, staggered=True)
    return [bricks, pits, *brush.octaves(octaves)]


def _cobble(brush: Brush) -> Layers:
    cells, waves = brush.cells(0.05), brush.cells(0.015)
    stones = patterns.Cells(
        brush.generator.uniform(0.3, 0.7, (cells, cells, 2)).astype(np.float32),
        brush.generator.normal(125.0, 15.0, (cells, cells)).astype(np.float32),
        border_gray=45.0,
        border=0.007 * cells / brush.size,
        warp=brush.generator.uniform(-0.05, 0.05, (2, waves, waves)).astype(np.float32),
    )
    octaves = ((0.012, 6.0), (0.002, 4.0), (0.0006, 5.0), (0.0002, 4.0))
    return [stones, *brush.octaves(octaves)]


def _planks(brush: Brush) -> Layers:
    gray = brush.generator.normal(0.0, 9.0, (brush.cells(0.05), 1)).astype(np.float32)
    boards = patterns.Bond(gray, -75.0, 0.003 / brush.size, 0.0006 / brush.size, staggered=False)
    return [*_wood(brush), patterns.Added(boards)]


def _carpet(brush: Brush) -> Layers:
    cells = brush.cells(0.0025)
    loops = patterns.Cells(
        brush.generator.uniform(0.4, 0.6, (cells, cells, 2)).astype(np.float32),
        brush.generator.normal(98.0, 6.0, (cells, cells)).astype(np.float32),
        border_gray=58.0,
        border=0.0009 * cells / brush.size,
        warp=np.zeros((2, 1, 1), np.float32),
    )
    return [loops, *brush.octaves(((0.02, 2.0), (0.0008, 3.0), (0.0003, 5.0)))]


def _terrazzo(brush: Brush) -> Layers:
    chips = brush.stones((0.0008, 0.00475), 0.9, (140.0, 18.0), 0.5)
    return [patterns.Plain(158.0), chips, *brush.octaves(((0.004, 2.0), (0.0004, 1.5)))]


def _slabs(brush: Brush) -> Layers:
    cells = brush.cells(0.1)
    gray = brush.generator.normal(142.0, 4.0, (cells, cells)).astype(np.float32)
    slabs = patterns.Bond(gray, 78.0, 0.004 / brush.size, 0.0008 / brush.size, staggered=False)
    # Paint brightens slabs and joints alike; it hides no relief.
    one = np.zeros((1, 1), np.float32)
    stripe = patterns.Bond(one, 70.0, 0.05 / brush.size, 0.001 / brush.size, staggered=False)
    octaves = ((0.03, 3.0), (0.001, 3.0), (0.0003, 3.5))
    return [slabs, patterns.Added(stripe), *brush.octaves(octaves)]


def _tile(brush: Brush) -> Layers:
    cells = brush.cells(0.05)
    gray = brush.generator.normal(185.0, 3.0, (cells, cells)).astype(np.float32)
    tiles = patterns.Bond(gray, 108.0, 0.003 / brush.size, 0.0004 / brush.size, staggered=False)
    return [tiles, *brush.octaves(((0.01, 1.0), (0.002, 1.0), (0.0004, 1.0)))]


def _wet_asphalt(brush: Brush) -> Layers:
    chippings = brush.stones((0.0006, 0.004), 2.0, (38.0, 9.0), 0.6, (12.0, 80.0))
    glint = _Shape((0.0001, 0.0005), (0.5, 1.0), (290.0, 60.0))  # brighter than white on average
    glints = brush.leaves(60000.0, glint, 0.0002)
    return [patterns.Plain(24.0), chippings, *brush.octaves(((0.0008, 3.0), (0.0003, 3.0))), glints]


def _sealed_concrete(brush: Brush) -> Layers:
    octaves = ((0.04, 0.6), (0.001, 1.5), (0.0003, 2.0))
    return [patterns.Plain(140.0), *brush.octaves(octaves)]


def _epoxy(brush: Brush) -> Layers:
    return [patterns.Plain(125.0), *brush.octaves(((0.0015, 1.5), (0.0003, 4.0)))]


def _flake_epoxy(brush: Brush) -> Layers:
    flakes = brush.stones((0.0008, 0.0032), 0.7, (125.0, 48.0), 0.6)
    return [patterns.Plain(128.0), flakes, *brush.octaves(((0.0015, 1.5), (0.0003, 2.0)))]


MATERIALS: Mapping[str, Callable[[Brush], Layers]] = {
    layers.__name__.removeprefix("_"): layers
    for layers in (
        _cork, _asphalt, _stone, _wood, _plastic, _metal, _walking_tile, _dry_earth, _worn_asphalt,
        _concrete, _wet_concrete, _gravel, _sand, _grass, _bark, _brick, _cobble, _planks,
        _carpet, _terrazzo, _slabs, _tile, _wet_asphalt, _sealed_concrete, _epoxy, _flake_epoxy,
    )
}  # fmt: skip
"""Function that paints the layers of a ground with a brush, lowest layer first; keyed by ground."""
