"""Conversion of messages to table rows, with one column for each plain value.

Examples of columns are ``twist.twist.linear.x``, ``header.stamp_ns`` (times are converted to
nanoseconds) and ``covariance[7]``. The arrays of a ``JointState`` have a column for each joint,
such as ``velocity.front_left``. A message that would need more than `RecordingLimits.columns`
columns, such as an image, is not converted.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from omni_core.quantities import SECOND_NS
from omni_core.topics import JOINT_STATE
from omni_recording.decode import MessageDecoder
from omni_recording.limits import LIMITS

# Kinds of a rosbags field, which is a pair (kind, parts).
_BASE, _NAME = range(1, 3)
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_JOINT_VALUES = ("position", "velocity", "effort")

Value = bool | int | float | str
Cell = tuple[str, str, Value]


class TooWideError(ValueError):
    """A message needs more columns than a table may have."""


def flatten(decoder: MessageDecoder, type_name: str, message: Any) -> list[Cell]:
    """Return a decoded message as table columns.

    Args:
        decoder: decoder, which knows the fields of the type.
        type_name: type of the message.
        message: message as returned by `MessageDecoder.decode`.

    Returns:
        Name, kind (a ROS base type such as ``float64``) and value of each column.

    Raises:
        TooWideError: the message has more than `RecordingLimits.columns` columns.
    """
    cells: list[Cell] = []
    for cell in _cells(decoder, type_name, message, ""):
        cells.append(cell)
        if len(cells) > LIMITS.columns:
            raise TooWideError(f"a message contains more than {LIMITS.columns} values")
    return cells


def _cells(decoder: MessageDecoder, type_name: str, message: Any, prefix: str) -> Iterator[Cell]:
    labels = _joint_labels(type_name, message)
    for name, (kind, parts) in decoder.fields(type_name):
        value = getattr(message, name)
        path = prefix + name
        if kind == _BASE:
            yield path, parts[0], _plain(value)
        elif kind == _NAME:
            yield from _nested(decoder, parts, value, path)
        elif name == "name" and labels is not None:
            continue  # joint names are part of the column names
        else:
            by_label = labels if name in _JOINT_VALUES else None
            yield from _elements(decoder, parts[0], value, path, by_label)


def _nested(decoder: MessageDecoder, type_name: str, value: Any, path: str) -> Iterator[Cell]:
    if type_name in _TIMES:
        yield f"{path}_ns", "int64", int(value.sec) * SECOND_NS + int(value.nanosec)
    else:
        yield from _cells(decoder, type_name, value, f"{path}.")


def _elements(
    decoder: MessageDecoder,
    element: tuple[int, Any],
    values: Sequence[Any],
    path: str,
    labels: Sequence[str] | None,
) -> Iterator[Cell]:
    if len(values) > LIMITS.columns:
        raise TooWideError(f"{path} contains more than {LIMITS.columns} values")
    kind, parts = element
    for index, value in enumerate(values):
        labeled = labels is not None and len(labels) == len(values)
        place = f"{path}.{labels[index]}" if labeled and labels else f"{path}[{index}]"
        if kind == _BASE:
            yield place, parts[0], _plain(value)
        else:
            yield from _nested(decoder, parts, value, place)


def _joint_labels(type_name: str, message: Any) -> Sequence[str] | None:
    """Return the names of the joints if they can be used as column names; otherwise None."""
    if type_name != JOINT_STATE:
        return None
    names: Sequence[str] = message.name
    fit = all(name.isprintable() and 0 < len(name) <= LIMITS.label for name in names)
    return names if fit and len(set(names)) == len(names) <= LIMITS.columns else None


def _plain(value: Any) -> Value:
    """Convert a NumPy number to a Python number."""
    plain: Value = value.item() if hasattr(value, "item") else value
    return plain
