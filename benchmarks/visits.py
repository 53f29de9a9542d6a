"""Count the files that a reader visits on two walks through the code, from a trace.

    ./omni exec python benchmarks/visits.py [--tree FOLDER]

A walk follows the calls of a program and enters each function once, at its first call. Each change
from one file to another is a visit; a visit is repeated if the walk has been in that file before.
The walk ``step`` leads from the lines of the cameras to the brake torque, in the closed loop within
one process; the walk ``run`` is that of ``./omni run`` in the process that starts the nodes. With
``--tree`` the walks are those of another clone, also of an earlier commit.
"""

import argparse
import contextlib
import importlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numba
import numpy as np

# Coarse cameras, and as few control periods as contain all parts of the loop.
_SHORT = ("maneuver.brake_time=0.02", "simulation.duration_limit=0.05", "maneuver.speed=2")
_RUN = ("run", "small_stop", "--json", *(word for one in _SHORT for word in ("--set", one)))


class Walk:
    """Files in the order in which a program calls functions of them for the first time."""

    def __init__(self, tree: Path) -> None:
        self._sources = f"{tree / 'src'}{os.sep}"
        self._seen: set[Any] = set()
        self.files: list[str] = []

    def __call__(self, frame: FrameType, event: str, _argument: object) -> None:
        """Note a call; a return to the file of the caller counts with the caller's next call."""
        code = frame.f_code
        if event != "call" or code in self._seen or not code.co_filename.startswith(self._sources):
            return
        self._seen.add(code)
        for one in (frame.f_back, frame):
            file = one.f_code.co_filename if one else ""
            if file.startswith(self._sources) and self.files[-1:] != [file]:
                self.files.append(file)

    @contextlib.contextmanager
    def traced(self) -> Iterator[None]:
        """Note the calls within the ``with`` block."""
        sys.setprofile(self)
        try:
            yield
        finally:
            sys.setprofile(None)


def step(tree: Path) -> Callable[[], object]:
    """Return the closed loop of a few control periods."""
    importlib.import_module("omni_sim.camera.batches")  # rendering in Python would take minutes
    numba.config.DISABLE_JIT = 1  # compiled calls leave no trace
    package = "omni_runs" if (tree / "src/omni_runs").is_dir() else "omni_loop"
    loop, experiment = (importlib.import_module(f"{package}.{n}") for n in ("loop", "experiment"))
    numba.config.DISABLE_JIT = 0  # rendering may have to be compiled
    read_as_attributes()
    library = experiment.ExperimentLibrary(tree / "config")
    configuration = library.load("small_stop", "assisted", _SHORT)
    return lambda: loop.run_closed_loop(configuration)


def run(folder: str) -> None:
    """Run the command ``run``, without its output."""
    cli = importlib.import_module("omni_bringup.cli")
    with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(SystemExit):
        cli.main([*_RUN, "--out", folder])


class Record(np.void):  # type: ignore[misc]  # NumPy permits it, its stubs do not
    """Record whose fields Python reads and writes as attributes, as compiled code does."""

    def __getattribute__(self, name: str) -> Any:
        get = super().__getattribute__
        return self[name] if name in (get("dtype").names or ()) else get(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value


def as_records(kind: Any) -> Any:
    """Return a type of array elements with `Record` for each structure."""
    if not kind.names:
        return kind
    parts = [(name, as_records(kind[name].base), kind[name].shape) for name in kind.names]
    return np.dtype((Record, parts))


def read_as_attributes() -> None:
    """Use `Record` in all modules."""
    for module in list(sys.modules.values()):
        for name, value in list(vars(module).items()):
            if isinstance(value, np.dtype):
                setattr(module, name, as_records(value))


def main() -> None:
    """Print the number of files, visits and repeated visits of both walks."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    here = Path(__file__).resolve().parents[1]
    parser.add_argument("--tree", type=Path, default=here, help="clone whose code is walked")
    tree = parser.parse_args().tree.resolve()
    os.environ["OMNI_WORKSPACE"] = str(tree)
    sys.path[:0] = [str(path.parent) for path in tree.glob("src/*/package.xml")]
    print(f"{'walk':8}{'files':>8}{'visits':>8}{'repeated':>10}")
    with tempfile.TemporaryDirectory() as scratch:
        walks: dict[str, Callable[[], object]] = {
            "step": step(tree),
            "run": lambda: run(f"{scratch}/run"),
        }
        for name, action in walks.items():
            walk = Walk(tree)
            with walk.traced():
                action()
            files, visits = len(set(walk.files)), len(walk.files)
            print(f"{name:8}{files:8}{visits:8}{visits - files:10}")


if __name__ == "__main__":
    main()
