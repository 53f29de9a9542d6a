"""Changes to numba that activate the cache of kernels and shorten their compilation."""

from typing import Any

from numba.core.dispatcher import Dispatcher
from numba.core.targetconfig import TargetConfig

from omni_core.compilation.cache import KernelCache
from omni_core.compilation.machine_code import defer_machine_code


def patch_numba() -> None:
    """Apply all changes; called once, before the first kernel is declared."""
    setattr(Dispatcher, "enable_caching", _enable_caching)  # noqa: B010 - of `njit(cache=True)`
    setattr(TargetConfig, "values", _option_values)  # noqa: B010
    defer_machine_code()


def _enable_caching(dispatcher: Any) -> None:
    dispatcher._cache = KernelCache(dispatcher)


def _option_values(options: Any) -> dict[str, Any]:
    """Return the options of a compilation as numba's method does, without a property for each.

    numba looks at the options of each call that it compiles, which takes 5 % of its time.
    """
    return {name: options._values.get(name, one.default) for name, one in options.options.items()}
