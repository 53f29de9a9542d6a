"""Machine code of compiled kernels: linkage, generation on demand, storage.

This is the only module with private names of numba and llvmlite; a test lists them
(``test_private_names.py``) and says what each is for.

By default, a kernel contains private copies of the kernels that it calls. A kernel marked `linked`
exists only once: its callers contain a call of its address instead of a copy.

numba includes the code of a kernel in every kernel that calls it. LLVM optimizes each copy anew, so
copies may differ in their rounding. In numba's own linkage all copies share one symbol, and every
call reaches the copy that the process loaded first. This module makes the copies private, so a
kernel always calls its own copy.
"""

import copy
import hashlib
import importlib
from typing import Any
from weakref import WeakValueDictionary

import llvmlite.binding
from numba.core.codegen import JITCPUCodegen
from numba.core.targetconfig import TargetConfig

Kernel = tuple[str, str, Any]
"""Module, name and types of the arguments of a kernel"""

linked_kernels: set[Any] = set()
"""Linked kernels; a caller contains only a call of a linked kernel, not a copy of its code."""

_published: dict[str, Kernel] = {}  # linked kernels compiled or loaded by this process, by symbol
_symbols: dict[tuple[Any, Any], str] = {}  # their symbols, by kernel and types of the arguments
_environments: WeakValueDictionary[str, Any] = WeakValueDictionary()  # by the name of the variable


class _Environments:
    """Receives the environment of a kernel, which may not have machine code yet."""

    def __init__(self, library: Any) -> None:
        self._library = library

    def set_env(self, name: str, environment: Any) -> None:
        """Store the environment, and set its address in existing machine code."""
        _environments[name] = environment
        if self._library.generated:
            self._library.set_environment(name)


class _Library(JITCPUCodegen._library_class):
    """The code of a kernel, in which the copies of its callees are private.

    Its code is optimized, and its machine code generated, when its address is requested: the
    kernels that call a kernel contain its LLVM code, so its own machine code is executed only if
    Python calls it or if it is linked.
    """

    complete = False  # whether the callees are linked
    generated = False

    @property
    def codegen(self) -> Any:
        """Receiver of the environments; numba uses nothing else of this object."""
        return _Environments(self)

    def set_environment(self, name: str) -> None:
        """Set the address of an environment in the machine code."""
        super().codegen.set_env(name, _environments[name])

    def add_llvm_module(self, ll_module: Any) -> None:
        """Add LLVM code to this library."""
        self._final_module.link_in(ll_module)

    def finalize(self) -> None:
        """Link the callees."""
        if not self.complete:
            super().finalize()

    def _optimize_final_module(self) -> None:
        """Leave the code as it is."""

    def _finalize_final_module(self) -> None:
        self.complete = True
        if not any(self._final_module.functions):  # loaded together with its machine code
            self._generate()

    def _generate(self) -> None:
        super()._finalize_final_module()
        self.generated = True
        for variable in self._final_module.global_variables:
            if variable.name in _environments:
                self.set_environment(variable.name)

    def get_pointer_to_function(self, name: str) -> Any:
        """Return the address of a function; 0 if this library does not define it."""
        self.finalize()
        if not self.generated and name in (one.name for one in self.get_defined_functions()):
            for function in self._final_module.functions:
                if function.linkage.name == "linkonce_odr":
                    function.linkage = "internal"
            super()._optimize_final_module()
            self._generate()
        return super().get_pointer_to_function(name)

    def serialize_using_object_code(self) -> Any:
        """Return what is stored of this library."""
        if self.generated:
            return super().serialize_using_object_code()
        return self.serialize_using_bitcode()

    def portable(self) -> bool:
        """Return whether the code contains no addresses of this process."""
        variables = (one.name for one in self._final_module.global_variables)
        return not any(name.startswith("numba.dynamic.globals") for name in variables)

    def linked_callees(self) -> list[Kernel]:
        """Return the linked kernels that the code calls."""
        names = (function.name for function in self._final_module.functions)
        return [_published[name] for name in names if name in _published]


def linked(dispatcher: Any) -> Any:
    """Mark a kernel as linked, so that its callers do not contain a copy of its code.

    Use this decorator for the top function of a large call tree, and write it above `kernel` or
    `lean`. Callers then take less time to compile and to load, and their results do not change. A
    call of a linked kernel takes slightly longer than a call of an ordinary kernel.
    """
    linked_kernels.add(dispatcher)
    del dispatcher.get_call_template  # compiled once, for all callers
    dispatcher.get_overload = lambda signature: _symbols[dispatcher, tuple(signature)]
    return dispatcher


def publish(kernel: Any, result: Any, digest: str) -> None:
    """Make the address of a linked kernel available to its callers; ignore all other kernels.

    Args:
        kernel: a kernel that was compiled, or loaded from the cache.
        result: result of its compilation for one set of types.
        digest: digest of its code.
    """
    if kernel not in linked_kernels:
        return
    types, function = result.signature.args, kernel.py_func
    version = hashlib.sha256(f"{digest} {types}".encode()).hexdigest()[:16]
    symbol = f"{function.__module__}.{function.__qualname__}-{version}"
    address = result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
    llvmlite.binding.add_symbol(symbol, address)
    external = copy.copy(result.fndesc)
    external.mangled_name = symbol
    result.target_context.insert_user_function(symbol, external)
    _published[symbol] = function.__module__, function.__qualname__, types
    _symbols[kernel, tuple(types)] = symbol


def reduced(result: Any, *, for_callers: bool) -> Any:
    """Return what is stored of the result of a compilation; None if it cannot be stored.

    Args:
        result: result of the compilation of a kernel.
        for_callers: whether other kernels include the code of this one. Otherwise only the names
            of its functions are stored beside the machine code, since parsing LLVM code takes long.
    """
    if result.lifted or not result.library.portable():
        return None
    (name, kind, data), names, *rest = result._reduce()
    if kind == "object" and not for_callers:
        defined = (names.llvm_func_name, names.llvm_cpython_wrapper_name)
        stubs = "".join(f'define void @"{one}"() {{ ret void }}\n' for one in defined)
        data = data[0], llvmlite.binding.parse_assembly(stubs).as_bitcode()
    callees = result.library.linked_callees()
    return type(result), callees, ((name, kind, data), names, *rest)


def rebuilt(target_context: Any, stored: Any) -> Any:
    """Return the result of a stored compilation, after its linked callees have been loaded."""
    kind, callees, parts = stored
    for module, name, types in callees:
        getattr(importlib.import_module(module), name).compile(types)
    return kind._rebuild(target_context, *parts)


def use_cache(dispatcher: Any, cache: Any) -> None:
    """Let a kernel load and store its compilations in a cache of this project."""
    dispatcher._cache = cache


def _option_values(options: Any) -> dict[str, Any]:
    """Return the options of a compilation as numba's method does, without a property for each.

    numba looks at the options of each call that it compiles; this takes 11 % of the compilation.
    """
    return {name: options._values.get(name, one.default) for name, one in options.options.items()}


JITCPUCodegen._library_class = _Library
setattr(TargetConfig, "values", _option_values)  # noqa: B010
