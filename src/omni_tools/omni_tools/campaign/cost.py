"""Duration of a chunk of a campaign; only this module of the package reads a clock."""

import time
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """Return the result and the duration [s] of `work`; durations only affect later chunk sizes."""
    begin = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begin
