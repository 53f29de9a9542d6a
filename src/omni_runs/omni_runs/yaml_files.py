"""Reading and writing of configuration files in YAML, and the layers of an experiment.

The layers are nested mappings, which come from files and overrides.
"""

import functools
import math
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    declared_parameters,
    element_configuration,
    is_configuration,
    join_key,
)
from omni_core.files import read_text
from omni_recording.safe_yaml import FLOAT, LARGEST_YAML, SafeLoader

_NO_NOTES: Mapping[str, str] = {}
_LONGEST = 110  # limit on the number of characters of a mapping or list on one line


class _Loader(SafeLoader):
    """YAML loader that rejects repeated keys, and reads numbers as YAML 1.2 does.

    Unlike YAML 1.1, it reads 1e-3 as a number, and 3:1:2 (base 60) and 010 (octal) as texts.
    """

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        tag = super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]
        other_base = tag in _NUMBERS and _OTHER_BASE.match(value)
        return self.DEFAULT_SCALAR_TAG if other_base else tag

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen and key.value != "<<":
                problem = f"the key {key.value!r} is given twice"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_NUMBERS = ("tag:yaml.org,2002:int", FLOAT[0])
_OTHER_BASE = re.compile(r"[-+]?0[0-7_]+\Z|.*:")
_Loader.add_implicit_resolver(*FLOAT)


@functools.lru_cache(maxsize=100)
def load_yaml(text: str) -> Any:
    """Return the content of a YAML text; texts such as 1e-3 are read as numbers.

    The content is kept for the next call with the same text, because sweeps read the same files
    again and again; callers must not change it.

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
    """Return the values in a YAML file, keyed by name.

    Args:
        path: the file.
        key: configuration key or option, for error messages.

    Raises:
        ConfigurationError: the file cannot be read, or contains no mapping.
    """
    text = ""
    try:
        text = read_text(path)
        document = load_yaml(text)
    except OSError as error:
        raise ConfigurationError(key, f"cannot read {path}: {error.strerror}") from None
    except (yaml.YAMLError, ValueError) as error:  # ValueError: dates and bytes
        problem = " ".join(str(error).replace('in "<unicode string>", ', "in ").split())[:200]
        if re.search(r"^ *\t", text, re.MULTILINE):
            problem += "; YAML permits no tabs for indentation: use spaces"
        raise ConfigurationError(key, f"{path} is not valid YAML: {problem}") from None
    if not isinstance(document, dict):
        raise ConfigurationError(key, f"{path} must contain a mapping of names to values")
    return document


class Part(dict[str, Any]):
    """Values that `merge` does not add to, but puts in place of, those of the layers below.

    Such values are those of a part's file, such as a vehicle, and an empty set of named entries.
    """


def parse_override(text: str) -> dict[str, Any]:
    """Return a text such as ``vehicle.load.mass=400`` as nested mappings.

    Raises:
        ConfigurationError: ``=`` or the key is missing, or the value is not YAML.
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
    """Return a dotted key such as ``a.b`` and its value as nested mappings."""
    for part in reversed(path.split(".")):
        value = {part: value}
    return dict(value)


def plain(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested mappings as plain dictionaries, none of which is a `Part`."""
    return {key: plain(one) if isinstance(one, Mapping) else one for key, one in tree.items()}


def merge(base: Mapping[str, Any], layer: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of `base`, overridden by those of `layer` in all nested mappings.

    A `Part` in `layer` replaces the value of `base` as a whole.
    """
    merged = dict(base)
    for key, value in layer.items():
        below = merged.get(key)
        if isinstance(value, Mapping) and isinstance(below, Mapping) and type(value) is dict:
            merged[key] = merge(below, value)
        else:
            merged[key] = value
    return merged


def named_entries(cls: type[Configuration], prefix: str = "") -> Iterator[str]:
    """Yield the dotted keys of a configuration's mappings of names to entries."""
    for name, kind, _ in declared_parameters(cls):
        key = join_key(prefix, name)
        if is_configuration(kind):
            yield from named_entries(kind, key)
        elif element_configuration(kind) is not None:
            yield key


def emptied(layer: Mapping[str, Any], entries: Collection[str], prefix: str = "") -> dict[str, Any]:
    """Return a layer in which ``{}`` for a key in `entries` removes all entries of lower layers."""
    result = Part() if isinstance(layer, Part) else dict[str, Any]()
    for key, value in layer.items():
        path = join_key(prefix, str(key))
        if isinstance(value, Mapping):
            empty = not value and path in entries
            result[key] = Part() if empty else emptied(value, entries, path)
        else:
            result[key] = value
    return result


def commented_yaml(
    values: Mapping[str, Any], heading: str = "", notes: Mapping[str, str] = _NO_NOTES
) -> str:
    """Return values as YAML text; short mappings and lists without notes are on one line.

    Args:
        values: nested mappings, lists and scalars.
        heading: comment before the values, one or more lines.
        notes: comment for the end of a line, keyed by the dotted key on this line.
    """
    comment = [f"# {line}" for line in heading.splitlines()]
    return "\n".join([*comment, *_lines(values, notes, "")]) + "\n"


def _lines(values: Mapping[str, Any], notes: Mapping[str, str], prefix: str) -> list[str]:
    """Return values as lines of YAML, with the notes as comments; both have dotted keys."""
    lines = []
    for name, value in values.items():
        key, inner = f"{prefix}{name}", []
        first = yaml.safe_dump(
            {name: value}, sort_keys=False, default_flow_style=True, width=math.inf
        )[1:-2]
        if isinstance(value, Mapping) and (
            len(first) > _LONGEST
            or any(isinstance(part, Mapping) for part in value.values())
            or any(noted.startswith(f"{key}.") for noted in notes)
        ):
            first = f"{name}:"
            inner = [f"  {line}" for line in _lines(value, notes, f"{key}.")]
        elif isinstance(value, list) and len(first) > _LONGEST:
            first = f"{name}:"
            inner = [f"  {line}" for line in yaml.safe_dump(value).splitlines()]
        lines += [f"{first} # {notes[key]}" if key in notes else first, *inner]
    return lines
