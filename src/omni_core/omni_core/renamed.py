"""Imports by the names that packages had in earlier releases."""

import importlib
import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType


class _Renamed:
    """Finder and loader that give a module of a renamed package under its old name."""

    def __init__(self, names: Mapping[str, str]) -> None:
        self._names = names

    def find_spec(
        self, name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a spec for an old name; None for every other name."""
        package = name.partition(".")[0]
        return ModuleSpec(name, self, is_package=False) if package in self._names else None  # type: ignore[arg-type]

    def create_module(self, _spec: ModuleSpec) -> None:
        """Let Python create a module, which `exec_module` replaces."""

    def exec_module(self, module: ModuleType) -> None:
        """Replace a module by the module with the new name, so that each class exists once."""
        old = module.__name__
        above = next(part for part in _above(old) if part in self._names)
        sys.modules[old] = importlib.import_module(self._names[above] + old.removeprefix(above))


def _above(name: str) -> list[str]:
    """Return a dotted name and the names of all packages above it, the longest name first."""
    parts = name.split(".")
    return [".".join(parts[:count]) for count in range(len(parts), 0, -1)]


def forward_imports(package: str, names: Mapping[str, str]) -> None:
    """Warn that a package has a new name, and import its modules under their new names.

    Args:
        package: old name of the package.
        names: new names of the package and of modules that are in another place, keyed by the old
            names.
    """
    warnings.warn(
        f"{package} is now {names[package]}, and the old name will be removed with the next "
        "release",
        FutureWarning,
        stacklevel=3,
    )
    sys.meta_path.insert(0, _Renamed(names))
