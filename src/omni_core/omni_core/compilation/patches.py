"""Changes to numba that activate the cache of kernels and shorten start and compilation."""

import functools
from importlib.metadata import entry_points
from typing import Any

from numba.core import entrypoints
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import nrtdynmod, rtsys
from numba.core.targetconfig import TargetConfig
from numba.extending import register_jitable
from numba.np import arrayobj, linalg

from omni_core.compilation.cache import KernelCache
from omni_core.compilation.machine_code import defer_machine_code


def patch_numba() -> None:
    """Apply all changes; called once, before the first kernel is declared."""
    setattr(Dispatcher, "enable_caching", _enable_caching)  # noqa: B010 - of `njit(cache=True)`
    _defer_blas()
    _defer_transforms()
    _defer_reference_counts()
    _shorten_errors()
    setattr(TargetConfig, "values", _option_values)  # noqa: B010
    defer_machine_code()


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
