"""A kernel is compiled again only if its code or a value used in it has changed."""

from __future__ import annotations

import fcntl
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from omni_core.compilation import code
from omni_core.compilation.cache import kernel_digest
from omni_core.kernels import kernel, linked, njit

KERNEL = '''
"""Kernels over two files."""
from typing import NamedTuple
import moved, shared
from omni_core.kernels import kernel
from shared import Gains, tuned

class Own(NamedTuple):
    value: float

@kernel
def outer(x):
    """Return a number."""
    return shared.times(x) + tuned(x) + Gains(x, 3.0).offset + shared.LIMITS[1]

@kernel
def unrelated(x):
    return x - 1.0

@kernel
def of_tuple(pair):
    return pair.value
'''
SHARED = """
from typing import NamedTuple
from numba.extending import overload
from omni_core.kernels import kernel, linked

LIMITS = (1.0, 2.0)

class Gains(NamedTuple):
    gain: float
    offset: float

@linked
@kernel
def times(x):
    return 2.0 * x

def tuned(x):
    pass

@overload(tuned)
def _tuned(x):
    return lambda x: 100.0 * x
"""
MOVED = """
from typing import NamedTuple

class Pair(NamedTuple):
    value: float
"""
CALL = """
import kernel
pair = getattr(kernel.moved, "Pair", kernel.Own)
print(kernel.outer(1.0), kernel.unrelated(1.0), kernel.of_tuple(pair(5.0)))
for compiled in (kernel.outer, kernel.unrelated, kernel.of_tuple):
    print(*(["cached"] if compiled.stats.cache_hits else ["compiled"]))
"""


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with modules whose kernels have been compiled."""
    folder = tmp_path_factory.mktemp("modules")
    for name, text in (("kernel", KERNEL), ("shared", SHARED), ("moved", MOVED)):
        (folder / f"{name}.py").write_text(text)
    assert call(folder) == ["107.0 0.0 5.0", "compiled", "compiled", "compiled"]
    return folder


@pytest.fixture
def folder(first: Path) -> Iterator[Path]:
    """Return a copy of the folder with modules and cache in their first state."""
    contents = {path: path.read_bytes() for path in first.rglob("*.*")}
    yield first
    for path in set(first.rglob("*.*")) - set(contents):
        path.unlink()
    for path, content in contents.items():
        path.write_bytes(content)


# numba writes a temporary file to find out whether it can use a folder; root can write everywhere.
UNWRITABLE = """
import tempfile

def refuse(**_):
    raise PermissionError

tempfile.TemporaryFile = refuse
"""


def call(folder: Path, program: str = CALL, cache: Path | None = None) -> list[str]:
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(cache or folder / "cache"),
        "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    environment.pop("PYTHONHASHSEED", None)  # a digest must not depend on it
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    ("name", "old", "new", "result"),
    [
        ("shared", "2.0 * x", "4.0 * x", "109.0"),
        ("shared", "(1.0, 2.0)", "(1.0, 4.0)", "109.0"),
        ("shared", "gain: float\n    offset", "offset: float\n    gain", "105.0"),
        ("shared", "100.0 * x", "102.0 * x", "109.0"),
        ("kernel", "tuned(x) +", "tuned(x) + 2.0 +", "109.0"),
    ],
    ids=["callee", "constant", "fields", "overload", "kernel"],
)
def test_an_edit_reaches_the_kernels_that_use_it(
    folder: Path, name: str, old: str, new: str, result: str
) -> None:
    path = folder / f"{name}.py"
    path.write_text(path.read_text().replace(old, new))
    assert call(folder) == [f"{result} 0.0 5.0", "compiled", "cached", "cached"]


def test_kernels_are_kept_otherwise(folder: Path) -> None:
    path = folder / "kernel.py"
    text = path.read_text().replace('"""Kernels', 'import os\n\nUNUSED = 1\n"""Kernels')
    path.write_text(
        text.replace("Return a number", "Return a\n\n    pupil's number").replace("x - 1", "x - 2")
    )
    # A new line number, docstring or neighbor does not affect `outer`.
    assert call(folder) == ["107.0 -1.0 5.0", "cached", "compiled", "cached"]


def test_a_kernel_called_with_a_class_that_is_gone(folder: Path) -> None:
    (folder / "moved.py").write_text("")
    assert call(folder) == ["107.0 0.0 5.0", "cached", "cached", "compiled"]


def test_kernels_that_another_user_has_stored_are_used(folder: Path) -> None:
    assert call(folder, UNWRITABLE + CALL) == ["107.0 0.0 5.0", "cached", "cached", "cached"]


def test_kernels_that_cannot_be_stored_are_compiled(folder: Path) -> None:
    called = call(folder, UNWRITABLE + CALL, Path(os.devnull))
    assert called == ["107.0 0.0 5.0", "compiled", "compiled", "compiled"]


def test_of_two_processes_one_compiles_a_kernel(folder: Path) -> None:
    path = folder / "shared.py"
    path.write_text(path.read_text().replace("2.0 * x", "8.0 * x"))
    with ThreadPoolExecutor() as pool:
        results = list(pool.map(call, (folder, folder)))
    assert sorted(results) == [
        ["113.0 0.0 5.0", "cached", "cached", "cached"],
        ["113.0 0.0 5.0", "compiled", "cached", "cached"],
    ]


def test_a_process_that_never_stores_its_kernel_stops_no_other(folder: Path) -> None:
    """It was halted, or its compilation failed."""
    path = folder / "kernel.py"
    path.write_text(path.read_text().replace("x - 1.0", "x - 2.0"))
    program = "from omni_core.compilation import cache; cache._LONGEST_WAIT = 0.1" + CALL
    with (folder / "cache" / "lock").open("ab") as lock:
        fcntl.lockf(lock, fcntl.LOCK_EX)
        assert call(folder, program) == ["107.0 -1.0 5.0", "cached", "compiled", "cached"]


FORKS = """
import os
import kernel

kernel.unrelated(1.0)  # opens the file of the locks
for _ in range(2):
    if os.fork() == 0:
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))  # as the server of nodes does
        kernel.outer(1.0)
        print(*(["cached"] if kernel.outer.stats.cache_hits else ["compiled"]))
        break
else:
    os.wait()
    os.wait()
"""


def test_of_two_forks_one_compiles_a_kernel(folder: Path) -> None:
    for name, old, new in (("shared", "2.0 * x", "9.0 * x"), ("kernel", "x - 1.0", "x - 3.0")):
        path = folder / f"{name}.py"
        path.write_text(path.read_text().replace(old, new))
    assert sorted(call(folder, FORKS)) == ["cached", "compiled"]


def test_a_process_that_compiles_many_kernels_counts_them(folder: Path) -> None:
    program = (
        "import sys; from omni_core.compilation import cache; cache._BETWEEN_LINES = 2\n"
        "sys.stderr = sys.stdout" + CALL
    )
    counted = call(folder, program, folder / "empty")
    assert counted == [
        "kernels compiled for this computer: 2",
        "kernels compiled for this computer: 4",
        "107.0 0.0 5.0",
        *["compiled"] * 3,
    ]


@linked
@kernel
def _root(x: float) -> float:
    return math.sqrt(x)


def test_a_caller_of_a_linked_kernel_does_not_contain_its_code() -> None:
    caller = njit(lambda x: _root(x) + 1.0)
    assert caller(4.0) == 3.0
    (code,) = caller.inspect_llvm().values()
    assert "_root-" in code
    assert "sqrt" not in code


@kernel
def _series(x: float) -> float:
    total = 0.0
    for k in range(1, 9):
        total += math.sin(k * x) + math.exp(-k * x) * math.cos(x / k) + math.atan2(x, k)
        total += math.tan(total) + math.log(k + total**2) + math.sinh(x) + math.acos(x / 9.0)
    return total


def test_a_kernel_calls_its_own_copy_of_a_callee() -> None:
    # Copies differ in their rounding; a public copy would serve the callers that are loaded later.
    caller = njit(lambda x: _series(x) + _series(2.0 * x))
    assert math.isfinite(caller(0.5))
    (compiled,) = caller.overloads.values()
    defined = list(compiled.library.get_defined_functions())
    copies = [function.linkage.name for function in defined if "_series" in function.name]
    assert copies == ["internal"]
    assert not [function.name for function in defined if "linkonce" in function.linkage.name]


_DIFFERENCE = """
from {imported}
from typing import NamedTuple

class Pair(NamedTuple):
    {first}: float
    {second}: float

class Given(NamedTuple):
    pair: Pair

def difference(given: Given) -> float:
    return given.pair.a - given.pair.b
"""


@pytest.mark.parametrize("imported", ["typing import Any", "__future__ import annotations"])
def test_a_kernel_is_compiled_again_if_the_fields_of_its_argument_move(
    imported: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    digests = []
    for first, second in ("ab", "ab", "ba"):
        module = ModuleType("difference")
        monkeypatch.setitem(sys.modules, module.__name__, module)
        exec(_DIFFERENCE.format(imported=imported, first=first, second=second), vars(module))
        digests.append(kernel_digest(njit(module.difference)))
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


@kernel
def _square(x: float) -> float:
    return x * x


def test_a_kernel_gets_machine_code_only_when_python_calls_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    generated: list[str] = []
    generate = code._Library._generate

    def counted(library: Any) -> None:
        generated.append(library.name)
        generate(library)

    monkeypatch.setattr(code._Library, "_generate", counted)
    caller = njit(lambda x: _square(x) + 1.0)
    overloads = getattr(_square, "overloads")  # noqa: B009
    assert caller(3.0) == 10.0
    assert not overloads
    assert generated
    assert not [name for name in generated if "_square" in name]
    assert _square(3.0) == 9.0
    assert [name for name in generated if "_square" in name]
    assert len(overloads) == 1
    assert "'_square'" in repr(getattr(_square, "_cache"))  # noqa: B009
