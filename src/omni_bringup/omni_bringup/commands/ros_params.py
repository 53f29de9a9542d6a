"""``./omni ros-params``: write parameter files for a real vehicle.

Turn a vehicle file, or the configuration of a run, into the parameter files of odometry and
assistant and a URDF; docs/real_vehicle.md says what to do with them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK
from omni_platform.command_options import option
from omni_platform.configuration import Configuration


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni ros-params``."""

    configuration: Path = option(
        positional=True,
        metavar="CONFIGURATION",
        description="such as config/hardware/mecanum_agv.yaml, or the configuration.yaml of a run",
    )
    out: Path = option(metavar="DIR", description="folder of the files; made if it is missing")


def run(options: Options, _workspace: Path) -> int:
    """Write the files and say where they are; return the exit code."""
    from omni_bringup.graph.hardware import read_hardware, write_parameters

    hardware = read_hardware(options.configuration)
    try:
        written = write_parameters(hardware, options.out)
    except OSError as error:
        print(f"omni ros-params: cannot write to {options.out}: {error.strerror}", file=sys.stderr)
        return EXIT_FAILED
    for path in written:
        print(path)
    return EXIT_OK
