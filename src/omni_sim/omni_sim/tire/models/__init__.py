"""Tire models, one file each; a new model needs only a new file in this folder.

Each module defines ``MODEL``, a `TireModel`; the module's name is the model's name in YAML.
"""

import importlib
import pkgutil
from collections.abc import Mapping

from omni_sim.tire.interface.model import TireModel, register

MODELS: Mapping[str, TireModel] = {
    name: register(importlib.import_module(f"{__name__}.{name}").MODEL)
    for name in sorted(module.name for module in pkgutil.iter_modules(__path__))
}
"""All tire models, keyed by name."""
