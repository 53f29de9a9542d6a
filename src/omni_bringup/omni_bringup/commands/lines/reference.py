"""``./omni lines reference``: compute tables of the fixed pattern of line cameras.

Compute the tables with which the odometry corrects lines from the first one on, from dark lines
(lens covered), from white lines (an even surface under the lamp), or from the lines of a recorded
drive. `odometry.flat_field_tables` takes the folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_bringup.command_report import Report, entries
from omni_bringup.workspace import Workspace
from omni_platform.command_options import json_option, option
from omni_platform.configuration import ConfigurationError, parameter
from omni_tools.line_files.options import FileOptions, camera_files

if TYPE_CHECKING:
    from linescan_odometry.measurements import LineBatch, Lines
    from linescan_odometry.view.flat_field import FlatField

WORK = "averaging lines"

_PLACES = 200  # of the mean of a drive, as the odometry's own


@dataclass(frozen=True, kw_only=True)
class Options(FileOptions):
    """Options of ``omni lines reference``."""

    dark: tuple[str, ...] = option((), metavar="CAMERA=FILE")
    """lines of a covered camera, such as left=dark.npy"""
    white: tuple[str, ...] = option((), metavar="CAMERA=FILE")
    """lines of an even white surface"""
    drive: Path | None = option(None, metavar="BAG")
    """recorded drive whose lines show the fixed pattern"""
    sensors: str = parameter("three_generic")
    """the line cameras by name, as of `lines import`"""
    out: Path = option(metavar="DIR")
    """folder of the tables, one file for each camera"""
    json: bool = json_option()


def run(options: Options, workspace: Workspace) -> Report:
    """Make the tables."""
    from omni_bringup.replay.lines import read_batches
    from omni_bringup.replay.plan import replay_configuration
    from omni_recording.folder import open_vehicle
    from omni_tools.line_files.reading import read_lines

    library = workspace.experiment_library()
    if not (options.dark or options.white or options.drive):
        raise ConfigurationError("--dark", "nothing is given: neither --dark, --white nor --drive")
    batches: dict[str, list[LineBatch]] = {}
    cameras = library.sensors(options.sensors)
    if options.drive is not None:
        bag = open_vehicle(options.drive)
        cameras = replay_configuration(bag, library, None, ()).odometry.sensors
        batches = read_batches(bag, cameras)
    files = {
        kind: camera_files(given, cameras, options.sensors, f"--{kind}")
        for kind, given in (("dark", options.dark), ("white", options.white))
    }
    lines = {
        kind: {n: read_lines(path, options.cut, options.raw) for n, path in own.items()}
        for kind, own in files.items()
    }
    fields = {}
    for name, camera in cameras.items():
        references = lines["dark"].get(name), lines["white"].get(name)
        field = _field(name, camera.pixels, references, batches.get(name, []))
        if field is not None:
            fields[name] = field
    options.out.mkdir(parents=True, exist_ok=True)
    for name, field in fields.items():
        field.save(options.out / f"{name}.npz")
    rows = {name: _quantities(field) for name, field in fields.items()}
    text = [
        f"{name}: "
        + ", ".join(f"{key.replace('_', ' ')} {v:.3g} {u}" for key, (v, u) in row.items())
        for name, row in rows.items()
    ]
    use = f"use it: --set odometry.flat_field_tables={options.out.resolve()}"
    return Report(
        name="lines_reference",
        metrics=entries(
            {f"{key}.{name}": entry for name, row in rows.items() for key, entry in row.items()}
        ),
        details={"folder": str(options.out)},
        text=(*text, f"wrote {options.out}; {use}"),
    )


def _field(
    name: str,
    pixels: int,
    references: tuple[Lines | None, Lines | None],
    batches: Sequence[LineBatch],
) -> FlatField | None:
    """Return the tables of a camera from dark lines, white lines and a drive; None if not given."""
    from linescan_odometry.measurements import LineBatchError
    from linescan_odometry.view.flat_field import FlatField

    given = [part for part in references if part is not None]
    if not given and not batches:
        return None
    field = FlatField(pixels if batches else given[0].shape[1], _PLACES)
    if given:
        try:
            field.take_references(*references)
        except LineBatchError as error:
            key = "--dark" if references[1] is None else "--white"
            raise ConfigurationError(key, f"{name}: {error}") from None
    for batch in batches:
        if batch.lines.shape[1:] == (pixels,):
            field.apply(batch.lines)
    return field


def _quantities(field: FlatField) -> dict[str, tuple[float, str]]:
    """Return the figures of a camera's tables, as (value, unit)."""
    dark, white = field.references
    gain = 1.0 / white
    return {
        "dark_level": (float(dark.mean()), "gray levels"),
        "dark_spread": (float(dark.std()), "gray levels"),
        "gain_spread": (100.0 * float(gain.std() / gain.mean()), "%"),
        "still_spread": (100.0 * float(np.std(field.profile)) if field.places else 0.0, "%"),
        "places": (float(field.places), "1"),
        "blind_pixels": (float(np.count_nonzero(field.blind)), "1"),
    }
