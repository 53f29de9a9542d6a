"""``./omni doctor``: check the installation, and whether ROS nodes can communicate.

Check each part of the installation and print one line for each, with a remedy for each failure. The
exit code is 1 if any check fails.
"""

import contextlib
import importlib
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report
from omni_runs.workspace import ExperimentWorkspace

WORK = "checking"


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
    for name in ("numpy", "scipy", "matplotlib", "yaml", "rosbags", "omni_sim"):
        _imported(name)
    return f"numba {_imported('numba').__version__} and all other packages are installed"


def _imported(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except Exception as error:
        raise TroubleError(
            f"{name} cannot be imported ({error}); delete .venv and start again"
        ) from None


def _ros(_: Path) -> str:
    path = _imported("rclpy").__file__ or ""
    source = "from the wheels" if path.startswith(sys.prefix) else "sourced"
    middleware = os.environ.get("RMW_IMPLEMENTATION", "the default middleware")
    return f"{os.environ.get('ROS_DISTRO', 'jazzy')}, {source}, {middleware}"


# Two processes with a node each; the second one is a fork, so that both import rclpy only once.
_TALK = """
import os, sys, rclpy
from std_msgs.msg import String
other = os.fork()
own, its = ("a", "b") if other else ("b", "a")
rclpy.init()
node = rclpy.create_node("doctor_" + own)
received = []
node.create_subscription(String, "doctor_" + its, received.append, 1)
publisher = node.create_publisher(String, "doctor_" + own, 1)
spare = 20
while rclpy.ok() and spare:
    publisher.publish(String())
    rclpy.spin_once(node, timeout_sec=0.05)
    spare -= bool(received)
if other:
    sys.exit(os.waitpid(other, 0)[1] != 0)
"""


def _dds(_: Path) -> str:
    """Check that two nodes on this machine receive each other's messages."""
    from omni_ros.environment import node_environment
    from omni_runs.graph.domain import NoFreeDomainError, reserved_domain

    try:
        with reserved_domain() as domain:
            talkers = subprocess.Popen(
                [sys.executable, "-c", _TALK],
                env=node_environment(domain),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            try:
                code = talkers.wait(30.0)
            except subprocess.TimeoutExpired:
                code = 1
            finally:
                with contextlib.suppress(ProcessLookupError):  # both have ended
                    os.killpg(talkers.pid, signal.SIGKILL)
                talkers.wait()
    except NoFreeDomainError as error:
        raise TroubleError(str(error)) from None
    if code:
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
    from omni_sim.texture.cache import TextureCache

    names = ("build", "install", ".cache", "bags", "results")
    folders = [Path(sys.prefix), *(workspace / name for name in names)]
    folders.append(TextureCache.of_user().directory)
    sizes = {folder: _size(folder) for folder in folders if folder.is_dir()}
    return ", ".join(f"{folder} {size / 1e6:.0f} MB" for folder, size in sizes.items())


def _size(folder: Path) -> int:
    """Return the size of all files in a folder [B]."""
    total, folders = 0, [str(folder)]
    while folders:
        # A file or folder may be removed in the meantime.
        with contextlib.suppress(OSError), os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
                    continue
                with contextlib.suppress(OSError):
                    total += entry.stat(follow_symlinks=False).st_size
    return total


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
