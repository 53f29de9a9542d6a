"""Stops during which one sensor lies, in any way: what one number, the seed of a run, makes of it.

Drawn are the vehicle with its braking (`CASES`), whether it has an IMU, and the lie: which channel,
which axis or wheel, how, by how much and from when on. Every `SEARCH_SHARE`-th seed does not stop
at one lie: it goes on to the worst that it can find nearby, by changing one entry after the other.
Everything is compared with the longer stop and the larger rotation of unassisted braking and of
assisted braking with honest sensors.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_analysis.loop.compiled import FastRun, run_fast_loop
from omni_analysis.loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_platform.configuration import to_mapping
from omni_sim.faults import KINDS, FaultConfiguration

CASES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "straight_line": ("straight_line", "assisted", ()),
    "diagonal": ("straight_line", "assisted", ("maneuver.direction_deg=30", "maneuver.speed=8")),
    "slippery": ("straight_line", "assisted", ("ground.friction=0.4", "maneuver.speed=6")),
    "turn_while_translate": ("turn_while_translate", "k7", ()),
    "three_wheel_diagonal": ("three_wheel_diagonal", "assisted", ()),
    "table_2": ("straight_line", "assisted", ("vehicle=table_2_mecanum", "maneuver.speed=6")),
    "six_wheels": ("straight_line", "assisted", ("vehicle=six_wheel_mecanum", "maneuver.speed=6")),
}
"""Experiment, its variant with the assistant, and what differs from it, by name."""

SEARCH_SHARE = 8
SEARCH_STEPS = 10

# Size of a lie in the unit of the channel, from and to; the last axis of the twist is a rate.
_SIZES = {
    "twist": (0.1, 5.0),
    "rate": (0.03, 3.0),
    "gyro": (0.03, 3.0),
    "accelerometer": (0.3, 15.0),
    "encoder": (0.5, 40.0),
}
_SHARES = ("scale", "echo")  # their size is a share
_CHANNELS = {True: ("twist", "gyro", "accelerometer", "encoder"), False: ("twist", "encoder")}
# Encoders of 4096 counts; no picture is needed; a stop that takes longer has failed.
_SETTING = (
    "feedback=velocity_sensor",
    "simulation.render_lines=false",
    "simulation.duration_limit=20",
    "encoders.resolution=4096",
    "brake_assist.second_opinion=true",
)


class Lie(NamedTuple):
    """A lie: entries of `FaultConfiguration`, with the onset from the pedal on [s]."""

    channel: str
    kind: str
    axis: int
    onset: float
    amplitude: float
    period: float


class Reference(NamedTuple):
    """Stops to compare with: distance [m] and change of orientation [deg] of the worse one."""

    distance: float
    rotation: float


class Stop(NamedTuple):
    """What a stop with a lying sensor comes to.

    Attributes:
        seed: of the run.
        imu: whether there is one, 0 or 1.
        case: one of `CASES`.
        channel: entries of the lie, as in `Lie`.
        kind: likewise.
        axis: likewise.
        onset: likewise [s].
        amplitude: likewise.
        period: likewise [s].
        rest: whether the vehicle comes to rest, 0 or 1.
        distance: over that of the reference [1].
        rotation: beyond that of the reference [deg].
        assisting: whether brakes were still released after the lie had lasted for half a second, or
            the stop was over by then, 0 or 1.
    """

    seed: int
    imu: int
    case: str
    channel: str
    kind: str
    axis: int
    onset: float
    amplitude: float
    period: float
    rest: int
    distance: float
    rotation: float
    assisting: int


class LyingSensors:
    """Makes stops from their seeds.

    Args:
        library: where experiments and vehicles are.
        changes: of every assistant and vehicle, as ``dotted.key=value``.
    """

    def __init__(self, library: ExperimentLibrary, changes: Sequence[str] = ()) -> None:
        self._bases = {
            (case, imu, variant != "unassisted"): library.load(
                experiment,
                variant,
                [*_SETTING, *own, *changes, f"imu.enabled={str(imu).lower()}"],
            )
            for case, (experiment, assisted, own) in CASES.items()
            for imu in (True, False)
            for variant in ("unassisted", assisted)
        }
        self._references: dict[tuple[str, bool], Reference] = {}

    @property
    def fingerprint(self) -> str:
        """A digest of everything that the stops depend on besides their seeds."""
        bases = [to_mapping(base) for base in self._bases.values()]
        text = json.dumps([bases, SEARCH_SHARE, SEARCH_STEPS])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def __call__(self, seed: int) -> Stop:
        """Draw and run a seed."""
        random = np.random.default_rng([seed, 12])
        imu = bool(random.random() < 0.6)
        case = str(random.choice(list(CASES)))
        lie = self._draw(random, case, imu)
        worst = self.run(seed, case, lie, imu=imu)
        if seed % SEARCH_SHARE == 0:
            for _ in range(SEARCH_STEPS):
                tried = self.run(seed, case, self._change(random, case, imu, lie), imu=imu)
                if _badness(tried) > _badness(worst):
                    worst, lie = tried, _lie_of(tried)
        return worst

    def run(self, seed: int, case: str, lie: Lie, *, imu: bool) -> Stop:
        """Run a stop with a lie."""
        base = self._bases[case, imu, True]
        fault = FaultConfiguration(
            channel=lie.channel,
            kind=lie.kind,
            axis=lie.axis,
            time=max(round(base.maneuver.brake_time + lie.onset, 3), 0.0),
            amplitude=lie.amplitude,
            period=lie.period,
        )
        run = run_fast_loop(dataclasses.replace(base, faults={"lie": fault}))
        reference = self.reference(case, imu=imu)
        return Stop(
            seed,
            int(imu),
            case,
            *lie,
            rest=int(run.stopped),
            distance=run.stopping_distance / reference.distance,
            rotation=run.orientation_change - reference.rotation,
            assisting=int(_still_assists(run, base, lie)),
        )

    def reference(self, case: str, *, imu: bool) -> Reference:
        """Return the worse of unassisted braking and of assisted braking with honest sensors."""
        if (case, imu) not in self._references:
            runs = [run_fast_loop(self._bases[case, imu, assisted]) for assisted in (False, True)]
            self._references[case, imu] = Reference(
                max(run.stopping_distance for run in runs),
                max(run.orientation_change for run in runs),
            )
        return self._references[case, imu]

    def _draw(self, random: np.random.Generator, case: str, imu: bool) -> Lie:
        channel = str(random.choice(_CHANNELS[imu]))
        kind = str(random.choice(KINDS))
        wheels = len(self._bases[case, imu, True].vehicle.wheels)
        # A single fault is one wheel, one gyro, but any axes of the others.
        axes = {"twist": 3, "accelerometer": 2, "gyro": 1, "encoder": wheels}[channel]
        lowest = 0 if channel in ("encoder", "gyro") else -1
        axis = int(random.integers(lowest, axes))
        rate = channel == "twist" and axis == 2
        low, high = (0.05, 1.5) if kind in _SHARES else _SIZES["rate" if rate else channel]
        size = float(np.exp(random.uniform(np.log(low), np.log(high))))
        return Lie(
            channel,
            kind,
            axis,
            round(float(random.uniform(-0.2, 1.2)), 2),
            round(size * float(random.choice([-1.0, 1.0])), 3),
            round(float(random.uniform(0.01, 0.6)), 2),
        )

    def _change(self, random: np.random.Generator, case: str, imu: bool, lie: Lie) -> Lie:
        """Return a lie that differs in one entry."""
        other = self._draw(random, case, imu)
        entry = str(random.choice(["kind", "onset", "amplitude", "period", "all"]))
        if entry == "all":
            return other
        if entry == "kind":
            return lie._replace(kind=other.kind)
        if entry == "onset":
            return lie._replace(onset=round(lie.onset + float(random.normal(0.0, 0.1)), 2))
        if entry == "amplitude":
            factor = float(np.exp(random.normal(0.0, 0.4)))
            return lie._replace(amplitude=round(lie.amplitude * factor, 3))
        return lie._replace(period=other.period)


def _badness(stop: Stop) -> float:
    """Return how bad a stop is: 1 at the limits of distance or rotation."""
    limit = DISTANCE_LIMITS[bool(stop.imu)]
    far = (stop.distance - 1.0) / (limit - 1.0)
    turned = stop.rotation / ROTATION_LIMIT if stop.imu else 0.0
    return max(far, turned) + 100.0 * (1 - stop.rest)


def _lie_of(stop: Stop) -> Lie:
    return Lie(stop.channel, stop.kind, stop.axis, stop.onset, stop.amplitude, stop.period)


def _still_assists(run: FastRun, configuration: ExperimentConfiguration, lie: Lie) -> bool:
    start = configuration.maneuver.brake_time + max(lie.onset, 0.0) + 0.5
    first = round(start * 1e9) // run.period_ns
    released = np.any(run.record.enable[first:] < 0.5, axis=1)
    moving = np.hypot(run.twist[first:, 0], run.twist[first:, 1]) > 1.0
    return bool(not np.any(moving) or np.any(released[moving]))


DISTANCE_LIMITS = {True: 1.15, False: 1.5}
"""Of the distance over the reference, with an IMU and without [1]."""

ROTATION_LIMIT = 5.0
"""Of the rotation beyond the reference, with an IMU [deg]."""


def loss_of_twist(stops: LyingSensors, onset: float) -> float:
    """Return the change of orientation [deg] on ``straight_line`` if the twist is lost for good.

    Args:
        stops: makes the stop.
        onset: time from the pedal on [s].
    """
    lie = Lie("twist", "drop_out", -1, onset, 0.0, 0.1)
    stop = stops.run(0, "straight_line", lie, imu=True)
    return stop.rotation + stops.reference("straight_line", imu=True).rotation
