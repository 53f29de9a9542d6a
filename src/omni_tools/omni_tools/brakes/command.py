"""``./omni fit-brakes``: estimate torque, dead time and lag of brakes from recorded stops.

Estimate the maximum torque, the dead time and the time constant of a vehicle's brakes from
recordings of stops in which the wheels keep turning under their brakes (for example with the pedal
halfway down).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core import topics
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, estimate, estimate_table, write_text
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_sim.vehicle.configuration import VehicleConfiguration
    from omni_tools.brakes.fit import BrakeFit

_UNITS = {"max_torque": "N m", "dead_time": "s", "time_constant": "s"}

WORK = "reading stops and fitting the brakes"


class Options(CommandOptions):
    """Options of ``omni fit-brakes``."""

    recordings: tuple[Path, ...] = option(positional=True, metavar="RECORDING")
    """rosbag2 folders with wheel_states, brake/pedal and a twist; also brake/enable, unless a stop
    was made without an assistant"""
    vehicle: str | None = option(None)
    """a file of config/vehicles/, or a path that ends in .yaml (default: the vehicle of the
    configuration next to the first recording)"""
    twist: str = option(topics.TWIST.name, choices=tuple(topics.WITH_TWIST))
    """topic with the measured twist: odometry/twist, velocity_sensor/twist or ground_truth/odom"""
    out: Path | None = option(None, metavar="DIR")
    """folder for brake file and figure (default: results/fit-brakes/RECORDING)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Fit the brakes, write their parameters and draw the fit."""
    from omni_runs.figures.style import save_figure
    from omni_tools.brakes.data import read_brake_data
    from omni_tools.brakes.fit import brake_figure, fit_brakes
    from omni_tools.report.recording import run_names

    names = run_names(options.recordings)
    vehicle = _vehicle(options, workspace)
    wheels = tuple(vehicle.wheels)
    stops = [
        read_brake_data(path, wheels, vehicle.brake, options.twist) for path in options.recordings
    ]
    fit = fit_brakes(stops, vehicle)
    entries = _entries(fit, vehicle)
    folder = workspace.results(options.out, "fit-brakes", options.recordings[0].resolve().stem)
    brake = write_text(folder / "brake.yaml", _brake_file(fit, vehicle.brake.kind, names))
    figure = brake_figure(fit, names, "Brakes fitted to recorded stops")
    return Report(
        metrics=entries,
        text=_text(entries, fit, len(stops)),
        files=(brake, save_figure(figure, folder.resolve() / "fit.png")),
        summary=folder,
    )


def _vehicle(options: Options, workspace: ExperimentWorkspace) -> VehicleConfiguration:
    from omni_recording.folder import open_vehicle
    from omni_runs.replay.plan import recorded_configuration

    if options.vehicle is not None:
        return workspace.experiment_library().vehicle(options.vehicle)
    bag = open_vehicle(options.recordings[0])
    return recorded_configuration(bag, option="--vehicle", remedy="name the vehicle").vehicle


def _entries(fit: BrakeFit, vehicle: VehicleConfiguration) -> dict[str, Any]:
    errors = fit.standard_errors
    entries = {
        f"{key}.all": estimate(value, unit, error, bounded=math.isnan(error))
        | {"described": getattr(vehicle.brake, key)}
        for (key, unit), value, error in zip(_UNITS.items(), fit.values, errors, strict=True)
    }
    for wheel, value, error in zip(vehicle.wheels, fit.wheel_torque, fit.wheel_error, strict=True):
        if not math.isnan(value):  # NaN if the stops do not distinguish the wheels
            entries[f"max_torque.{wheel}"] = estimate(value, "N m", error)
    entries["residual.all"] = {"value": fit.residual, "unit": "m/s"}
    entries["intervals.all"] = {"value": float(fit.intervals), "unit": "1"}
    return entries


def _brake_file(fit: BrakeFit, kind: str, names: list[str]) -> str:
    """Return the section ``brake`` of a vehicle's file with the fitted values, as YAML."""
    lines = [
        f"# Brakes fitted to {', '.join(names)}; copy this section into the vehicle's file.",
        "# Standard errors: "
        + ", ".join(
            f"{key} on its bound" if math.isnan(error) else f"{key} {error:.2g} {unit}"
            for (key, unit), error in zip(_UNITS.items(), fit.standard_errors, strict=True)
        ),
        "# An error of 1 % in the vehicle's mass causes an error of 1 % in the torque.",
        "brake:",
        f"  kind: {kind}",
    ]
    lines += [f"  {key}: {value:.5g}" for key, value in zip(_UNITS, fit.values, strict=True)]
    return "\n".join(lines) + "\n"


def _text(entries: dict[str, Any], fit: BrakeFit, stops: int, vague: float = 0.1) -> Iterator[Any]:
    """Yield a table of the estimates, and remarks on them.

    Args:
        entries: estimates, keyed by name.
        fit: the fit.
        stops: number of stops.
        vague: relative standard error of the torque above which a remark warns [1].
    """
    yield estimate_table(entries)
    yield (
        f"recordings: {stops}; intervals in which a wheel turned under its brake: {fit.intervals}; "
        f"RMS difference: {1e3 * fit.residual:.2g} mm/s"
    )
    share = fit.standard_errors[0] / fit.values[0]
    if share > vague:
        yield (
            f"note: the standard error of the torque is {100.0 * share:.0f} %; before you use it, "
            "record more stops with the pedal halfway, so that the wheels keep turning"
        )
    if all(map(math.isnan, fit.wheel_torque)):
        yield "these stops do not distinguish the wheels"
