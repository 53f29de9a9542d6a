"""The nodes that the files in ``launch/`` start: those of `omni run` and `omni drive`."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Mapping
from pathlib import Path

from omni_analysis.loop.experiment import ExperimentLibrary
from omni_bringup.commands.drive import drive_nodes
from omni_bringup.graph import nodes as graph
from omni_bringup.graph.process_group import NodeProcess
from omni_platform.configuration import ConfigurationError

# Launch arguments: default and description.
ARGUMENTS = {
    "config": ("config", "Folder of the configuration, as in the workspace"),
    "experiment": ("straight_line", "A file of config/experiments/"),
    "variant": ("", "Variant of the experiment; its last if empty"),
    "overrides": ("", "KEY=VALUE words, as --set of omni takes them"),
    "out": ("", "Folder of the recording; must not exist"),
}
LOCKSTEP, REAL_TIME, DRIVE = "lockstep", "real_time", "drive"


def planned_nodes(mode: str, given: Mapping[str, str]) -> list[NodeProcess]:
    """Return the nodes of a mode, listeners first; their parameter files are left in ``/tmp``.

    Args:
        mode: `LOCKSTEP`, `REAL_TIME` or `DRIVE`.
        given: the launch arguments by name.

    Raises:
        ConfigurationError: an argument or a value of the configuration does not fit.
    """
    library = ExperimentLibrary(Path(given["config"]))
    variant = given["variant"] or library.variants(given["experiment"])[-1]
    overrides = shlex.split(given["overrides"])
    configuration = library.load(given["experiment"], variant, overrides)
    folder = Path(given["out"]).resolve() if given["out"] else None
    scratch = Path(tempfile.mkdtemp(prefix="omni-"))
    if mode == DRIVE:
        return drive_nodes(configuration, scratch, {}, folder)
    if folder is None:
        raise ConfigurationError("out", "is needed: the folder of the recording")
    return graph.run_nodes(configuration, folder, scratch, lockstep=mode == LOCKSTEP)
