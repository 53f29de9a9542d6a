"""Files stored with the recording of a run: configuration, versions, seed, results."""

import contextlib
import datetime
import functools
import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcap.writer import MCAP0_MAGIC

from omni_core.commands.command_report import make_folder, printable, write_text
from omni_core.configuration import ConfigurationError, to_mapping
from omni_recording.safe_yaml import in_yaml
from omni_runs.experiment import CONFIGURATION, ExperimentConfiguration
from omni_runs.yaml_files import read_mapping

VERSIONS = "versions.yaml"
SUMMARY = "summary.json"

_DISTRIBUTIONS = (
    "omni_sim",
    "linescan_odometry",
    "omni_brake_assist",
    "numpy",
    "numba",
    "scipy",
    "mcap",
    "rosbags",
    "ros-rclpy",
    "ros-rmw-fastrtps-cpp",
)


def unused(folder: Path) -> Path:
    """Check that the results folder of --out is new or empty, and return it.

    Raises:
        ConfigurationError: the path is a file, or the folder is not empty.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        problem = f"{folder} exists and is not an empty folder; choose another"
        raise ConfigurationError("--out", problem)
    return folder


def new_folder(folder: Path) -> Path:
    """Create a results folder, which must be new or empty, and return it."""
    return make_folder(unused(folder))


def time_in_name() -> str:
    """Return the current date and time as a text for the name of a folder."""
    return datetime.datetime.now().strftime("%Y-%m-%dT%H-%M-%S.%f")[:-3]


def write_configuration(configuration: ExperimentConfiguration, folder: Path) -> None:
    """Save the effective configuration (including the seed) and the software versions."""
    write_text(folder / CONFIGURATION, in_yaml(to_mapping(configuration)))
    write_text(folder / VERSIONS, in_yaml(versions()))


def write_summary(document: Mapping[str, Any], folder: Path) -> None:
    """Save the results of a run as the JSON document that `--json` prints."""
    write_text(folder / SUMMARY, json.dumps(document, indent=2, allow_nan=False) + "\n")


def unfinished_recordings(folder: Path) -> list[Path]:
    """Return those recordings in a folder of runs whose recorder was killed.

    The file of such a recording has no index at its end. It can be read up to its last complete
    chunk.
    """
    return [path for path in sorted(folder.glob("*/*.mcap")) if not _has_end(path)]


def _has_end(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > len(MCAP0_MAGIC) and file.read() == MCAP0_MAGIC


@functools.cache
def versions() -> dict[str, str]:
    """Return what the bits of results depend on, keyed by name.

    These are the versions of Python, the packages and the ROS middleware, the commit of the
    workspace and the model of the processor.
    """
    found = {"python": platform.python_version(), "machine": platform.machine()}
    with contextlib.suppress(OSError):  # Linux only
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
        found["processor"] = next(models, platform.machine())
    with contextlib.suppress(OSError, subprocess.CalledProcessError):  # no git, or no clone
        command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
        done = subprocess.run(command, capture_output=True, check=True, text=True)
        found["commit"] = done.stdout.strip()
    for name in _DISTRIBUTIONS:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # a sourced ROS installation has no Python distribution of rclpy
    found["ros_distro"] = os.environ.get("ROS_DISTRO", "jazzy")
    return found


def other_versions(folder: Path) -> list[str]:
    """Return each version stored with a recording that differs from the present one, in words.

    Args:
        folder: folder of the recording; without stored versions, the result is empty.

    Raises:
        ConfigurationError: the stored versions cannot be read.
    """
    path = folder / VERSIONS
    stored, present = read_mapping(path, VERSIONS) if path.is_file() else {}, versions()
    return [
        f"{name} {printable(str(stored[name]), 100)} (here {value})"
        for name, value in present.items()
        if str(stored.get(name, value)) != value
    ]
