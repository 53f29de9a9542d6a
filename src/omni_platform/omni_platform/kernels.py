"""Decorators that declare compiled kernels.

numba updates the reference count of an array whenever it passes or unpacks the array. A kernel that
receives the state of a vehicle or an assistant as a tuple of dozens of arrays would spend most of
its run time and of its compilation time on these counts. A `lean` kernel does not count references.
It must therefore neither create an array (a slice of an array is a new array) nor return one, not
even in a tuple; its caller provides all arrays. A kernel that creates arrays is declared as
`kernel` and should be short. The largest kernels are also declared as `linked`.
"""

import functools
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any, TypeVar, cast

import numba
from numba.core import entrypoints
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import nrtdynmod, rtsys
from numba.core.targetconfig import TargetConfig
from numba.extending import register_jitable
from numba.np import arrayobj, linalg

from omni_platform.compilation.cache import KernelCache
from omni_platform.compilation.calls import linked
from omni_platform.compilation.machine_code import defer_machine_code

__all__ = ["declares", "inlined", "kernel", "lean", "lean_inline", "linked", "njit"]

_F = TypeVar("_F", bound=Callable[..., Any])

njit = numba.njit
"""Decorator of numba; importing it from this module activates the cache of `compilation.cache`."""


def _enable_caching(dispatcher: Any) -> None:
    dispatcher._cache = KernelCache(dispatcher)


def _defer_blas() -> None:
    """Defer numba's search for a BLAS library until BLAS is first called.

    The search imports all of scipy.linalg, which takes 0.3 s in each process. It only checks that
    SciPy is installed, as it always is. Compiling a matrix product still loads SciPy.
    """
    look = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath  # noqa: F401  # searches while it is imported
    finally:
        linalg.ensure_blas = look


def _defer_transforms() -> None:
    """Prevent numba from importing `rocket_fft` with the first kernel; the import takes 0.1 s.

    Modules whose kernels call numpy.fft import `rocket_fft` themselves. Other extensions of numba
    are loaded as usual.
    """
    entrypoints._already_initialized = True
    for extension in entry_points(group="numba_extensions", name="init"):
        if extension.module != "rocket_fft":
            extension.load()()


def _defer_reference_counts() -> None:
    """Defer the compilation of numba's functions for reference counts until a kernel is compiled.

    Kernels from the cache already contain these functions. Their compilation would take 20 ms in
    each process.
    """
    compiled = nrtdynmod.compile_nrt_functions
    nrtdynmod.compile_nrt_functions = lambda context: functools.cache(lambda: compiled(context))
    setattr(type(rtsys), "library", property(lambda runtime: runtime._library()))  # noqa: B010


def _shorten_errors() -> None:
    """Omit the shapes in the error about an array that is assigned to a slice of another shape.

    Otherwise every kernel with such an assignment, and every caller of the kernel, contains the
    code that formats the shapes, which takes 0.3 s to compile.
    """
    setattr(arrayobj, "raise_with_shape_context", register_jitable(_refuse_shape))  # noqa: B010


def _refuse_shape(_: Any, __: Any) -> None:
    raise ValueError("cannot assign an array to a slice of another shape")


def _option_values(options: Any) -> dict[str, Any]:
    """Return the options of a compilation as numba's method does, without a property for each.

    numba looks at the options of each call that it compiles, which takes 5 % of its time.
    """
    return {name: options._values.get(name, one.default) for name, one in options.options.items()}


setattr(Dispatcher, "enable_caching", _enable_caching)  # noqa: B010 - of `njit(cache=True)`
_defer_blas()
_defer_transforms()
_defer_reference_counts()
_shorten_errors()
setattr(TargetConfig, "values", _option_values)  # noqa: B010
defer_machine_code()


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
        entry = declare()(function)
        callee = functools.cache(lambda: declare(no_cpython_wrapper=True)(function))
        entry.get_call_template = lambda *arguments: callee().get_call_template(*arguments)
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
