"""``./omni lines reference``: tables of what is fixed in the views of line cameras.

Make the tables by which the odometry corrects its lines from the first one on: of dark lines (the
lens covered) and white ones (an even surface under the lamp), and of what stands still in the
lines of a recorded drive. `odometry.flat_field_tables` takes the folder.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_analysis.line_files.options import FileOptions, camera_files
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED
from omni_platform.command_options import json_option, option
from omni_platform.configuration import ConfigurationError, parameter

if TYPE_CHECKING:
    from linescan_odometry.measurements import LineBatch, Lines
    from linescan_odometry.view.flat_field import FlatField

WORK = "averaging lines"

_PLACES = 200  # of the mean of a drive, as the odometry's own


@dataclass(frozen=True, kw_only=True)
class Options(FileOptions):
    """Options of ``omni lines reference``."""

    dark: tuple[str, ...] = option(
        (), metavar="CAMERA=FILE", description="lines of a covered camera, such as left=dark.npy"
    )
    white: tuple[str, ...] = option(
        (), metavar="CAMERA=FILE", description="lines of an even white surface"
    )
    drive: Path | None = option(
        None, metavar="BAG", description="recorded drive, whose lines show what stands still"
    )
    sensors: str = parameter(
        "three_generic", description="the line cameras by name, as of `lines import`"
    )
    out: Path = option(metavar="DIR", description="folder of the tables, a file a camera")
    json: bool = json_option()


def run(options: Options, workspace: Path) -> int:
    """Make the tables and return the exit code."""
    from omni_analysis.line_files.reading import read_lines
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_bringup.replay.lines import read_batches
    from omni_bringup.replay.plan import replay_configuration
    from omni_recording.error import BagError
    from omni_recording.folder import open_vehicle

    library = ExperimentLibrary(workspace / "config")
    if not (options.dark or options.white or options.drive):
        raise ConfigurationError("--dark", "nothing is given: neither --dark, --white nor --drive")
    batches: dict[str, list[LineBatch]] = {}
    cameras = library.sensors(options.sensors)
    if options.drive is not None:
        try:
            bag = open_vehicle(options.drive)
            cameras = replay_configuration(bag, library, None, ()).odometry.sensors
            batches = read_batches(bag, cameras)
        except BagError as error:
            print(f"omni lines reference: {error}", file=sys.stderr)
            return EXIT_REFUSED
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
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        for name, field in fields.items():
            field.save(options.out / f"{name}.npz")
    except OSError as error:
        print(f"omni lines reference: cannot write {options.out}: {error}", file=sys.stderr)
        return EXIT_FAILED
    rows = {name: _told(field) for name, field in fields.items()}
    if options.json:
        metrics = {
            f"{quantity}.{name}": {"value": value, "unit": unit}
            for name, row in rows.items()
            for quantity, (value, unit) in row.items()
        }
        document = {"name": "lines_reference", "metrics": metrics, "folder": str(options.out)}
        print(json.dumps(document, indent=2))
        return EXIT_OK
    for name, row in rows.items():
        words = [f"{quantity.replace('_', ' ')} {v:.3g} {u}" for quantity, (v, u) in row.items()]
        print(f"{name}: {', '.join(words)}")
    print(f"wrote {options.out}; use it: --set odometry.flat_field_tables={options.out.resolve()}")
    return EXIT_OK


def _field(
    name: str,
    pixels: int,
    references: tuple[Lines | None, Lines | None],
    batches: Sequence[LineBatch],
) -> FlatField | None:
    """Return the tables of a camera: of its dark and white lines, and of a drive; None of none."""
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


def _told(field: FlatField) -> dict[str, tuple[float, str]]:
    """Return what the tables of a camera say."""
    dark, white = field.references
    gain = 1.0 / white
    return {
        "dark_level": (float(dark.mean()), "grey levels"),
        "dark_spread": (float(dark.std()), "grey levels"),
        "gain_spread": (100.0 * float(gain.std() / gain.mean()), "%"),
        "still_spread": (100.0 * float(np.std(field.profile)) if field.places else 0.0, "%"),
        "places": (float(field.places), "1"),
        "blind_pixels": (float(np.count_nonzero(field.blind)), "1"),
    }
