"""``./omni lines import``: import files of real cameras into a recording.

Create a recording from the lines in files: a folder of pictures (PNG, TIFF), one picture with many
rows or pages, NPY, CSV, raw bytes or a video. `omni replay` and `omni lines show` can
read this recording.
"""

import dataclasses
import json
from pathlib import Path

from omni_core.commands.command_options import CommandOptions, option, overrides_option
from omni_core.commands.command_report import Report, entries_by_case, in_words
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.line_files.commands import FileOptions, camera_files

WORK = "reading and recording lines"


class Options(FileOptions, CommandOptions):
    """Options of ``omni lines import``."""

    sources: tuple[str, ...] = option(positional=True, metavar="CAMERA=FILE")
    """name of a camera, and the file or folder of its lines, such as left=left.npy"""
    sensors: str = option("three_generic")
    """a file of config/sensors/, or another YAML file with line cameras; the number of pixels is
    taken from the lines"""
    rate: float | None = option(None, above=0.0, unit="1/s", maximum=1e6)
    """line rate (default: that of the cameras, or of --stamps)"""
    stamps: Path | None = option(None, metavar="FILE")
    """CSV or NPY file with the time of each line [s], equal for all cameras; it shows lost lines
    and lines that an encoder has triggered, which are refused"""
    batch: float = option(0.01, above=0.0, maximum=1.0, unit="s")
    """time that the lines in one message span"""
    start: float = option(0.0, minimum=0.0, unit="s", maximum=4.0e9)
    """stamp of the first line"""
    experiment: str = option("straight_line")
    """experiment whose vehicle and settings are stored with the recording"""
    overrides: tuple[str, ...] = overrides_option("odometry.median_lines=5")
    out: Path = option(metavar="DIR")
    """new folder of the recording"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Create a recording from the lines in the files."""
    from omni_core.configuration import ConfigurationError, to_mapping
    from omni_runs.graph.run_folder import unused, write_configuration
    from omni_runs.replay.lines import write_lines
    from omni_tools.line_files.reading import constant_rate, read_lines

    library = workspace.experiment_library()
    known = library.sensors(options.sensors)
    files = camera_files(options.sources, known, options.sensors)
    unused(options.out)
    lines = {name: read_lines(path, options.cut, options.raw) for name, path in files.items()}
    rate, start_ns = options.rate, round(1e9 * options.start)
    if options.stamps is not None:
        if rate is not None:
            raise ConfigurationError("--rate", "cannot be combined with --stamps")
        rate, start_ns = constant_rate(options.stamps, {len(own) for own in lines.values()})
    sensors = {
        name: dataclasses.replace(
            known[name], pixels=own.shape[1], line_rate=rate or known[name].line_rate
        )
        for name, own in lines.items()
    }
    tree = {name: to_mapping(sensor) for name, sensor in {**known, **sensors}.items()}
    changes = (f"sensors={json.dumps(tree)}", *options.overrides)
    configuration = library.load(options.experiment, overrides=changes)
    messages = write_lines(options.out, lines, sensors, options.batch, start_ns)
    write_configuration(configuration, options.out)
    rows: dict[str, dict[str, tuple[float, str]]] = {
        name: {
            "lines": (len(own), "1"),
            "pixels": (own.shape[1], "px"),
            "bits": (8 * own.itemsize, "1"),
            "messages": (messages[name], "1"),
            "duration": (len(own) / sensors[name].line_rate, "s"),
        }
        for name, own in lines.items()
    }
    text = [f"{name}: {in_words(row)}" for name, row in rows.items()]
    missing = ", ".join(name for name in known if name not in lines)
    if missing:
        text.append(
            f"no lines of {missing}: the lines can be shown, but the odometry cannot be replayed"
        )
    text.append(f"recorded in {options.out}; look at it: ./omni lines show {options.out}")
    return Report(metrics=entries_by_case(rows), details={"folder": str(options.out)}, text=text)
