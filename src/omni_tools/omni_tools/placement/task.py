"""Conversion of command-line options to the task of a placement."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from omni_figures.scene import Scene
from omni_loop.experiment import ExperimentLibrary
from omni_platform.configuration import ConfigurationError, check_choice
from omni_platform.sensors import LineSensor
from omni_sim.texture.texture import KINDS
from omni_tools.line_trials.rig import ground
from omni_tools.placement import design, error, mounting_area
from omni_tools.placement.options import PlacementOptions


def design_task(options: PlacementOptions, library: ExperimentLibrary) -> design.DesignTask:
    """Check the options and read the files that they name.

    Raises:
        ConfigurationError: an option is invalid.
    """
    check_choice("--ground", options.ground, KINDS)
    vehicle = library.vehicle(options.vehicle)
    kind = options.type or (options.check[0] if options.check else "generic")
    given = {name: library.sensors(name) for name in options.check or [kind]}
    view = design.view_of(kind, library.sensors(kind))
    for name in options.check:
        if design.view_of(name, given[name]) != view:
            raise ConfigurationError("--check", f"{name} has another type of camera than {kind}")
    count = options.sensors
    if count is None:
        checked = len(given[options.check[0]]) if options.check else design.FEWEST_SENSORS
        count = min(max(checked, design.FEWEST_SENSORS), design.MOST_SENSORS)
    if options.redundant and count == design.FEWEST_SENSORS:
        raise ConfigurationError("--redundant", "requires at least four sensors: --sensors 4")
    scene = Scene(vehicle.chassis_length, vehicle.chassis_width, vehicle.wheels)
    area = mounting_area.MountingArea(scene, view, options.housing, options.clearance)
    speed = design.design_speed(options.speed, options.yaw_rate, area)
    return design.DesignTask(
        area=area,
        texture=ground(options.ground),
        noise=options.noise,
        count=count,
        mix=error.MotionMix.of(speed, options.yaw_rate, _weights(options.mix)),
        speed=speed,
        redundant=options.redundant,
        given=_cases(
            {
                name: sensors
                for name, sensors in given.items()
                if options.check or len(sensors) == count
            }
        ),
        seed=options.seed,
    )


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
    """Return placements by the names of their files; duplicate names are made unique."""
    cases: dict[str, Mapping[str, LineSensor]] = {}
    for name, sensors in given.items():
        case = Path(name).stem.replace(".", "_")
        while case in cases or case in {"best", "condition", "tangential", "radial", "parallel"}:
            case += "_given"
        cases[case] = sensors
    return cases
