"""Commands that run no kernel and draw no figure import neither numba nor matplotlib."""

import subprocess
import sys
from pathlib import Path

import pytest
from omni_process import WORKSPACE

SLOW = ("matplotlib", "numba", "scipy")
"""Packages whose import takes longer than the work of these commands."""

PROGRAM = f"""
import atexit, sys
from omni_bringup.cli import main

atexit.register(lambda: print(*(name for name in {SLOW} if name in sys.modules), file=sys.stderr))
main()
"""

BAG = "bags/small_stop/assisted"
COMMANDS = {
    "list": "list",
    "the configuration of an experiment": "ros-params straight_line --out OUT",
    "a recording": f"bag info {BAG}",
    "all messages of a recording": f"bag check {BAG}",
    "a table": f"bag export {BAG} --out OUT.csv",
    "an installation and all experiments": "doctor",
}


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_a_command_without_kernels_and_figures_starts_lightly(words: str, tmp_path: Path) -> None:
    command = [word.replace("OUT", str(tmp_path / "out")) for word in words.split()]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *command],
        cwd=WORKSPACE, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr.splitlines()[-1] == ""
