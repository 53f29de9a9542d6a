"""Kind of a configuration file, inferred from its keys."""

from collections.abc import Collection, Mapping
from typing import Any

from omni_core.configuration import Configuration, declared_parameters
from omni_core.sensors import LineSensor
from omni_runs.experiment import ExperimentConfiguration
from omni_sim.configuration import GroundConfiguration
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration


def possible_kinds(tree: Mapping[str, Any]) -> list[str]:
    """Return the kinds of file that declare the largest share of the keys; none if all are unknown.

    A misspelled key does not change the result, so that reading the file can report this key.

    Args:
        tree: nested values of a file.
    """
    cameras = [value if isinstance(value, Mapping) else () for value in tree.values()]
    shares = {
        "vehicles": _share(tree, _declared(VehicleConfiguration)),
        "grounds": _share(tree, _declared(GroundConfiguration)),
        "sensors": sum(_share(one, _declared(LineSensor)) for one in cameras) / max(len(tree), 1),
        "experiments": _share(tree, {*_declared(ExperimentConfiguration), "variants"}),
        "tires": _share(tree, _declared(TireConfiguration)),
    }
    largest = max(shares.values())
    return [kind for kind, share in shares.items() if share == largest > 0.0]


def _declared(cls: type[Configuration]) -> set[str]:
    return {name for name, *_ in declared_parameters(cls)}


def _share(keys: Collection[str], known: Collection[str]) -> float:
    """Return the share of keys that are known, 0 to 1."""
    return sum(key in known for key in keys) / max(len(keys), 1)
