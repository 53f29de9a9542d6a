"""``./omni design-sensors``: where line cameras measure the twist best."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED

if TYPE_CHECKING:
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_analysis.placement.design import Design, DesignTask
    from omni_analysis.placement.judged import JudgedPlacement
    from omni_analysis.placement.trials import PlacementTrial
    from omni_platform.sensors import LineSensor


_TEXELS = 4096  # of the ground over 0.2 m
_DRAWN = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options to the parser of ``omni design-sensors``."""
    parser.add_argument(
        "--vehicle",
        default="mecanum_forklift",
        metavar="NAME",
        help="a file of config/vehicles/, or a path that ends in .yaml (default: %(default)s)",
    )
    parser.add_argument(
        "--sensors", type=int, metavar="N", help="how many, 3 to 8 (default: 3, or as --check)"
    )
    parser.add_argument(
        "--type",
        metavar="NAME",
        help="type of camera: a file of config/sensors/ such as generic, lis_770i or s3901, or a "
        "path that ends in .yaml; its places are judged too (default: generic, or as --check)",
    )
    parser.add_argument(
        "--check",
        action="append",
        default=[],
        metavar="NAME",
        help="judge this placement, a file as for --type; may be repeated; exit code 1 if one is "
        "singular",
    )
    parser.add_argument(
        "--redundant",
        action="store_true",
        help="minimise the error without the camera whose failure is the worst; four or more",
    )
    parser.add_argument(
        "--speed",
        type=float,
        metavar="M/S",
        help="of the motions to design for (default: 10, or less if the cameras are too slow)",
    )
    parser.add_argument(
        "--yaw-rate",
        type=float,
        default=1.0,
        metavar="RAD/S",
        help="of the turning motion (default: %(default)g)",
    )
    parser.add_argument(
        "--mix",
        default="1:1:1:1",
        metavar="A:B:C:D",
        help="shares of straight, sideways, diagonal and turning motion (default: %(default)s)",
    )
    parser.add_argument(
        "--ground",
        default="cork",
        metavar="KIND",
        help="on which the camera's error is measured (default: %(default)s)",
    )
    parser.add_argument(
        "--noise",
        type=float,
        default=1.0,
        metavar="LEVELS",
        help="of the camera in grey levels (default: %(default)g)",
    )
    parser.add_argument(
        "--housing",
        type=float,
        default=0.02,
        metavar="M",
        help="of a camera, around its field of view (default: %(default)g)",
    )
    parser.add_argument(
        "--clearance",
        type=float,
        default=0.02,
        metavar="M",
        help="to the edge of the chassis, wheels and other cameras (default: %(default)g)",
    )
    parser.add_argument(
        "--confirm",
        action="store_true",
        help="drive every placement over rendered lines and compare the errors",
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of placement and figure (default: results/design-sensors/VEHICLE)",
    )
    parser.add_argument("--json", action="store_true", help="print the results as JSON")


def design_sensors(options: argparse.Namespace, workspace: Path) -> int:
    """Place sensors as the command line asks and return the exit code."""
    from omni_analysis.figures.style import save_figure
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_analysis.placement.design import confirm, design
    from omni_analysis.placement.figure import placement_figure
    from omni_analysis.placement.report import entries, sensor_file
    from omni_bringup.progress_bar import progress_bar
    from omni_platform.configuration import ConfigurationError

    vehicle = Path(options.vehicle).stem
    folder: Path = options.out or workspace / "results" / "design-sensors" / vehicle
    try:
        task = _task(options, ExperimentLibrary(workspace / "config"))
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


def _task(options: argparse.Namespace, library: ExperimentLibrary) -> DesignTask:
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
    from omni_platform.configuration import ConfigurationError
    from omni_sim.texture.texture import KINDS

    for name, low, high in (
        ("noise", 0.0, 100.0),
        ("housing", 0.0, 1.0),
        ("clearance", 0.0, 1.0),
        ("yaw_rate", 0.0, 100.0),
        ("seed", 0, 2**63 - 1),
    ):
        value = getattr(options, name)
        if not low <= value <= high:
            option = f"--{name.replace('_', '-')}"
            raise ConfigurationError(option, f"{value:g} must be in {low:g} to {high:g}")
    if options.ground not in KINDS:
        raise ConfigurationError("--ground", f"{options.ground!r} is not one of {', '.join(KINDS)}")
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
    from omni_platform.configuration import ConfigurationError

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


def _conditions(task: DesignTask, options: argparse.Namespace) -> str:
    return f"{task.speed:.3g} m/s on {options.ground}"


def _drawn(result: Design, task: DesignTask) -> list[JudgedPlacement]:
    """Return the best placement and up to three that are of most interest beside it."""
    names = [*task.given, "tangential", "radial", "condition"]
    return [result.best, *(result.placement(name) for name in names[: _DRAWN - 1])]


def _print(
    task: DesignTask,
    result: Design,
    driven: Mapping[str, PlacementTrial],
    options: argparse.Namespace,
    files: tuple[Path, Path],
) -> None:
    from rich.console import Console
    from rich.table import Table

    from omni_analysis.figures.comparison_table import comparison_table
    from omni_analysis.placement.report import column, findings

    console = Console()
    sensors = Table("sensor", "x [m]", "y [m]", "heading [deg]", pad_edge=False)
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
        vehicle = Path(vehicle).resolve()
    parts = (f"vehicle={vehicle}", f"sensors={files[0]}")
    command = shlex.join(("./omni", "run", *(word for part in parts for word in ("--set", part))))
    use = f"use it: {command}, or copy it into config/sensors"
    console.print(use, soft_wrap=True, highlight=False, markup=False)
