"""A cache of compiled kernels that detects every change of the code of a kernel.

numba's own cache depends only on the source file of a kernel. It therefore does not detect changes
of functions and constants in other files, and compiles again after a comment has been edited. In
this cache, the name of a file contains a digest of the kernel's bytecode and options, and of all
functions, constants and tuple classes to which the kernel refers, directly or indirectly. The cache
may contain several versions of a kernel.

Processes share the cache: the first process that needs a kernel compiles it, and other processes
that need the same kernel wait for it, but not for ever: it may have been halted, or the compilation
may have failed. numba itself has no such lock: without it, two processes that store the same kernel
at the same time could damage its index file.

If the user cannot write to any folder of the cache, stored kernels are used, and other kernels are
compiled in each process.
"""

import contextlib
import dataclasses
import enum
import fcntl
import functools
import hashlib
import itertools
import os
import pickle
import re
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import IO, Any, ForwardRef, get_type_hints

import numba
import numpy as np
from numba.extending import is_jitted

from omni_core.compilation import code, references
from omni_core.files import replaced, user_folder

_LIBRARIES = sys.stdlib_module_names | {"llvmlite", "numba", "numpy", "rocket_fft", "scipy"}
_PLAIN = {bool, bytes, float, int, str, type(None)}
_DEPTH = 3  # levels of modules in modules, as in numpy.linalg
# Stored kernels depend on the names and the code of these modules.
_LINKAGE = hashlib.sha256(
    b"".join(
        one.__name__.encode() + Path(str(one.__file__)).read_bytes() for one in (code, references)
    )
).hexdigest()
_LONGEST_WAIT = 120.0  # [s] for another process; all kernels together take 90 s of CPU time
_KEPT_VERSIONS = 3  # versions of a kernel on disk, so that another branch need not be compiled
_BETWEEN_LINES = 10  # kernels from one line of progress to the next

_compiled = itertools.count(1)

_stored_only = False


class NotStoredError(Exception):
    """A kernel would have to be compiled."""


@contextlib.contextmanager
def stored_only() -> Iterator[None]:
    """Raise `NotStoredError` in the ``with`` block instead of compiling a kernel."""
    global _stored_only  # noqa: PLW0603
    _stored_only = True
    try:
        yield
    finally:
        _stored_only = False


class KernelCache:
    """Stored compilations of a kernel, as numba's dispatcher uses them."""

    def __init__(self, dispatcher: Any, *, for_callers: bool = True) -> None:
        """Create the cache of a kernel, without a search for its folder and callees.

        Args:
            dispatcher: the kernel.
            for_callers: whether other kernels include the code of this one.
        """
        self.dispatcher, self._for_callers = dispatcher, for_callers

    def __repr__(self) -> str:
        return f"KernelCache({self.dispatcher.py_func.__qualname__!r})"

    @functools.cached_property
    def cache_path(self) -> str:
        """Folder of the stored kernels, which may not be writable."""
        module = Path(self.dispatcher.py_func.__code__.co_filename)
        return os.environ.get("NUMBA_CACHE_DIR") or _folder_of(module.parent)

    @functools.cached_property
    def _digest(self) -> str:
        return kernel_digest(self.dispatcher)[:16]

    @functools.cached_property
    def _prefix(self) -> str:
        function = self.dispatcher.py_func
        return re.sub("[<>]", "", f"{function.__module__}.{function.__qualname__}") + "-"

    def file(self, signature: Any) -> Path:
        """Return the file of a compilation for the types of a signature and this processor."""
        processor = self.dispatcher.targetctx.codegen().magic_tuple()
        target = f"{signature} {processor} {numba.__version__} {sys.version_info[:2]}"
        version = f"{self._digest}.{hashlib.sha256(target.encode()).hexdigest()[:16]}"
        return Path(self.cache_path, f"{self._prefix}{version}.nbc")

    def _lock(self) -> None:
        """Lock the kernel against other processes, or compile it as well after `_LONGEST_WAIT`.

        A caller is locked before its callees, so two processes never wait for each other. When a
        process ends, its locks are released.
        """
        deadline = time.monotonic() + _LONGEST_WAIT
        while not self._change_lock(fcntl.LOCK_EX | fcntl.LOCK_NB) and time.monotonic() < deadline:
            time.sleep(0.02)

    def _change_lock(self, operation: int) -> bool:
        """Lock or unlock the kernel; return False if another process has locked it.

        Args:
            operation: `fcntl.LOCK_EX` with `fcntl.LOCK_NB`, or `fcntl.LOCK_UN`.
        """
        try:
            Path(self.cache_path).mkdir(parents=True, exist_ok=True)
            fcntl.lockf(_lock_file(self.cache_path), operation, 1, int(self._digest[:15], 16))
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks, a folder of another user
            pass
        return True

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the stored kernel for a signature; None if there is none."""
        target_context.refresh()
        result = self._stored(sig, target_context)
        if result is None:
            if _stored_only:
                raise NotStoredError(self.dispatcher.py_func.__qualname__)
            self._lock()
            result = self._stored(sig, target_context)  # stored meanwhile by another process
            if result is not None:
                self._change_lock(fcntl.LOCK_UN)
        return result

    def _stored(self, sig: Any, target_context: Any) -> Any:
        try:
            stored = pickle.loads(self.file(sig).read_bytes())
            result = code.rebuilt(target_context, stored)
        except OSError:  # there is no such file, or it cannot be read
            return None
        except (ImportError, AttributeError):  # compiled for a class that has been moved or renamed
            return None
        except (EOFError, pickle.UnpicklingError):  # damaged by a power failure
            return None
        code.publish(self.dispatcher, result, self._digest)
        return result

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compilation of a kernel for a signature, and delete old versions."""
        code.publish(self.dispatcher, data, self._digest)
        stored = code.reduced(data, for_callers=self._for_callers)
        with contextlib.suppress(OSError):  # of another user, or a full disk
            if stored is not None:
                with replaced(self.file(sig)) as file:
                    file.write_bytes(pickle.dumps(stored))
        self._change_lock(fcntl.LOCK_UN)
        if (number := next(_compiled)) % _BETWEEN_LINES == 0:
            print(f"kernels compiled for this computer: {number}", file=sys.stderr, flush=True)
        with contextlib.suppress(OSError):  # another process deletes them, too
            files = sorted(Path(self.cache_path).glob(f"{self._prefix}*"), key=os.path.getmtime)
            versions = [file.name.split(".")[-3] for file in files]
            kept = list(dict.fromkeys(reversed(versions)))[:_KEPT_VERSIONS]
            for file, version in zip(files, versions, strict=True):
                if version not in kept:
                    file.unlink()


@functools.cache
def _folder_of(package: Path) -> str:
    """Return the folder for the kernels of a package, in which this user can write."""
    wanted = package / "__pycache__", "~/.cache/omni_sim/kernels"
    return str(user_folder("omni_kernels", *wanted))


@functools.cache
def _lock_file(folder: str) -> IO[bytes]:
    return Path(folder, "lock").open("ab")


# A node that is forked from the server of nodes reuses the descriptors of the files of the server.
os.register_at_fork(after_in_child=_lock_file.cache_clear)


def kernel_digest(dispatcher: Any) -> str:
    """Return a digest of the code and constants that a kernel uses, directly or indirectly.

    The digest does not depend on the types of the kernel's arguments.
    """
    reached: dict[FunctionType, str] = {}
    pending: list[FunctionType] = []
    root = _LINKAGE + _describe(dispatcher, pending)
    while pending:
        function = pending.pop()
        if function not in reached:
            reached[function], callees = _describe_function(function)
            pending += callees
    return hashlib.sha256("\n".join([root, *sorted(reached.values())]).encode()).hexdigest()


@functools.cache
def _describe_function(function: FunctionType) -> tuple[str, list[FunctionType]]:
    """Return a description of a function, and the functions that it refers to."""
    callees: list[FunctionType] = []
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    names = sorted(set(_names(function.__code__)))
    parts = [_describe(value, callees) for value in (function.__defaults__, cells)]
    parts += _describe_names(names, function.__globals__, callees)
    # numba reads the fields of a named tuple by their positions.
    parts += map(_describe_fields, _annotations(function))
    code = function.__code__
    constants = (one for one in code.co_consts if one is None or one != function.__doc__)
    described = _describe(code.replace(co_consts=tuple(constants)), callees)
    return f"{function.__module__}.{function.__qualname__} {described} {parts}", callees


def _describe_names(
    names: list[str], values: dict[str, Any], callees: list[FunctionType], depth: int = 0
) -> Iterator[str]:
    """Yield a description of each value that a function finds by name in a module.

    Args:
        names: names in the code of the function.
        values: contents of the module, keyed by name.
        callees: output, the functions among these values are appended.
        depth: number of modules through which `values` was reached.
    """
    for name in names:
        value = values.get(name)
        if isinstance(value, ModuleType) and depth < _DEPTH:  # the code may use its attributes
            yield from _describe_names(names, vars(value), callees, depth + 1)
        elif name in values:
            yield f"{name}={_describe(value, callees)}"


@functools.cache
def _describe_fields(value: Any) -> str:
    """Return the field names of a named tuple, and of named tuples in its fields, as one text.

    The text is empty for any other type.
    """
    if not hasattr(value, "_fields"):
        return ""
    nested = map(_describe_fields, _annotations(value))
    return f"{value.__qualname__} {value._fields} {[*nested]}"


def _annotations(value: Any) -> Iterable[Any]:
    """Return the types with which a function or class is annotated; strings are evaluated."""
    found = value.__annotations__
    in_text = any(isinstance(kind, (str, ForwardRef)) for kind in found.values())
    return (get_type_hints(value) if in_text else found).values()


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _describe(value: Any, callees: list[FunctionType]) -> str:  # noqa: PLR0911
    """Return a text that identifies a value, and append the functions in the value to `callees`."""
    if type(value) in _PLAIN:  # most constants
        return repr(value)
    if is_jitted(value):
        callees.append(value.py_func)
        options = _describe(value.targetoptions, callees)
        return f"{value.py_func.__qualname__} {options} {value in code.linked_kernels}"
    if isinstance(value, FunctionType):
        module = value.__module__
        if module.partition(".")[0] not in _LIBRARIES:
            # numba compiles an overload in place of this function; it is in the same module.
            others = vars(sys.modules[module]).values()
            functions = [other for other in others if isinstance(other, FunctionType)]
            callees += [value, *(f for f in functions if f.__module__ == module)]
        return f"{module}.{value.__qualname__}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, CodeType):
        constants = [_describe(constant, callees) for constant in value.co_consts]
        return f"{value.co_code.hex()} {value.co_names} {value.co_varnames} {constants}"
    if isinstance(value, type):
        content = list(value) if issubclass(value, enum.Enum) else getattr(value, "_fields", "")
        return f"{value.__module__}.{value.__qualname__} {content}"
    if dataclasses.is_dataclass(value):
        value = vars(value)
    if isinstance(value, dict):
        value = tuple(value.items())
    if isinstance(value, (tuple, list)):
        return f"{type(value).__qualname__} {[_describe(item, callees) for item in value]}"
    if isinstance(value, (set, frozenset)):
        return repr(sorted(map(repr, value)))
    return re.sub(" at 0x[0-9a-f]+", "", repr(value))
