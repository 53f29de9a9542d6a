"""Duration of a chunk of a campaign; the only module of this folder that reads the clock."""

import time
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """Return the result of some work and its duration [s], which only sizes the next chunk."""
    begin = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begin
