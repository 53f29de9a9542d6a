"""Commands of the command line, one module each.

A command is a module of this package. The first line of its docstring states the name and the
purpose of the command; an optional second paragraph is the introduction of the help text. The
module has a `Configuration` called ``Options`` and a function ``run(options, workspace)`` that
returns a `Report`. For invalid input the function raises `InputError` before the work starts; if
the work fails after its start, it raises `WorkError` or `OSError`. Modules that a command needs are
imported when it runs, so that help and option errors are printed without delay.

A command that may take long without reporting progress describes its work in ``WORK``; every few
seconds, a line with the elapsed time is then printed to standard error.

A module with a ``PACKAGE`` has subcommands, which are the modules of that package. If the module
defines ``command(name)``, this function returns the command; otherwise the submodule is the
command.
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
    """Interface of a module that defines a command."""

    __doc__: str
    Options: type[Configuration]

    def run(self, options: Any, workspace: Workspace) -> Report:
        """Run the command with its options, and return the result."""


@functools.cache
def commands_of(package: str) -> dict[str, str]:
    """Return the descriptions of the commands in a package, keyed by name, without importing them.

    Args:
        package: dotted name of the package; modules whose names begin with ``_`` are not commands.
    """
    return {
        _command_name(package, name): first_line(words)
        for name, (_, words) in described_modules(package).items()
    }


def load_command(group: Any, name: str) -> Any:
    """Return a command of a group by its name.

    If the group has a function `command`, this function returns the command. Otherwise the command
    is a module of the group's package.

    Args:
        group: module with a ``PACKAGE``, such as this one.
        name: one of the names from `commands_of`.
    """
    if hasattr(group, "command"):
        return group.command(name)
    module = name.replace("-", "_")
    return importlib.import_module(f"{group.PACKAGE}.{module}{'_' * keyword.iskeyword(module)}")


def _command_name(package: str, module: str) -> str:
    """Return the command name of a module: ``fit-tire`` for fit_tire; a study keeps its name."""
    return module.rstrip("_").replace("_", "-") if package.startswith(PACKAGE) else module


def first_line(words: str) -> str:
    """Return the first line of a command's docstring without the command name."""
    return re.sub(r"^``[^`]*``: ", "", words.strip().split("\n")[0]).rstrip(".")
