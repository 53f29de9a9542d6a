"""Installation of the packages of this workspace into one prefix, for entry points and `ros2 run`.

The launcher does without colcon, which starts four processes for each package.
"""

import os
import runpy
import shutil
import sys
from pathlib import Path

from setup import workspace as places
from setup.pythons import say
from setup.steps import Steps


def build(workspace: places.Workspace, steps: Steps) -> None:
    """Install the packages from scratch."""
    # The state is computed first, so that an edit during the build causes another build.
    state = places.build_state(workspace)
    say("building the packages of src")
    # The stamp is deleted first. No file of a deleted package may remain.
    (workspace.install / places.STAMP).unlink(missing_ok=True)
    shutil.rmtree(workspace.install, ignore_errors=True)
    workspace.install.mkdir()
    steps.check(
        [workspace.python, "-m", "setup.build", workspace.install],
        places.final_environment(workspace),
        "building the packages",
        lambda line: line if line.startswith("building ") else None,
    )
    places.write_stamp(workspace.install, state)


def install(root: Path, prefix: Path) -> None:
    """Install all packages of a workspace into a prefix, each by its ``setup.py``.

    They are installed in one process, because importing setuptools takes longer than installing a
    package.
    """
    for manifest in sorted((root / "src").glob("*/package.xml")):
        print("building", manifest.parent.name, flush=True)
        base = prefix / "build" / manifest.parent.name
        base.mkdir(parents=True)
        os.chdir(manifest.parent)
        sys.argv = ["setup.py", "--quiet", "egg_info", "--egg-base", str(base), "build"]
        # The path of the environment may contain spaces, with which no first line can begin.
        sys.argv += ["--build-base", str(base), "--executable", "/usr/bin/env python3"]
        sys.argv += ["install", "--prefix", str(prefix), "--record", str(base / "install.log")]
        sys.argv += ["--single-version-externally-managed"]
        runpy.run_path("setup.py", run_name="__main__")


if __name__ == "__main__":
    install(Path.cwd(), Path(sys.argv[1]))
