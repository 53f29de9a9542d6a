"""How compiled kernels are declared.

numba counts the references to every array whenever it passes or unpacks it. Kernels that get all
state of a vehicle or an assistant as one tuple of dozens of arrays spent two thirds of their time
on that, and as much of their compilation. A `lean` kernel does not count. It may therefore neither
make an array (slices assigned from other arrays make one) nor return one, also not within a tuple;
what it works on comes from its caller. One that does is a `kernel`, and short.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

import numba
from numba.core import entrypoints
from numba.core.dispatcher import Dispatcher
from numba.np import linalg

from omni_platform.kernel_cache import KernelCache

njit = numba.njit
"""numba's own; modules take it from here, so that their caches follow the content."""


def _enable_caching(dispatcher: Any) -> None:
    dispatcher._cache = KernelCache(dispatcher)


def _defer_blas() -> None:
    """Let numba look for a BLAS when a kernel calls it, not when the first kernel is loaded.

    It looks by importing all of scipy.linalg, 0.3 s in each process. SciPy is there, so the answer
    is known, and compiling a product of matrices still loads it.
    """
    look = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath  # noqa: F401  # asks while it is imported
    finally:
        linalg.ensure_blas = look


def _defer_transforms() -> None:
    """Keep numba from loading scipy.fft with its first kernel, 0.2 s in each process.

    Whose kernels call it imports `rocket_fft`. Other extensions of numba are loaded as ever.
    """
    entrypoints._already_initialized = True
    for extension in entry_points(group="numba_extensions", name="init"):
        if extension.module != "rocket_fft":
            extension.load()()


setattr(Dispatcher, "enable_caching", _enable_caching)  # noqa: B010 - of `njit(cache=True)`
_defer_blas()
_defer_transforms()

kernel = njit(cache=True, nogil=True, error_model="numpy", _nrt=True)
"""Declares a kernel that makes or returns arrays."""

lean = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
"""Declares a kernel whose arrays are all its caller's; what it calls, too, says which it is."""

lean_inline = njit(cache=True, nogil=True, error_model="numpy", forceinline=True, _nrt=False)
"""As `lean`, for what few places call with so many arguments that handing them on is dear."""
