"""Decorators that declare compiled kernels.

numba updates the reference count of an array whenever it passes or unpacks the array. A kernel that
receives the state of a vehicle or an assistant as a tuple of dozens of arrays would spend most of
its run time and of its compilation time on these counts. A `lean` kernel does not count references.
It must therefore neither create an array (a slice of an array is a new array) nor return one, not
even in a tuple; its caller provides all arrays. A kernel that creates arrays is declared as
`kernel` and should be short. The largest kernels are also declared as `linked`.

A kernel copies arrays element by element. With the first assignment of an array to a slice or a row
of another, a process would compile numba's text about unequal shapes, which takes 2 s.
"""

import contextlib
import functools
import importlib
import sys
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from omni_core.compilation.cache import KernelCache
from omni_core.compilation.code import linked, use_cache
from omni_core.compilation.references import by_reference

__all__ = ["by_reference", "declares", "inlined", "kernel", "lean", "lean_inline", "linked", "njit"]

_F = TypeVar("_F", bound=Callable[..., Any])


def njit(*functions: Any, cache: bool = False, for_callers: bool = True, **options: Any) -> Any:
    """Compile a function as numba's decorator does, with the cache of `compilation.cache`.

    Args:
        functions: the function; none to return a decorator.
        cache: whether compilations are stored.
        for_callers: whether other kernels include the code of this one.
        options: further options of numba.
    """

    def decorate(function: Any) -> Any:
        dispatcher = numba.njit(**options)(function)
        if cache:
            use_cache(dispatcher, KernelCache(dispatcher, for_callers=for_callers))
        return dispatcher

    return decorate(*functions) if functions else decorate


def _load_transforms() -> None:
    """Import `rocket_fft` without scipy.fft, which no kernel uses; that import takes 0.3 s.

    numba would import it with the first kernel, in each process.
    """
    hidden = sys.modules.setdefault("scipy.fft", None) is None  # type: ignore[arg-type]
    with contextlib.suppress(ImportError):
        importlib.import_module("rocket_fft")
    if hidden:
        del sys.modules["scipy.fft"]


_load_transforms()


def declares(
    *, cache: bool = True, error_model: str = "numpy", nrt: bool = True, **options: Any
) -> Callable[[_F], _F]:
    """Return a decorator that declares a kernel with further options of numba, such as `fastmath`.

    A call from Python requires an entry point that converts the arguments. Compiling the entry
    point takes a quarter of the compilation time. The decorator therefore makes two dispatchers of
    a function: one with the entry point, for Python, and one without it, for other kernels. A
    dispatcher compiles nothing until it is called.
    """
    options = {"error_model": error_model, "no_cfunc_wrapper": True, **options, "_nrt": nrt}
    declare = functools.partial(njit, cache=cache, nogil=True, **options)

    def decorate(function: _F) -> _F:
        entry = declare(for_callers=False)(function)
        callee = functools.cache(lambda: declare(no_cpython_wrapper=True)(function))
        # A constant argument has its ordinary type: a kernel is not compiled for each value.
        entry.get_call_template = lambda positional, named: callee().get_call_template(
            [*map(numba.types.unliteral, positional)], named
        )
        entry.get_overload = lambda signature: callee().get_overload(signature)
        return cast(_F, entry)

    return decorate


kernel = declares()
"""Declares a kernel that creates or returns arrays."""

lean = declares(nrt=False)
"""Declares a kernel that neither creates nor returns arrays and calls only kernels of this kind."""

lean_inline = declares(forceinline=True, nrt=False)
"""Declares a lean kernel that is inlined into its callers; for kernels with many arguments."""

inlined = declares(inline="always", nrt=False)
"""Declares a function that numba inlines into the kernels that call it."""
