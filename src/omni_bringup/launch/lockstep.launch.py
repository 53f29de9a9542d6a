"""Launch files of earlier releases, which repeated the command line, are refused."""

from pathlib import Path
from typing import NoReturn

COMMANDS = {
    "drive": "./omni drive --experiment EXPERIMENT",
    "lockstep": "./omni run EXPERIMENT",
    "real_time": "./omni run EXPERIMENT --real-time",
}


def generate_launch_description() -> NoReturn:
    """Raise an error that names the command to use instead."""
    name = Path(__file__).name
    raise RuntimeError(f"{name} is removed: use {COMMANDS[name.partition('.')[0]]}")
