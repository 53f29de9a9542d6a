"""Comparison of the best placement of cameras under a vehicle with other placements.

`design_task` converts command-line options to the requirements of a placement. `drive_mix` measures
the error of a placement on rendered lines.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.odometry import LineScanOdometry
from omni_core.configuration import ConfigurationError, WorkError, check_choice
from omni_core.geometry import WheelMount
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.sensors import LineSensor
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures.scene import Scene
from omni_sim.texture.configuration import KINDS
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials import rig
from omni_tools.line_trials.rig import BATCH_TIME, PERIOD, Rig, View, batch_lines
from omni_tools.placement import error as criteria
from omni_tools.placement import mounting_area
from omni_tools.placement.carriers import SteeredCameras, steered_cameras
from omni_tools.placement.mounting_area import common_placements, named
from omni_tools.placement.options import PlacementOptions
from omni_tools.placement.search import FoundPlacement, NoRoomError, search
from omni_tools.placement.sensor_error import ORIENTATIONS, SensorTrial, measure_sensor_error

_Mount = TypeVar("_Mount", WheelMount, LineSensor)

FEWEST_SENSORS, MOST_SENSORS = 3, 8

BEST, CONDITION = "best", "condition"

Report = Callable[[float, str], None]
_USUAL_SPEED = 10.0  # speed for which cameras are placed if none is given [m/s]


class PlacementTrial(NamedTuple):
    """Errors of the twist that a placement of cameras measures on rendered lines.

    Attributes:
        error: estimated minus true twist of each of b batches [m/s, m/s, rad/s], an array of shape
            (b, 3) for each motion of the mix.
        share: share of time of each motion [1], shape (M,).
        unmeasured: share of the batches without a twist, 0 to 1.
    """

    error: tuple[FloatArray, ...]
    share: FloatArray
    unmeasured: float

    @property
    def deviation(self) -> FloatArray:
        """RMS errors of v_x, v_y [m/s] and yaw rate [rad/s] over the mix, shape (3,)."""
        squared = np.array([np.mean(error**2, axis=0) for error in self.error])
        return np.asarray(np.sqrt(self.share @ squared))

    def mean_error(self, gyration: float) -> float:
        """Return the RMS velocity error over all points of the platform and all motions [m/s].

        Args:
            gyration: RMS distance of the platform's points from base_link [m].
        """
        return float(np.linalg.norm(self.deviation * (1.0, 1.0, gyration)))


def drive_mix(
    sensors: Mapping[str, LineSensor],
    mix: criteria.MotionMix,
    texture: GroundTexture,
    noise: float,
    batches: int,
    seed: int,
    report: Callable[[float], None] = lambda _share: None,
) -> PlacementTrial:
    """Simulate a placement over a ground; return the errors of the twist from the rendered lines.

    Each batch begins at a random position on the ground, in one of several random orientations.

    Args:
        sensors: cameras of a placement that is not singular.
        mix: mix of motions.
        texture: the ground.
        noise: standard deviation [gray levels of 8 bit].
        batches: number of batches of each motion in each orientation.
        seed: seed of positions, orientations and noise.
        report: function that is called with the completed share (0 to 1).
    """
    generator = np.random.default_rng(seed)
    # Cameras on carriers are simulated at steering angles of 0.
    sensors = {name: dataclasses.replace(one, carrier="") for name, one in sensors.items()}
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    rig = Rig(sensors, texture, noise, seed)
    lines = {name: np.arange(batch_lines(s.line_rate) + 1) for name, s in sensors.items()}
    errors, total = [], 0
    for index, twist in enumerate(mix.twist):
        report(index / len(mix.twist))
        yaws = np.repeat(generator.uniform(0.0, math.tau, ORIENTATIONS), batches)
        own = []
        for yaw in yaws:
            start = np.append(generator.uniform(0.0, PERIOD, 2), yaw)
            # The stamps are far apart, so that lines of different batches are not compared.
            begin_ns = round(SECOND_NS * total * 4.0 * BATCH_TIME)
            total += 1
            estimate = odometry.update(rig.expose(start, twist, lines, begin_ns))
            if estimate.measured:
                own.append(estimate.twist - twist)
        errors.append(np.array(own).reshape(-1, 3))
    report(1.0)
    measured = sum(len(error) for error in errors)
    return PlacementTrial(tuple(errors), mix.share, 1.0 - measured / total)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DesignTask:
    """Requirements of a placement of cameras under a vehicle.

    All positions are relative to the center of the chassis.

    Attributes:
        area: mounting area of the chassis.
        texture: ground on which the cameras are tested.
        noise: noise of the cameras, standard deviation [gray levels of 8 bit].
        count: number of cameras.
        mix: mix of motions over which the mean error is computed.
        speed: speed of the center of the chassis in all motions of the mix [m/s].
        redundant: whether to minimize the error after the failure of the most important camera.
        given: further placements to evaluate, keyed by name; cameras on carriers are at steering
            angles of 0.
        steered: cameras of these placements in motions that turn their carriers, keyed by placement
            and motion.
        seed: seed of the search and the trials.
        batches: number of line batches for each combination of orientation and motion.
        center: center of the chassis in the body frame [m].
    """

    area: mounting_area.MountingArea
    texture: GroundTexture
    noise: float
    count: int
    mix: criteria.MotionMix
    speed: float
    redundant: bool
    given: Mapping[str, Mapping[str, LineSensor]]
    seed: int
    steered: Mapping[tuple[str, str], SteeredCameras] = dataclasses.field(default_factory=dict)
    batches: int = 4
    center: tuple[float, float] = (0.0, 0.0)

    def in_body(self, sensors: Mapping[str, LineSensor]) -> dict[str, LineSensor]:
        """Return sensors with their positions in the body frame, to 1 um."""
        return {
            name: dataclasses.replace(one, x=round(one.x, 6), y=round(one.y, 6))
            for name, one in _moved(sensors, np.array(self.center)).items()
        }


class Design(NamedTuple):
    """Result of a search for the best placement of cameras.

    Attributes:
        trial: measured errors of one camera, and the error model fitted to them.
        criterion: mean twist error, by which the placements are evaluated.
        found: result of the search.
        placements: the best placement, the given placements, the placement with the smallest
            condition number, and common placements.
        steered: placements of `DesignTask.steered`, each in its motion, with the same keys.
    """

    trial: SensorTrial
    criterion: criteria.MeanError
    found: FoundPlacement
    placements: tuple[criteria.EvaluatedPlacement, ...]
    steered: Mapping[tuple[str, str], criteria.EvaluatedPlacement]

    @property
    def best(self) -> criteria.EvaluatedPlacement:
        """Best placement that the search found."""
        return self.placements[0]

    def placement(self, name: str) -> criteria.EvaluatedPlacement:
        """Return the placement with this name."""
        return next(entry for entry in self.placements if entry.name == name)


def design(task: DesignTask, report: Report) -> Design:
    """Measure a camera's error, search for the best placement, and evaluate other placements.

    Args:
        task: requirements of the placement.
        report: function that is called with the completed share (0 to 1) and a text.

    Raises:
        WorkError: the cameras do not fit, or cannot measure the motion.
    """
    area, view = task.area, task.area.view
    report(0.0, "errors of one camera")
    trial = measure_sensor_error(
        view, task.texture, task.noise, task.speed, task.batches, task.seed
    )
    scene = area.scene
    radius = criteria.gyration(scene.chassis_length, scene.chassis_width)
    criterion = criteria.MeanError(view, trial.error, task.mix, radius)
    try:
        found = search(
            criterion, area, task.count, redundant=task.redundant, seed=task.seed,
            report=lambda share, words: report(0.3 + 0.4 * share, words),
        )  # fmt: skip
        report(0.7, "smallest condition number")
        other = search(criteria.ConditionNumber(), area, task.count, seed=task.seed)
    except NoRoomError as error:
        raise WorkError(
            f"--sensors: {error} under {scene.chassis_length:g} x {scene.chassis_width:g} m; "
            f"each requires {2e3 * area.half[0]:.0f} x {2e3 * area.half[1]:.0f} mm and "
            f"{1e3 * area.clearance:.0f} mm around it, see --housing and --clearance"
        ) from None
    sensors: dict[str, Mapping[str, LineSensor]] = {BEST: named(found.poses, view)}
    sensors |= task.given
    sensors[CONDITION] = named(other.poses, view)
    for name, poses in common_placements(area, task.count).items():
        sensors[name] = named(poses, view, rounded=False)
    placements = tuple(
        criteria.evaluate(name, own, criterion, area) for name, own in sensors.items()
    )
    steered = {
        key: criteria.evaluate("_".join(key), one.sensors, criterion._replace(mix=one.mix), area)
        for key, one in task.steered.items()
    }
    return Design(trial, criterion, found, placements, steered)


def confirm(task: DesignTask, result: Design, report: Report) -> dict[str, PlacementTrial]:
    """Return the measured errors of all non-singular placements, keyed by placement name."""
    regular = [placement for placement in result.placements if not placement.singular]
    trials = {}
    for index, placement in enumerate(regular):

        def on_drive(share: float, index: int = index, name: str = placement.name) -> None:
            report((index + share) / len(regular), f"driving {name}")

        trials[placement.name] = drive_mix(
            placement.sensors, task.mix, task.texture, task.noise, task.batches, task.seed, on_drive
        )
    return trials


def design_speed(speed: float | None, yaw_rate: float, area: mounting_area.MountingArea) -> float:
    """Return the speed for which cameras are placed [m/s].

    The default is the usual speed, or the highest measurable speed if that is lower.

    Args:
        speed: given speed [m/s], None for the default.
        yaw_rate: yaw rate of the turning motion [rad/s].
        area: mounting area, which determines the camera type and the largest distance of a camera
            from the center.

    Raises:
        ConfigurationError: the speed is not above 0, or consecutive lines overlap by less than
            60 % in sideways motion at this speed.
    """
    limit = area.view.mounted().sideways_speed - yaw_rate * math.hypot(*area.reach)
    if limit <= 0.0:
        raise ConfigurationError(
            "--yaw-rate",
            f"at {yaw_rate:g} rad/s lines at the corners of the chassis overlap by less than 60 %",
        )
    if speed is None:
        return min(_USUAL_SPEED, limit)
    if not 0.0 < speed <= limit:
        raise ConfigurationError(
            "--speed",
            f"{speed:g} m/s must be above 0 and at most {limit:.3g} m/s, at which consecutive "
            "lines of this type of camera overlap by 60 % in sideways motion",
        )
    return speed


def view_of(name: str, sensors: Mapping[str, LineSensor]) -> View:
    """Return the field of view and line rate that all cameras of a file have in common.

    Args:
        name: name of the file.
        sensors: cameras of the file.

    Raises:
        ConfigurationError: the file has no camera, or its cameras differ in type.
    """
    views = {View.of(sensor) for sensor in sensors.values()}
    if len(views) != 1:
        raise ConfigurationError(
            "sensors", f"{name} must have cameras of one type, it has {len(views)} types"
        )
    return views.pop()


def design_task(options: PlacementOptions, library: ExperimentLibrary) -> DesignTask:
    """Return the requirements from checked options and from the files that they name.

    Raises:
        ConfigurationError: an option is invalid.
    """
    check_choice("--ground", options.ground, KINDS)
    vehicle = library.vehicle(options.vehicle)
    kind = options.type or (options.check[0] if options.check else "generic")
    given = {name: library.sensors(name) for name in options.check or [kind]}
    view = view_of(kind, library.sensors(kind))
    for name in options.check:
        if view_of(name, given[name]) != view:
            raise ConfigurationError("--check", f"{name} has another type of camera than {kind}")
    count = options.sensors
    if count is None:
        checked = len(given[options.check[0]]) if options.check else FEWEST_SENSORS
        count = min(max(checked, FEWEST_SENSORS), MOST_SENSORS)
    if options.redundant and count == FEWEST_SENSORS:
        raise ConfigurationError("--redundant", "requires at least four sensors: --sensors 4")
    to_center = -np.array(vehicle.chassis_center)
    wheels = _moved(vehicle.wheels, to_center)
    scene = Scene(vehicle.chassis_length, vehicle.chassis_width, wheels)
    area = mounting_area.MountingArea(scene, view, options.housing, options.clearance)
    speed = design_speed(options.speed, options.yaw_rate, area)
    compared = _cases(
        {name: own for name, own in given.items() if options.check or len(own) == count}
    )
    mix = criteria.MotionMix.of(speed, options.yaw_rate, _weights(options.mix))
    steered = {
        (case, motion): one._replace(sensors=_moved(one.sensors, to_center))
        for case, own in compared.items()
        for motion, one in steered_cameras(own, vehicle, mix).items()
    }
    return DesignTask(
        area=area,
        texture=rig.ground(options.ground),
        noise=options.noise,
        count=count,
        mix=mix,
        speed=speed,
        redundant=options.redundant,
        given={case: _moved(own, to_center) for case, own in compared.items()},
        seed=options.seed,
        steered=steered,
        center=vehicle.chassis_center,
    )


def _moved(mounts: Mapping[str, _Mount], by: FloatArray) -> dict[str, _Mount]:
    """Return wheels or sensors whose positions are moved by a vector [m], shape (2,)."""
    x, y = by.tolist()
    return {
        name: dataclasses.replace(mount, x=mount.x + x, y=mount.y + y)
        for name, mount in mounts.items()
    }


def _weights(text: str) -> Sequence[float]:
    try:
        weights = [float(part) for part in text.split(":")]
    except ValueError:
        weights = []
    valid = all(math.isfinite(weight) and weight >= 0.0 for weight in weights)
    if len(weights) != 4 or not valid or sum(weights) == 0.0:
        raise ConfigurationError(
            "--mix", f"{text!r} must be four shares, straight:sideways:diagonal:turning"
        )
    return weights


def _cases(given: Mapping[str, Mapping[str, LineSensor]]) -> dict[str, Mapping[str, LineSensor]]:
    """Return the given placements, keyed by short, unique names made from their file names."""
    cases: dict[str, Mapping[str, LineSensor]] = {}
    for name, sensors in given.items():
        case = Path(name).stem.replace(".", "_")
        while case in cases or case in {"best", "condition", "tangential", "radial", "parallel"}:
            case += "_given"
        cases[case] = sensors
    return cases
