"""Reference of all commands and studies, generated from their declarations.

``python -m omni_bringup.reference.commands > docs/options.md`` writes the page for the
documentation site; the file is not part of the repository.
"""

import dataclasses
import inspect
import sys
from collections.abc import Iterator
from typing import Any

from omni_core import commands, configuration
from omni_core.commands import command_options

_HEAD = """\
# All options

This page lists all options of every command and study; it is generated from the code.
Use it to look up an option; [Commands](commands.md) has purposes, examples and the output of
`--json`. Exit codes: 0 done, 1 failed, 2 refused before anything started, 130 ended by Ctrl-C
(143 by SIGTERM).

"""


def reference() -> str:
    """Return the reference of all commands and studies as Markdown text."""
    return "\n".join((_HEAD, *_sections(commands, "./omni", 2)))


def _sections(group: Any, above: str, level: int) -> Iterator[str]:
    """Yield a Markdown section for each command of a group and its subgroups.

    Args:
        group: module with a ``PACKAGE`` of commands.
        above: words of the command line before the name of a command, such as ``./omni bag``.
        level: level of the headings.
    """
    for name in commands.commands_of(group.PACKAGE):
        command, program = commands.load_command(group, name), f"{above} {name}"
        words = inspect.cleandoc(command.__doc__ or "")
        if words.startswith("``") and "\n\n" in words:
            words = words.split("\n\n", 1)[1]
        yield f"{'#' * level} `{program}`\n\n{_prose(words)}\n"
        if hasattr(command, "PACKAGE"):
            yield from _sections(command, program, level + 1)
        else:
            yield "\n".join(("| option | default | unit | meaning |", "|---|---|---|---|"))
            yield "\n".join(_rows(command.Options)) + "\n"


def _prose(words: str) -> str:
    """Convert the code spans of a docstring from reStructuredText to Markdown."""
    return words.replace("``", "`")


def _rows(cls: Any) -> Iterator[str]:
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    for name, _, info in configuration.declared_parameters(cls):
        default = defaults[name]
        if default is dataclasses.MISSING:
            shown = "required"
        elif isinstance(default, bool) or default in (None, (), ""):
            shown = ""
        else:
            values = default if isinstance(default, tuple) else (default,)
            shown = f"`{', '.join(str(value) for value in values)}`"
        meaning = info.description.replace("|", "\\|").replace("<", "&lt;")
        yield f"| `{command_options.option_of(cls, name)}` | {shown} | {info.unit} | {meaning} |"


if __name__ == "__main__":
    sys.stdout.write(reference())
