"""Units of the parameters of a configuration."""

import dataclasses
import typing

from omni_platform.configuration import Configuration, declared_parameters


def unit_of(cls: type[Configuration], key: str) -> str:
    """Return the unit of a parameter; ``1`` if it has none.

    Args:
        cls: configuration that declares the parameter.
        key: dotted key, such as ``load.mass``; it may contain names of entries, such as wheels.
    """
    fields = {name: (kind, info) for name, kind, info in declared_parameters(cls)}
    name, _, rest = key.partition(".")
    if name not in fields:
        return "1"
    kind, info = fields[name]
    if typing.get_origin(kind) is not None:  # a mapping of entries
        kind, rest = typing.get_args(kind)[-1], rest.partition(".")[2]
    if rest and dataclasses.is_dataclass(kind):
        return unit_of(kind, rest)
    return info.unit or "1"
