"""Tire models, one file each; their parameters are in `tire.interface.configuration`.

Each module defines ``MODEL``, a `TireModel`; the module's name is the model's name in YAML.
"""

import importlib
import pkgutil
from collections.abc import Mapping
from typing import Any

from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.interface.model import TireModel, register

MODELS: Mapping[str, TireModel] = {
    name: register(importlib.import_module(f"{__name__}.{name}").MODEL)
    for name in sorted(module.name for module in pkgutil.iter_modules(__path__))
}
"""All tire models, keyed by name."""


def kernel_parameters(tire: TireConfiguration) -> Any:
    """Return the constants of a tire's chosen model for kernels, a NamedTuple of the model."""
    return MODELS[tire.model].parameters(tire.model_parameters)
