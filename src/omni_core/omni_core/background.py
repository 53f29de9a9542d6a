"""Single background thread for numba kernels that release Python's global interpreter lock (GIL).

Waiting for the GIL takes time. Background work should therefore be a single kernel that runs for a
few tenths of a millisecond, with little Python code around it. On a computer with two processors, a
kernel in the background and one in the main thread then run at the same time. On a computer with a
single processor, the main thread does the work when it needs the result.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

_T = TypeVar("_T")

ALONE = "OMNI_ONE_THREAD"
"""Name of an environment variable; if it is set and not empty, a process uses only one thread."""


@cache
def _thread() -> ThreadPoolExecutor | None:
    """Return the background thread; None if this process has no such thread."""
    if len(os.sched_getaffinity(0)) < 2 or os.environ.get(ALONE):
        return None
    return ThreadPoolExecutor(1, "background")


os.register_at_fork(after_in_child=_thread.cache_clear)  # a forked process does not have it


def in_background(work: Callable[[], _T], *, worth: bool = True) -> Callable[[], _T]:
    """Queue a function for the background thread; return a function that returns its result.

    The returned function must be called once. If the background thread has not started the work
    yet, the returned function does the work itself.

    Args:
        work: function to queue, usually a call of one long kernel.
        worth: whether to queue the function. Otherwise the returned function does the work, which
            is faster if the work takes less than a few tenths of a millisecond.
    """
    thread = _thread() if worth else None
    queued = None if thread is None else thread.submit(work)
    # `work` usually refers to an object that refers to the returned function. This cycle of
    # references would delay the release of the memory, so the function forgets the work.
    own = [work]

    def result() -> _T:
        work = own.pop()
        return work() if queued is None or queued.cancel() else queued.result()

    return result
