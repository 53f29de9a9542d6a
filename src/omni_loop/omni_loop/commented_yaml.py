"""Text of configuration files with comments, for files that people edit."""

import math
from collections.abc import Mapping
from typing import Any

import yaml

_NO_NOTES: Mapping[str, str] = {}
_LONGEST = 110  # limit on the number of characters of a mapping or list on one line


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
