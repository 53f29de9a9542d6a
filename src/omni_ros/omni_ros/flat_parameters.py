"""Configurations as flat, dotted parameters, which is the form of ROS 2 parameters.

A field of a nested configuration becomes ``parent.child``. A mapping of named entries becomes a
list ``wheels.names`` and parameters such as ``wheels.front_left.x``, because a node must know the
name of a ROS parameter before it can read the parameter.
"""

import dataclasses
import typing
from collections.abc import Callable
from typing import Any, TypeVar

from omni_core import configuration as declared

NAMES = "names"

C = TypeVar("C", bound=declared.Configuration)
ReadParameter = Callable[[str, Any, Any, declared.ParameterInfo], Any]


def flatten(
    configuration: declared.Configuration,
    prefix: str = "",
    part: type[declared.Configuration] | None = None,
) -> dict[str, Any]:
    """Return all values of a configuration, keyed by dotted parameter name.

    Args:
        configuration: the configuration.
        prefix: dotted path that is put before each name.
        part: class whose fields are returned, a base class of the configuration's class; None for
            all fields.

    Returns:
        Values of the types bool, int, float, str, or list of float or str, keyed by parameter name.
    """
    flat: dict[str, Any] = {}
    for name, kind, _ in declared.declared_parameters(part or type(configuration)):
        value = getattr(configuration, name)
        key = declared.join_key(prefix, name)
        if declared.is_configuration(kind):
            flat.update(flatten(value, key))
        elif declared.element_configuration(kind) is not None:
            flat[declared.join_key(key, NAMES)] = list(value)
            for entry in value:
                if entry == NAMES:
                    raise declared.ConfigurationError(
                        key, f"{NAMES!r} is reserved and names no entry"
                    )
                flat.update(flatten(value[entry], declared.join_key(key, entry)))
        else:
            flat[key] = list(value) if isinstance(value, tuple) else value
    return flat


def unflatten(cls: type[C], read: ReadParameter) -> C:
    """Build a configuration by reading its parameters one by one.

    Args:
        cls: the configuration to build.
        read: function that returns the value of a plain parameter; its arguments are the dotted
            name, type, default (None if a value is required) and info of the parameter.

    Raises:
        ConfigurationError: a value is missing or invalid.
    """
    return declared.from_mapping(cls, _read_mapping(cls, None, read, ""))


def _read_mapping(
    cls: type[declared.Configuration], default: Any, read: ReadParameter, prefix: str
) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, kind, info in declared.declared_parameters(cls):
        key = declared.join_key(prefix, name)
        preset = getattr(default, name) if default is not None else _default_of(cls, name)
        element = declared.element_configuration(kind)
        if declared.is_configuration(kind):
            values[name] = _read_mapping(kind, preset, read, key)
        elif element is not None:
            names_info = declared.ParameterInfo(f"Names of: {info.description}")
            known = tuple(preset) if preset else ()
            names = read(declared.join_key(key, NAMES), tuple[str, ...], known, names_info)
            values[name] = {
                entry: _read_mapping(
                    element, (preset or {}).get(entry), read, declared.join_key(key, entry)
                )
                for entry in names
            }
        else:
            value = read(key, kind, preset, info)
            if value is None:
                raise declared.ConfigurationError(key, "is required and has no value")
            values[name] = list(value) if typing.get_origin(kind) is tuple else value
    return values


def _default_of(cls: type[declared.Configuration], name: str) -> Any:
    """Return the default of a field; None if a value is required."""
    field = cls.__dataclass_fields__[name]
    if callable(field.default_factory):
        return field.default_factory()
    return None if field.default is dataclasses.MISSING else field.default
