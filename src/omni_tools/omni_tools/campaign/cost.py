"""What a piece of a campaign costs: the one place of this folder that reads the clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """Return what some work gives, and how long it took [s]; it only sizes the next piece."""
    begin = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begin
