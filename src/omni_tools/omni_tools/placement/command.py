"""``./omni design-sensors``: place line cameras under a chassis for the most accurate twist.

Search for the positions of line cameras that give the smallest mean twist error, draw them, and
evaluate given and common placements for comparison.
"""

import shlex
from pathlib import Path

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, write_text
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.placement.options import PlacementOptions


class Options(PlacementOptions, CommandOptions):
    """Options of ``omni design-sensors``."""

    out: Path | None = option(None, metavar="DIR")
    """folder for placement and figure (default: results/design-sensors/VEHICLE)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Place the sensors, write and draw the placement."""
    from omni_runs.experiment import short_name
    from omni_runs.figures.style import save_figure
    from omni_tools.placement.design import confirm, design, design_task
    from omni_tools.placement.figure import placement_figure
    from omni_tools.placement.report import entries, printed, sensor_file

    vehicle = short_name(options.vehicle)
    folder = workspace.results(options.out, "design-sensors", vehicle)
    task = design_task(options, workspace.checked_experiments())
    with workspace.progress() as report:
        result = design(task, report)
        driven = confirm(task, result, report) if options.confirm else {}
    placement = write_text(folder / "sensors.yaml", sensor_file(task, result, vehicle))
    conditions = f"{task.speed:.3g} m/s on {options.ground}"
    title = f"{task.count} line cameras under {vehicle}, {conditions}"
    compared = [*task.given, "tangential", "radial", "condition"][:3]
    drawn = [result.best, *map(result.placement, compared)]
    figure = placement_figure(drawn, result.criterion, task.area, title)
    singular = any(result.placement(name).singular for name in task.given)
    singular |= any(placement.singular for placement in result.steered.values())
    return Report(
        metrics=entries(task, result, driven),
        text=printed(task, result, driven, conditions),
        files=(placement, save_figure(figure, folder.resolve() / "placements.png")),
        hints=(_use(options.vehicle, placement),),
        summary=folder,
        ok=not (options.check and singular),
    )


def _use(vehicle: str, placement: Path) -> str:
    """Return a sentence with the command that runs a vehicle with a placement of its sensors.

    The command names the vehicle, because the placement is valid only for this vehicle. If there is
    an experiment in the folder of the vehicle, its speed suits the vehicle.
    """
    file = Path(vehicle).resolve()
    folder = file.parent if vehicle.endswith(".yaml") else file
    words = ["./omni", "run"]
    if (folder / "experiment.yaml").is_file():
        words.append(str(folder / "experiment.yaml"))
    else:
        words += ["--set", f"vehicle={file if vehicle.endswith('.yaml') else vehicle}"]
    command = shlex.join([*words, "--set", f"sensors={placement}"])
    return f"use it: {command}, or copy it into config/sensors"
