"""``./omni lines reference``: compute tables of the fixed pattern of line cameras.

Compute the tables with which the odometry corrects every line, including the first one. They are
computed from dark lines (lens covered), from white lines (an evenly lit surface), or from the lines
of a recorded motion. Set `odometry.flat_field_tables` to the folder of the tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, entries_by_case, in_words
from omni_core.configuration import ConfigurationError
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.line_files.commands import FileOptions, camera_files

if TYPE_CHECKING:
    from linescan_odometry.configuration import OdometryConfiguration
    from linescan_odometry.joint.spectra import FixedPattern
    from linescan_odometry.references import References
    from omni_core.signals import LineBatch, Lines

WORK = "averaging lines"


class Options(FileOptions, CommandOptions):
    """Options of ``omni lines reference``."""

    dark: tuple[str, ...] = option((), metavar="CAMERA=FILE")
    """lines of a covered camera, such as left=dark.npy"""
    white: tuple[str, ...] = option((), metavar="CAMERA=FILE")
    """lines of an evenly lit white surface"""
    drive: Path | None = option(None, metavar="BAG")
    """recording of a motion from whose lines the fixed pattern is estimated"""
    sensors: str = option("three_generic")
    """a file with line cameras, as in `lines import`"""
    out: Path = option(metavar="DIR")
    """folder for the tables, one file for each camera"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Compute and write the correction tables of all given cameras."""
    from omni_recording.folder import open_vehicle
    from omni_runs.replay.lines import read_batches
    from omni_runs.replay.plan import recorded_configuration
    from omni_tools.line_files.reading import read_lines

    if not (options.dark or options.white or options.drive):
        raise ConfigurationError("--dark", "give --dark, --white or --drive")
    batches: dict[str, list[LineBatch]] = {}
    cameras = workspace.experiment_library().sensors(options.sensors)
    odometry = None
    if options.drive is not None:
        bag = open_vehicle(options.drive)
        odometry = recorded_configuration(bag).odometry
        cameras = odometry.sensors
        batches = read_batches(bag, cameras)
    files = {
        kind: camera_files(given, cameras, options.sensors, f"--{kind}")
        for kind, given in (("dark", options.dark), ("white", options.white))
    }
    lines = {
        kind: {n: read_lines(path, options.cut, options.raw) for n, path in own.items()}
        for kind, own in files.items()
    }
    tables = {}
    for name, camera in cameras.items():
        dark, white = lines["dark"].get(name), lines["white"].get(name)
        given = [part for part in (dark, white) if part is not None]
        if given or name in batches:
            pixels = camera.pixels if name in batches else given[0].shape[1]
            tables[name] = _references(name, pixels, dark, white)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, references in tables.items():
        file = options.out / f"{name}.npz"
        references.save(file)
        if odometry is not None and name in batches:
            references.pattern = _pattern_of(odometry, name, batches[name], file)
            references.save(file)
    rows = {name: _quantities(references) for name, references in tables.items()}
    text = [f"{name}: {in_words(row)}" for name, row in rows.items()]
    use = f"use it: --set odometry.flat_field_tables={options.out.resolve()}"
    return Report(
        metrics=entries_by_case(rows),
        details={"folder": str(options.out)},
        text=(*text, f"wrote {options.out}; {use}"),
    )


def _references(name: str, pixels: int, dark: Lines | None, white: Lines | None) -> References:
    """Return the correction tables of a camera from dark and white lines.

    Args:
        name: name of the camera, for error messages.
        pixels: number n of pixels of the camera.
        dark: lines with the lens covered, shape (m, n); None if there are none.
        white: lines of an evenly lit surface, shape (k, n); None if there are none.

    Raises:
        ConfigurationError: the lines do not fit the camera.
    """
    from linescan_odometry.references import References
    from omni_core.signals import LineBatchError

    references = References(pixels)
    try:
        references.take(dark, white)
    except LineBatchError as error:
        key = "--dark" if white is None else "--white"
        raise ConfigurationError(key, f"{name}: {error}") from None
    return references


def _pattern_of(
    odometry: OdometryConfiguration, name: str, batches: Sequence[LineBatch], tables: Path
) -> FixedPattern | None:
    """Return the fixed pattern that the odometry estimates from a recording; None without estimate.

    Args:
        odometry: configuration of the odometry.
        name: name of the camera.
        batches: recorded lines of this camera, oldest first.
        tables: file of the camera's correction tables.
    """
    from linescan_odometry.sensor import SensorOdometry

    camera = SensorOdometry(odometry.sensors[name], odometry, tables)
    for batch in batches:
        camera.update(batch)
    return camera.pattern


def _quantities(references: References) -> dict[str, tuple[float, str]]:
    """Return statistics of a camera's tables as pairs (value, unit), keyed by name."""
    dark, pattern = references.dark, references.pattern
    gain = 1.0 / references.gain
    still = 0.0 if pattern is None else pattern.deviation(len(dark))
    return {
        "dark_level": (float(dark.mean()), "gray levels"),
        "dark_spread": (float(dark.std()), "gray levels"),
        "gain_spread": (100.0 * float(gain.std() / gain.mean()), "%"),
        "pattern_spread": (100.0 * still, "%"),
        "dead_pixels": (float(np.count_nonzero(references.dead)), "1"),
    }
