"""The command line as a process of its own, as the launcher starts it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parents[1]
RUN_TIMEOUT = 240.0  # [s] a run takes seconds; this only ends one that hangs


def omni_command(arguments: Sequence[str]) -> list[str]:
    """Return the command of ``./omni ARGUMENTS``."""
    return [sys.executable, "-m", "omni_bringup.cli", *arguments]


def omni_environment() -> dict[str, str]:
    """Return the environment of the command."""
    return {**os.environ, "OMNI_WORKSPACE": str(WORKSPACE)}


def omni(arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end."""
    return subprocess.run(
        omni_command(arguments),
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT,
        check=False,
        env=omni_environment(),
    )
