"""Comparison of the best, the given and the common placements of cameras under a vehicle."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from omni_platform.configuration import ConfigurationError, WorkError
from omni_platform.sensors import LineSensor
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import View
from omni_tools.placement import evaluation, mounting_area
from omni_tools.placement.common_placements import common_placements, named
from omni_tools.placement.error import ConditionNumber, MeanError, MotionMix, gyration
from omni_tools.placement.search import FoundPlacement, NoRoomError, search
from omni_tools.placement.sensor_error import SensorTrial, measure_sensor_error
from omni_tools.placement.trials import PlacementTrial, drive_mix

FEWEST_SENSORS, MOST_SENSORS = 3, 8

BEST, CONDITION = "best", "condition"

Report = Callable[[float, str], None]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DesignTask:
    """Task of a placement.

    Attributes:
        area: mounting area of the chassis.
        texture: ground on which the cameras are tested.
        noise: noise of the cameras, standard deviation [gray levels of 8 bit].
        count: number of cameras.
        mix: mix of motions for the mean error.
        speed: speed of base_link in all motions of the mix [m/s].
        redundant: whether to minimize the error after the failure of the most important camera.
        given: further placements to evaluate, by name.
        seed: seed of the search and the trials.
        batches: number of line batches for each direction or motion in each orientation.
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


class Design(NamedTuple):
    """Result of a placement.

    Attributes:
        trial: measured error of one camera.
        criterion: criterion of the search.
        found: result of the search.
        placements: the best placement, the given ones, the one with the smallest condition number,
            and the common ones.
    """

    trial: SensorTrial
    criterion: MeanError
    found: FoundPlacement
    placements: tuple[evaluation.EvaluatedPlacement, ...]

    @property
    def best(self) -> evaluation.EvaluatedPlacement:
        """Placement with the smallest mean twist error that the search found."""
        return self.placements[0]

    def placement(self, name: str) -> evaluation.EvaluatedPlacement:
        """Return a placement by its name."""
        return next(entry for entry in self.placements if entry.name == name)


def design(task: DesignTask, report: Report) -> Design:
    """Measure a camera's error, search for the best placement, and evaluate other placements.

    Args:
        task: the task.
        report: called with the completed share (0 to 1) and a text.

    Raises:
        WorkError: the cameras do not fit, or cannot measure the motion.
    """
    area, view = task.area, task.area.view
    report(0.0, "errors of one camera")
    trial = measure_sensor_error(
        view, task.texture, task.noise, task.speed, task.batches, task.seed
    )
    scene = area.scene
    radius = gyration(scene.chassis_length, scene.chassis_width)
    criterion = MeanError(view, trial.error, task.mix, radius)
    try:
        found = search(
            criterion, area, task.count, redundant=task.redundant, seed=task.seed,
            report=lambda share, words: report(0.3 + 0.4 * share, words),
        )  # fmt: skip
        report(0.7, "smallest condition number")
        other = search(ConditionNumber(), area, task.count, seed=task.seed)
    except NoRoomError as error:
        raise WorkError(
            f"--sensors: {error} under {scene.chassis_length:g} x {scene.chassis_width:g} m; "
            f"each requires {2e3 * area.half[0]:.0f} x {2e3 * area.half[1]:.0f} mm and "
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
    """Return the design speed [m/s]: the given one, or the usual one if the cameras can measure it.

    Args:
        speed: given speed [m/s], None for the default.
        yaw_rate: yaw rate of the turning motion [rad/s].
        area: mounting area, which gives the camera type and the largest distance from the center.
        usual: usual speed [m/s].

    Raises:
        ConfigurationError: at this speed, consecutive lines overlap by less than 60 % in sideways
            motion.
    """
    limit = area.view.mounted().sideways_speed - yaw_rate * math.hypot(*area.reach)
    if limit <= 0.0:
        raise ConfigurationError(
            "--yaw-rate",
            f"at {yaw_rate:g} rad/s lines at the corners of the chassis overlap by less than 60 %",
        )
    if speed is None:
        return min(usual, limit)
    if not 0.0 < speed <= limit:
        raise ConfigurationError(
            "--speed",
            f"{speed:g} m/s must be above 0 and at most {limit:.3g} m/s, at which consecutive "
            "lines of this type of camera overlap by 60 % in sideways motion",
        )
    return speed


def view_of(name: str, sensors: Mapping[str, LineSensor]) -> View:
    """Return the field of view that all cameras of a file share.

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
