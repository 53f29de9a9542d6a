"""Linkage of compiled kernels.

By default, a kernel contains private copies of the kernels that it calls. A kernel marked `linked`
exists only once: its callers contain a call of its address instead of a copy.

numba includes the code of a kernel in every kernel that calls it. LLVM optimizes each copy anew, so
copies may differ in their rounding. In numba's own linkage all copies share one symbol, and every
call reaches the copy that the process loaded first. This module makes the copies private, so a
kernel always calls its own copy.
"""

import functools
import hashlib
import importlib
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba.core import config
from numba.core.caching import (
    CompileResultCacheImpl,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
)
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher

_Kernel = tuple[str, str, Any]  # module, name, types of the arguments

linked_kernels: set[Dispatcher] = set()
"""Linked kernels; a caller contains only a call of a linked kernel, not a copy of its code."""

_EMPTY_MODULE = llvmlite.binding.parse_assembly("").as_bitcode()

_published: dict[str, _Kernel] = {}
"""The linked kernels that this process has compiled or loaded, by symbol."""


class KernelLibrary(JITCodeLibrary):
    """The code of a kernel, in which the copies of its callees are private.

    Its functions are not optimized before all callees are linked, because this took up to 40 % of
    the compilation time of a kernel and did not change its results.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _finalize_final_module(self) -> None:
        if self._shared_module is None:  # compiled, not loaded from the cache
            self._finalized = True
            shared, module = self._get_module_for_linking(), self._final_module
            if shared is not module:
                for function in module.functions:
                    if function.linkage == llvmlite.binding.Linkage.linkonce_odr:
                        function.linkage = "internal"
        super()._finalize_final_module()


def linked(dispatcher: Any) -> Any:
    """Mark a kernel as linked, so that its callers do not contain a copy of its code.

    Use this decorator for the top function of a large call tree, and write it above `kernel` or
    `lean`. Callers then take less time to compile and to load, and their results do not change. A
    call of a linked kernel takes slightly longer than a call of an ordinary kernel.
    """
    linked_kernels.add(dispatcher)
    del dispatcher.get_call_template, dispatcher.get_overload  # compiled once, for all callers
    return dispatcher


def publish(kernel: Dispatcher, result: CompileResult, digest: str) -> None:
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
    _published[symbol] = function.__module__, function.__qualname__, types
    result.library._get_module_for_linking = functools.cache(lambda: _call_of(result, symbol))


def _call_of(result: CompileResult, symbol: str) -> Any:
    """Return an LLVM module that only calls a linked kernel; the kernel's callers include it."""
    module, names = ir.Module(), result.fndesc
    convention = result.target_context.call_conv
    native = convention.get_function_type(names.restype, names.argtypes)
    pointer = ir.IntType(8).as_pointer()
    for_python = ir.FunctionType(pointer, [pointer] * 3)  # numba looks for its name in the module
    for kind, name in (
        (native, names.llvm_func_name),
        (for_python, names.llvm_cpython_wrapper_name),
    ):
        function = ir.Function(module, kind, name)
        function.linkage = "linkonce_odr"
        function.attributes.add("alwaysinline")
        builder = ir.IRBuilder(function.append_basic_block())
        if kind is native:
            builder.ret(builder.call(ir.Function(module, native, symbol), function.args))
        else:
            builder.unreachable()
    return llvmlite.binding.parse_assembly(str(module))


class _UnwritableLocator:
    """Folder of the cache, although this user cannot write in it."""

    @staticmethod
    def from_function(function: Any, file: str) -> Any:
        """Return the locator of numba for the folder, which numba rejects."""
        wanted = UserProvidedCacheLocator if config.CACHE_DIR else InTreeCacheLocator
        return wanted(function, file)


class CompiledKernel(CompileResultCacheImpl):
    """A compiled kernel on disk, with the list of the linked kernels that it calls."""

    _locator_classes = (*CompileResultCacheImpl._locator_classes, _UnwritableLocator)

    def reduce(self, result: CompileResult) -> tuple[list[_Kernel], Any]:
        """Return the data of a compiled kernel that are stored on disk."""
        names = (function.name for function in result.library._final_module.functions)
        return [_published[name] for name in names if name in _published], super().reduce(result)

    def rebuild(self, target_context: Any, payload: tuple[list[_Kernel], Any]) -> CompileResult:
        """Return a kernel from disk, after its linked callees have been loaded or compiled."""
        callees, reduced = payload
        for module, name, types in callees:
            getattr(importlib.import_module(module), name).compile(types)
        (symbol, kind, (code, bitcode)), names, *rest = reduced
        defined = (names.llvm_func_name, names.llvm_cpython_wrapper_name)
        target_context.codegen()._engine._defined_symbols.update(defined)
        library = symbol, kind, (code, _EMPTY_MODULE)
        result = super().rebuild(target_context, (library, names, *rest))
        # Only the compilation of a caller needs the bitcode, which takes long to parse.
        parse = functools.cache(lambda: llvmlite.binding.parse_bitcode(bitcode))
        result.library._get_module_for_linking = parse
        return result
