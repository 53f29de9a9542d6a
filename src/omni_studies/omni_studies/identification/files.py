"""Configuration files of an identified candidate: vehicle and experiment."""

from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from omni_loop.experiment import ExperimentConfiguration
from omni_platform.configuration import to_mapping

VEHICLE = "table_2_mecanum"
"""Name of the identified vehicle."""


def write_files(
    configuration: ExperimentConfiguration, config: Path, folder: Path
) -> tuple[Path, Path]:
    """Write vehicle and experiment of a candidate as modified copies of the files in ``config/``.

    Args:
        configuration: configuration of any variant of the candidate.
        config: folder of the files to copy, including their comments.
        folder: folder of the copies.

    Returns:
        Vehicle file and experiment file.
    """
    values = to_mapping(configuration)
    return (
        _copied(config / f"vehicles/{VEHICLE}.yaml", values["vehicle"], folder),
        _copied(config / "experiments/turn_while_translate.yaml", values, folder),
    )


def _copied(source: Path, values: Mapping[str, Any], folder: Path) -> Path:
    """Copy a file with new numbers from a configuration; return the path of the copy."""
    yaml = YAML()
    yaml.width = 110
    document = yaml.load(source)
    _replace(document, values)
    yaml.dump(document, folder / source.name)
    return folder / source.name


def _replace(document: MutableMapping[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in document.items():
        if isinstance(value, MutableMapping):
            _replace(value, values.get(key, {}))
        elif isinstance(value, float):
            document[key] = float(f"{values[key]:.10g}")
