"""``./omni doctor``: check the installation, and whether ROS nodes can communicate.

Check each part of the installation and print one line for each, with a remedy for each failure. The
exit code is 1 if any check fails.
"""

import contextlib
import csv
import importlib
import multiprocessing
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report
from omni_runs.workspace import ExperimentWorkspace

WORK = "checking"

_PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "matplotlib", "PyYAML", "rosbags")
_AGAIN = "delete .venv and start again"
_PATIENCE = 30.0  # time within which two nodes must exchange messages [s]


class Options(CommandOptions):
    """Options of ``omni doctor``."""

    parameters: Path | None = option(None, metavar="DIR")
    """folder written by ./omni ros-params, to check for a warning about the source of the twist"""


class TroubleError(Exception):
    """A problem of the installation, with its remedy."""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Check each part of the installation, and report the results."""
    checks: dict[str, Callable[[Path], str]] = {
        "Python": _python,
        "packages": _packages,
        "ROS": _ros,
        "DDS": _dds,
        "kernels": _kernels,
        "configuration": _configuration,
        "disk": _disk,
        "folders": _folders,
        "browser": _browser,
    }
    if options.parameters is not None:
        checks["feedback"] = partial(_feedback, options.parameters)
    found: dict[str, dict[str, Any]] = {}
    for name, check in checks.items():
        try:
            found[name] = {"ok": True, "words": check(workspace.folder)}
        except TroubleError as trouble:
            found[name] = {"ok": False, "words": str(trouble)}
    return Report(
        details={"checks": found},
        text=(
            f"{'ok' if one['ok'] else 'wrong':<7} {name}: {one['words']}"
            for name, one in found.items()
        ),
        ok=all(one["ok"] for one in found.values()),
    )


def _python(_: Path) -> str:
    return f"{platform.python_version()} on {platform.system()} {platform.machine()}"


def _packages(_: Path) -> str:
    versions = {name: _complete(name) for name in _PACKAGES}
    return f"numba {versions['numba']} and all other packages are installed"


def _complete(name: str) -> str:
    """Return the version of an installed package after a check of the sizes of its files.

    Importing all packages would take more time than all other checks.
    """
    try:
        package = metadata.distribution(name)
    except metadata.PackageNotFoundError:
        raise TroubleError(f"{name} is not installed; {_AGAIN}") from None
    folder = str(package.locate_file(""))
    for path, _, size in csv.reader((package.read_text("RECORD") or "").splitlines()):
        file = os.path.join(folder, path)
        if size and (not os.path.exists(file) or os.path.getsize(file) != int(size)):
            raise TroubleError(f"{name} is incomplete ({file}); {_AGAIN}")
    return package.version


def _ros(_: Path) -> str:
    try:
        path = importlib.import_module("rclpy").__file__ or ""
    except Exception as error:
        raise TroubleError(f"rclpy cannot be imported ({error}); {_AGAIN}") from None
    source = "from the wheels" if path.startswith(sys.prefix) else "sourced"
    middleware = os.environ.get("RMW_IMPLEMENTATION", "the default middleware")
    return f"{os.environ.get('ROS_DISTRO', 'jazzy')}, {source}, {middleware}"


def _dds(_: Path) -> str:
    """Check that two nodes on this machine receive each other's messages."""
    from omni_ros.environment import node_environment
    from omni_ros.exchange import exchange_messages
    from omni_runs.graph.domain import NoFreeDomainError, reserved_domain

    try:
        with reserved_domain() as domain:
            # A fork imports neither rclpy nor this module again.
            talkers = multiprocessing.get_context("fork").Process(
                target=exchange_messages, args=(node_environment(domain),)
            )
            talkers.start()
            talkers.join(_PATIENCE)
            code = talkers.exitcode
            with contextlib.suppress(ProcessLookupError):  # both have ended
                os.killpg(talkers.pid or 0, signal.SIGKILL)
            talkers.join()
    except NoFreeDomainError as error:
        raise TroubleError(str(error)) from None
    if code != 0:
        raise TroubleError(
            "two nodes on this machine do not receive each other's messages; is UDP on the "
            "loopback device, or /dev/shm, forbidden? unset ROS_DOMAIN_ID, RMW_IMPLEMENTATION and "
            "FASTRTPS_DEFAULT_PROFILES_FILE and try again"
        )
    return f"two nodes in domain {domain} exchange messages"


def _kernels(_: Path) -> str:
    folder = Path(os.environ.get("NUMBA_CACHE_DIR", ""))
    count = sum(1 for _ in folder.rglob("*.nbc")) if folder.is_dir() else 0
    if not count:
        raise TroubleError("none are compiled yet; ./omni compiles them when it next builds")
    return f"{count} compiled in {folder}"


def _configuration(workspace: Path) -> str:
    from omni_core.configuration import ConfigurationError
    from omni_runs.experiment import ExperimentLibrary

    library = ExperimentLibrary(workspace / "config")
    names = library.names()
    try:
        for name in names:
            for variant in library.variants(name):
                library.load(name, variant)
    except ConfigurationError as error:
        raise TroubleError(f"experiment {name}: {error}") from None
    if not names:
        raise TroubleError(
            f"there are no experiments in {workspace / 'config'}; start omni in the workspace"
        )
    return f"all {len(names)} experiments can be loaded"


def _disk(workspace: Path, needed: float = 0.2e9) -> str:
    """Check that the disk has the space `needed` [B] for a run with its recordings."""
    with tempfile.TemporaryFile(dir=workspace):
        pass
    free = shutil.disk_usage(workspace).free
    if free < needed:
        raise TroubleError(
            f"{free / 1e9:.1f} GB are free in {workspace}, but a run may need {needed / 1e9:.1f} GB"
        )
    return f"{free / 1e9:.1f} GB are free"


def _folders(workspace: Path) -> str:
    """Return the folders that the workspace fills, with their sizes."""
    from omni_ros.environment import named_log_folder
    from omni_sim.texture.cache import TextureCache

    names = ("build", "install", ".cache", "bags", "results")
    folders = [Path(sys.prefix), *(workspace / name for name in names)]
    folders.append(TextureCache.of_user().directory)
    if logs := named_log_folder(os.environ):
        folders.append(logs[1])
    found = [str(folder) for folder in folders if folder.is_dir()]
    # Some of the files may be removed in the meantime.
    rows = subprocess.run(["du", "-sk", *found], capture_output=True, text=True, check=False).stdout
    sizes = (row.split("\t") for row in rows.splitlines())
    return ", ".join(f"{folder} {int(size) * 1.024e-3:.0f} MB" for size, folder in sizes)


def _feedback(parameters: Path, _: Path) -> str:
    from omni_runs.graph.hardware import BRAKE_ASSIST, WARNING

    file = parameters / f"{BRAKE_ASSIST}.yaml"
    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
        warning = tree["/**"]["ros__parameters"].get(WARNING, "")
    except OSError as error:
        raise TroubleError(f"cannot read {file}: {error.strerror}") from None
    except (yaml.YAMLError, KeyError, TypeError):
        raise TroubleError(
            f"{file} contains no parameters; write it by ./omni ros-params"
        ) from None
    if warning:
        raise TroubleError(f"{warning}; use another source or law, or no assistant")
    return "no warning about the source of the twist"


def _browser(_: Path) -> str:
    for name in ("xdg-open", "chromium", "google-chrome", "firefox"):
        if shutil.which(name):
            return f"{name} is installed (for reports and ./omni drive)"
    return "none found; open reports and the page of ./omni drive from another machine"
