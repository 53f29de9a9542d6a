"""Linkage of compiled kernels: a kernel calls linked kernels and does not include their code.

numba includes the code of a kernel in every kernel that calls it, and LLVM optimizes it again with
each level of the call tree. The callers of a `linked` kernel contain only a call of its address.

numba gives every kernel a second entry for Python, which converts all arguments. Here a kernel that
only other kernels have called has no such entry. It is compiled again, with the entry, when Python
calls it.
"""

import hashlib
import importlib
import threading
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba.core.caching import CompileResultCacheImpl
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext
from numba.core.dispatcher import Dispatcher
from numba.core.sigutils import normalize_signature

_Kernel = tuple[str, str, Any]  # module, name, types of the arguments

linked_kernels: set[Dispatcher] = set()
"""Kernels of which callers contain only a call."""

_published: dict[str, _Kernel] = {}
"""The linked kernels that this process has compiled or loaded, by symbol."""


def linked(dispatcher: Any) -> Any:
    """Mark a kernel whose callers only call it and do not include its code.

    The decorator is for the top of a large call tree and is written above `kernel` or `lean`.
    Callers take less time to compile and to load, and their results have the same bits. A call
    takes about 0.1 us more.
    """
    linked_kernels.add(dispatcher)
    return dispatcher


def publish(kernel: Dispatcher, result: CompileResult, digest: str) -> None:
    """Make a compiled or loaded kernel known to its callers, if it is linked.

    Args:
        kernel: the kernel.
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
    result.library._shared_module = _call_of(result, symbol)


def _call_of(result: CompileResult, symbol: str) -> Any:
    """Return the module that callers of a linked kernel include: a call to its symbol."""
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


class CompiledKernel(CompileResultCacheImpl):
    """A compiled kernel on disk, with the linked kernels that it calls."""

    def reduce(self, result: CompileResult) -> tuple[list[_Kernel], Any]:
        """Return the data of a compiled kernel that are stored on disk."""
        names = (function.name for function in result.library._final_module.functions)
        return [_published[name] for name in names if name in _published], super().reduce(result)

    def rebuild(self, target_context: Any, payload: tuple[list[_Kernel], Any]) -> CompileResult:
        """Load a kernel after the kernels that it calls, which it needs for loading."""
        callees, reduced = payload
        for module, name, types in callees:
            getattr(importlib.import_module(module), name).compile(types)
        return super().rebuild(target_context, reduced)


class _Compilation(threading.local):
    """The compilation under way in a thread."""

    for_kernel = False  # whether another kernel, which is being compiled, needs this kernel
    bare = False  # whether the kernel gets no entry for Python


compilation = _Compilation()


def _is_bare(result: CompileResult) -> bool:
    engine = result.library.codegen._engine
    return not engine.is_symbol_defined(result.fndesc.llvm_cpython_wrapper_name)


def omit_entries_for_python() -> None:
    """Let numba compile a kernel without an entry for Python when another kernel calls it."""
    get_call_template, compile_types = Dispatcher.get_call_template, Dispatcher.compile
    add_overload, create_entry = Dispatcher.add_overload, CPUContext.create_cpython_wrapper

    def get_template(self: Dispatcher, *arguments: Any) -> Any:
        compilation.for_kernel = True
        try:
            return get_call_template(self, *arguments)
        finally:
            compilation.for_kernel = False

    def compile_kernel(self: Dispatcher, signature: Any) -> Any:
        with global_compiler_lock:
            before = compilation.bare
            compilation.bare = compilation.for_kernel and self not in linked_kernels
            compilation.for_kernel = False
            types = tuple(normalize_signature(signature)[0])
            known = self.overloads.get(types)
            if known is not None and _is_bare(known) and not compilation.bare:
                del self.overloads[types]
            try:
                return compile_types(self, signature)
            finally:
                compilation.bare = before

    def add(self: Dispatcher, result: CompileResult) -> None:
        if _is_bare(result):
            self.overloads[tuple(result.signature.args)] = result
        else:
            add_overload(self, result)

    def create(self: CPUContext, *arguments: Any, **options: Any) -> None:
        if not compilation.bare:
            create_entry(self, *arguments, **options)

    setattr(Dispatcher, "get_call_template", get_template)  # noqa: B010 - methods of numba's
    setattr(Dispatcher, "compile", compile_kernel)  # noqa: B010
    setattr(Dispatcher, "add_overload", add)  # noqa: B010
    setattr(CPUContext, "create_cpython_wrapper", create)  # noqa: B010
