"""The commands of the command line, one module each.

A command is a module of this package. The first line of its docstring names the command and what
it does; the second paragraph, if there is one, introduces its help. It has its options
as a `Configuration` called ``Options`` and a function ``run(options, workspace)`` that returns a
`Report`. It raises `InputError` to refuse before anything starts, and `WorkError` or `OSError`
if work fails that has begun. It imports what it needs when it runs, so that help and errors in
options are printed without delay.

A command that may take long without reporting progress describes its work in ``WORK``; a line with
the time elapsed goes to standard error every few seconds.

A module with a ``PACKAGE`` has subcommands: the modules of that package, which ``command(name)`` of
the module turns into commands if it is defined.
"""

import functools
import importlib
import keyword
import re
from typing import Any, Protocol

from omni_bringup.command_report import Report
from omni_bringup.workspace import Workspace
from omni_platform.configuration import Configuration
from omni_platform.plugins import described_modules

PACKAGE = __name__


class Command(Protocol):
    """The module of a command."""

    __doc__: str
    Options: type[Configuration]

    def run(self, options: Any, workspace: Workspace) -> Report:
        """Run the command."""


@functools.cache
def commands_of(package: str) -> dict[str, str]:
    """Return the description of each command of a package by name, without importing them.

    Args:
        package: dotted name; modules that begin with ``_`` are no commands.
    """
    return {
        _command_name(package, name): first_line(words)
        for name, (_, words) in described_modules(package).items()
    }


def load_command(group: Any, name: str) -> Any:
    """Return a command, or a module with a ``PACKAGE`` of further ones.

    Args:
        group: this module, or another one with a ``PACKAGE``.
        name: one of its `commands_of`.
    """
    if hasattr(group, "command"):
        return group.command(name)
    module = name.replace("-", "_")
    return importlib.import_module(f"{group.PACKAGE}.{module}{'_' * keyword.iskeyword(module)}")


def _command_name(package: str, module: str) -> str:
    """Return the command name of a module: ``fit-tire``, but ``straight_line`` for a study."""
    return module.rstrip("_").replace("_", "-") if package.startswith(PACKAGE) else module


def first_line(words: str) -> str:
    """Return the first line of a docstring without the command itself."""
    return re.sub(r"^``[^`]*``: ", "", words.strip().split("\n")[0]).rstrip(".")
