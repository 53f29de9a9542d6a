"""Layers of nested mappings, from which an experiment is composed: files and overrides."""

from collections.abc import Mapping
from typing import Any

import yaml

from omni_loop.yaml_files import load_yaml
from omni_platform.configuration import ConfigurationError


class Part(dict[str, Any]):
    """A part read from a file: it replaces the previous value instead of being merged into it."""


def parse_override(text: str) -> dict[str, Any]:
    """Convert a text such as ``vehicle.load.mass=400`` to nested mappings.

    Raises:
        ConfigurationError: there is no ``=``, no key, or the value is not YAML.
    """
    key, equals, value_text = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts) or len(parts) > 20:
        raise ConfigurationError(
            "--set", f"{text[:200]!r} must have the form key=value, such as vehicle.load.mass=400"
        )
    try:
        value = load_yaml(value_text)
    except (yaml.YAMLError, ValueError):  # ValueError: a date such as 2020-13-01
        raise ConfigurationError(key, f"the value {value_text[:200]!r} is not valid YAML") from None
    return nest(key.strip(), value)


def nest(path: str, value: Any) -> dict[str, Any]:
    """Return ``a.b`` and a value as nested mappings."""
    for part in reversed(path.split(".")):
        value = {part: value}
    return dict(value)


def plain(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested mappings without the marks of parts."""
    return {key: plain(one) if isinstance(one, Mapping) else one for key, one in tree.items()}


def merge(base: Mapping[str, Any], layer: Mapping[str, Any]) -> dict[str, Any]:
    """Merge the values of `layer` into `base`, mapping by mapping, and return the result."""
    merged = dict(base)
    for key, value in layer.items():
        below = merged.get(key)
        if isinstance(value, Mapping) and isinstance(below, Mapping) and type(value) is dict:
            merged[key] = merge(below, value)
        else:
            merged[key] = value
    return merged
