"""``./omni calibrate-sensors``: estimate the mounting of line cameras from a known motion.

Estimate pixel pitch, direction of the axis, position, mirroring and line rate of each line camera,
with uncertainties. The recorded motion (straight, sideways, turning) must be known from the wheel
speeds or from a simulation. Write a figure of the residuals and a YAML file of the cameras.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, estimate, write_text
from omni_core.configuration import ConfigurationError
from omni_core.sensors import velocity_row
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_tools.line_files.calibration import Calibration

WORK = "matching lines and fitting"


class Options(CommandOptions):
    """Options of ``omni calibrate-sensors``."""

    drives: tuple[Path, ...] = option(positional=True, metavar="DRIVE")
    """recordings with the lines of the cameras and the motion of the vehicle"""
    reference: str = option("auto", choices=("auto", "truth", "wheels"))
    """source of the known motion: `wheels` for wheel speeds during steady driving, `truth` for the
    ground truth of a simulation; `auto` selects `truth` if it was recorded, otherwise `wheels`"""
    out: Path | None = option(None, metavar="DIR")
    """folder of sensors.yaml and the figure (default: results/calibrate-sensors)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Calibrate the cameras, write the calibration and draw the residuals."""
    from omni_recording.folder import open_vehicle
    from omni_runs.figures.style import save_figure
    from omni_runs.replay.lines import read_batches
    from omni_runs.replay.plan import recorded_configuration
    from omni_runs.replay.reference import read_reference
    from omni_tools.line_files.calibration import calibrate, draw_residuals, observe

    seen: dict[str, list[Any]] = {}
    nominal: Mapping[str, Any] = {}
    kinds = set()
    for path in options.drives:
        bag = open_vehicle(path)
        configuration = recorded_configuration(bag)
        sensors = configuration.odometry.sensors
        if nominal and sensors != nominal:
            raise ConfigurationError(
                "DRIVE", f"{path} was recorded with other line cameras than the first drive"
            )
        nominal = sensors
        time, twist, kind = read_reference(bag, configuration, options.reference)
        kinds.add(kind)
        for name, batches in read_batches(bag, sensors).items():
            drive = observe(sensors[name], batches, time, twist, configuration.odometry)
            seen.setdefault(name, []).append(drive)
    found = {name: calibrate(nominal[name], drives) for name, drives in seen.items()}
    title = f"Residuals of {len(options.drives)} drive(s) against {' and '.join(sorted(kinds))}"
    folder = workspace.results(options.out, "calibrate-sensors")
    file = write_text(folder / "sensors.yaml", _yaml(found))
    picture = save_figure(draw_residuals(found, title), folder.resolve() / "residuals.png")
    return Report(
        metrics=_metrics(found),
        details={"files": [str(file), str(picture)]},
        text=_text(found),
        files=(file, picture),
        hints=(f"use it: ./omni run --set sensors={file}, or as odometry.sensors of your vehicle",),
    )


class _Row(NamedTuple):
    """Table row of a calibrated quantity of a camera."""

    quantity: str
    unit: str
    nominal: float
    found: float
    error: float


def _metrics(found: Mapping[str, Calibration]) -> dict[str, Any]:
    metrics: dict[str, Any] = {}
    for name, one in found.items():
        residual = math.sqrt(sum(float(r @ r) for r in one.residual) / sum(map(len, one.residual)))
        for row in _rows(one):
            metrics[f"{row.quantity}.{name}"] = estimate(row.found, row.unit, row.error)
        metrics[f"mirrored.{name}"] = estimate(one.mirrored, "1", 0.0)
        metrics[f"residual.{name}"] = estimate(residual, "m/s", 0.0)
    return metrics


def _rows(one: Calibration) -> Iterator[_Row]:
    nominal, sensor, error = one.nominal, one.sensor, one.error
    side, ahead = abs(math.sin(sensor.heading)), abs(math.cos(sensor.heading))
    before, lever = (velocity_row(at.x, at.y, at.heading)[2] for at in (nominal, sensor))
    yield _Row("pitch", "m", nominal.pixel_pitch, sensor.pixel_pitch, error["pitch"])
    yield _Row("length", "m", nominal.length, sensor.length, error["pitch"] * sensor.pixels)
    turned = math.degrees(error["heading"])
    yield _Row("heading", "deg", nominal.heading_deg, sensor.heading_deg, turned)
    yield _Row("x", "m", nominal.x, sensor.x, error["lever"] * side)
    yield _Row("y", "m", nominal.y, sensor.y, error["lever"] * ahead)
    yield _Row("lever", "m", before, lever, error["lever"])
    yield _Row("line_rate", "1/s", nominal.line_rate, sensor.line_rate, error["line_rate"])


def _yaml(found: Mapping[str, Calibration]) -> str:
    from omni_core.configuration import to_mapping
    from omni_runs.yaml_files import commented_yaml

    lines = ["Line cameras calibrated from drives of known motion; standard errors:"]
    for name, one in found.items():
        error = one.error
        lines.append(
            f"  {name}: pitch {100.0 * error['pitch'] / one.sensor.pixel_pitch:.2g} %, "
            f"axis {math.degrees(error['heading']):.2g} deg, position "
            f"across the axis {1e3 * error['lever']:.2g} mm, line rate {error['line_rate']:.2g}/s"
        )
        lines += [f"    {words}" for words in _remarks(one)]
    tree = {
        name: {
            key: round(value, 7) if isinstance(value, float) else value
            for key, value in to_mapping(one.sensor).items()
        }
        for name, one in found.items()
    }
    return commented_yaml(tree, "\n".join(lines))


def _text(found: Mapping[str, Calibration]) -> Iterator[Any]:
    from omni_core.commands.wrapped_table import WrappedTable

    cells = []
    for name, one in found.items():
        for row in _rows(one):
            scale, unit = (1e3, "mm") if row.unit == "m" else (1.0, row.unit)
            before, after = f"{scale * row.nominal:.6g}", f"{scale * row.found:.6g}"
            words = row.quantity.replace("_", " ")
            cells.append((name, words, unit, before, after, f"{scale * row.error:.2g}"))
    headings = ("camera", "quantity", "unit", "nominal", "found", "standard error")
    columns = dict(zip(headings, map(list, zip(*cells, strict=True)), strict=True))
    names = {heading: columns.pop(heading) for heading in headings[:3]}
    yield WrappedTable(names, columns)
    yield from (f"{name}: {words}" for name, one in found.items() for words in _remarks(one))


def _remarks(one: Calibration) -> Iterator[str]:
    if one.unseen:
        yield f"the drives do not determine {', '.join(one.unseen)}; nominal values kept"
    if one.mirrored:
        yield "its lines are mirrored relative to the nominal axis"
