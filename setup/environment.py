"""Environment of the workspace, with exactly the packages of a lock file."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

from setup import failures
from setup import workspace as places
from setup.pythons import find_python, say
from setup.steps import Steps
from setup.uv import Uv

# Packages that are needed to compile the kernels. They are installed first, because compilation
# takes the longest.
COMPILER = ("setuptools", "llvmlite", "numba", "numpy", "pillow", "pyyaml", "rocket-fft", "scipy")


def make_environment(workspace: places.Workspace, steps: Steps) -> None:
    """Create the environment with the packages of the lock file."""
    python = choose_python(workspace)
    marker = workspace.venv / "made-by-omni"
    if workspace.venv.exists():
        if not marker.exists() and any(workspace.venv.iterdir()):
            raise failures.SetupError(
                f"{workspace.venv} exists and was not made by this program: move it away and "
                f"start again."
            )
        shutil.rmtree(workspace.venv)
    shutil.rmtree(workspace.kernels, ignore_errors=True)  # compiled with other packages
    say(f"setting up in {workspace.venv} (0.7 GB, once, about a minute; log: {workspace.log})")
    uv = Uv(workspace, steps, python)
    workspace.venv.mkdir()
    marker.touch()
    uv.make_environment(python)
    say(f"installing the packages of {workspace.lock_file.relative_to(workspace.root)}")
    first = workspace.venv / "first.lock"
    lock = workspace.lock_file.read_text()
    blocks = [re.findall(rf"(?m)^{name}==(?:.*\\\n)*.*\n", lock) for name in COMPILER]
    first.write_text("".join(block for package in blocks for block in package))
    uv.install(first)
    compile_in_background(workspace)
    uv.install(workspace.lock_file)
    check = "import rclpy, numba, sensor_msgs.msg, matplotlib.font_manager"
    steps.check(
        [workspace.python, "-c", check],
        places.final_environment(workspace),
        "starting the installed ROS 2 and its packages",
    )
    places.write_stamp(workspace.venv, places.environment_state(workspace))


def choose_python(workspace: places.Workspace) -> str:
    """Return the Python for the environment: that of the sourced ROS, if there is one."""
    if not workspace.ros or workspace.ros.python == sys.version_info[:2]:
        # The base Python is used, as an active environment may be the one that is to be replaced.
        return str(getattr(sys, "_base_executable", sys.executable))
    python = find_python((workspace.ros.python,))
    if not python:
        raise failures.SetupError(
            "the sourced ROS 2 needs Python {0}.{1}: install python{0}.{1} and "
            "python{0}.{1}-venv, or start with OMNI_ROS=wheels.".format(*workspace.ros.python)
        )
    return python


def compile_in_background(workspace: places.Workspace) -> None:
    """Start a process that compiles the kernels of a run and continues after this process ends."""
    with open(workspace.cache / "kernels.log", "w") as log:
        subprocess.Popen(
            [str(workspace.python), "-m", "omni_bringup.warm_up"],
            env=places.final_environment(workspace),
            cwd=str(workspace.root),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,  # Ctrl-C ends the command, but not the compilation
        )
    say(
        "compiling kernels in the background (about one minute); commands wait only for those "
        "that they use"
    )


def group_lock(workspace: places.Workspace, group: str) -> Path:
    """Return the lock file of a group of packages that a run does not need.

    Raises:
        SetupError: There is no such group.
    """
    groups = sorted(path.stem for path in workspace.requirements.glob("*.lock"))
    if group not in groups:
        raise failures.SetupError(f"there is no group '{group}': name one of {', '.join(groups)}.")
    return workspace.requirements / f"{group}.lock"


def install_group(workspace: places.Workspace, lock: int | None, group: str) -> None:
    """Install the packages of a group, unless they are installed."""
    packages = group_lock(workspace, group)
    installed = workspace.venv / packages.name
    if installed.exists() and installed.read_bytes() == packages.read_bytes():
        return
    say(f"installing the packages of {packages.relative_to(workspace.root)}, once")
    Uv(workspace, Steps(workspace, lock), str(workspace.python)).install(packages)
    shutil.copyfile(packages, installed)
