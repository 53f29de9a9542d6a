"""``./omni fit-brakes``: find torque, dead time and lag of brakes from recorded stops.

Estimate the largest torque of a vehicle's brakes, their dead time and their time constant from
recordings of stops in which the wheels turn on under their brakes (with the pedal halfway down).
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_bringup.exit_codes import EXIT_OK, EXIT_REFUSED
from omni_platform.command_options import json_option, option
from omni_platform.configuration import Configuration, parameter

if TYPE_CHECKING:
    from omni_analysis.brakes.fit import BrakeFit
    from omni_sim.vehicle.configuration import VehicleConfiguration

_UNITS = {"max_torque": "N m", "dead_time": "s", "time_constant": "s"}

WORK = "reading stops and fitting the brakes"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni fit-brakes``."""

    recordings: tuple[Path, ...] = option(
        positional=True,
        metavar="RECORDING",
        description="rosbag2 folders with wheel_states, brake/pedal, brake/enable and a twist",
    )
    vehicle: str | None = parameter(
        None,
        description="a file of config/vehicles/, or a path that ends in .yaml (default: the "
        "vehicle of the configuration beside the first recording)",
    )
    twist: str = parameter(
        "odometry/twist",
        description="topic with the measured twist: odometry/twist, velocity_sensor/twist or "
        "ground_truth/odom",
        choices=("odometry/twist", "velocity_sensor/twist", "ground_truth/odom"),
    )
    out: Path | None = option(
        None,
        metavar="DIR",
        description="folder of brake and figure (default: results/fit-brakes/RECORDING)",
    )
    json: bool = json_option()


def run(options: Options, workspace: Path) -> int:
    """Fit brakes as the command line asks and return the exit code."""
    from omni_analysis.brakes.data import read_brake_data
    from omni_analysis.brakes.figure import brake_figure
    from omni_analysis.brakes.fit import fit_brakes
    from omni_analysis.figures.style import save_figure
    from omni_analysis.report.recording import run_names
    from omni_recording.error import BagError

    first: Path = options.recordings[0]
    name = first.resolve().stem
    folder: Path = options.out or workspace / "results" / "fit-brakes" / name
    try:
        names = run_names(options.recordings)
        vehicle = _vehicle(options, workspace)
        wheels = tuple(vehicle.wheels)
        stops = [
            read_brake_data(path, wheels, vehicle.brake, options.twist)
            for path in options.recordings
        ]
        fit = fit_brakes(stops, vehicle)
    except (BagError, ValueError) as error:  # a configuration or data that do not fit, too
        print(f"omni fit-brakes: {error}", file=sys.stderr)
        return EXIT_REFUSED
    entries = _entries(fit, wheels)
    document = {"name": "fit-brakes", "metrics": entries}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        brake = (folder / "brake.yaml").resolve()
        brake.write_text(_brake_file(fit, vehicle.brake.kind, names), encoding="utf-8")
        picture = save_figure(
            brake_figure(fit, names, "Brakes fitted to recorded stops"),
            folder.resolve() / "fit.png",
        )
        (folder / "summary.json").write_text(json.dumps(document, indent=2) + "\n")
    except OSError as error:
        print(f"omni fit-brakes: cannot write {folder}: {error.strerror}", file=sys.stderr)
        return EXIT_REFUSED
    if options.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        _print(entries, fit, len(stops), (brake, picture))
    return EXIT_OK


def _vehicle(options: Options, workspace: Path) -> VehicleConfiguration:
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_bringup.replay.plan import recorded_configuration
    from omni_recording.folder import open_vehicle

    if options.vehicle is not None:
        return ExperimentLibrary(workspace / "config").vehicle(options.vehicle)
    bag = open_vehicle(options.recordings[0])
    return recorded_configuration(bag, (), "--vehicle", "name the vehicle").vehicle


def _entries(fit: BrakeFit, wheels: tuple[str, ...]) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for (key, unit), value, error in zip(
        _UNITS.items(), fit.values, fit.standard_errors, strict=True
    ):
        entry: dict[str, Any] = {
            "value": float(value),
            "unit": unit,
            "standard_error": float(error),
        }
        if math.isnan(error):
            entry |= {"standard_error": None, "note": "on its bound"}
        entries[f"{key}.all"] = entry
    for wheel, value, error in zip(wheels, fit.wheel_torque, fit.wheel_error, strict=True):
        if not math.isnan(value):  # where the stops do not tell the wheels apart
            entry = {"value": float(value), "unit": "N m", "standard_error": float(error)}
            entries[f"max_torque.{wheel}"] = entry
    entries["residual.all"] = {"value": fit.residual, "unit": "m/s"}
    entries["intervals.all"] = {"value": float(fit.intervals), "unit": "1"}
    return entries


def _brake_file(fit: BrakeFit, kind: str, names: list[str]) -> str:
    lines = [
        f"# Brakes fitted to {', '.join(names)}; copy this section into the vehicle's file.",
        "# Standard errors: "
        + ", ".join(
            f"{key} {error:.2g} {unit}"  # nan on a bound
            for (key, unit), error in zip(_UNITS.items(), fit.standard_errors, strict=True)
        ),
        "# The torque is as uncertain as the vehicle's mass: 1 % of mass is 1 % of torque.",
        "brake:",
        f"  kind: {kind}",
    ]
    lines += [f"  {key}: {value:.5g}" for key, value in zip(_UNITS, fit.values, strict=True)]
    return "\n".join(lines) + "\n"


def _print(entries: dict[str, Any], fit: BrakeFit, stops: int, files: tuple[Path, Path]) -> None:
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table("brake", "unit", "value", "standard error", pad_edge=False)
    for key, entry in entries.items():
        if "standard_error" in entry:
            quantity, case = key.split(".")
            words = quantity.replace("_", " ") + ("" if case == "all" else f", {case}")
            error = entry.get("note") or f"{entry['standard_error']:.2g}"
            table.add_row(words, entry["unit"], f"{entry['value']:.5g}", error)
    console.print(table)
    console.print(
        f"a wheel turned under its brake in {fit.intervals} intervals of {stops} recorded, "
        f"differences of {1e3 * fit.residual:.2g} mm/s",
        soft_wrap=True,
        highlight=False,
    )
    if np.all(np.isnan(fit.wheel_torque)):
        console.print("these stops do not tell the wheels apart", highlight=False)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True, highlight=False)
