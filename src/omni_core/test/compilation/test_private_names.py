"""Private names of other libraries are few, in one module, and still exist.

If a test fails after an update of numba, its message says what the name was for.
"""

from __future__ import annotations

import ast
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

import numba

from omni_core.compilation import code
from omni_core.kernels import njit

_SOURCES = Path(__file__).resolve().parents[4]
_PRIVATE_MODULES = re.compile(r"(numba\.(core|np)|llvmlite)\b")
_OURS = {"_generate", "_library"}  # in the module with the private names
_DOCUMENTED = {"_asdict", "_exit", "_fields", "_make", "_replace"}  # of Python
USED = {
    "llvmlite.binding": "gives linked kernels an address, and parses the stubs of stored kernels",
    "numba.core.codegen": "its JITCPUCodegen makes the libraries that contain the code of kernels",
    "numba.core.targetconfig": "its TargetConfig lists options, faster than by properties",
    "_values": "the options of a compilation that are set",
    "_library_class": "the class of new libraries, which ours replaces",
    "_final_module": "the LLVM code of a library",
    "_optimize_final_module": "optimizes LLVM code; ours does so when the address is requested",
    "_finalize_final_module": "generates machine code; ours does so when the address is requested",
    "_cache": "where a kernel looks for stored compilations",
    "_reduce": "the parts of a compilation that are stored",
    "_rebuild": "makes a compilation of its stored parts",
}
ELSEWHERE = {"parameters.py": {"_parameter_overrides"}}  # rclpy: the values given to a node


def _names(tree: ast.AST) -> set[str]:
    """Return the private modules that a module imports, and the private attributes it uses."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {one.name for one in node.names if _PRIVATE_MODULES.match(one.name)}
        elif isinstance(node, ast.ImportFrom) and _PRIVATE_MODULES.match(node.module or ""):
            found.add(str(node.module))
        elif isinstance(node, ast.Attribute) and re.match("_[^_]", node.attr):
            found.add(node.attr)
    return found


def _defined(tree: ast.AST) -> set[str]:
    """Return the private names that a module defines: functions, classes and variables."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            found |= {node.attr} if ast.unparse(node.value) == "self" else set()
    return found


def test_one_module_uses_few_private_names() -> None:
    trees = {
        path: ast.parse(path.read_text("utf-8"))
        for folder in ("src", "setup", "benchmarks")
        for path in (_SOURCES / folder).rglob("*.py")
        if "test" not in path.parts and not path.is_symlink()
    }
    assert _names(trees.pop(Path(code.__file__))) - _OURS == USED.keys()
    ours = _DOCUMENTED.union(*map(_defined, trees.values()))
    others = {path.name: names for path, tree in trees.items() if (names := _names(tree) - ours)}
    assert others == ELSEWHERE
    assert len(USED) + len(ELSEWHERE) <= 12


def square(x: float) -> float:
    return x * x


def _found() -> Iterator[str]:
    """Yield the private names that the installed numba has."""
    for module in USED:
        if "." in module and importlib.util.find_spec(module):
            yield module
    kernel = njit(square)
    kernel(2.0)
    (result,) = kernel.overloads.values()
    options = importlib.import_module("numba.core.targetconfig").TargetConfig()
    generator = importlib.import_module("numba.core.codegen").JITCPUCodegen
    for owner in (kernel, result, result.library, options, generator):
        yield from dir(owner)


def test_numba_still_has_the_private_names() -> None:
    found = set(_found())
    broken = {
        name: f"numba {numba.__version__} has no {name} any more: {purpose}. "
        f"Find what replaces it, and change {Path(code.__file__).name}."
        for name, purpose in USED.items()
        if name not in found
    }
    assert not broken, " ".join(broken.values())
