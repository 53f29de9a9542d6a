"""Message definitions of a ROS 2 installation, which make recordings self-describing.

A message package installs ``share/<package>/msg/<Name>.msg`` and, next to it, a JSON description of
the type that contains the official type hashes. From these two files, the exact types of the
running system are obtained without a parser of the message language.
"""

import dataclasses
import enum
import json
import os
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

_TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")
_SEPARATOR = "=" * 80


class _FieldType(enum.IntEnum):
    """Values of type_description_interfaces/msg/FieldType."""

    NESTED = 1
    NESTED_SEQUENCE = 145
    """Sequence of messages of any length"""


_TIME = "builtin_interfaces/msg/Time"


class MessageDefinitionError(LookupError):
    """The definition of a message type was not found; the text lists the searched folders."""


@dataclasses.dataclass(frozen=True)
class MessageDefinition:
    """Description of a message type in a recording.

    Attributes:
        type_name: name of the type, such as ``sensor_msgs/msg/Image``.
        text: the type's ``.msg`` text, followed by the texts of the types that it contains, each
            after a line of 80 ``=`` and a line ``MSG: <package>/<Name>``.
        type_hash: official hash of the type, ``RIHS01_...``.
        stamped: whether every message begins with a time stamp, usually the stamp in its header.
        of_stamped: whether every message begins with a list of stamped messages.
    """

    type_name: str
    text: str
    type_hash: str
    stamped: bool
    of_stamped: bool = False


def installation_prefixes(environment: Mapping[str, str] = os.environ) -> tuple[Path, ...]:
    """Return the folders in which message packages may be installed.

    The last folder belongs to the running Python, because the ROS wheels are installed there but
    not added to ``AMENT_PREFIX_PATH``.
    """
    named = environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return tuple(Path(prefix) for prefix in (*filter(None, named), sys.prefix))


def find_message_definition(
    type_name: str, prefixes: Iterable[Path] | None = None
) -> MessageDefinition:
    """Return the definition of an installed message type.

    Args:
        type_name: name of the type, such as ``sensor_msgs/msg/Image``.
        prefixes: folders to search; None for `installation_prefixes()`.

    Raises:
        MessageDefinitionError: the name is malformed, or the type is not installed.
    """
    folders = installation_prefixes() if prefixes is None else tuple(prefixes)
    try:
        description = json.loads(_read(type_name, ".json", folders))
    except ValueError as error:
        raise MessageDefinitionError(f"{type_name}.json cannot be read: {error}") from None
    # The list of hashes names the type and all types that it contains.
    hashes = {entry["type_name"]: entry["hash_string"] for entry in description["type_hashes"]}
    texts = [_read(type_name, ".msg", folders)]
    for dependency in sorted(hashes.keys() - {type_name}):
        package, _, name = dependency.split("/")
        texts.append(f"{_SEPARATOR}\nMSG: {package}/{name}\n{_read(dependency, '.msg', folders)}")
    whole = description["type_description_msg"]
    nested = {entry["type_name"]: entry for entry in whole["referenced_type_descriptions"]}
    outer = whole["type_description"]
    first = outer["fields"][0]["type"]
    of_stamped = first["type_id"] == _FieldType.NESTED_SEQUENCE and _begins_with_time(
        nested[first["nested_type_name"]], nested
    )
    stamped = _begins_with_time(outer, nested)
    return MessageDefinition(type_name, "".join(texts), hashes[type_name], stamped, of_stamped)


def _begins_with_time(current: Mapping[str, Any], nested: Mapping[str, Any]) -> bool:
    """Return whether the first field of a message is, or begins with, a `builtin_interfaces/Time`.

    Args:
        current: description of the message type.
        nested: descriptions of all types that the message contains, keyed by name.
    """
    while current["type_name"] != _TIME:
        first = current["fields"][0]["type"]
        if first["type_id"] != _FieldType.NESTED:
            return False
        current = nested[first["nested_type_name"]]
    return True


def _read(type_name: str, ending: str, prefixes: Iterable[Path]) -> str:
    """Return the text of the ``.msg`` or ``.json`` file of a message type, with a final newline."""
    path = _find(type_name, ending, prefixes)
    try:
        return path.read_text(encoding="utf-8").removesuffix("\n") + "\n"
    except (OSError, ValueError) as error:
        raise MessageDefinitionError(f"{type_name}: {path} cannot be read: {error}") from None


def _find(type_name: str, ending: str, prefixes: Iterable[Path]) -> Path:
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise MessageDefinitionError(
            f"{type_name!r} is not the name of a message type, such as sensor_msgs/msg/Image"
        )
    package, name = match.groups()
    for prefix in prefixes:
        path = f"{prefix}/share/{package}/msg/{name}{ending}"
        if os.path.isfile(path):  # faster than Path, as there may be dozens of prefixes
            return Path(path)
    searched = ", ".join(str(prefix) for prefix in prefixes)
    raise MessageDefinitionError(f"{type_name} is not installed below any of: {searched}")
