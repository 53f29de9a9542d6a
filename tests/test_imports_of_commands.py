"""Commands that run no kernel and draw no figure import neither numba nor matplotlib.

Help imports no numpy either.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from omni_process import WORKSPACE

SLOW = ("matplotlib", "numba", "scipy")
"""Packages whose import takes longer than the work of these commands."""

PROGRAM = """
import atexit, sys
from omni_bringup.cli import main

atexit.register(lambda: print(*(name for name in {slow} if name in sys.modules), file=sys.stderr))
main()
"""

BAG = "bags/small_stop/assisted"
COMMANDS = {
    "help": "--help",
    "help of a command": "run --help",
    "list": "list",
    "the configuration of an experiment": "ros-params straight_line --out OUT",
    "a recording": f"bag info {BAG}",
    "all messages of a recording": f"bag check {BAG}",
    "a table": f"bag export {BAG} --out OUT.csv",
    "an installation and all experiments": "doctor",
}


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_a_command_without_kernels_and_figures_starts_lightly(words: str, tmp_path: Path) -> None:
    slow = (*SLOW, "numpy") if "--help" in words else SLOW
    command = [word.replace("OUT", str(tmp_path / "out")) for word in words.split()]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(slow=slow), *command],
        cwd=WORKSPACE, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr.splitlines()[-1] == ""


@pytest.mark.parametrize("first", ["from omni_bringup.cli import main", "import conftest"])
def test_a_process_has_no_threads_of_numpy_that_wait_actively(first: str) -> None:
    """On a busy machine, a small matrix product would take up to 100 times as long with them."""
    program = f"{first}; import numpy, os; print(len(os.listdir('/proc/self/task')))"
    environment = {name: text for name, text in os.environ.items() if "BLAS" not in name}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=WORKSPACE, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "1\n", done.stderr
