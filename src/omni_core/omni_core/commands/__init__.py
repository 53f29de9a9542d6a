"""Commands of the command line: what declares a command, and how it is found.

A command is a module in the folder of its feature. An entry point of the group `PACKAGE`, which its
package declares, gives it a name. The first line of its docstring states the name and the purpose
of the command; an optional second paragraph is the introduction of the help text. The
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

from omni_core.commands.command_report import Report
from omni_core.commands.workspace import Workspace
from omni_core.configuration import Configuration
from omni_core.plugins import described_entry_points, described_modules, entry_points_of

PACKAGE = "omni.commands"
"""Group of entry points, each of which names the module of a command."""

OF_THE_LAUNCHER = {
    "install": "install a group of optional packages",
    "test": "run the tests (arguments go to pytest)",
}
"""Descriptions of the commands that the script `omni` runs itself, keyed by name."""


class Command(Protocol):
    """Interface of a module that defines a command."""

    __doc__: str
    Options: type[Configuration]

    def run(self, options: Any, workspace: Workspace) -> Report:
        """Run the command with its options, and return the result."""


@functools.cache
def commands_of(package: str) -> dict[str, str]:
    """Return the descriptions of commands, keyed by name, without importing the commands.

    Args:
        package: dotted name of the package with the commands, of which modules whose names begin
            with ``_`` are none; or `PACKAGE`.
    """
    if package == PACKAGE:
        found = described_entry_points(package)
    else:
        modules = described_modules(package)
        found = {name.rstrip("_"): words for name, (_, words) in modules.items()}
    return {name: first_line(words) for name, words in found.items()}


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
    if group.PACKAGE == PACKAGE:
        return importlib.import_module(entry_points_of(PACKAGE)[name])
    return importlib.import_module(f"{group.PACKAGE}.{name}{'_' * keyword.iskeyword(name)}")


def first_line(words: str) -> str:
    """Return the first line of a command's docstring without the command name."""
    return re.sub(r"^``[^`]*``: ", "", words.strip().split("\n")[0]).rstrip(".")
