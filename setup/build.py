"""Build of the packages by colcon."""

import contextlib
import re
import shutil
from pathlib import Path

from setup import workspace as places
from setup.failures import SetupError
from setup.pythons import say
from setup.steps import Steps


def build(workspace: places.Workspace, steps: Steps) -> None:
    """Build the packages from scratch."""
    state = places.files_state(
        places.build_inputs(workspace.root)
    )  # computed before the build, so that an edit during the build causes another build
    environment_stamp = places.read_stamp(workspace.venv)
    environment = places.venv_environment(workspace, environment_stamp["libraries"])
    packages = sorted(path.parent for path in (workspace.root / "src").glob("*/package.xml"))
    say(f"building {len(packages)} packages with colcon")
    # The stamp is deleted first. No file of a deleted package may remain.
    (workspace.install / "omni.json").unlink(missing_ok=True)
    for folder in (workspace.root / "build", workspace.install, workspace.cache / "colcon"):
        remove(folder)

    def note(line: str) -> str | None:
        return line if line.startswith(("Starting >>>", "Finished <<<")) else None

    colcon: list[object] = [workspace.python, workspace.venv / "bin" / "colcon"]
    colcon += ["--log-base", workspace.cache / "colcon", "build"]
    colcon += ["--base-paths", "src", "--event-handlers", "console_cohesion+"]
    code, output = steps.run(colcon, environment, note)
    if code:
        failed = re.findall(r"(?m)^Failed\s+<<<\s+(\S+)", output)
        raise SetupError(
            "building {} failed: see {} for the cause.".format(
                ", ".join(failed) or "the packages", workspace.log
            )
        )
    for package in packages:
        prefix = workspace.install / package.name
        if not (prefix / "share" / package.name / "hook" / "ament_prefix_path.dsv").exists():
            raise SetupError(
                f"colcon does not recognize {package} as an ament_python package: correct its "
                f"package.xml "
                f"(details in {workspace.log})."
            )
        repair_first_lines(prefix / "lib")
    places.write_stamp(workspace.install, places.build_identity(environment_stamp), state=state)


def remove(folder: Path) -> None:
    """Delete a folder and its content, if it exists."""
    with contextlib.suppress(FileNotFoundError):
        shutil.rmtree(str(folder))


def repair_first_lines(library: Path) -> None:
    """Replace the first line of executables if Python's path is too long or contains spaces."""
    for script in library.glob("*/*"):
        if script.parent.name.startswith("python3") or not script.is_file():
            continue
        text = script.read_bytes()
        first, _, rest = text.partition(b"\n")
        # setuptools quotes a path with spaces, but the kernel does not accept quotes.
        if first.startswith(b'#!"') or (first.startswith(b"#!/") and len(first) > 127):
            interpreter = first[2:].strip(b'"')
            # Python reads these lines as a string, and the shell reads them as a command.
            script.write_bytes(
                b"#!/bin/sh\n'''exec' \"" + interpreter + b'" "$0" "$@"\n' + b"' '''\n" + rest
            )
