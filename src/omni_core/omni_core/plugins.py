"""Import of user classes that a configuration names, as ``module:Class`` or by an entry point.

Also import of packages that only some commands need; the launcher installs them.
"""

import ast
import functools
import importlib
import importlib.metadata
import importlib.util
import os
import pkgutil
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

from omni_core.configuration import ConfigurationError, did_you_mean


@functools.cache
def described_modules(package: str) -> dict[str, tuple[str, str]]:
    """Return the descriptions of the modules of a package without importing them.

    Args:
        package: dotted name of the package; modules whose names begin with ``_`` are omitted.

    Returns:
        Module and description, keyed by name. For most modules, the name is that of the module, and
        the description is the first line of its docstring. A module with ``CASES`` gives one entry
        for each of its cases instead.
    """
    found: dict[str, tuple[str, str]] = {}
    for folder in _folders_of(package):
        for module in pkgutil.iter_modules([folder]):
            if not module.name.startswith("_"):
                file = f"{module.name}/__init__.py" if module.ispkg else f"{module.name}.py"
                tree = ast.parse(Path(folder, file).read_text("utf-8"))
                words = _purpose(tree)
                cases = _constant(tree, "CASES") or {module.name: words}
                found |= {name: (module.name, what) for name, what in cases.items()}
    return dict(sorted(found.items()))


def described_entry_points(group: str) -> dict[str, str]:
    """Return the purposes of the modules that the entry points of a group name.

    Args:
        group: group of entry points.

    Returns:
        First lines of the docstrings of the modules, keyed by the names of the entry points. The
        packages of the modules are imported.
    """
    specs = {name: importlib.util.find_spec(to) for name, to in entry_points_of(group).items()}
    files = {name: Path(spec.origin) for name, spec in specs.items() if spec and spec.origin}
    return {name: _purpose(ast.parse(path.read_text("utf-8"))) for name, path in files.items()}


def _folders_of(package: str) -> list[str]:
    """Return the folders of a package, which are none if the package is not installed."""
    try:
        spec = importlib.util.find_spec(package)
    except ModuleNotFoundError:  # of the package above it
        spec = None
    return list(spec.submodule_search_locations or ()) if spec else []


def _purpose(tree: ast.Module) -> str:
    return (ast.get_docstring(tree) or "").strip().split("\n")[0]


def _constant(tree: ast.Module, name: str) -> Any:
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == name:
            return ast.literal_eval(node.value)
    return None


def check_name(key: str, name: str, built_in: Collection[str], group: str) -> None:
    """Check that the name of a class is valid, without importing the class.

    Args:
        key: key of the configuration.
        name: name of a built-in class, an entry point of `group`, or ``module:Class``.
        built_in: names of the built-in classes.
        group: group of entry points.

    Raises:
        ConfigurationError: the name has none of these forms.
    """
    if name in built_in or ":" in name:
        return
    known = [*built_in, *entry_points_of(group)]
    if name in known:
        return
    hint = did_you_mean(name, known) or ";"
    words = f"{name!r} is not known{hint} known: {', '.join(known)}, or module:Class for your own"
    raise ConfigurationError(key, words)


def load_class(
    key: str, name: str, built_in: Collection[str], group: str, *methods: str
) -> type[Any]:
    """Import a user's class.

    Python searches for the module in `sys.path` and in the working directory.

    Args:
        key: key of the configuration.
        name: an entry point of `group`, or ``module:Class``.
        built_in: names of the built-in classes, for messages.
        group: group of entry points.
        *methods: names of the methods that the class must have.

    Raises:
        ConfigurationError: the class cannot be imported, or lacks a required method.
    """
    check_name(key, name, built_in, group)
    place = (
        name if ":" in name else entry_points_of(group).get(name, name)
    )  # the search takes 20 ms
    module_name, _, class_name = place.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        module = importlib.import_module(module_name)
    except (Exception, SystemExit) as error:  # a user's module may raise any exception
        raise ConfigurationError(
            key,
            f"{name!r}: cannot import {module_name!r} ({type(error).__name__}: {error}); it must "
            "be in the working directory or on PYTHONPATH",
        ) from None
    found = getattr(module, class_name, None)
    if not isinstance(found, type):
        # A module that is compiled into Python has the class of its loader as `__loader__`.
        public = {entry: one for entry, one in vars(module).items() if not entry.startswith("_")}
        known = ", ".join(entry for entry, one in public.items() if isinstance(one, type)) or "none"
        raise ConfigurationError(
            key, f"{name!r}: {module_name} has no class {class_name!r}; it has {known}"
        )
    lacking = [method for method in methods if not callable(getattr(found, method, None))]
    if lacking:
        raise ConfigurationError(key, f"{name!r} has no method {lacking[0]!r}")
    return found


def make_part(key: str, name: str, cls: type[Any], *arguments: Any) -> Any:
    """Create an instance of a user's class.

    Args:
        key: key of the configuration.
        name: name of the class in the configuration, for messages.
        cls: the class.
        *arguments: arguments of its constructor.

    Raises:
        ConfigurationError: the constructor raises an exception.
    """
    try:
        return cls(*arguments)
    except ConfigurationError:
        raise
    except (Exception, SystemExit) as error:  # a user's class may raise any exception
        raise ConfigurationError(
            key, f"{name!r} cannot be made ({type(error).__name__}: {error})"
        ) from error


@functools.cache
def entry_points_of(group: str) -> dict[str, str]:
    """Return what the entry points of a group name, keyed by their names in alphabetical order."""
    found = importlib.metadata.entry_points(group=group)
    return {entry.name: entry.value for entry in sorted(found, key=lambda one: one.name)}


def import_optional(module: str, group: str) -> Any:
    """Return a module; if it is missing, let the launcher install its group of packages first.

    Args:
        module: name of the module.
        group: name of the lock file in the folder ``requirements`` of the workspace.

    Raises:
        ImportError: the module is missing, and no launcher has started this process, or the
            launcher could not install the group, for which it has printed the reason.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        launcher = Path(os.environ.get("OMNI_WORKSPACE", "."), "omni")
        # The output of the command itself is not mixed with the messages of the launcher.
        command = [sys.executable, str(launcher), "install", group]
        if not launcher.exists() or subprocess.call(command, stdout=sys.stderr):
            raise
    importlib.invalidate_caches()
    return importlib.import_module(module)
