"""Folders of the workspace, their stamps, and environment variables."""

import contextlib
import glob
import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from setup.failures import SetupError
from setup.pythons import SUPPORTED

STAMP_FORMAT = 1
OWN_FOLDERS = ("src", "build", "install")
SOURCED_DISTRO = "jazzy"
# Variables through which another Python, ROS or pip configuration would affect this environment.
FOREIGN_VARIABLES = (
    *("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"),
    *("ROS_DISTRO", "ROS_VERSION", "ROS_PYTHON_VERSION", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"),
    *("OMNI_RUNNING", "PIP_TARGET", "PIP_PREFIX", "PIP_ROOT", "PIP_USER"),
    # Without stored bytecode every process would compile its libraries again.
    "PYTHONDONTWRITEBYTECODE",
)


class SourcedRos(NamedTuple):
    """The ROS installation that the user has sourced: its prefixes and its Python."""

    prefixes: tuple[str, ...]
    python: tuple[int, int]


class Workspace:
    """The workspace and the folders that set-up fills."""

    def __init__(self, root: Path, ros: SourcedRos | None) -> None:
        self.root = root
        self.ros = ros
        # There is one environment for each kind of ROS, so that both kinds can exist side by side.
        self.venv = root / (".venv-sourced" if ros else ".venv")
        self.python = self.venv / "bin" / "python"
        self.lock_file = root / "requirements" / ("sourced-ros.lock" if ros else "wheels.lock")
        self.install = root / "install"
        self.cache = root / ".cache"
        self.kernels = self.cache / "numba"
        self.log = self.cache / "setup.log"


def find_sourced_ros(environ: Mapping[str, str], root: Path) -> SourcedRos | None:
    """Return the sourced Jazzy with rclpy; None if the ROS wheels from PyPI are to be used.

    Args:
        environ: The user's environment; OMNI_ROS forces the choice.
        root: Folder of the workspace, whose own prefixes do not count.

    Raises:
        SetupError: OMNI_ROS has an unknown value, or demands a sourced Jazzy and none is found.
    """
    wanted = environ.get("OMNI_ROS", "")
    if wanted not in ("", "wheels", "sourced"):
        raise SetupError(f"OMNI_ROS is '{wanted}': set it to 'wheels' or 'sourced'.")
    if wanted == "wheels":
        return None
    if environ.get("ROS_DISTRO") == SOURCED_DISTRO:
        prefixes = tuple(
            prefix
            for prefix in environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
            if prefix and not is_below(prefix, [str(root)])
        )
        for prefix in prefixes:
            for found in glob.glob(glob.escape(prefix) + "/lib/python3.*/*-packages/rclpy"):
                python = (3, int(re.findall(r"/lib/python3\.(\d+)/", found)[-1]))
                if python in SUPPORTED:
                    return SourcedRos(prefixes, python)
    if wanted == "sourced":
        raise SetupError(
            "OMNI_ROS=sourced, but no ROS 2 Jazzy with rclpy is sourced: "
            "run 'source /opt/ros/jazzy/setup.bash' and start again."
        )
    return None


def is_below(path: str, folders: Sequence[str]) -> bool:
    """Return whether `path` is one of `folders` or in one of them."""
    return any(path == folder or path.startswith(folder.rstrip("/") + "/") for folder in folders)


def without(value: str, folders: Sequence[str]) -> list[str]:
    """Return the entries of a PATH-like value that are not below any of `folders`."""
    return [part for part in value.split(os.pathsep) if part and not is_below(part, folders)]


def base_environment(environ: Mapping[str, str], workspace: Workspace) -> dict[str, str]:
    """Return the user's environment variables without the settings of other installations.

    From variables with lists of folders, the folders of this workspace, of other ROS workspaces and
    of an active Python environment are removed.
    """
    environment = {name: environ[name] for name in environ if name not in FOREIGN_VARIABLES}
    foreign = [str(workspace.root)]
    kept = workspace.ros.prefixes if workspace.ros else ()
    others = environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    others.append(environ.get("VIRTUAL_ENV", ""))
    foreign += [prefix for prefix in others if prefix and prefix not in kept]
    for name in ("LD_LIBRARY_PATH", "PYTHONPATH" if workspace.ros else ""):
        if environ.get(name):
            environment[name] = os.pathsep.join(without(environ[name], foreign))
    if workspace.ros:
        environment["AMENT_PREFIX_PATH"] = os.pathsep.join(workspace.ros.prefixes)
        environment["ROS_DISTRO"] = SOURCED_DISTRO
        for name in ("ROS_VERSION", "ROS_PYTHON_VERSION"):
            if name in environ:
                environment[name] = environ[name]
    environment["PATH"] = os.pathsep.join(
        without(environ.get("PATH", os.defpath), [str(workspace.root)])
    )
    environment["PYTHONPYCACHEPREFIX"] = str(workspace.cache / "bytecode")
    return environment


def own_modules(environ: Mapping[str, str], workspace: Workspace) -> list[str]:
    """Return the entries of PYTHONPATH that contain the user's own modules.

    Packages of another Python or ROS are incompatible. Therefore the entries below the prefix of
    such an installation and all folders of site-packages are removed.
    """
    foreign = [str(workspace.venv), *(f"{workspace.root}/{name}" for name in OWN_FOLDERS)]
    foreign += environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    foreign.append(environ.get("VIRTUAL_ENV", ""))
    entries = without(environ.get("PYTHONPATH", ""), [folder for folder in foreign if folder])
    return [
        entry
        for entry in entries
        if not {"site-packages", "dist-packages"} & set(Path(entry).parts)
    ]


def prepend(environment: dict[str, str], name: str, *parts: object) -> None:
    """Prepend path entries to an environment variable."""
    held = environment.get(name, "")
    environment[name] = os.pathsep.join([str(part) for part in parts] + ([held] if held else []))


def venv_environment(workspace: Workspace, libraries: Sequence[str]) -> dict[str, str]:
    """Return the environment variables for programs of the environment.

    Args:
        workspace: The workspace.
        libraries: Folders with shared libraries of the ROS wheels.
    """
    environment = base_environment(os.environ, workspace)
    environment["VIRTUAL_ENV"] = str(workspace.venv)
    prepend(environment, "PATH", workspace.venv / "bin")
    if not workspace.ros:
        # The environment is also an ament prefix. Without the last two variables, the ROS
        # wheels would set them at import and restart every Python.
        prepend(environment, "AMENT_PREFIX_PATH", workspace.venv)
        prepend(environment, "LD_LIBRARY_PATH", *libraries)
        environment["_ROS_WHEELS_BOOTSTRAP_COMPLETE"] = "1"
        environment["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"  # the only one among the wheels
    return environment


def final_environment(workspace: Workspace, libraries: Sequence[str]) -> dict[str, str]:
    """Return the environment variables for the command, with the built packages on the paths."""
    environment = venv_environment(workspace, libraries)
    installed = sorted(workspace.install.glob("*/lib/python3.*/site-packages"))
    prepend(environment, "AMENT_PREFIX_PATH", *(library.parents[2] for library in installed))
    if not workspace.ros:  # a sourced base has PYTHONPATH already
        prepend(environment, "PYTHONPATH", *own_modules(os.environ, workspace))
    # Modules from src, so that an edit needs no build; entry points are listed in install.
    modules = sorted(path.parent for path in (workspace.root / "src").glob("*/package.xml"))
    prepend(environment, "PYTHONPATH", *modules, *installed)
    environment["OMNI_WORKSPACE"] = str(workspace.root)
    environment["OMNI_CACHE_DIR"] = str(workspace.cache)
    environment["NUMBA_CACHE_DIR"] = str(workspace.kernels)
    environment["MPLCONFIGDIR"] = str(workspace.cache / "matplotlib")
    return environment


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def build_inputs(root: Path) -> Iterator[Path]:
    """Yield the files and folders on which a build depends, in a fixed order.

    A build does not depend on modules, because they are imported from src, or on tests and pages,
    because they are not installed.
    """
    for folder, folders, names in os.walk(root / "src", followlinks=True):
        place = Path(folder).relative_to(root / "src").parts
        if len(place) == 1:  # a package: without modules, tests and files that pip has built
            folders[:] = [name for name in folders if name not in (place[0], "test", "build")]
        folders[:] = sorted(name for name in folders if not name.endswith((".egg-info", "cache__")))
        for name in sorted(names):
            if not name.startswith((".", "#")) and not name.endswith(("~", ".pyc", ".md")):
                yield Path(folder, name)


def files_state(files: Iterable[Path]) -> str:
    """Return a digest of the paths, sizes and times of files; every edit changes the digest."""
    digest = hashlib.sha256()
    for path in files:
        with contextlib.suppress(FileNotFoundError):  # an editor's short-lived file
            status = path.stat()
            # ctime also changes with an edit that keeps size and modification time.
            entry = (str(path), status.st_size, status.st_mtime_ns, status.st_ctime_ns)
            digest.update(repr(entry).encode())
    return digest.hexdigest()


def environment_identity(workspace: Workspace) -> dict[str, object]:
    """Return the entries that the stamp of an up-to-date environment contains."""
    return {
        "format": STAMP_FORMAT,
        "root": str(workspace.root),
        "lock": file_digest(workspace.lock_file),
        "python": os.path.realpath(str(workspace.python)),
        "ros": list(workspace.ros.prefixes) if workspace.ros else "wheels",
    }


def build_identity(environment: Mapping[str, object]) -> dict[str, object]:
    """Return the entries of a build's stamp that do not depend on the files of the packages."""
    return {"format": STAMP_FORMAT, "environment": environment.get("made")}


def read_stamp(folder: Path) -> dict[str, Any]:
    """Return the stamp that a finished step left in its folder; empty if there is none."""
    try:
        stamp = json.loads((folder / "omni.json").read_text())
    except (OSError, ValueError):
        return {}
    return stamp if isinstance(stamp, dict) else {}


def write_stamp(folder: Path, identity: Mapping[str, object], **more: object) -> None:
    """Write the stamp of a finished step atomically."""
    partial = folder / "omni.json.partial"
    partial.write_text(json.dumps(dict(identity, **more)))
    os.replace(str(partial), str(folder / "omni.json"))


def holds(stamp: Mapping[str, object], identity: Mapping[str, object]) -> bool:
    """Return whether a stamp contains all of `identity`."""
    return all(stamp.get(name) == value for name, value in identity.items())


def environment_ready(workspace: Workspace) -> bool:
    """Return whether the environment is complete and has the packages of the lock file."""
    stamp = read_stamp(workspace.venv)
    return workspace.python.exists() and holds(stamp, environment_identity(workspace))


def build_ready(workspace: Workspace) -> bool:
    """Return whether the build is complete and its inputs are unchanged."""
    stamp = read_stamp(workspace.install)
    identity = build_identity(read_stamp(workspace.venv))
    return holds(stamp, identity) and stamp.get("state") == files_state(
        build_inputs(workspace.root)
    )
