"""``./omni lines import``: files of real cameras into a recording.

Make a recording of the lines in files: a folder of pictures (PNG, TIFF), one picture with many rows
or pages, NPY, CSV, raw bytes or a video. `omni replay --offline` and `omni lines show` take it.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from dataclasses import dataclass
from pathlib import Path

from omni_analysis.line_files.options import FileOptions, camera_files
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK
from omni_platform.command_options import json_option, option, overrides_option
from omni_platform.configuration import parameter

WORK = "reading and recording lines"


@dataclass(frozen=True, kw_only=True)
class Options(FileOptions):
    """Options of ``omni lines import``."""

    sources: tuple[str, ...] = option(
        positional=True,
        metavar="CAMERA=FILE",
        description="name of a camera and the file or folder of its lines, such as left=left.npy",
    )
    sensors: str = parameter(
        "three_generic",
        description="the line cameras by name, a set of config/sensors or a YAML file; pixels "
        "are taken from the lines",
    )
    rate: float | None = option(
        None, above=0.0, unit="1/s", description="lines per second (default: that of the cameras)"
    )
    batch: float = parameter(
        0.01, above=0.0, maximum=1.0, unit="s", description="time of the lines of a message"
    )
    start: float = parameter(0.0, minimum=0.0, unit="s", description="stamp of the first line")
    experiment: str = parameter(
        "straight_line", description="whose vehicle and settings go with the recording"
    )
    overrides: tuple[str, ...] = overrides_option("odometry.median_lines=5")
    out: Path = option(metavar="DIR", description="new folder of the recording")
    json: bool = json_option()


def run(options: Options, workspace: Path) -> int:
    """Make the recording and return the exit code."""
    from omni_analysis.line_files.reading import read_lines
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_bringup.graph.run_folder import check_unused, write_configuration
    from omni_bringup.replay.lines import write_lines
    from omni_platform.configuration import to_mapping
    from omni_recording.write import RecordingError

    library = ExperimentLibrary(workspace / "config")
    known = library.sensors(options.sensors)
    files = camera_files(options.sources, known, options.sensors)
    check_unused(options.out)
    lines = {name: read_lines(path, options.cut, options.raw) for name, path in files.items()}
    sensors = {
        name: dataclasses.replace(
            known[name],
            pixels=own.shape[1],
            line_rate=options.rate or known[name].line_rate,
        )
        for name, own in lines.items()
    }
    try:
        start_ns = round(1e9 * options.start)
        messages = write_lines(options.out, lines, sensors, options.batch, start_ns)
        missing = [name for name in known if name not in lines]
        whole = {**known, **sensors}
        variant = library.variants(options.experiment)[-1]
        tree = {name: to_mapping(sensor) for name, sensor in whole.items()}
        changes = (f"sensors={json.dumps(tree)}", *options.overrides)
        write_configuration(library.load(options.experiment, variant, changes), options.out)
    except RecordingError as error:
        print(f"omni lines import: {error}", file=sys.stderr)
        return EXIT_FAILED
    except OSError as error:
        print(f"omni lines import: cannot write to {options.out}: {error}", file=sys.stderr)
        return EXIT_FAILED
    if options.json:
        metrics = {
            f"{quantity}.{name}": {"value": value, "unit": unit}
            for name, own in lines.items()
            for quantity, value, unit in (
                ("lines", len(own), "1"),
                ("pixels", own.shape[1], "px"),
                ("messages", messages[name], "1"),
                ("duration", len(own) / sensors[name].line_rate, "s"),
            )
        }
        document = {"name": "lines_import", "metrics": metrics, "folder": str(options.out)}
        print(json.dumps(document, indent=2))
        return EXIT_OK
    for name, own in lines.items():
        rate = sensors[name].line_rate
        print(
            f"{name}: {len(own)} lines of {own.shape[1]} px, {8 * own.itemsize} bit, "
            f"{len(own) / rate:.3g} s at {rate:g} lines/s"
        )
    if missing:
        print(f"no lines of {', '.join(missing)}: the odometry cannot be replayed, only looked at")
    print(f"recorded in {options.out}; look at it: ./omni lines show {options.out}")
    return EXIT_OK
