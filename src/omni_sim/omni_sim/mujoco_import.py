"""Import of MuJoCo, an optional package."""

import importlib
import os
from typing import Any

from omni_core.configuration import ConfigurationError

INSTALL = "./omni install mujoco"


def load_mujoco() -> Any:
    """Return the module of MuJoCo, imported without the viewer.

    Raises:
        ConfigurationError: MuJoCo is not installed; the message explains how to install it.
    """
    os.environ.setdefault("MUJOCO_GL", "disable")
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise ConfigurationError("mujoco", f"is not installed; {INSTALL}") from error
