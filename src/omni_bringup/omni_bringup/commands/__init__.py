"""The commands of the command line, one module each.

A command is a module of this package. The first line of its docstring says what it does, behind
the command itself; the second paragraph, if there is one, introduces its help. It has its options
as a `Configuration` called ``Options`` and a function ``run(options, workspace)`` that returns the
exit code and may raise `ConfigurationError` to refuse. It imports what it needs when it runs, so
that help and a mistyped option are answered at once.

One that may take long and cannot tell its share says in ``WORK`` what it is at; a line of it goes
to standard error every few seconds.

A module with a ``PACKAGE`` has commands of its own: the modules of that package, each made a
command by ``command(name)`` of the module where it has one.
"""

from __future__ import annotations

import ast
import functools
import importlib
import importlib.util
import keyword
import pkgutil
import re
from pathlib import Path
from typing import Any, Protocol

from omni_platform.configuration import Configuration

PACKAGE = __name__


class Command(Protocol):
    """The module of a command."""

    __doc__: str
    Options: type[Configuration]

    def run(self, options: Any, workspace: Path) -> int:
        """Do what the options say and return the exit code; `workspace` holds `config`."""


@functools.cache
def commands_of(package: str) -> dict[str, str]:
    """Return what each command of a package does, by its name; none of them is imported.

    Args:
        package: dotted name; modules that begin with ``_`` are no commands.
    """
    found = {}
    spec = importlib.util.find_spec(package)
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        for module in pkgutil.iter_modules([folder]):
            if not module.name.startswith("_"):
                file = f"{module.name}/__init__.py" if module.ispkg else f"{module.name}.py"
                source = Path(folder, file).read_text("utf-8")
                words = ast.get_docstring(ast.parse(source)) or ""
                found[_command_name(package, module.name)] = first_line(words)
    return dict(sorted(found.items()))


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
    """Return what people type for a module: ``fit-tire``, but ``straight_line`` for a study."""
    return module.rstrip("_").replace("_", "-") if package.startswith(PACKAGE) else module


def first_line(words: str) -> str:
    """Return what a docstring says in its first line, without the command itself."""
    return re.sub(r"^``[^`]*``: ", "", words.strip().split("\n")[0]).rstrip(".")
