"""``./omni design-sensors``: place line cameras under a chassis so that the twist errs least.

Search the places of line cameras with the smallest mean twist error, draw them, and judge given and
classical placements beside them.
"""

from __future__ import annotations

import json
import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED
from omni_bringup.noting import noting_library
from omni_platform.command_options import json_option, option
from omni_platform.configuration import Configuration, ConfigurationError, did_you_mean, parameter

if TYPE_CHECKING:
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_analysis.placement.design import Design, DesignTask
    from omni_analysis.placement.judged import JudgedPlacement
    from omni_analysis.placement.trials import PlacementTrial
    from omni_platform.sensors import LineSensor


_TEXELS = 4096  # of the ground over 0.2 m
_DRAWN = 4


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni design-sensors``."""

    vehicle: str = parameter(
        "mecanum_forklift",
        description="a file of config/vehicles/, or a path that ends in .yaml",
    )
    sensors: int | None = parameter(
        None, description="how many, 3 to 8 (default: 3, or as --check)"
    )
    type: str | None = parameter(
        None,
        description="type of camera: a file of config/sensors/ such as generic, lis_770i or s3901, "
        "or a path that ends in .yaml; its places are judged too (default: generic, or as --check)",
    )
    check: tuple[str, ...] = parameter(
        (),
        description="judge this placement, a file as for --type; exit code 1 if one is singular",
    )
    redundant: bool = parameter(
        False,
        description="minimise the error without the camera whose failure is the worst; four or "
        "more",
    )
    speed: float | None = option(
        None,
        metavar="M/S",
        description="of the motions to design for (default: 10, or less if the cameras are too "
        "slow)",
    )
    yaw_rate: float = option(
        1.0,
        metavar="RAD/S",
        description="of the turning motion",
        minimum=0.0,
        maximum=100.0,
    )
    mix: str = option(
        "1:1:1:1",
        metavar="A:B:C:D",
        description="shares of straight, sideways, diagonal and turning motion",
    )
    ground: str = option(
        "cork", metavar="KIND", description="on which the camera's error is measured"
    )
    noise: float = option(
        1.0,
        metavar="LEVELS",
        description="of the camera in grey levels",
        minimum=0.0,
        maximum=100.0,
    )
    housing: float = option(
        0.02,
        metavar="M",
        description="of a camera, around its field of view",
        minimum=0.0,
        maximum=1.0,
    )
    clearance: float = option(
        0.02,
        metavar="M",
        description="to the edge of the chassis, wheels and other cameras",
        minimum=0.0,
        maximum=1.0,
    )
    confirm: bool = parameter(
        False, description="drive every placement over rendered lines and compare the errors"
    )
    seed: int = parameter(1, description="of search, ground and noise", minimum=0)
    out: Path | None = option(
        None,
        metavar="DIR",
        description="folder of placement and figure (default: results/design-sensors/VEHICLE)",
    )
    json: bool = json_option()


def run(options: Options, workspace: Path) -> int:
    """Place sensors as the command line asks and return the exit code."""
    from omni_analysis.figures.style import save_figure
    from omni_analysis.placement.design import confirm, design
    from omni_analysis.placement.figure import placement_figure
    from omni_analysis.placement.report import entries, sensor_file
    from omni_bringup.progress_bar import progress_bar

    vehicle = Path(options.vehicle).stem
    folder: Path = options.out or workspace / "results" / "design-sensors" / vehicle
    try:
        task = _task(options, noting_library(workspace, "omni design-sensors"))
        with progress_bar("design-sensors") as report:
            result = design(task, report)
            driven = confirm(task, result, report) if options.confirm else {}
    except ConfigurationError as error:
        print(f"omni design-sensors: {error}", file=sys.stderr)
        return EXIT_REFUSED
    document = {"name": "design-sensors", "metrics": entries(task, result, driven)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        placement = (folder / "sensors.yaml").resolve()
        placement.write_text(sensor_file(task, result, vehicle), encoding="utf-8")
        title = f"{task.count} line cameras under {vehicle}, {_conditions(task, options)}"
        figure = placement_figure(_drawn(result, task), result.criterion, task.area, title)
        picture = save_figure(figure, folder.resolve() / "placements.png")
        (folder / "summary.json").write_text(json.dumps(document, indent=2) + "\n")
    except OSError as error:
        print(f"omni design-sensors: cannot write {folder}: {error.strerror}", file=sys.stderr)
        return EXIT_REFUSED
    if options.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        _print(task, result, driven, options, (placement, picture))
    singular = [name for name in task.given if result.placement(name).singular]
    return EXIT_FAILED if options.check and singular else EXIT_OK


def _task(options: Options, library: ExperimentLibrary) -> DesignTask:
    """Check the options and read what they name."""
    from omni_analysis.figures.scene import Scene
    from omni_analysis.line_trials.trials import ground
    from omni_analysis.placement.design import (
        FEWEST_SENSORS,
        MOST_SENSORS,
        DesignTask,
        design_speed,
        view_of,
    )
    from omni_analysis.placement.error import MotionMix
    from omni_analysis.placement.mounting_area import MountingArea
    from omni_sim.texture.texture import KINDS

    if options.ground not in KINDS:
        hint = did_you_mean(options.ground, KINDS)
        raise ConfigurationError(
            "--ground", f"{options.ground!r} is not one of {', '.join(KINDS)}{hint}"
        )
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
    if not FEWEST_SENSORS <= count <= MOST_SENSORS:
        raise ConfigurationError(
            "--sensors",
            f"{count} must be {FEWEST_SENSORS}, for the three components of the twist, to "
            f"{MOST_SENSORS}",
        )
    if options.redundant and count == FEWEST_SENSORS:
        raise ConfigurationError("--redundant", "takes four sensors or more: --sensors 4")
    scene = Scene(vehicle.chassis_length, vehicle.chassis_width, vehicle.wheels)
    area = MountingArea(scene, view, options.housing, options.clearance)
    speed = design_speed(options.speed, options.yaw_rate, area)
    return DesignTask(
        area=area,
        texture=ground(options.ground, _TEXELS),
        noise=options.noise,
        count=count,
        mix=MotionMix.of(speed, options.yaw_rate, _weights(options.mix)),
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
    """Return placements by the names of their files, told apart from those of the others."""
    cases: dict[str, Mapping[str, LineSensor]] = {}
    for name, sensors in given.items():
        case = Path(name).stem.replace(".", "_")
        while case in cases or case in {"best", "condition", "tangential", "radial", "parallel"}:
            case += "_given"
        cases[case] = sensors
    return cases


def _conditions(task: DesignTask, options: Options) -> str:
    return f"{task.speed:.3g} m/s on {options.ground}"


def _drawn(result: Design, task: DesignTask) -> list[JudgedPlacement]:
    """Return the best placement and up to three that are of most interest beside it."""
    names = [*task.given, "tangential", "radial", "condition"]
    return [result.best, *(result.placement(name) for name in names[: _DRAWN - 1])]


def _print(
    task: DesignTask,
    result: Design,
    driven: Mapping[str, PlacementTrial],
    options: Options,
    files: tuple[Path, Path],
) -> None:
    from rich.console import Console
    from rich.table import Table

    from omni_analysis.figures.comparison_table import comparison_table
    from omni_analysis.placement.report import column, findings

    console = Console()
    sensors = Table("sensor", r"x \[m]", r"y \[m]", r"heading \[deg]", pad_edge=False)
    for name, sensor in result.best.sensors.items():
        sensors.add_row(name, f"{sensor.x:.3f}", f"{sensor.y:.3f}", f"{sensor.heading_deg:.0f}")
    console.print(sensors)
    radius = result.criterion.gyration
    console.print(
        comparison_table(
            {
                placement.name: column(placement, driven.get(placement.name), radius)
                for placement in result.placements
                if placement.name in task.given or not placement.singular
            },
            title="standard deviations of the twist, and its mean error over the platform",
        )
    )
    for sentence in findings(task, result, _conditions(task, options)):
        console.print(sentence, highlight=False)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True, highlight=False)
    # The places are those under this chassis, the experiment's vehicle may be another one.
    vehicle = options.vehicle
    if vehicle.endswith(".yaml"):
        vehicle = str(Path(vehicle).resolve())
    parts = (f"vehicle={vehicle}", f"sensors={files[0]}")
    command = shlex.join(("./omni", "run", *(word for part in parts for word in ("--set", part))))
    use = f"use it: {command}, or copy it into config/sensors"
    console.print(use, soft_wrap=True, highlight=False, markup=False)
