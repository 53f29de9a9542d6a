"""A `Configuration` as the options of a command line.

A command declares its options as the fields of a `Configuration`; type, bounds, default and help
follow from them. A field ``max_rotation`` becomes the option ``--max-rotation N``. A bool becomes a
switch, a tuple becomes an option that may be repeated, and a field of the type ``X | None`` becomes
an option that may be omitted.
"""

import argparse
import dataclasses
import functools
import re
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from omni_core import configuration

_SPELLING = "omni_option"
_METAVARS = {int: "N", float: "X", str: "NAME", Path: "PATH"}

C = TypeVar("C", bound=configuration.Configuration)


@dataclasses.dataclass(frozen=True)
class _Spelling:
    """Properties of an option that do not follow from its field; see `option`."""

    flag: str | None = None
    metavar: str | None = None
    positional: bool = False
    many: bool = False


def option(
    default: Any = dataclasses.MISSING,
    *,
    flag: str | None = None,
    metavar: str | None = None,
    positional: bool = False,
    many: bool = False,
    **declared: Any,
) -> Any:
    """Declare a field of a configuration, with additional properties of its command-line option.

    Args:
        default: value used if none is given; without a default the option is required.
        flag: flag such as ``--set`` if it differs from the field's name.
        metavar: name of the value in the help.
        positional: whether the option is a positional argument without a flag.
        many: whether one flag takes several values, which form a tuple.
        **declared: the other arguments of `parameter`.
    """
    field = configuration.parameter(default, **declared)
    spelling = _Spelling(flag, metavar, positional, many)
    field.metadata = {**field.metadata, _SPELLING: spelling}
    return field


class CommandOptions(configuration.Configuration):
    """Options of every command that computes metrics."""

    json: bool = configuration.parameter(False)
    """print the results as JSON"""


def overrides_option(example: str = "vehicle.load.mass=400") -> Any:
    """Declare ``--set KEY=VALUE``; `example` is shown in its help."""
    words = f"override a configuration value, such as {example}"
    return option((), flag="--set", metavar="KEY=VALUE", description=words)


def add_options(parser: argparse.ArgumentParser, cls: type[configuration.Configuration]) -> None:
    """Declare the parameters of `cls` as options of a parser.

    An option that is omitted on the command line is absent from the result of the parser.

    Args:
        parser: parser of the command.
        cls: configuration class that declares the options.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}
    for name, kind, info in configuration.declared_parameters(cls):
        spelling = _spelling(fields[name])
        single = configuration.without_none(kind)
        repeated = typing.get_origin(single) is tuple
        single = typing.get_args(single)[0] if repeated else single
        given: dict[str, Any] = {
            "help": _help(info, fields[name].default, repeated).replace("%", "%%"),
            "default": argparse.SUPPRESS,
        }
        if single is bool:
            given["action"] = "store_true"
        else:
            given["type"] = functools.partial(_converted, single)
            given["metavar"] = spelling.metavar or (
                "{" + ",".join(info.choices) + "}" if info.choices else _METAVARS[single]
            )
        required = fields[name].default is dataclasses.MISSING
        if spelling.positional:
            if repeated:
                given["nargs"] = "+" if required else "*"
            elif not required:
                given["nargs"] = "?"
            parser.add_argument(name, **given)
            continue
        if repeated:
            given |= {"action": "extend", "nargs": "+"} if spelling.many else {"action": "append"}
        parser.add_argument(_flag(name, spelling), dest=name, required=required, **given)


def _converted(kind: type[Any], word: str) -> Any:
    """Return a word as a value; if it is none, the word, which is then refused."""
    try:
        return kind(word) if word else word  # an empty path would be the working directory
    except ValueError:
        return word


def parse_options(
    cls: type[C], words: Sequence[str], parser: argparse.ArgumentParser | None = None
) -> C:
    """Return the options that the words of a command line specify.

    Args:
        cls: configuration class that declares the options.
        words: words of the command line, such as ``--pairs 64``.
        parser: parser without options; a new one by default.

    Raises:
        ConfigurationError: a value is invalid; the key of the error is the option as typed.
        SystemExit: the words are not options of `cls`; the reason is printed to standard error.
    """
    parser = parser or argparse.ArgumentParser()
    add_options(parser, cls)
    return read_options(cls, parser.parse_args(words))


def read_options(cls: type[C], parsed: argparse.Namespace) -> C:
    """Return the checked options of a parsed command line.

    Args:
        cls: configuration class that declares the options.
        parsed: result of a parser with `add_options`.

    Raises:
        ConfigurationError: a value is invalid; the key of the error is the option as typed.
    """
    given = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in vars(parsed).items()
        if name in {name for name, _, _ in configuration.declared_parameters(cls)}
    }
    for field in dataclasses.fields(cls):
        value = given.get(field.name)
        if value == "" != field.default or (isinstance(value, tuple) and "" in value):
            problem = "is empty, perhaps the value of an unset variable; give a value"
            raise configuration.ConfigurationError(option_of(cls, field.name), problem)
    try:
        return cls(**given)
    except configuration.ConfigurationError as error:
        raise configuration.ConfigurationError(option_of(cls, error.key), error.problem) from None


def flags_of(cls: type[configuration.Configuration]) -> list[str]:
    """Return the flags of a command's options, such as ``--max-rotation``."""
    fields = {field.name: _spelling(field) for field in dataclasses.fields(cls)}
    return [
        _flag(name, fields[name])
        for name, _, _ in configuration.declared_parameters(cls)
        if not fields[name].positional
    ]


def option_of(cls: type[configuration.Configuration], key: str) -> str:
    """Return the option of a field as it is typed, such as ``--max-rotation``.

    Args:
        cls: configuration class that declares the options.
        key: dotted path of a value in the field, such as the key of a `ConfigurationError`; it is
            returned unchanged if `cls` has no such field.
    """
    name = re.split(r"[.\[]", key)[0]
    for field in dataclasses.fields(cls):
        if field.name == name:
            spelling = _spelling(field)
            shown = spelling.metavar or name.upper()
            return shown if spelling.positional else _flag(name, spelling)
    return key


def _spelling(field: dataclasses.Field[Any]) -> _Spelling:
    return typing.cast(_Spelling, field.metadata.get(_SPELLING, _Spelling()))


def _flag(name: str, spelling: _Spelling) -> str:
    return spelling.flag or "--" + name.replace("_", "-")


def _help(info: configuration.ParameterInfo, default: Any, repeated: bool) -> str:
    words = f"{info.description} [{info.unit}]" if info.unit else info.description
    notes = ["may be repeated"] if repeated else []
    if default not in (dataclasses.MISSING, None, "", ()) and not isinstance(default, bool):
        values = default if isinstance(default, tuple) else (default,)
        words_of = (f"{value:g}" if isinstance(value, float) else str(value) for value in values)
        notes.append(f"default: {', '.join(words_of)}")
    return f"{words} ({'; '.join(notes)})" if notes else words
