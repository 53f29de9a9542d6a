"""Reading of configuration files and values in YAML."""

import re
from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from omni_platform.configuration import ConfigurationError
from omni_recording.safe_yaml import SafeLoader

LARGEST_YAML = 1 << 20
"""Largest number of characters of a configuration; reading as many takes a few seconds."""


class _Loader(SafeLoader):
    """YAML loader that reads 1e-3 as a number, unlike YAML 1.1, and rejects repeated keys."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        repeated = next((name for name, n in names.items() if n > 1 and name != "<<"), None)
        if repeated is not None:
            raise yaml.constructor.ConstructorError(
                None, None, f"the key {repeated!r} is given twice", node.start_mark
            )
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+\Z"),
    list("-+.0123456789"),
)


def load_yaml(text: str) -> Any:
    """Return the content of a YAML text; texts such as 1e-3 are read as numbers.

    Raises:
        yaml.YAMLError: the text is not YAML.
        ValueError: the text is too long, or a value such as a date is invalid.
    """
    if len(text) > LARGEST_YAML:
        raise ValueError(f"it has {len(text)} characters, more than the limit of {LARGEST_YAML}")
    try:
        return yaml.load(text, Loader=_Loader)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_mapping(path: Path, key: str) -> dict[str, Any]:
    """Return the values in a YAML file by name.

    Args:
        path: the file.
        key: configuration key or option, for error messages.

    Raises:
        ConfigurationError: the file cannot be read, or contains no mapping.
    """
    try:
        document = load_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(key, f"cannot read {path}: {error.strerror}") from None
    except (yaml.YAMLError, ValueError) as error:  # ValueError: dates and bytes
        problem = " ".join(str(error).split())[:200]
        raise ConfigurationError(key, f"{path} is not valid YAML: {problem}") from None
    if not isinstance(document, dict):
        raise ConfigurationError(key, f"{path} must contain a mapping of names to values")
    return document
