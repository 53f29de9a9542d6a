"""Stopping distance and rotation with different sources of the body twist.

The same random stops are run without the assistant, and with each combination of law and source,
with the brakes of the vehicle, and with or without an IMU. The sources are an ideal sensor, line
cameras, optical-flow chips, wheel odometry, dead reckoning, and ideal sensors with delay or a low
rate. The table shows the sources with which assistance does more harm than good.

Camera lines are rendered in the first random stops, and in the stops of the named experiments, such
as ``straight_line``. In all other stops, an error model replaces the cameras.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from omni_core.brakes import TYPICAL, typical_changes
from omni_core.configuration import ConfigurationError, parameter
from omni_core.kinematics import PlatformKinematics
from omni_core.sensors import LineSensor
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary, changed, short_name
from omni_runs.figures import style
from omni_runs.ground_choice import prepare_grounds
from omni_runs.loop import run_closed_loop
from omni_runs.metrics import Metric, run_metrics
from omni_sim.masses import MassConfiguration
from omni_sim.texture.cache import TextureCache
from omni_sim.twist_sources import SOURCES, SourceModel
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions, digest
from omni_tools.ros_params.feedback_results import conditions_of, harm_sentence

_LAWS = ("sliding_mode", "allocation")
_UNASSISTED = "unassisted"
_NAMED = "named"
_EXPERIMENTS = ("straight_line", "three_wheel_diagonal", "ice_patch", "turn_while_translate")
_VEHICLES = ("mecanum_forklift", "three_wheel_robot", "six_wheel_mecanum")
_HEAVIEST_LOAD = 0.4  # largest random load, divided by the mass of the vehicle [1]


class Options(CampaignOptions):
    """Options of the study ``feedback``: vehicles, sources of the twist, and number of stops."""

    vehicle: tuple[str, ...] = parameter(_VEHICLES)
    """vehicle: a file of config/vehicles/, a path, or a vehicle's folder"""
    source: tuple[str, ...] = parameter(tuple(SOURCES), choices=tuple(SOURCES))
    """source of the twist"""
    runs: int = parameter(200, minimum=1, maximum=10000)
    """number of random stops of each vehicle"""
    rendered: int = parameter(20, minimum=0, maximum=10000)
    """number of random stops of each vehicle in which camera lines are rendered"""
    speed: float = parameter(2.0, unit="m/s", above=0.1, maximum=20.0)
    """maximum speed of the random stops"""
    named: bool = parameter(False)
    """also run the named experiments, each with its own vehicle and speed"""
    brakes: str | None = parameter(None, choices=tuple(TYPICAL))
    """kind of brakes, with typical timing (default: the brakes of each vehicle)"""
    without_imu: bool = parameter(False)
    """remove the IMU, which the assistant uses to estimate the motion while the twist is missing,
    and to detect faults"""


class StopWithSource(NamedTuple):
    """Result of a stop with one law and one source of the twist.

    Attributes:
        seed: number of the case, as in `Cases.run`.
        vehicle: name of the vehicle's file, or ``named`` for a named experiment.
        stop: number of the stop. Stops with the same vehicle and number differ only in law and
            source.
        law: name of the control law, or ``unassisted``.
        source: source of the twist.
        distance: stopping distance [m].
        rotation: change of orientation [deg].
    """

    seed: int
    vehicle: str
    stop: int
    law: str
    source: str
    distance: float
    rotation: float


Table = Mapping[tuple[str, str, str], Mapping[str, float]]
"""Values of all quantities, keyed by vehicle, law and source of the twist."""


@dataclass(frozen=True)
class Cases:
    """All cases of the campaign; a case is a stop with one law and one source of the twist."""

    bases: dict[str, ExperimentConfiguration]
    named: tuple[ExperimentConfiguration, ...]
    cameras: dict[str, Mapping[str, LineSensor]]
    options: Options

    @classmethod
    def of(cls, library: ExperimentLibrary, options: Options) -> Cases:
        """Return the cases for the options, and load vehicles, experiments and cameras."""
        changes = [
            "feedback=velocity_sensor",
            "simulation.render_lines=false",
            *(typical_changes(options.brakes) if options.brakes else ()),
            f"imu.enabled={str(not options.without_imu).lower()}",
            # A longer time at rest would take a quarter of the computing time and change distances
            # by 2 mm.
            "simulation.settling_time=0.2",
        ]
        bases: dict[str, ExperimentConfiguration] = {}
        for path in options.vehicle:
            if (name := short_name(path)) in bases:
                raise ConfigurationError("--vehicle", f"names a vehicle twice: {name}")
            base = library.load("straight_line", "assisted", [f"vehicle={path}", *changes])
            if library.located("experiments", path) != path:  # a folder with an experiment
                own = library.load(path, overrides=changes)
                parts = ("vehicle", "imu", "encoders", "brake_assist")
                base = dataclasses.replace(base, **{part: getattr(own, part) for part in parts})
            bases[name] = base
        named = [
            library.load(name, overrides=changes)
            for name in (_EXPERIMENTS if options.named else ())
        ]
        cameras = {
            name: library.load(
                "straight_line", "assisted", [f"sensors={name}", f"maneuver.speed={options.speed}"]
            ).sensors
            for name in (SOURCES[source].cameras for source in options.source)
            if name
        }
        return cls(bases, tuple(named), cameras, options)

    @property
    def _each(self) -> list[tuple[str, str]]:
        """Law and source of the twist for each run of a stop; the unassisted run is the first."""
        sources = self.options.source
        return [(_UNASSISTED, "ideal"), *((law, one) for law in _LAWS for one in sources)]

    @property
    def groups(self) -> list[str]:
        """Names of the vehicles, and ``named`` for the named experiments."""
        return [*self.bases, *([_NAMED] if self.named else ())]

    def __len__(self) -> int:
        stops = len(self.bases) * self.options.runs + len(self.named)
        return stops * len(self._each)

    def run(self, number: int) -> StopWithSource:
        """Run the case with the given number."""
        rest, case = divmod(number, len(self._each))
        place = min(rest // self.options.runs, len(self.bases))
        stop = rest - place * self.options.runs
        vehicle, (law, name) = self.groups[place], self._each[case]
        source = SOURCES[name]
        if vehicle == _NAMED:
            configuration = self.named[stop]
        else:
            configuration = _drawn(self.bases[vehicle], stop, self.options.speed)
        assisted = law != _UNASSISTED
        assistant = {"enabled": assisted, "law": law if assisted else _LAWS[0]}
        configuration = changed(configuration, brake_assist=assistant)
        if source.cameras and (vehicle == _NAMED or stop < self.options.rendered):
            configuration = _rendered(configuration, self.cameras[source.cameras])
            metrics = run_metrics(run_closed_loop(configuration))
        else:
            kinematics = PlatformKinematics.of(configuration.vehicle.wheels)
            model = SourceModel(source, kinematics, stop)
            metrics = run_metrics(run_fast_loop(configuration, model.measure))
        quantities = ("stopping_distance", "orientation_change")
        return StopWithSource(
            number, vehicle, stop, law, name, *(metrics[one].value for one in quantities)
        )


def _drawn(base: ExperimentConfiguration, stop: int, speed: float) -> ExperimentConfiguration:
    """Return an experiment with a random motion, friction and load.

    Args:
        base: experiment with the vehicle.
        stop: number of the stop, which is the seed.
        speed: limit on the initial speed [m/s].
    """
    random = np.random.default_rng([7, stop])
    vehicle = base.vehicle
    mass = (1.0 + 0.5 * _HEAVIEST_LOAD) * vehicle.body.mass  # with an average load
    reach = 0.3 * vehicle.chassis_length, 0.3 * vehicle.chassis_width
    load = MassConfiguration(
        mass=random.uniform(0.0, _HEAVIEST_LOAD) * vehicle.body.mass,
        x=random.uniform(-1.0, 1.0) * reach[0],
        y=random.uniform(-1.0, 1.0) * reach[1],
        height=vehicle.body.height,
        yaw_inertia=0.0,
    )
    maneuver = {
        "speed": random.uniform(0.25, 1.0) * speed,
        "direction_deg": random.uniform(-180.0, 180.0),
        "yaw_rate_deg": random.uniform(-30.0, 30.0) if stop % 2 else 0.0,
        "brake_time": 0.3,
    }
    return changed(
        base,
        seed=stop,
        vehicle={"load": load},
        brake_assist={"nominal_mass": mass},
        ground={"friction": random.uniform(0.4, 1.0)},
        maneuver=maneuver,
    )


def _rendered(
    configuration: ExperimentConfiguration, cameras: Mapping[str, LineSensor]
) -> ExperimentConfiguration:
    """Return an experiment with line cameras at positions that are scaled to the chassis."""
    # The positions in the files are for a chassis of the default size.
    along = configuration.vehicle.chassis_length / VehicleConfiguration.chassis_length
    across = configuration.vehicle.chassis_width / VehicleConfiguration.chassis_width
    placed = {
        name: dataclasses.replace(camera, x=along * camera.x, y=across * camera.y)
        for name, camera in cameras.items()
    }
    return changed(
        configuration,
        feedback="optical",
        sensors=placed,
        odometry={"sensors": placed},
        simulation={"render_lines": True},
    )


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run all cases, and write table and figure."""
    cases = Cases.of(study.experiments, options)
    stops = (*cases.bases.values(), *cases.named)
    rendered = (_rendered(stop, one) for stop in stops for one in cases.cameras.values())
    prepare_grounds(rendered, TextureCache.of_user())
    given = (options.source, options.runs, options.rendered, options.speed)
    fingerprint = digest(cases.bases, cases.named, *given)
    rows = study.campaign(cases.run, range(len(cases)), StopWithSource, options, fingerprint)
    table = {
        (vehicle, law, source): _results(rows, vehicle, law, source)
        for vehicle in cases.groups
        for law in _LAWS
        for source in options.source
    }
    metrics = {
        f"{quantity}.{'_'.join(key)}": Metric(value, "deg" if "rotation" in quantity else "1")
        for key, found in table.items()
        for quantity, value in found.items()
    }
    for vehicle in cases.groups:
        study.figure(f"{vehicle}.png", _figure(table, vehicle, options.source))
    bases = cases.bases.items()
    conditions = {name: conditions_of(one.brake_assist, one.imu.enabled) for name, one in bases}
    return dataclasses.replace(study.result(metrics, *_findings(table)), conditions=conditions)


def _results(
    rows: Sequence[StopWithSource], vehicle: str, law: str, source: str
) -> dict[str, float]:
    """Return statistics of the stops with one vehicle, law and source, keyed by name.

    Distances are divided by those of the same stops without the assistant [1]; rotations are in
    degrees; ``harm`` is 1 if assistance does more harm than good, otherwise 0.
    """
    own = {row.stop: row for row in rows if (row.vehicle, row.law) == (vehicle, _UNASSISTED)}
    stops = [
        (row, own[row.stop])
        for row in rows
        if (row.vehicle, row.law, row.source) == (vehicle, law, source)
    ]
    # The distance of a stop that does not come to rest counts as infinite.
    ratios = [
        math.inf if math.isnan(row.distance) else row.distance / max(free.distance, 0.05)
        for row, free in stops
    ]
    turned = [math.inf if math.isnan(row.rotation) else row.rotation for row, _ in stops]
    free = [free.rotation for _, free in stops]
    found = {
        "distance_ratio_median": float(np.median(ratios)),
        "distance_ratio_p95": float(np.percentile(ratios, 95, method="higher")),
        "rotation_median": float(np.median(turned)),
        "rotation_p95": float(np.percentile(turned, 95, method="higher")),
        "rotation_unassisted_p95": float(np.percentile(free, 95, method="higher")),
    }
    return found | {"harm": float(_harms(found))}


def _findings(table: Table) -> list[str]:
    return [harm_sentence(*key, found) for key, found in table.items() if found["harm"]] or [
        "Assistance does more harm than good with none of these sources"
    ]


def _harms(
    found: Mapping[str, float], longer: float = 1.05, worst: float = 1.5, turn: float = 2.0
) -> bool:
    """Return whether assistance does more harm than good.

    It does if it increases the largest rotations or distances too much, or if it lengthens most
    stops without reducing the largest rotations. A distance ratio is the distance divided by that
    without the assistant.

    Args:
        found: the other statistics from `_results` of a source.
        longer: limit on the median distance ratio, if the largest rotations are not reduced [1].
        worst: limit on the 95th percentile of the distance ratio [1].
        turn: limit on the increase of the 95th percentile of the rotation due to the assistant
            [deg].
    """
    ratio, high = found["distance_ratio_median"], found["distance_ratio_p95"]
    turned, free = found["rotation_p95"], found["rotation_unassisted_p95"]
    return turned > free + turn or high > worst or (ratio > longer and turned > free)


def _figure(table: Table, vehicle: str, sources: Sequence[str]) -> Figure:
    """Draw the 95th percentiles of distance and rotation for each source."""
    title = f"{vehicle}: each bar ends at the 95th percentile of the stops"
    size = (10.0, 1.5 + 0.38 * len(sources))
    figure, grid = style.panels(title, 1, 2, size=size, sharey=True)
    panels = grid[0]
    places = np.arange(len(sources))[::-1]
    quantities = (("distance_ratio_p95", 3.0), ("rotation_p95", 360.0))
    for axes, (quantity, most) in zip(panels, quantities, strict=True):
        for shift, law, color in ((0.18, _LAWS[0], style.BLUE), (-0.18, _LAWS[1], style.ORANGE)):
            found = [table[vehicle, law, source] for source in sources]
            values = np.minimum([one[quantity] for one in found], most)
            axes.barh(places + shift, values, 0.34, color=color, label=law)
            if (harm := np.array([one["harm"] for one in found], dtype=bool)).any():
                red = {
                    "edgecolor": style.VERMILLION,
                    "linewidth": 2.0,
                    "label": "more harm than good",
                }
                axes.barh((places + shift)[harm], values[harm], 0.34, color="none", **red)
    panels[0].axvline(1.0, color=style.GRAY)
    panels[0].set_xlabel("stopping distance / that without assistant [1]")
    free = table[vehicle, _LAWS[0], sources[0]]["rotation_unassisted_p95"]
    panels[1].axvline(free, color=style.GRAY, label="without assistant")
    panels[1].set_xlabel("rotation [deg]")
    panels[0].set_yticks(places, [SOURCES[source].label for source in sources])
    style.legend_below(figure, 4)
    return figure
