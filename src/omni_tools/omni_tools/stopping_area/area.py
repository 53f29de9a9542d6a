"""The area that a vehicle needs to stop, with its footprint and rotation, for every motion.

A stop is stored as the support function of the area that it covers: h_k = max d_k . p over all
points p of the footprint until rest. The `DIRECTIONS` directions d_k are fixed in the frame of
`base_link` at the alarm. The area of a cell (a direction of motion, a band of speeds, a band of yaw
rates) is the polygon {p: d_k . p <= H_k}. A stop stays inside exactly if h_k <= H_k for all k.

A first part of the stops of a cell gives a hull, H_k = max h_k. Each of the other n stops requires
a growth of the hull, and the hull grows by the largest of these n lengths (split conformal
prediction; Wilks' tolerance limit). A further stop of the same population is then inside with a
probability of at least `coverage`, with a `confidence` of 1 - coverage^n.

For each stop, speed, direction and yaw rate within the cell, mass and position of the load, and
friction are drawn at random. Two of three draws for the areas are at the ends of these ranges,
where distance and rotation are largest. Held-out stops are drawn from the ends and uniformly.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_loop import compiled, experiment
from omni_platform.configuration import ConfigurationError
from omni_platform.geometry import PlatformGeometry
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_sim.driver.scripted import ManeuverConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.campaign.runner import digest

DIRECTIONS = 16
"""Number of directions of the support function, the largest number of corners of a polygon."""

SECTORS = (
    *("forward", "forward_left", "left", "backward_left"),
    *("backward", "backward_right", "right", "forward_right"),
)
"""Names of the directions of motion, each 45 deg wide, counter-clockwise."""

HULL_STOPS = 60
"""Number of stops that determine the hull of a cell."""

_NORMALS = np.array(
    [
        (math.cos(2 * math.pi * k / DIRECTIONS), math.sin(2 * math.pi * k / DIRECTIONS))
        for k in range(DIRECTIONS)
    ]
)


class Cell(NamedTuple):
    """Motions that share an area.

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

    def holds(self, twist: FloatArray) -> bool:
        """Return whether a body twist (v_x, v_y, yaw rate) [m/s, m/s, rad/s] is in the cell."""
        angle, (start, end) = math.atan2(twist[1], twist[0]), self.direction
        after, before = angle >= start, angle <= end
        return (
            self.speed[0] <= math.hypot(twist[0], twist[1]) <= self.speed[1]
            and self.yaw_rate[0] <= twist[2] <= self.yaw_rate[1]
            and (after and before if start <= end else after or before)
        )


def make_cells(speed: float, bands: int, yaw_rate: float, turns: int) -> tuple[Cell, ...]:
    """Return cells that divide all motions up to a speed and a yaw rate.

    Args:
        speed: largest speed [m/s].
        bands: number of equally wide bands of speed.
        yaw_rate: largest yaw rate to either side [rad/s].
        turns: number of equally wide bands of yaw rate.
    """
    words = [f"_turn_{turn + 1}" for turn in range(turns)]
    words = {1: [""], 3: ["_right", "_straight", "_left"]}.get(turns, words)
    half = math.pi / len(SECTORS)
    return tuple(
        Cell(
            f"{sector}_{band + 1}{word}",
            (speed * band / bands, speed * (band + 1) / bands),
            (_wrapped(2 * half * index - half), _wrapped(2 * half * index + half)),
            (yaw_rate * (2 * turn / turns - 1), yaw_rate * (2 * (turn + 1) / turns - 1)),
        )
        for band in range(bands)
        for index, sector in enumerate(SECTORS)
        for turn, word in enumerate(words)
    )


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


def calibration_stops(coverage: float, confidence: float) -> int:
    """Return the number of stops of a cell that a coverage with a confidence needs."""
    return math.ceil(math.log(1.0 - confidence) / math.log(coverage))


class Sweep(NamedTuple):
    """Area covered by a stop.

    Attributes:
        seed: number of the stop in the campaign.
        support: support function of the area [m], `DIRECTIONS` numbers separated by spaces.
    """

    seed: int
    support: str


@dataclasses.dataclass(frozen=True)
class StopCampaign:
    """The stops of a vehicle for the areas and for their check.

    Attributes:
        base: configuration of the loop, with the largest load at its largest offset.
        cells: cells that divide the motions.
        friction: friction of the ground, lowest and highest [1].
        reaction_time: time of constant motion from the alarm to the pedal [s].
        per_cell: number of stops of each cell for its area; higher numbers are held out.
        seed: seed of all draws.
        settling: time for which the vehicle rolls before the alarm, so that its loads settle [s].
    """

    base: experiment.ExperimentConfiguration
    cells: tuple[Cell, ...]
    friction: tuple[float, float]
    reaction_time: float
    per_cell: int
    seed: int
    settling: float = 0.2

    @property
    def fitted(self) -> int:
        """Number of stops for the areas; higher numbers are held out."""
        return self.per_cell * len(self.cells)

    @property
    def fingerprint(self) -> str:
        """Digest of everything except its number on which a stop depends."""
        fields = (getattr(self, field.name) for field in dataclasses.fields(self))
        return digest(*fields)

    def cell_of(self, number: int) -> int:
        """Return the index of the cell to which a stop belongs."""
        return number % len(self.cells)

    def extreme(self, number: int) -> bool:
        """Return whether the values of a stop are drawn mainly from the ends of their ranges."""
        return number < self.fitted or (number - self.fitted) // len(self.cells) % 2 == 0

    def configuration(self, number: int) -> experiment.ExperimentConfiguration:
        """Return the configuration of a stop, drawn at random."""
        random = np.random.default_rng([self.seed, number])
        draw = _extreme if self.extreme(number) else _uniform
        cell = self.cells[self.cell_of(number)]
        start, end = cell.direction
        load = self.base.vehicle.load
        vehicle = dataclasses.replace(
            self.base.vehicle,
            load=dataclasses.replace(
                load,
                mass=draw(random, 0.0, load.mass),
                x=draw(random, -abs(load.x), abs(load.x)),
                y=draw(random, -abs(load.y), abs(load.y)),
            ),
        )
        maneuver = ManeuverConfiguration(
            speed=draw(random, *cell.speed),
            direction_deg=math.degrees(draw(random, start, end if end > start else end + math.tau)),
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
                f"stop {number} of {self.cells[self.cell_of(number)].name} is not at rest after "
                f"{configuration.simulation.duration_limit:g} s at a friction of "
                f"{configuration.ground.friction:.2g}; give it longer, or more friction",
            )
        swept = support(run, footprint(configuration.vehicle), self.settling)
        return Sweep(number, " ".join(repr(value) for value in swept.tolist()))


def _uniform(random: np.random.Generator, low: float, high: float) -> float:
    return float(random.uniform(low, high))


def _extreme(random: np.random.Generator, low: float, high: float) -> float:
    """Draw the lower end, the upper end or a value between, each with probability 1/3."""
    return (low, high, _uniform(random, low, high))[int(random.integers(3))]


def footprint(vehicle: VehicleConfiguration) -> FloatArray:
    """Return points in `base_link` whose hull is the vehicle's footprint [m], shape (C, 2)."""
    x, y = 0.5 * vehicle.chassis_length, 0.5 * vehicle.chassis_width
    geometry = PlatformGeometry.from_wheels(vehicle.wheels)
    tread = geometry.radius[:, None] * geometry.rolling
    chassis = np.array([(x, y), (-x, y), (-x, -y), (x, -y)])
    return np.concatenate((chassis, geometry.position + tread, geometry.position - tread))


def support(run: compiled.FastRun, points: FloatArray, start: float) -> FloatArray:
    """Return the support function of the area covered by a run [m], shape (DIRECTIONS,).

    Args:
        run: run to be finished.
        points: the footprint in `base_link` [m], shape (C, 2).
        start: time from which the area counts; the frame is that of `base_link` at this time [s].
    """
    pose = run.pose[round(start * SECOND_NS / run.period_ns) :]
    angle = pose[:, 2] - pose[0, 2]
    turned = points @ _rotation(angle).transpose(0, 2, 1)  # (T, C, 2)
    moved = (pose[:, :2] - pose[0, :2]) @ _rotation(pose[0, 2])  # from odom into the frame
    swept = (turned + moved[:, None, :]).reshape(-1, 2)
    return np.asarray(np.max(swept @ _NORMALS.T, axis=0))


def _rotation(angle: FloatArray | float) -> FloatArray:
    """Return rotation matrices by angles [rad], shape (..., 2, 2)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    rows = np.stack((cosine, -sine, sine, cosine), axis=-1)
    return rows.reshape(*np.shape(angle), 2, 2)


def areas(campaign: StopCampaign, sweeps: Sequence[Sweep]) -> FloatArray:
    """Return H_k of every cell [m], shape (cells, DIRECTIONS), from its stops."""
    supports = supports_of(sweeps[: campaign.fitted])
    # Consecutive stops belong to consecutive cells.
    by_cell = supports.reshape(campaign.per_cell, len(campaign.cells), DIRECTIONS)
    hull = np.max(by_cell[:HULL_STOPS], axis=0)
    growth = np.max(by_cell[HULL_STOPS:] - hull, axis=(0, 2))
    return np.asarray(hull + np.maximum(growth, 0.0)[:, None])


def inside(
    campaign: StopCampaign, limits: FloatArray, sweeps: Sequence[Sweep]
) -> NDArray[np.bool_]:
    """Return for each stop whether it stays within the area of its cell, shape (stops,)."""
    cells = [campaign.cell_of(sweep.seed) for sweep in sweeps]
    return np.asarray(np.all(supports_of(sweeps) <= limits[cells], axis=1))


def supports_of(sweeps: Sequence[Sweep]) -> FloatArray:
    """Return h_k of stops [m], shape (stops, DIRECTIONS)."""
    numbers = [[float(word) for word in sweep.support.split()] for sweep in sweeps]
    return np.array(numbers).reshape(-1, DIRECTIONS)


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
    chosen: FloatArray = points[distinct] if np.any(distinct) else points[:1]
    return chosen
