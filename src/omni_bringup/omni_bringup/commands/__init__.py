"""The commands of the command line, one module each.

A command is a module of this package. The first line of its docstring names the command and what it
does; the second paragraph, if there is one, introduces its help. It has its options as a
`Configuration` called ``Options`` and a function ``run(options, workspace)`` that returns a
`Report`. It raises `InputError` before anything starts, and `WorkError` or `OSError` if the work
fails after its start. It imports what it needs when it runs, so that help and errors in options are
printed without delay.

A command that may take long without reporting progress describes its work in ``WORK``; a line with
the time elapsed goes to standard error every few seconds.

A module with a ``PACKAGE`` has subcommands, the modules of that package. If the module defines
``command(name)``, that function makes the command; otherwise the submodule is the command.
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
    """Return the descriptions of a package's commands by name, without importing the commands.

    Args:
        package: dotted name of the package; its modules whose names begin with ``_`` are no
            commands.
    """
    return {
        _command_name(package, name): first_line(words)
        for name, (_, words) in described_modules(package).items()
    }


def load_command(group: Any, name: str) -> Any:
    """Return a command, or a module whose ``PACKAGE`` has subcommands.

    Args:
        group: module with a ``PACKAGE``, such as this one.
        name: one of the names from `commands_of`.
    """
    if hasattr(group, "command"):
        return group.command(name)
    module = name.replace("-", "_")
    return importlib.import_module(f"{group.PACKAGE}.{module}{'_' * keyword.iskeyword(module)}")


def _command_name(package: str, module: str) -> str:
    """Return the name of a command: ``fit-tire`` for fit_tire; studies keep their underscores."""
    return module.rstrip("_").replace("_", "-") if package.startswith(PACKAGE) else module


def first_line(words: str) -> str:
    """Return the first line of a docstring without the command itself."""
    return re.sub(r"^``[^`]*``: ", "", words.strip().split("\n")[0]).rstrip(".")
