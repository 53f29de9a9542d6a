"""Area that a vehicle needs to stop from any motion, including its footprint and rotation.

A stop is stored as the support function of the area that it covers: h_k = max d_k . p over all
points p of the footprint until rest. The `DIRECTIONS` directions d_k are fixed in the frame of
`base_link` at the time of the alarm. The area of a cell (a direction of motion, a speed band, a yaw
rate band) is the polygon {p: d_k . p <= H_k}. A stop stays within it if and only if h_k <= H_k for
all k.

The first stops of a cell determine a hull, H_k = max h_k. To contain one of the other n stops, the
hull must grow by some length. It is enlarged by the largest of these n lengths (split conformal
prediction; Wilks' tolerance limit). A further stop from the same population is then inside with a
probability of at least `coverage`, with a `confidence` of 1 - coverage^n.

For each stop, random values are drawn for speed, direction and yaw rate within the cell, for mass
and position of the load, and for friction. For the stops that determine the areas, two of three
values are at one of the ends of their range, because the longest distances and largest rotations
occur at such values. Half of the held-out stops are drawn in the same way, the other half
uniformly.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_core.configuration import ConfigurationError
from omni_core.geometry import PlatformGeometry, turned
from omni_core.quantities import SECOND_NS, BoolArray, FloatArray
from omni_runs import compiled, experiment
from omni_runs.figures.scene import Scene
from omni_runs.history import FastRun
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.campaign.runner import digest

DIRECTIONS = 16
"""Number of directions of the support function, and limit on the number of a polygon's corners."""

SECTORS = (
    *("forward", "forward_left", "left", "backward_left"),
    *("backward", "backward_right", "right", "forward_right"),
)
"""Names of the directions of motion, each 45 deg wide, counter-clockwise."""

HULL_STOPS = 60
"""Number of stops that determine the hull of a cell."""

_NORMALS = turned(np.array([1.0, 0.0]), 2 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS)


class Cell(NamedTuple):
    """Range of motions for which one stopping area is computed.

    Attributes:
        name: name of the cell, such as ``forward_left_2_straight``.
        speed: lowest and highest speed [m/s].
        direction: first and last direction, counter-clockwise from forward [rad]; the first may be
            larger.
        yaw_rate: lowest and highest yaw rate [rad/s].
    """

    name: str
    speed: tuple[float, float]
    direction: tuple[float, float]
    yaw_rate: tuple[float, float]


def make_cells(
    speed: float, bands: int, yaw_rate: float, turns: int, limits: FloatArray | None = None
) -> tuple[Cell, ...]:
    """Return cells that divide all motions up to a speed and a yaw rate.

    Args:
        speed: maximum speed [m/s].
        bands: number of speed bands of equal width.
        yaw_rate: maximum yaw rate in either direction [rad/s].
        turns: number of yaw-rate bands of equal width.
        limits: limits on the magnitudes of v_x and v_y [m/s], shape (2,); None for no such limits.
            The speed bands of a direction then end at its highest speed.
    """
    words = [f"_turn_{turn + 1}" for turn in range(turns)]
    words = {1: [""], 3: ["_right", "_straight", "_left"]}.get(turns, words)
    half = math.pi / len(SECTORS)
    fastest = [min(speed, _fastest(2 * half * k, half, limits)) for k in range(len(SECTORS))]
    return tuple(
        Cell(
            f"{sector}_{band + 1}{word}",
            (fastest[index] * band / bands, fastest[index] * (band + 1) / bands),
            (_wrapped(2 * half * index - half), _wrapped(2 * half * index + half)),
            (yaw_rate * (2 * turn / turns - 1), yaw_rate * (2 * (turn + 1) / turns - 1)),
        )
        for band in range(bands)
        for index, sector in enumerate(SECTORS)
        for turn, word in enumerate(words)
    )


def speed_limit(direction: float, limits: FloatArray | None) -> float:
    """Return the highest speed in a direction [rad] if v_x and v_y are limited separately [m/s]."""
    if limits is None:
        return math.inf
    along = np.abs([math.cos(direction), math.sin(direction)])
    return float(np.min(limits / np.maximum(along, 1e-12)))


def _fastest(middle: float, half: float, limits: FloatArray | None) -> float:
    """Return the highest speed of all directions within `half` of the direction `middle` [rad]."""
    corner = 0.0 if limits is None else math.atan2(limits[1], limits[0])
    corners = (corner, math.pi - corner, math.pi + corner, -corner)
    within = [one for one in corners if abs(_wrapped(one - middle)) < half]
    return max(speed_limit(one, limits) for one in (middle - half, middle + half, *within))


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


def calibration_stops(coverage: float, confidence: float) -> int:
    """Return the number of stops per cell that are required for this coverage and confidence."""
    return math.ceil(math.log(1.0 - confidence) / math.log(coverage))


class Sweep(NamedTuple):
    """Area on the ground that the vehicle covers in one stop.

    Attributes:
        seed: number of the stop in the campaign.
        support: support function of the area [m], `DIRECTIONS` numbers separated by spaces.
    """

    seed: int
    support: str


@dataclasses.dataclass(frozen=True)
class StopCampaign:
    """Stops of a vehicle from which the areas are computed and with which they are checked.

    Attributes:
        base: configuration of the loop, with the maximum load at its maximum offset.
        cells: cells that divide the motions.
        friction: friction of the ground, lowest and highest [1].
        reaction_time: time of constant motion from the alarm to the pedal [s].
        per_cell: number of stops that determine the area of each cell; further stops are held out.
        seed: seed of all random values.
        limits: limits on the magnitudes of v_x and v_y [m/s]; None for no such limits.
        settling: time for which the vehicle rolls before the alarm, so that its loads settle [s].
    """

    base: experiment.ExperimentConfiguration
    cells: tuple[Cell, ...]
    friction: tuple[float, float]
    reaction_time: float
    per_cell: int
    seed: int
    limits: tuple[float, float] | None = None
    settling: float = 0.2

    @property
    def fitted(self) -> int:
        """Number of stops that determine the areas; they are the first stops of the campaign."""
        return self.per_cell * len(self.cells)

    @property
    def fingerprint(self) -> str:
        """Digest of all settings that determine a stop, except the stop's number."""
        fields = (getattr(self, field.name) for field in dataclasses.fields(self))
        return digest(*(value for value in fields if value is not None))

    @functools.cached_property
    def footprint(self) -> FloatArray:
        """Points in `base_link` whose hull is the footprint of the vehicle [m], shape (C, 2)."""
        return footprint(self.base.vehicle)

    def cell_of(self, number: int) -> int:
        """Return the index of the cell to which a stop belongs."""
        return number % len(self.cells)

    def extreme(self, number: int) -> bool:
        """Return whether most random values of a stop are drawn from the ends of their ranges."""
        return number < self.fitted or (number - self.fitted) // len(self.cells) % 2 == 0

    def configuration(self, number: int) -> experiment.ExperimentConfiguration:
        """Return the configuration of a stop, drawn at random."""
        random = np.random.default_rng([self.seed, number])
        draw = _extreme if self.extreme(number) else _uniform
        cell = self.cells[self.cell_of(number)]
        start, end = cell.direction
        load = self.base.vehicle.load
        mass = draw(random, 0.0, load.mass)
        x, y = (draw(random, -abs(most), abs(most)) for most in (load.x, load.y))
        load = dataclasses.replace(load, mass=mass, x=x, y=y)
        vehicle = dataclasses.replace(self.base.vehicle, load=load)
        speed = draw(random, *cell.speed)
        direction = draw(random, start, end if end > start else end + math.tau)
        limits = None if self.limits is None else np.array(self.limits)
        maneuver = ManeuverConfiguration(
            speed=min(speed, speed_limit(direction, limits)),
            direction_deg=math.degrees(direction),
            yaw_rate_deg=math.degrees(draw(random, *cell.yaw_rate)),
            brake_time=self.settling + self.reaction_time,
        )
        ground = dataclasses.replace(self.base.ground, friction=draw(random, *self.friction))
        return dataclasses.replace(
            self.base, seed=number, vehicle=vehicle, maneuver=maneuver, ground=ground
        )

    def stop(self, number: int) -> Sweep:
        """Simulate a stop and return the area that it covers.

        Raises:
            ConfigurationError: the vehicle does not come to rest.
        """
        configuration = self.configuration(number)
        run = compiled.run_fast_loop(configuration)
        if not run.stopped:
            raise ConfigurationError(
                "simulation.duration_limit",
                f"stop {number} of {self.cells[self.cell_of(number)].name} does not come to rest "
                f"after {configuration.simulation.duration_limit:g} s at a friction of "
                f"{configuration.ground.friction:.2g}; increase the duration or the friction",
            )
        swept = support(run, self.footprint, self.settling)
        return Sweep(number, " ".join(repr(value) for value in swept.tolist()))


def _uniform(random: np.random.Generator, low: float, high: float) -> float:
    return float(random.uniform(low, high))


def _extreme(random: np.random.Generator, low: float, high: float) -> float:
    """Draw the lower end, the upper end or a value in between, each with probability 1/3."""
    return (low, high, _uniform(random, low, high))[int(random.integers(3))]


def footprint(vehicle: VehicleConfiguration) -> FloatArray:
    """Return points in `base_link` whose hull is the vehicle's footprint [m], shape (C, 2)."""
    chassis = Scene.of_vehicle(vehicle).chassis
    geometry = PlatformGeometry.from_wheels(vehicle.wheels)
    along = geometry.radius[:, None] * geometry.rolling
    width = np.array([wheel.assumed_width for wheel in vehicle.wheels.values()])
    across = 0.5 * width[:, None] * geometry.axis
    wheels = [geometry.position + a * along + b * across for a in (-1, 1) for b in (-1, 1)]
    return np.concatenate((chassis, *wheels))


def support(run: FastRun, points: FloatArray, start: float) -> FloatArray:
    """Return the support function of the area covered by a run [m], shape (DIRECTIONS,).

    Args:
        run: run that ends at rest.
        points: the footprint in `base_link` [m], shape (C, 2).
        start: time from which the area is counted [s]; the area is described in the frame of
            `base_link` at this time.
    """
    pose = run.pose[np.searchsorted(run.stamp_ns, round(start * SECOND_NS)) :]
    angle = pose[:, 2] - pose[0, 2]
    moved = turned(pose[:, :2] - pose[0, :2], -pose[0, 2])  # from odom into this frame
    swept = turned(points, angle[:, np.newaxis]) + moved[:, np.newaxis, :]  # (T, C, 2)
    return np.asarray(np.max(swept.reshape(-1, 2) @ _NORMALS.T, axis=0))


def areas(campaign: StopCampaign, sweeps: Sequence[Sweep]) -> FloatArray:
    """Return the area of each cell as support function H_k [m], shape (cells, DIRECTIONS)."""
    supports = supports_of(sweeps[: campaign.fitted])
    # Consecutive stops belong to consecutive cells.
    by_cell = supports.reshape(campaign.per_cell, len(campaign.cells), DIRECTIONS)
    hull = np.max(by_cell[:HULL_STOPS], axis=0)
    growth = np.max(by_cell[HULL_STOPS:] - hull, axis=(0, 2))
    return np.asarray(hull + np.maximum(growth, 0.0)[:, None])


def inside(campaign: StopCampaign, limits: FloatArray, sweeps: Sequence[Sweep]) -> BoolArray:
    """Return whether each stop stays within the area of its cell, shape (stops,).

    Args:
        campaign: campaign of the stops.
        limits: support function H_k of the area of each cell [m], shape (cells, DIRECTIONS).
        sweeps: results of the stops.
    """
    cells = [campaign.cell_of(sweep.seed) for sweep in sweeps]
    return np.asarray(np.all(supports_of(sweeps) <= limits[cells], axis=1))


def supports_of(sweeps: Sequence[Sweep]) -> FloatArray:
    """Return the support function h_k of each stop's area [m], shape (stops, DIRECTIONS)."""
    words = [sweep.support.split() for sweep in sweeps]
    return np.array(words, np.float64).reshape(-1, DIRECTIONS)


def corners(limits: FloatArray) -> FloatArray:
    """Return the corners of an area [m], counter-clockwise, shape (C, 2).

    Args:
        limits: H_k [m], the support function of a convex area, shape (DIRECTIONS,).
    """
    following = np.roll(limits, -1)
    step = 2 * math.pi / DIRECTIONS
    # Intersections of the lines d_k . p = H_k and d_(k+1) . p = H_(k+1).
    along = (following - limits * math.cos(step)) / math.sin(step)
    tangents = np.column_stack((-_NORMALS[:, 1], _NORMALS[:, 0]))
    points = limits[:, None] * _NORMALS + along[:, None] * tangents
    distinct = np.hypot(*(points - np.roll(points, 1, axis=0)).T) > 1e-6
    return points[distinct] if np.any(distinct) else points[:1]
