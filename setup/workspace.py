"""Folders of the workspace, their stamps, and environment variables."""

import contextlib
import glob
import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from setup.failures import SetupError
from setup.pythons import SUPPORTED

STAMP = "omni.stamp"
STAMP_FORMAT = 2
OWN_FOLDERS = (".cache", ".venv", ".venv-sourced", "src", "build", "install")
SOURCED_DISTRO = "jazzy"
# Variables through which another Python, ROS or pip configuration would affect this environment.
FOREIGN_VARIABLES = (
    *("PYTHONHOME", "VIRTUAL_ENV", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"),
    *("ROS_DISTRO", "ROS_VERSION", "ROS_PYTHON_VERSION", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"),
    *("OMNI_RUNNING", "PIP_TARGET", "PIP_PREFIX", "PIP_ROOT", "PIP_USER"),
    # Help texts are read from docstrings, which optimized bytecode does not contain.
    "PYTHONOPTIMIZE",
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
        self.requirements = root / "requirements"
        self.lock_file = self.requirements / ("sourced-ros.lock" if ros else "wheels.lock")
        self.cache = root / ".cache"
        self.install = self.cache / "install"
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


def base_environment(environ: Mapping[str, str], workspace: Workspace) -> dict[str, str]:
    """Return the user's environment variables without the settings of other installations.

    From variables with lists of folders, the folders of this workspace, of other ROS workspaces and
    of an active Python environment are removed. Packages of another Python are incompatible, so
    PYTHONPATH also loses all folders of site-packages but those of the sourced ROS.
    """
    environment = {name: environ[name] for name in environ if name not in FOREIGN_VARIABLES}
    kept = workspace.ros.prefixes if workspace.ros else ()
    others = [*environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), environ.get("VIRTUAL_ENV")]
    foreign = [f"{workspace.root}/{name}" for name in OWN_FOLDERS]
    foreign += [prefix for prefix in others if prefix and prefix not in kept]
    environment.setdefault("PATH", os.defpath)
    for name in ("PATH", "LD_LIBRARY_PATH", "PYTHONPATH"):
        entries = environment.pop(name, "").split(os.pathsep)
        entries = [entry for entry in entries if entry and not is_below(entry, foreign)]
        if name == "PYTHONPATH":
            packages = {"site-packages", "dist-packages"}
            entries = [
                entry
                for entry in entries
                if is_below(entry, kept) or not packages & set(Path(entry).parts)
            ]
        prepend(environment, name, *entries)
    if workspace.ros:
        prepend(environment, "AMENT_PREFIX_PATH", *kept)
        environment["ROS_DISTRO"] = SOURCED_DISTRO
        for name in ("ROS_VERSION", "ROS_PYTHON_VERSION"):
            if name in environ:
                environment[name] = environ[name]
    environment["PYTHONPYCACHEPREFIX"] = str(workspace.cache / "bytecode")
    return environment


def prepend(environment: dict[str, str], name: str, *parts: object) -> None:
    """Prepend path entries to an environment variable."""
    held = environment.get(name, "")
    if parts:
        joined = os.pathsep.join(map(str, parts))
        environment[name] = os.pathsep.join([joined, held] if held else [joined])


def final_environment(workspace: Workspace) -> dict[str, str]:
    """Return the environment variables for programs, with the built packages on the paths."""
    environment = base_environment(os.environ, workspace)
    environment["VIRTUAL_ENV"] = str(workspace.venv)
    prepend(environment, "PATH", workspace.venv / "bin")
    if not workspace.ros:
        # The environment is also an ament prefix. Without the last two variables, the ROS
        # wheels would set them at import and restart every Python.
        prepend(environment, "AMENT_PREFIX_PATH", workspace.venv)
        libraries = sorted(workspace.venv.glob("lib/python3.*/site-packages/ros_*.libs"))
        prepend(environment, "LD_LIBRARY_PATH", workspace.venv / "lib", *libraries)
        environment["_ROS_WHEELS_BOOTSTRAP_COMPLETE"] = "1"
        environment["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"  # the only one among the wheels
    prepend(environment, "AMENT_PREFIX_PATH", workspace.install)
    # Modules from src, so that an edit needs no build; entry points are listed in the prefix.
    modules = sorted(path.parent for path in (workspace.root / "src").glob("*/package.xml"))
    installed = sorted(workspace.install.glob("lib/python3.*/site-packages"))
    prepend(environment, "PYTHONPATH", *modules, *installed)
    environment["OMNI_WORKSPACE"] = str(workspace.root)
    environment["OMNI_CACHE_DIR"] = str(workspace.cache)
    environment["NUMBA_CACHE_DIR"] = str(workspace.kernels)
    environment["MPLCONFIGDIR"] = str(workspace.cache / "matplotlib")
    return environment


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


def environment_state(workspace: Workspace) -> str:
    """Return a text that changes with every reason to make the environment again."""
    lock = hashlib.sha256(workspace.lock_file.read_bytes()).hexdigest()
    python = os.path.realpath(workspace.python)
    return repr((STAMP_FORMAT, str(workspace.root), lock, python, workspace.ros))


def build_state(workspace: Workspace) -> str:
    """Return a digest that changes with every reason to build again: an edit, another environment.

    It contains paths, sizes and times of the files.
    """
    digest = hashlib.sha256()
    for path in (workspace.venv / STAMP, *build_inputs(workspace.root)):
        with contextlib.suppress(FileNotFoundError):  # an editor's short-lived file
            status = path.stat()
            # ctime also changes with an edit that keeps size and modification time.
            entry = (str(path), status.st_size, status.st_mtime_ns, status.st_ctime_ns)
            digest.update(repr(entry).encode())
    return digest.hexdigest()


def write_stamp(folder: Path, state: str) -> None:
    """Write the stamp of a finished step, which contains its state, atomically."""
    partial = folder / f"{STAMP}.partial"
    partial.write_text(state)
    os.replace(partial, folder / STAMP)


def is_ready(folder: Path, state: str) -> bool:
    """Return whether the stamp of a folder contains a state."""
    try:
        return (folder / STAMP).read_text() == state
    except (OSError, ValueError):
        return False


def ready(workspace: Workspace) -> tuple[bool, bool]:
    """Return whether the environment is complete and up to date, and whether the build is."""
    environment = workspace.python.exists() and is_ready(
        workspace.venv, environment_state(workspace)
    )
    return environment, environment and is_ready(workspace.install, build_state(workspace))
