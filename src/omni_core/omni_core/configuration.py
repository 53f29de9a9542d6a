"""Typed configuration: frozen dataclasses whose fields carry description, unit and bounds.

A component declares its parameters once, as a frozen dataclass derived from `Configuration`. Its
fields come from `parameter()`, with a string below each field that describes it. This declaration
gives the defaults, the checks, the strict reading of YAML mappings, the effective configuration
that is saved with every run, and (in `omni_ros.parameters`) the ROS parameters with their
descriptors.

A field is a bool, int, float, str, a tuple of floats or strings, another `Configuration`, or a
`Mapping[str, Configuration]` for things that have names of their own (wheels, sensors, patches).
An option of a command (`omni_core.commands.command_options`) may also be a `Path`, or ``X | None``.
Invalid values are never corrected: they raise `ConfigurationError`, which names the key, the value
and what is permitted.

Every number except a seed has a smallest and a largest permitted value. The permitted range is
about ten times as wide as the range of wheeled vehicles and their sensors. Values outside it are
typing errors, and results computed from them could overflow.
"""

from __future__ import annotations

import ast
import dataclasses
import difflib
import functools
import inspect
import itertools
import math
import re
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from typing import dataclass_transform
else:  # Python 3.10 lacks this decorator, and nothing reads it at run time

    def dataclass_transform(**_: Any) -> Callable[[type], type]:
        """Return a decorator that has no effect."""
        return lambda cls: cls


_METADATA = "omni_parameter"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# ROS parameters and seeds are 64-bit integers.
_SMALLEST_INTEGER, LARGEST_INTEGER = -(2**63), 2**63 - 1

C = TypeVar("C", bound="Configuration")


class InputError(ValueError):
    """An input is rejected before work starts; the message names the value and a remedy."""

    def __init__(self, words: str) -> None:
        super().__init__(shortened(words))


class WorkError(RuntimeError):
    """A computation has begun and cannot be completed; the message gives the reason."""


class ConfigurationError(InputError):
    """A configuration value is invalid.

    Attributes:
        key: dotted path of the value, such as ``vehicle.load.mass``.
        problem: the violated condition and the permitted values.
    """

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(f"{key}: {problem}" if key else problem)
        self.key = key
        self.problem = problem

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the constructor and its arguments, so that workers can pickle the error."""
        return type(self), (self.key, self.problem)

    def below(self, parent: str) -> ConfigurationError:
        """Return the same error with the path `parent` put before its key."""
        return ConfigurationError(join_key(parent, self.key), self.problem)


class UnknownKeyError(ConfigurationError):
    """A configuration does not declare a key."""


class ConfigurationWarning(UserWarning):
    """A configuration is valid, but a value is implausible; the message contains a remedy."""


@dataclasses.dataclass(frozen=True)
class ParameterInfo:
    """Properties of a parameter other than its value; a bound that does not exist is None.

    The description is given in the declaration, or else by the string below the field. This string
    is read from the source code when it is needed.

    Attributes:
        given: description given in the declaration; None if there is none.
        unit: SI symbol (or ``deg``), empty for names, flags and pure numbers.
        minimum: smallest permitted value.
        maximum: largest permitted value.
        above: bound that the value must exceed.
        choices: permitted words of a str.
        field: class and name of the field; None before the class is complete.
    """

    given: str | None
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    choices: tuple[str, ...] | None = None
    field: tuple[type[Any], str] | None = None

    @property
    def description(self) -> str:
        """Description from the declaration or from the string below the field, as one line."""
        if self.given is not None or self.field is None:
            return self.given or ""
        cls, name = self.field
        for base in cls.__mro__[: cls.__mro__.index(Configuration)]:
            if words := _field_docstrings(base.__module__).get((base.__name__, name)):
                return words
        raise TypeError(f"{cls.__name__}.{name} has no description")

    def permits(self, value: Any) -> bool:
        """Return whether a value of the field's type is finite, within the bounds and a choice."""
        if not isinstance(value, int | float):
            return self.choices is None or value in self.choices
        low, high = self.minimum, self.maximum
        inside = (low is None or value >= low) and (high is None or value <= high)
        return inside and math.isfinite(value) and (self.above is None or value > self.above)

    def bounds_in_words(self) -> str:
        """Return a description of the permitted range."""
        unit = f" {self.unit}" if self.unit else ""
        bounds = {"above": self.above, "at least": self.minimum, "at most": self.maximum}
        words = [f"{word} {bound:g}" for word, bound in bounds.items() if bound is not None]
        return " and ".join(words) + unit


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    description: str | None = None,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """Declare a configuration field.

    Args:
        default: value used if none is given; without a default the key is required.
        description: text shown by ``--help`` and ``ros2 param describe``; by default the string
            below the field.
        unit: SI symbol (or ``deg``), empty for names, flags and pure numbers.
        minimum: smallest permitted value.
        maximum: largest permitted value.
        above: bound that the value must exceed.
        choices: permitted words of a str.
    """
    info = ParameterInfo(description, unit, minimum, maximum, above, choices)
    keywords: dict[str, Any] = {"metadata": {_METADATA: info}, "kw_only": True}
    if default is not dataclasses.MISSING:
        keywords["default"] = default
    return dataclasses.field(**keywords)


def section(make: Callable[[], Any], *, description: str | None = None) -> Any:
    """Declare a field that is a configuration, or a mapping of names to configurations.

    Args:
        make: function that returns the default value: the configuration class, or ``dict``.
        description: description in the documentation; by default the string below the field.
    """
    metadata = {_METADATA: ParameterInfo(description)}
    return dataclasses.field(default_factory=make, metadata=metadata, kw_only=True)


@dataclass_transform(kw_only_default=True, frozen_default=True)
@dataclasses.dataclass(frozen=True, kw_only=True)
class Configuration:
    """Base of every configuration; checks each declared field at construction.

    Subclasses are frozen dataclasses with keyword-only fields; they need no decorator.

    Raises:
        ConfigurationError: a value has the wrong type, is not finite or is out of its range.
    """

    def __init_subclass__(cls) -> None:
        dataclasses.dataclass(frozen=True, kw_only=True)(cls)

    def __post_init__(self) -> None:
        for name, kind, info in declared_parameters(type(self)):
            value = getattr(self, name)
            if without_none(kind) is float and type(value) is int:
                value = _convert(value, float, name)  # an integer such as 1 is accepted as 1.0
                object.__setattr__(self, name, value)
            if type(value) is not kind or kind is int or not info.permits(value):
                _check_value(name, value, kind, info)
        self.check_consistency()

    def check_consistency(self) -> None:
        """Raise `ConfigurationError` if values that are valid individually are inconsistent."""


def declared_parameters(cls: type[Configuration]) -> tuple[tuple[str, Any, ParameterInfo], ...]:
    """Return (name, type, info) of every parameter of `cls`, in order of declaration."""
    hashable: Any = cls  # a class is hashable; its instances' __hash__ misleads the checker
    return _declared_parameters(hashable)


@functools.cache
def _declared_parameters(cls: Any) -> tuple[tuple[str, Any, ParameterInfo], ...]:
    hints = typing.get_type_hints(cls)
    return tuple(
        (name, hints[name], dataclasses.replace(field.metadata[_METADATA], field=(cls, name)))
        for name, field in cls.__dataclass_fields__.items()
        if _METADATA in field.metadata
    )


@functools.cache
def _field_docstrings(module: str) -> dict[tuple[str, str], str]:
    """Return the strings below the fields of a module's classes, keyed by (class, field)."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {
        (node.name, ast.unparse(field.target)): " ".join(str(below.value.value).split())
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        for field, below in itertools.pairwise(node.body)
        if isinstance(field, ast.AnnAssign)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
    }


def join_key(parent: str, key: str) -> str:
    """Return the dotted path of `key` below `parent`."""
    return ".".join(part for part in (parent, key) if part)


@functools.cache
def element_configuration(kind: Any) -> type[Configuration] | None:
    """Return the configuration class of a ``Mapping[str, Configuration]``; None for other types."""
    if typing.get_origin(kind) is Mapping:
        element = typing.get_args(kind)[1]
        if is_configuration(element):
            return typing.cast(type[Configuration], element)
    return None


@functools.cache
def without_none(kind: Any) -> Any:
    """Return the type ``X`` of a field declared as ``X | None``; return other types unchanged."""
    members = typing.get_args(kind) if isinstance(kind, types.UnionType) else ()
    kept = [member for member in members if member is not type(None)]
    return kept[0] if len(kept) == 1 and len(members) == 2 else kind


def is_configuration(kind: Any) -> bool:
    """Return whether a field's type is a nested configuration."""
    return isinstance(kind, type) and issubclass(kind, Configuration)


def from_mapping(cls: type[C], mapping: Mapping[str, Any], key: str = "") -> C:
    """Build a configuration from nested mappings, such as the content of a YAML file.

    Args:
        cls: the configuration to build.
        mapping: values, keyed by name; a missing parameter keeps its default.
        key: dotted path of `mapping` itself, for messages.

    Raises:
        ConfigurationError: a key is unknown or missing, or a value is invalid.
    """
    if not isinstance(mapping, Mapping):
        raise ConfigurationError(key, f"{_described(mapping)}, not a mapping of names to values")
    declared = {name: kind for name, kind, _ in declared_parameters(cls)}
    for name in mapping:
        if name not in declared:
            shown = str(name) or "''"
            hint = did_you_mean(shown, declared) or ";"
            if shown.isdigit() and mapping[name] is None:  # such as {x: 0,5}
                hint = "; a number must have a decimal point, not a comma;"
            problem = f"is not a known key{hint} known here: {', '.join(sorted(declared))}"
            raise UnknownKeyError(join_key(key, shown), problem)
    values: dict[str, Any] = {}
    for name, kind in declared.items():
        if name in mapping:
            values[name] = _convert(mapping[name], kind, join_key(key, name))
    missing = [
        field.name
        for field in dataclasses.fields(cls)
        if field.name in declared
        and field.name not in values
        and field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise ConfigurationError(join_key(key, missing[0]), "is required and has no value")
    try:
        return cls(**values)
    except ConfigurationError as error:
        raise error.below(key) from None


def to_mapping(configuration: Configuration) -> dict[str, Any]:
    """Return a configuration as nested dicts of plain values that YAML can represent."""
    result: dict[str, Any] = {}
    for name, kind, _ in declared_parameters(type(configuration)):
        value = getattr(configuration, name)
        if is_configuration(kind):
            result[name] = to_mapping(value)
        elif element_configuration(kind) is not None:
            result[name] = {element: to_mapping(value[element]) for element in value}
        elif isinstance(value, tuple):
            result[name] = list(value)
        else:
            result[name] = value
    return result


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``; did you mean ...?`` if a known name is similar to `name`, else an empty text."""
    # A word of three letters may have one wrong letter.
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.66)
    return f"; did you mean {close[0]!r}?" if close else ""


def shortened(text: str, longest: int = 255) -> str:
    """Return a text in which each name of more than `longest` characters is cut to 60 characters.

    A name is a word, or a part of a path. The default of `longest` is the maximum length of a file
    name.
    """
    return re.sub(
        rf"([^\s/]{{60}})[^\s/]{{{longest - 59},}}",
        lambda word: f"{word[1]}... ({len(word[0])} characters)",
        text,
    )


def check_choice(key: str, value: Any, known: Iterable[str]) -> None:
    """Raise an error unless a value is one of the permitted values.

    Raises:
        ConfigurationError: the value is not permitted; the message names the permitted values and
            the most similar value.
    """
    names = list(known)
    if value not in names:
        hint = did_you_mean(str(value), names)
        raise ConfigurationError(key, f"{value!r} is not one of {', '.join(names)}{hint}")


def _convert(value: Any, kind: Any, key: str) -> Any:
    """Convert a YAML value to the type of a field if possible; `_check_value` checks the rest."""
    if is_configuration(kind):
        return from_mapping(kind, value, key)
    element = element_configuration(kind)
    if element is not None:
        if not isinstance(value, Mapping):
            raise ConfigurationError(key, f"{_described(value)}, not a mapping of names to entries")
        return {
            name: from_mapping(element, entry, join_key(key, str(name)))
            for name, entry in value.items()
        }
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ConfigurationError(key, "the number is too large") from None
    if typing.get_origin(kind) is tuple and isinstance(value, list | tuple):
        item = typing.get_args(kind)[0]
        return tuple(_convert(entry, item, f"{key}[{i}]") for i, entry in enumerate(value))
    return value


def _check_value(name: str, value: Any, kind: Any, info: ParameterInfo) -> None:
    if value is None and type(None) in typing.get_args(kind):
        return
    kind = without_none(kind)
    if typing.get_origin(kind) is tuple:
        item = typing.get_args(kind)[0]
        if not isinstance(value, tuple):
            items = _type_in_words(item).removeprefix("a ")
            raise ConfigurationError(name, f"{_described(value)}, not a list of {items}s")
        for index, entry in enumerate(value):
            _check_value(f"{name}[{index}]", entry, item, info)
        return
    if element_configuration(kind) is not None:
        _check_names(name, value)
        return
    if isinstance(kind, types.UnionType) or not isinstance(kind, type):
        raise TypeError(f"{name}: fields of type {kind!r} are not supported")
    if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
        problem = f"{_described(value)}, must be {_type_in_words(kind)}"
        if isinstance(value, str) and info.unit:
            problem += f" in {info.unit}, without its unit"
            problem += " and with a decimal point" if kind is float else ""
        raise ConfigurationError(name, problem)
    if isinstance(value, int | float) and not isinstance(value, bool):
        _check_range(name, value, info)
    if info.choices is not None:
        check_choice(name, value, info.choices)


def _check_names(name: str, value: Any) -> None:
    if not isinstance(value, Mapping):
        raise ConfigurationError(name, f"{_described(value)}, not a mapping of names to entries")
    for entry in value:
        if not (isinstance(entry, str) and _NAME.fullmatch(entry)):
            raise ConfigurationError(
                name, f"the name {entry!r} must be a letter followed by letters, digits or _"
            )


def _check_range(name: str, value: float, info: ParameterInfo) -> None:
    unit = f" {info.unit}" if info.unit else ""
    if isinstance(value, int) and not _SMALLEST_INTEGER <= value <= LARGEST_INTEGER:
        limits = f"{_SMALLEST_INTEGER} to {LARGEST_INTEGER}"
        problem = f"the whole number has more than 64 bits, must be from {limits}"
        raise ConfigurationError(name, problem)
    if not math.isfinite(value):
        raise ConfigurationError(name, f"{value}{unit} is not a finite number")
    if not info.permits(value):
        problem = f"{value:.15g}{unit} is out of range, must be {info.bounds_in_words()}"
        raise ConfigurationError(name, problem)


def _described(value: Any) -> str:
    """Return a description of a value and its type."""
    if value is None:
        return "is nothing"
    return f"{value!r:.200} is {_type_in_words(type(value))}"


def _type_in_words(kind: type) -> str:
    words = {
        bool: "true or false", int: "a whole number", float: "a number", str: "a text",
        list: "a list", dict: "a mapping", type(None): "nothing",
    }  # fmt: skip
    return words.get(kind, f"a {kind.__name__}")
