"""Imports by the names that packages had in earlier releases."""

import importlib
import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib.machinery import ModuleSpec
from types import CodeType, ModuleType


class _Renamed:
    """Finder and loader that give a module of a renamed package under its old name."""

    def __init__(self, package: str, names: Mapping[str, str]) -> None:
        self._package, self._names = package, names

    def find_spec(
        self, name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a spec for an old name; None for every other name."""
        known = name == self._package or name.startswith(f"{self._package}.")
        return ModuleSpec(name, self, origin=name) if known else None  # type: ignore[arg-type]

    def create_module(self, _spec: ModuleSpec) -> None:
        """Let Python create a module, which `exec_module` replaces."""

    def exec_module(self, module: ModuleType) -> None:
        """Replace a module by the module with the new name, so that each class exists once."""
        old = module.__name__
        new = sys.modules[old] = importlib.import_module(self._new(old))
        if not hasattr(new, "__path__"):  # else the longer names are those of its modules
            for name in self._names:
                above, _, attribute = name.rpartition(".")
                if above == old:
                    place, _, renamed = self._names[name].rpartition(".")
                    setattr(new, attribute, getattr(importlib.import_module(place), renamed))

    def get_code(self, name: str) -> CodeType:
        """Return a program that runs a module with the new name, for ``python -m``."""
        text = f"import runpy; runpy.run_module({self._new(name)!r}, run_name='__main__')"
        return compile(text, name, "exec")

    def _new(self, old: str) -> str:
        """Return the new name of a module."""
        parts = old.split(".")
        names = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
        above = next(name for name in names if name in self._names)
        return self._names[above] + old.removeprefix(above)


def forward_imports(package: str, names: Mapping[str, str]) -> None:
    """Warn that a package or module has a new name, and import it and its modules under this name.

    Args:
        package: old name of the package or module, which calls this function.
        names: new names of the package, and of modules and their contents that are in another
            place, keyed by the old names.
    """
    warnings.warn(
        f"{package} is now {names[package]}, and the old name will be removed with the next "
        "release",
        FutureWarning,
        stacklevel=3,
    )
    sys.meta_path.insert(0, _Renamed(package, names))
    sys.modules[package] = importlib.import_module(names[package])
