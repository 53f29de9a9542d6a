"""``./omni design-sensors``: where line cameras measure the twist best."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from omni_analysis.experiment import ExperimentLibrary
    from omni_analysis.judged_placement import JudgedPlacement
    from omni_analysis.placement_trials import TwistTrial
    from omni_analysis.sensor_design import Design, DesignTask
    from omni_platform.sensors import LineSensor

EXIT_OK = 0
EXIT_SINGULAR = 1
EXIT_REFUSED = 2

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
    from omni_analysis.experiment import ExperimentLibrary
    from omni_analysis.figure_style import save_figure
    from omni_analysis.placement_figure import placement_figure
    from omni_analysis.sensor_design import confirm, design
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
    document = {"name": "design-sensors", "metrics": _entries(task, result, driven)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        placement = (folder / "sensors.yaml").resolve()
        placement.write_text(_sensor_file(task, result, vehicle), encoding="utf-8")
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
    return EXIT_SINGULAR if options.check and singular else EXIT_OK


def _task(options: argparse.Namespace, library: ExperimentLibrary) -> DesignTask:
    """Check the options and read what they name."""
    from omni_analysis.line_trials import ground
    from omni_analysis.mounting_area import MountingArea
    from omni_analysis.placement_error import MotionMix
    from omni_analysis.scene import Scene
    from omni_analysis.sensor_design import (
        FEWEST_SENSORS,
        MOST_SENSORS,
        DesignTask,
        design_speed,
        view_of,
    )
    from omni_platform.configuration import ConfigurationError
    from omni_sim.ground_texture import KINDS

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
        count = len(given[options.check[0]]) if options.check else FEWEST_SENSORS
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
        given={
            _case(name): sensors
            for name, sensors in given.items()
            if options.check or len(sensors) == count
        },
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


def _case(name: str) -> str:
    """Return the file's name, told apart from the names of the other placements."""
    stem = Path(name).stem.replace(".", "_")
    taken = {"best", "smallest_condition", "tangential", "radial", "parallel"}
    return f"{stem}_given" if stem in taken else stem


def _conditions(task: DesignTask, options: argparse.Namespace) -> str:
    return f"{task.speed:.3g} m/s on {options.ground}"


def _drawn(result: Design, task: DesignTask) -> list[JudgedPlacement]:
    """Return the best placement and up to three that are of most interest beside it."""
    names = [*task.given, "tangential", "radial", "smallest_condition"]
    return [result.best, *(result.placement(name) for name in names[: _DRAWN - 1])]


def _sensor_file(task: DesignTask, result: Design, vehicle: str) -> str:
    """Return the YAML that an experiment names as its sensors."""
    best = result.best
    lines = [
        f"# {task.count} line cameras under {vehicle}: mean twist error "
        f"{1e3 * best.mean_error:.2f} mm/s at {task.speed:.3g} m/s,",
        f"# v_x {1e3 * best.deviation[0]:.2f} mm/s, v_y {1e3 * best.deviation[1]:.2f} mm/s, "
        f"yaw rate {1e3 * best.deviation[2]:.2f} mrad/s.",
    ]
    lines += [f"{name}: {_flow(sensor)}" for name, sensor in best.sensors.items()]
    return "\n".join(lines) + "\n"


def _flow(sensor: LineSensor) -> str:
    return (
        f"{{x: {sensor.x!r}, y: {sensor.y!r}, heading_deg: {sensor.heading_deg!r}, "
        f"pixels: {sensor.pixels}, length: {sensor.length!r}, width: {sensor.width!r}, "
        f"line_rate: {sensor.line_rate!r}}}"
    )


def _entries(
    task: DesignTask, result: Design, driven: Mapping[str, TwistTrial]
) -> dict[str, dict[str, Any]]:
    """Return the metrics of the results' document."""
    radius = result.criterion.gyration
    entries: dict[str, dict[str, Any]] = {}

    def add(name: str, value: float, unit: str, note: str = "") -> None:
        finite = float(value) if math.isfinite(value) else None
        entries[name] = {"value": finite, "unit": unit} | ({"note": note} if note else {})

    for name, sensor in result.best.sensors.items():
        add(f"x.{name}", sensor.x, "m")
        add(f"y.{name}", sensor.y, "m")
        add(f"heading.{name}", sensor.heading_deg, "deg")
    for placement in result.placements:
        case = placement.name
        add(f"mean_error.{case}", placement.mean_error, "m/s", placement.singular)
        for axis, quantity in enumerate(("v_x", "v_y", "yaw_rate")):
            unit = "rad/s" if axis == 2 else "m/s"
            add(f"deviation_{quantity}.{case}", placement.deviation[axis], unit)
        for motion, error in placement.by_motion.items():
            add(f"mean_error_{motion}.{case}", error, "m/s")
        if len(placement.sensors) > 3:
            add(f"mean_error_after_failure.{case}", placement.worst_without, "m/s")
        add(f"condition_number.{case}", placement.condition, "1")
        add(f"axes_spread.{case}", placement.spread_deg, "deg")
        add(f"effective_lever.{case}", placement.lever, "m")
        add(f"singular.{case}", float(bool(placement.singular)), "1", placement.singular)
        add(f"mountable.{case}", float(not placement.mounting), "1", placement.mounting)
        if case in driven:
            add(f"mean_error_measured.{case}", driven[case].mean_error(radius), "m/s")
    add("rounding_loss.best", result.found.rounding, "1")
    error = result.trial.error
    add("speed.design", task.speed, "m/s")
    add("deviation.one_camera_straight", math.sqrt(error.straight), "m/s")
    add("deviation.one_camera_sideways", float(result.trial.fitted[-1]), "m/s")
    add("misfit.one_camera", result.trial.misfit, "1")
    return entries


def _print(
    task: DesignTask,
    result: Design,
    driven: Mapping[str, TwistTrial],
    options: argparse.Namespace,
    files: tuple[Path, Path],
) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    sensors = Table("sensor", "x [m]", "y [m]", "heading [deg]", pad_edge=False)
    for name, sensor in result.best.sensors.items():
        sensors.add_row(name, f"{sensor.x:.3f}", f"{sensor.y:.3f}", f"{sensor.heading_deg:.0f}")
    console.print(sensors)
    console.print(_placement_table(result, driven))
    for sentence in _findings(task, result, options):
        console.print(sentence, highlight=False)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True, highlight=False)
    use = f"use it: ./omni run --set sensors={files[0]}, or copy it into config/sensors"
    console.print(use, soft_wrap=True, highlight=False)


def _placement_table(result: Design, driven: Mapping[str, TwistTrial]) -> Any:
    from rich.table import Table

    radius = result.criterion.gyration
    failing = len(result.best.sensors) > 3
    head = ["placement", "mean error [mm/s]", "v_x [mm/s]", "v_y [mm/s]", "yaw rate [mrad/s]"]
    head += ["after a failure [mm/s]"] if failing else []
    head += ["measured [mm/s]"] if driven else []
    table = Table(*head, "condition number", "axes spread [deg]", "lever [m]", "", pad_edge=False)
    for placement in result.placements:
        numbers = [1e3 * value for value in (placement.mean_error, *placement.deviation)]
        if failing:
            numbers.append(1e3 * placement.worst_without)
        if driven:
            trial = driven.get(placement.name)
            numbers.append(1e3 * trial.mean_error(radius) if trial else math.inf)
        numbers += [placement.condition, placement.spread_deg, placement.lever]
        remark = "singular" if placement.singular else placement.mounting
        texts = ("-" if not abs(n) < 1e6 else f"{n:.2f}" for n in numbers)
        table.add_row(placement.name, *texts, remark)
    return table


def _findings(task: DesignTask, result: Design, options: argparse.Namespace) -> list[str]:
    """Return what the numbers say, in sentences."""
    best, found, trial = result.best, result.found, result.trial
    fitted = 1e3 * trial.fitted[[0, -1]]
    sentences = [
        f"One camera errs by {fitted[0]:.2g} mm/s moving along its axis and {fitted[1]:.2g} mm/s "
        f"across it at {_conditions(task, options)} (the law is within a factor of "
        f"{1.0 + trial.misfit:.2f} of the trials).",
        f"The best placement is {found.symmetry or 'not symmetric'}; rounded to 1 mm and 1 deg it "
        f"is {100.0 * found.rounding:.2g} % worse.",
    ]
    for placement in result.placements[1:]:
        if placement.singular:
            sentences.append(f"{placement.name} is singular: {placement.singular}.")
        elif placement.name in task.given:
            ratio = placement.mean_error / best.mean_error - 1.0
            sentences.append(
                f"{placement.name} is not singular: its axes spread by {placement.spread_deg:.0f} "
                f"deg (5 deg are taken for parallel, 45 deg are best), its effective lever is "
                f"{placement.lever:.2f} m (0 where all axes pass through one point); its mean "
                f"error is {100.0 * ratio:.0f} % above the best one's."
            )
        if placement.mounting and placement.name in task.given:
            sentences.append(f"{placement.name} does not fit this chassis: {placement.mounting}.")
    other = result.placement("smallest_condition")
    sentences.append(
        f"The smallest condition number, {other.condition:.2f} against {best.condition:.2f}, "
        f"costs {100.0 * (other.mean_error / best.mean_error - 1.0):.0f} % of mean error."
    )
    return sentences
