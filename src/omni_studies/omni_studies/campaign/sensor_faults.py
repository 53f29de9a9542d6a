"""Stops with a fault of one sensor, two sensors or a brake, each determined by a seed.

The seed determines the law, whether the vehicle has an IMU, the vehicle and its braking maneuver
(`CASES`), and the fault. A `single` fault affects one channel. A `pair` or a `triple` affects two
or three channels with the same kind and onset, like a failure of a shared supply, clock or
calibration. Every third of these faults is intermittent. A `brake` fault affects the brake of one
wheel, before or during the stop. An `event` is ice under one side of the vehicle, from the middle
of the stop on, a payload at one corner, of which the assistant does not know, or a push against one
corner during the stop. For every eighth seed, a search for a worse fault changes one entry of the
fault at a time.

Stops with sensor faults are compared with the longer distance and the larger rotation of two stops
without the fault, unassisted and assisted. Stops with brake faults or events are compared with
unassisted braking with the same fault or event.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentConfiguration, ExperimentLibrary
from omni_runs.history import FastRun
from omni_runs.limit.bounds import heading_bound, maneuver_of, straight_bound
from omni_sim.push import NO_PUSH, Push
from omni_sim.sensor_configuration import CHANNELS, KINDS, FaultConfiguration
from omni_sim.vehicle.configuration import WheelCondition
from omni_studies.campaign import brake_detection, drawn_faults
from omni_studies.campaign.drawn_faults import SensorFault
from omni_tools.campaign.runner import digest

CASES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "straight_line": ("straight_line", "assisted", ()),
    "diagonal": ("straight_line", "assisted", ("maneuver.direction_deg=30", "maneuver.speed=8")),
    "slippery": ("straight_line", "assisted", ("ground.friction=0.4", "maneuver.speed=6")),
    "turn_while_translate": ("turn_while_translate", "k7", ()),
    "three_wheel_diagonal": ("three_wheel_diagonal", "assisted", ()),
    "table_2": ("straight_line", "assisted", ("vehicle=table_2_mecanum", "maneuver.speed=6")),
    "six_wheels": ("straight_line", "assisted", ("vehicle=six_wheel_mecanum", "maneuver.speed=6")),
}
"""Experiment, assisted variant and overrides, keyed by the name of the case."""

LAWS: dict[str, tuple[str, ...]] = {
    "sliding_mode": ("brake_assist.law=sliding_mode",),
    "allocation": ("brake_assist.law=allocation", "vehicle.brake.kind=proportional"),
}
"""Overrides of the experiment, keyed by law; `allocation` requires proportional brakes."""

EXTENTS = ("single", "single", "single", "pair", "triple", "brake", "brake", "event")
"""Extents of a fault; repeated entries are drawn more often."""

_PERIODS = 0.02, 0.6  # shortest period, of two samples, and longest one [s]
_BURSTS = 0.05, 0.3  # shortest and longest duration of an intermittent fault [s]
# Channel, and smallest and largest amplitude of each event: friction of ice relative to the ground,
# mass of the payload relative to that of the vehicle, and force of the push relative to its weight,
# from that of a person to that of a collision that changes the speed by up to 1.5 m/s [1].
_EVENTS = {
    "ice": ("ground", 0.1, 0.3),
    "payload": ("load", 0.1, 0.5),
    "push": ("chassis", 0.03, 0.3),
}
_PUSHES = 0.05, 0.5  # shortest and longest duration of a push [s]
_CHANNELS = {True: ("twist", "gyro", "accelerometer", "encoder"), False: ("twist", "encoder")}
_BRAKES = ("brake", "open_valve", "stuck_brake")  # fields of `WheelCondition`
# The encoders have 4096 counts, and no lines are rendered. A stop longer than the limit counts as
# failed.
_SETTING = (
    *WITHOUT_CAMERAS,
    *("simulation.duration_limit=20", "encoders.resolution=4096"),
    "brake_assist.fault_detection=true",
)
_SEARCHED = 8  # every n-th seed is followed by a search for a worse fault
_STEPS = 10  # number of faults that a search tries


class Setting(NamedTuple):
    """Conditions of a stop: the law, whether the vehicle has an IMU, and one of `CASES`."""

    law: str
    imu: bool
    case: str


class Reference(NamedTuple):
    """Reference stop: whether it comes to rest, distance [m], change of orientation [deg]."""

    rest: bool
    distance: float
    rotation: float


class StopWithFault(NamedTuple):
    """Result of a stop with a fault.

    Attributes:
        seed: seed of the run.
        law: law of the setting.
        imu: whether there is an IMU, 0 or 1.
        case: vehicle and braking maneuver, one of `CASES`.
        extent: extent of the fault, one of `EXTENTS`.
        channel: faulty channels, as in `SensorFault`.
        kind: kind of the fault, as in `SensorFault`.
        axis: index of the faulty axis or wheel, -1 for all.
        onset: time of the fault after the pedal is pressed [s].
        amplitude: amplitude of the fault, in the unit of the first channel.
        period: as in `SensorFault` [s].
        burst: duration of an intermittent fault, 0 if the fault is permanent [s].
        counted: whether the reference stop comes to rest, 0 or 1.
        rest: whether the vehicle comes to rest, 0 or 1.
        distance: stopping distance, divided by the distance of the reference stop [1].
        rotation: rotation minus the rotation of the reference stop [deg].
        all_on_distance: for a brake fault, distance of the stop with all brakes on from the onset,
            as after a detection without delay; otherwise that of the reference stop; divided by the
            distance of the reference stop [1].
        all_on_rotation: rotation of this stop minus that of the reference stop [deg].
        assisting: whether the assistant still released a brake more than 0.5 s after the onset
            while the vehicle was faster than 1 m/s; also 1 if the vehicle was never that fast after
            this time.
        bound: for a lost brake, lower bound of the distance of stops that keep the heading; for
            ice, that of stops that keep heading and line of motion; divided by the distance of the
            reference stop [1]. It is 0 for other faults, and if the vehicle rotates at the start of
            braking.
        observable: for a brake lost during the stop, time from the loss until its effect could be
            observed; NaN if never, and for other faults [s].
        found: time from the loss until the assistant reports this brake; NaN if never [s].
        false_brake: whether the assistant reports a working brake as failed, 0 or 1.
    """

    seed: int
    law: str
    imu: int
    case: str
    extent: str
    channel: str
    kind: str
    axis: int
    onset: float
    amplitude: float
    period: float
    burst: float
    counted: int
    rest: int
    distance: float
    rotation: float
    all_on_distance: float
    all_on_rotation: float
    assisting: int
    bound: float
    observable: float
    found: float
    false_brake: int

    @property
    def group(self) -> str:
        """Name of the group to which this stop belongs in the study's metrics."""
        name = f"{self.law}_{'imu' if self.imu else 'no_imu'}_{self.extent}"
        return f"{name}_{self.kind}" if self.extent == "event" else name


class FaultyStops:
    """Callable that draws conditions and fault with a seed, and runs the stop.

    Args:
        library: library that contains the experiment and vehicle files.
        changes: ``dotted.key=value`` changes of all assistants and vehicles; if they name a law,
            only this law is run.
    """

    def __init__(self, library: ExperimentLibrary, changes: Sequence[str] = ()) -> None:
        chosen = [c.split("=", 1)[1] for c in changes if c.startswith("brake_assist.law=")]
        laws = {law: LAWS.get(law, (f"brake_assist.law={law}",)) for law in chosen or LAWS}
        self._laws = tuple(laws)
        self._bases = {
            (Setting(law, imu, case), variant != "unassisted"): library.load(
                experiment,
                variant,
                [*_SETTING, *own, *settings, *changes, f"imu.enabled={str(imu).lower()}"],
            )
            for law, settings in laws.items()
            for case, (experiment, assisted, own) in CASES.items()
            for imu in (True, False)
            for variant in ("unassisted", assisted)
        }
        self._references: dict[Setting, Reference] = {}

    @property
    def fingerprint(self) -> str:
        """Digest of all settings that determine the stops, except the seeds."""
        ranges = drawn_faults.SIZES, _PERIODS, _BURSTS, _EVENTS, _PUSHES
        drawn = EXTENTS, KINDS, ranges, drawn_faults.SHARES, _BRAKES, list(_CHANNELS.items())
        return digest(list(self._bases.values()), drawn, _SEARCHED, _STEPS)

    def __call__(self, seed: int) -> StopWithFault:
        """Run the stop with conditions and fault drawn with a seed, and return the result.

        If a search for a worse fault follows, the worst stop is returned.
        """
        random = np.random.default_rng([seed, 29])
        imu = bool(random.random() < 0.6)
        setting = Setting(str(random.choice(self._laws)), imu, str(random.choice(list(CASES))))
        extent = str(random.choice(EXTENTS))
        fault = self._draw(random, setting, extent)
        worst = self.run(setting, fault, seed)
        if seed % _SEARCHED == 0:
            for _ in range(_STEPS):
                changed = self._change(random, setting, extent, fault)
                tried = self.run(setting, changed, seed)
                if _severity(tried) > _severity(worst):
                    worst, fault = tried, changed
        return worst

    def run(self, setting: Setting, fault: SensorFault, seed: int = 0) -> StopWithFault:
        """Run a stop with a fault, and return the result compared with the reference stop."""
        base = self._bases[setting, True]
        time = max(round(base.maneuver.brake_time + fault.onset, 3), 0.0)
        push, least = NO_PUSH, 0.0
        if fault.channel == "brake":
            extent, bound = "brake", heading_bound if fault.kind == "brake" else None
            wheel = list(base.vehicle.wheels)[fault.axis]
            condition = WheelCondition(onset=time, **{fault.kind: fault.amplitude})
            changed: dict[str, Any] = {
                "vehicle": dataclasses.replace(base.vehicle, conditions={wheel: condition})
            }
        elif fault.kind in _EVENTS:
            extent, bound = "event", straight_bound if fault.kind == "ice" else None
            changed, push = _event(base, fault, time)
        else:
            extent, bound = ("single", "pair", "triple")[fault.channel.count("+")], None
            changed = {"faults": drawn_faults.configurations(fault, time)}
        faulty = dataclasses.replace(base, **changed)
        if extent in ("brake", "event"):
            unassisted = dataclasses.replace(self._bases[setting, False], **changed)
            reference = all_on = _reference([run_fast_loop(unassisted, push=push)])
        else:
            reference = all_on = self.reference(setting)
        if extent == "brake":
            all_on = _reference([run_fast_loop(_without_sensors(faulty, time))])
        run = run_fast_loop(faulty, push=push)
        if bound is not None:
            question = faulty.vehicle, faulty.ground, maneuver_of(faulty.maneuver)
            least = np.nan_to_num(bound(*question, math.inf).distance)
        detection = brake_detection.UNKNOWN
        if (fault.channel, fault.kind) == ("brake", "brake") and fault.onset >= 0.0:
            detection = brake_detection.detection(run, base, fault.axis, time)
        return StopWithFault(
            seed,
            setting.law,
            int(setting.imu),
            setting.case,
            extent,
            *fault,
            counted=int(reference.rest),
            rest=int(run.stopped),
            distance=run.stopping_distance / reference.distance,
            rotation=run.orientation_change - reference.rotation,
            all_on_distance=all_on.distance / reference.distance,
            all_on_rotation=all_on.rotation - reference.rotation,
            assisting=int(_still_assists(run, base, fault)),
            bound=float(least / reference.distance),
            **detection._asdict(),
            false_brake=int(run.failed >= 0 and (extent != "brake" or run.failed != fault.axis)),
        )

    def reference(self, setting: Setting) -> Reference:
        """Return the longer distance and the larger rotation of two fault-free stops.

        The stops are an unassisted and an assisted one under the conditions of `setting`.
        """
        if setting not in self._references:
            bases = [self._bases[setting, assisted] for assisted in (False, True)]
            self._references[setting] = _reference([run_fast_loop(base) for base in bases])
        return self._references[setting]

    def _draw(self, random: np.random.Generator, setting: Setting, extent: str) -> SensorFault:
        wheels = len(self._bases[setting, True].vehicle.wheels)
        onset = round(float(random.uniform(-0.1, 1.4)), 3)
        if random.random() < 0.2:
            onset = round(float(random.uniform(-1.5, -0.1)), 3)  # before the pedal is pressed
        if extent == "event":
            kind = str(random.choice(list(_EVENTS)))
            event, low, high = _EVENTS[kind]
            place, size = int(random.integers(0, 4)), round(float(random.uniform(low, high)), 2)
            onset = 0.0 if kind == "payload" else abs(onset)
            time = round(float(random.uniform(*_PUSHES)), 2) if kind == "push" else 0.1
            place = place % 2 if kind == "ice" else place
            return SensorFault(event, kind, place, onset, size, time)
        if extent == "brake":
            kind = str(random.choice(_BRAKES))
            before = random.random() < 0.5
            amplitude = {"brake": 0.0, "open_valve": 1.0, "stuck_brake": 0.5}[kind]
            wheel = int(random.integers(0, wheels))
            return SensorFault("brake", kind, wheel, -9.0 if before else abs(onset), amplitude, 0.1)
        kind = str(random.choice(KINDS))
        if extent in ("pair", "triple"):
            count = min(2 if extent == "pair" else 3, len(_CHANNELS[setting.imu]))
            chosen = random.choice(_CHANNELS[setting.imu], count, replace=False)
            channel, axis = "+".join(sorted(map(str, chosen))), int(random.integers(-1, 3))
        else:
            channel = str(random.choice(_CHANNELS[setting.imu]))
            # A single fault of encoders affects one wheel. A single fault of another channel
            # affects one axis or all axes.
            axes = {"twist": 3, "accelerometer": 2, "gyro": 1, "encoder": wheels}[channel]
            axis = int(random.integers(0 if channel in ("encoder", "gyro") else -1, axes))
        low, high = drawn_faults.size_range(channel.split("+")[0], kind, axis)
        size = float(np.exp(random.uniform(np.log(low), np.log(high))))
        amplitude = round(size * float(random.choice([-1.0, 1.0])), 3)
        period = round(float(np.exp(random.uniform(*np.log(_PERIODS)))), 2)
        bursts = random.random() < 1.0 / 3.0
        burst = round(float(random.uniform(*_BURSTS)), 2) if bursts else 0.0
        return SensorFault(channel, kind, axis, onset, amplitude, period, burst)

    def _change(
        self, random: np.random.Generator, setting: Setting, extent: str, fault: SensorFault
    ) -> SensorFault:
        """Return the next fault of a search: a copy with one changed entry, or a new fault."""
        other = self._draw(random, setting, extent)
        entry = str(random.choice(["kind", "onset", "amplitude", "period", "burst", "all"]))
        if entry == "all" or (extent in ("brake", "event") and entry != "onset"):
            return other
        if entry == "kind":
            return fault._replace(kind=other.kind)
        if entry == "onset":
            moved = round(fault.onset + float(random.normal(0.0, 0.1)), 3)
            return fault._replace(onset=moved)
        if entry == "amplitude":
            factor = float(np.exp(random.normal(0.0, 0.4)))
            return fault._replace(amplitude=round(fault.amplitude * factor, 3))
        return fault._replace(**{entry: getattr(other, entry)})


def _event(
    base: ExperimentConfiguration, fault: SensorFault, time: float
) -> tuple[dict[str, Any], Push]:
    """Return changes of an experiment, and the push, that an event at a time [s] causes."""
    if fault.kind == "ice":
        ground = drawn_faults.with_ice(base.ground, fault, run_fast_loop(base), time)
        return {"ground": ground}, NO_PUSH
    if fault.kind == "payload":
        return {"vehicle": drawn_faults.with_payload(base.vehicle, fault)}, NO_PUSH
    return {}, drawn_faults.push_of(base.vehicle, fault, run_fast_loop(base), time)


def _without_sensors(base: ExperimentConfiguration, time: float) -> ExperimentConfiguration:
    """Return an experiment without sensors from a time on [s], so that all brakes are on."""
    lost = {name: FaultConfiguration(channel=name, kind="drop_out", time=time) for name in CHANNELS}
    return dataclasses.replace(base, faults=lost)


def _reference(runs: Sequence[FastRun]) -> Reference:
    return Reference(
        all(run.stopped for run in runs),
        max(run.stopping_distance for run in runs),
        max(run.orientation_change for run in runs),
    )


def _severity(stop: StopWithFault) -> float:
    """Return the severity of a stop [1]: 1 at the limit of distance or rotation.

    If the vehicle does not come to rest, 100 is added. A stop that is not counted has severity 0.
    """
    limit = limits(stop.extent, imu=bool(stop.imu))
    far = (stop.distance - 1.0) / ((limit.distance or 2.0) - 1.0)
    turned = stop.rotation / limit.rotation if limit.rotation else 0.0
    return stop.counted * (max(far, turned) + 100.0 * (1 - stop.rest))


def _still_assists(
    run: FastRun, configuration: ExperimentConfiguration, fault: SensorFault
) -> bool:
    start = configuration.maneuver.brake_time + max(fault.onset, 0.0) + 0.5
    first = np.searchsorted(run.stamp_ns, round(start * 1e9), side="right") - 1
    released = np.any(run.enable[first:] < 0.5, axis=1)
    moving = np.hypot(run.twist[first:, 0], run.twist[first:, 1]) > 1.0
    return bool(not np.any(moving) or np.any(released[moving]))


class StopLimits(NamedTuple):
    """Limits on the results of stops whose faults have a given extent; None for no limit.

    Attributes:
        distance: limit on the distance, divided by the distance of the reference stop [1].
        rotation: limit on the rotation minus the rotation of the reference stop [deg].
        assisting: lower limit on the share of stops with continued assistance [%].
    """

    distance: float | None
    rotation: float | None
    assisting: float | None


def limits(extent: str, *, imu: bool) -> StopLimits:
    """Return the limits on stops whose faults have the given extent; they hold for both laws."""
    if extent == "brake":
        return StopLimits(1.2, 5.0, None)
    if extent in ("pair", "triple"):
        return StopLimits(1.5 if imu else None, None, None)
    if extent == "event":
        return StopLimits(1.5, 10.0, None)
    return StopLimits(1.15, 5.0, 92.0) if imu else StopLimits(1.5, 15.0, None)


def loss_of_twist(stops: FaultyStops, onset: float = 0.3) -> float:
    """Return the change of orientation [deg] in ``straight_line`` if the twist is lost permanently.

    Args:
        stops: campaign that runs the stop with each of its laws; the larger rotation is returned.
        onset: time of the drop-out after the start of braking [s].
    """
    fault = SensorFault("twist", "drop_out", -1, onset, 0.0, 0.1)
    settings = [Setting(law, True, "straight_line") for law in stops._laws]
    return max(
        stops.run(setting, fault).rotation + stops.reference(setting).rotation
        for setting in settings
    )
