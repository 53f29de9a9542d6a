"""Kind of a configuration file, inferred from its keys."""

from collections.abc import Callable, Mapping
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
    shares = {
        kind: _mean([known(*item) for item in tree.items()]) for kind, known in _KNOWN.items()
    }
    largest = max(shares.values())
    return [kind for kind, share in shares.items() if share == largest > 0.0]


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else 0.0


def _declares(cls: type[Configuration], *further: str) -> Callable[[str, Any], float]:
    names = {name for name, *_ in declared_parameters(cls)}.union(further)
    return lambda key, _: float(key in names)


def _camera(_name: str, values: Any) -> float:
    if not isinstance(values, Mapping):
        return 0.0
    known = _declares(LineSensor)
    return _mean([known(key, value) for key, value in values.items()])


# Share of a key and its value that a kind of file declares, 0 to 1, keyed by kind.
_KNOWN: Mapping[str, Callable[[str, Any], float]] = {
    "vehicles": _declares(VehicleConfiguration),
    "grounds": _declares(GroundConfiguration),
    "sensors": _camera,
    "experiments": _declares(ExperimentConfiguration, "variants"),
    "tires": _declares(TireConfiguration),
}
