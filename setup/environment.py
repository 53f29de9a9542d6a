"""Environment of the workspace, with exactly the packages of a lock file."""

import itertools
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping

from setup import failures
from setup import workspace as places
from setup.pythons import find_python, say
from setup.steps import Steps

DISK_SPACE = 1.5e9  # bytes: 0.9 GB for the environment, the rest for downloads and kernels
# Packages that are needed to compile the kernels. They are installed first, because compilation
# takes the longest. Every package index has setuptools, so it shows whether an index is reachable.
COMPILER = ["setuptools", "llvmlite", "numba", "numpy", "pillow", "pyyaml", "rocket-fft", "scipy"]


def make_environment(workspace: places.Workspace, steps: Steps) -> None:
    """Create the environment with the packages of the lock file."""
    python = choose_python(workspace)
    failures.check_venv_module(python)
    if not workspace.ros:
        import platform

        libc = os.confstr("CS_GNU_LIBC_VERSION") if hasattr(os, "confstr") else ""
        bits = 64 if sys.maxsize > 2**32 else 32
        failures.check_platform(platform.system(), platform.machine(), libc or "", bits)
    marker = workspace.venv / "made-by-omni"
    if workspace.venv.exists():
        if not marker.exists() and any(workspace.venv.iterdir()):
            raise failures.SetupError(
                f"{workspace.venv} exists and was not made by this program: move it away and "
                f"start again."
            )
        shutil.rmtree(workspace.venv)
    shutil.rmtree(workspace.kernels, ignore_errors=True)  # compiled with other packages
    failures.check_space(workspace.root, DISK_SPACE)
    say(f"setting up in {workspace.venv} (about 1 GB, once, some minutes; log: {workspace.log})")
    workspace.venv.mkdir()
    marker.touch()
    environment = places.base_environment(os.environ, workspace)
    environment.pop("PYTHONPATH", None)
    code, output = steps.run([python, "-m", "venv", workspace.venv], environment)
    if code:
        raise failures.SetupError(
            failures.explain_install(output, workspace.log, "making the environment")
        )
    install_packages(workspace, steps, environment)
    site = next((workspace.venv / "lib").glob("python3.*")) / "site-packages"
    libraries = [str(path) for path in sorted(site.glob("ros_*.libs"))]
    libraries = [str(workspace.venv / "lib"), *libraries]
    check = "import rclpy, numba, sensor_msgs.msg, matplotlib.font_manager"
    ready = places.final_environment(workspace, libraries)
    code, output = steps.run([workspace.python, "-c", check], ready)
    if code:
        raise failures.SetupError(
            "ROS 2 and its packages are installed but do not start here ({}): see {} for the "
            "cause.".format((output.splitlines() or ["signal"])[-1], workspace.log)
        )
    places.write_stamp(
        workspace.venv,
        places.environment_identity(workspace),
        libraries=libraries,
        made=time.time_ns(),
    )


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


def install_packages(
    workspace: places.Workspace, steps: Steps, environment: Mapping[str, str]
) -> None:
    """Install exactly the packages of the lock file, and check every file against its hash."""
    lock = workspace.lock_file.read_text()
    pip = [workspace.python, "-m", "pip", "--disable-pip-version-check", "--no-input"]
    install = [*pip, "install", "--no-deps", "--require-hashes", "--no-compile"]
    install += ["--progress-bar", "off", "--no-warn-script-location"]
    if "PIP_RETRIES" not in environment:
        install += ["--retries", "3"]
    # empy is published as source only. It is built with the setuptools of the lock file.
    first = workspace.venv / "first.lock"
    blocks = [re.findall(rf"(?m)^{name}==(?:.*\\\n)*.*\n", lock) for name in COMPILER]
    first.write_text("".join(itertools.chain(*blocks)))
    total = len(re.findall(r"(?m)^[\w.-]+==", lock))
    ignored: list[str] = []
    names: list[str] = []

    def note(line: str) -> str | None:
        if line.startswith("Ignoring "):
            ignored.append(line)
        found = re.match(r"(?:Collecting|Processing|Requirement already satisfied:?) (\S+)", line)
        if found:
            name = re.split(r"[=<>]|-\d", found.group(1).rpartition("/")[2])[0]
            names.append(name)
            count = f"{len(names)}/{total - len(ignored)} "
            return "fetching " + count + name
        if line.startswith("Installing collected packages"):
            return f"unpacking {len(names)} packages"
        return None

    say(f"installing the packages of {workspace.lock_file.relative_to(workspace.root)}")
    wheels = ["--only-binary", ":all:"]
    sources = ["--no-binary", "empy", "--use-pep517", "--no-build-isolation"]
    code, output = steps.run(install + wheels + ["-r", first], environment)
    if not code:
        compile_in_background(workspace)
        every = wheels + sources + ["-r", workspace.lock_file]
        code, output = steps.run(install + every, environment, note)
    if code:
        raise failures.SetupError(failures.explain_install(output, workspace.log))


def compile_in_background(workspace: places.Workspace) -> None:
    """Start a process that compiles the kernels of a run and continues after this process ends."""
    with open(workspace.cache / "kernels.log", "w") as log:
        subprocess.Popen(
            [str(workspace.python), "-m", "omni_bringup.warm_up"],
            env=places.final_environment(workspace, ()),
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
