"""Comparison of the best, the given and common placements of line cameras under a vehicle."""

import dataclasses
import math
from collections.abc import Callable, Mapping

from omni_platform.configuration import ConfigurationError
from omni_platform.sensors import LineSensor
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import View
from omni_tools.placement import evaluation, mounting_area
from omni_tools.placement.common_placements import common_placements, named
from omni_tools.placement.error import ConditionNumber, MeanError, MotionMix, gyration
from omni_tools.placement.search import FoundPlacement, NoRoomError, search
from omni_tools.placement.sensor_error import SensorTrial, measure_sensor_error, sideways_limit
from omni_tools.placement.trials import PlacementTrial, drive_mix

FEWEST_SENSORS, MOST_SENSORS = 3, 8

BEST, CONDITION = "best", "condition"

Report = Callable[[float, str], None]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DesignTask:
    """Task of a placement.

    Attributes:
        area: area for the cameras on the chassis.
        texture: ground over which the cameras are tried.
        noise: noise of the cameras, standard deviation [gray levels of 8 bit].
        count: number of cameras.
        mix: mix of motions for the mean error.
        speed: speed of base_link in all motions of the mix [m/s].
        redundant: whether to minimize the error after the worst failure of a camera.
        given: further placements to evaluate, by name.
        seed: seed of the search and the trials.
        batches: number of batches of lines for each orientation of each direction or motion.
    """

    area: mounting_area.MountingArea
    texture: GroundTexture
    noise: float
    count: int
    mix: MotionMix
    speed: float
    redundant: bool
    given: Mapping[str, Mapping[str, LineSensor]]
    seed: int
    batches: int = 4


@dataclasses.dataclass(frozen=True, eq=False)
class Design:
    """Result of a placement.

    Attributes:
        trial: error of one camera.
        criterion: criterion of the search.
        found: result of the search.
        placements: the best one, the given ones, the one with the smallest condition number and
            the common ones.
    """

    trial: SensorTrial
    criterion: MeanError
    found: FoundPlacement
    placements: tuple[evaluation.EvaluatedPlacement, ...]

    @property
    def best(self) -> evaluation.EvaluatedPlacement:
        """The best placement."""
        return self.placements[0]

    def placement(self, name: str) -> evaluation.EvaluatedPlacement:
        """Return a placement by its name."""
        return next(entry for entry in self.placements if entry.name == name)


def design(task: DesignTask, report: Report) -> Design:
    """Measure a camera's error, search the best placement and evaluate others.

    Args:
        task: the task.
        report: called with the completed share [0..1] and a text.

    Raises:
        ConfigurationError: the cameras do not fit or do not see the motion.
    """
    area, view = task.area, task.area.view
    report(0.0, "errors of one camera")
    trial = measure_sensor_error(
        view, task.texture, task.noise, task.speed, task.batches, task.seed
    )
    scene = area.scene
    radius = gyration(scene.chassis_length, scene.chassis_width)
    criterion = MeanError(view, trial.error, task.mix, radius)

    def on_search(share: float, words: str) -> None:
        report(0.3 + 0.4 * share, words)

    try:
        found = search(
            criterion, area, task.count, redundant=task.redundant, seed=task.seed, report=on_search
        )
        report(0.7, "smallest condition number")
        other = search(ConditionNumber(), area, task.count, seed=task.seed)
    except NoRoomError as error:
        raise ConfigurationError(
            "--sensors",
            f"{error} under {scene.chassis_length:g} x {scene.chassis_width:g} m; each takes "
            f"{2e3 * area.half[0]:.0f} x {2e3 * area.half[1]:.0f} mm and "
            f"{1e3 * area.clearance:.0f} mm around it, see --housing and --clearance",
        ) from None
    sensors: dict[str, Mapping[str, LineSensor]] = {BEST: named(found.poses, view)}
    sensors |= task.given
    sensors[CONDITION] = named(other.poses, view)
    for name, poses in common_placements(area, task.count).items():
        sensors[name] = named(poses, view, rounded=False)
    placements = tuple(
        evaluation.evaluate(name, own, criterion, area) for name, own in sensors.items()
    )
    return Design(trial, criterion, found, placements)


def confirm(task: DesignTask, result: Design, report: Report) -> dict[str, PlacementTrial]:
    """Return the errors of non-singular placements by name, measured on rendered lines."""
    regular = [placement for placement in result.placements if not placement.singular]
    trials = {}
    for index, placement in enumerate(regular):

        def on_drive(share: float, index: int = index, name: str = placement.name) -> None:
            report((index + share) / len(regular), f"driving {name}")

        trials[placement.name] = drive_mix(
            placement.sensors, task.mix, task.texture, task.noise, task.batches, task.seed, on_drive
        )
    return trials


def design_speed(
    speed: float | None, yaw_rate: float, area: mounting_area.MountingArea, usual: float = 10.0
) -> float:
    """Return the design speed [m/s]: the given one, or the usual one if the cameras allow it.

    Args:
        speed: given speed [m/s], None for the default.
        yaw_rate: yaw rate of the turning motion [rad/s].
        area: area for the cameras, with their type and their largest distance from the center.
        usual: usual speed [m/s].

    Raises:
        ConfigurationError: at this speed consecutive lines overlap by less than 60 % in sideways
            motion.
    """
    limit = sideways_limit(area.view) - yaw_rate * math.hypot(*area.reach)
    if limit <= 0.0:
        raise ConfigurationError(
            "--yaw-rate",
            f"{yaw_rate:g} rad/s alone leave less than 60 % overlap at the corners of the chassis",
        )
    if speed is None:
        return min(usual, limit)
    if not 0.0 < speed <= limit:
        raise ConfigurationError(
            "--speed",
            f"{speed:g} m/s must be above 0 and at most {limit:.3g} m/s, where this type of camera "
            "still has 60 % overlap sideways",
        )
    return speed


def view_of(name: str, sensors: Mapping[str, LineSensor]) -> View:
    """Return the view of all cameras of a file.

    Args:
        name: name of the file.
        sensors: cameras of the file.

    Raises:
        ConfigurationError: there is no camera, or the cameras are not all of one type.
    """
    views = {View(s.pixels, s.length, s.width, s.line_rate) for s in sensors.values()}
    if len(views) != 1:
        raise ConfigurationError(
            "sensors", f"{name} must have cameras of one type, it has {len(views)} types"
        )
    return views.pop()
