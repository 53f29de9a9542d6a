"""Single background thread for numba kernels that release Python's global interpreter lock (GIL).

Waiting for the GIL takes time. Background work should therefore be a single kernel that runs for a
few tenths of a millisecond, with little Python code around it. On a computer with two processors, a
kernel in the background and one in the main thread then run at the same time. On a computer with a
single processor, the main thread does the work when it needs the result.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import cache
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

_T = TypeVar("_T")

ALONE = "OMNI_ONE_THREAD"
"""Name of an environment variable; if it is set and not empty, a process uses only one thread."""


class _Work(Generic[_T]):
    """A task that is executed once, by the first thread that is free.

    The task deletes its reference to the function when the function starts. The function usually
    refers to an object that refers to this task. Without the deletion, this cycle of references
    would delay the release of the memory.
    """

    def __init__(self, work: Callable[[], _T], queue: SimpleQueue[_Work[Any]] | None) -> None:
        self._work: Callable[[], _T] | None = work
        self._queue = queue
        self._begun, self._under_way = threading.Lock(), threading.Lock()
        self._under_way.acquire()
        self._error: BaseException | None = None

    def do(self) -> None:
        """Do the work, unless another thread has already started it."""
        if not self._begun.acquire(blocking=False):
            return
        work, self._work = self._work, None
        assert work is not None  # the work has not begun
        try:
            self._result = work()
        except BaseException as error:
            self._error = error
        self._under_way.release()

    def result(self) -> _T:
        """Return the result of the work; while waiting for it, do other queued work.

        If the work raised an exception, raise this exception.
        """
        self.do()
        while self._queue is not None and self._under_way.locked():
            try:
                self._queue.get_nowait().do()
            except Empty:
                break
        self._under_way.acquire()
        if self._error is not None:
            raise self._error
        return self._result


@cache
def _queue() -> SimpleQueue[_Work[Any]] | None:
    """Return the queue of the background thread; None if this process has no such thread."""
    if len(os.sched_getaffinity(0)) < 2 or os.environ.get(ALONE):
        return None
    queue: SimpleQueue[_Work[Any]] = SimpleQueue()

    def work() -> None:
        while True:
            queue.get().do()

    threading.Thread(target=work, name="background", daemon=True).start()
    return queue


os.register_at_fork(after_in_child=_queue.cache_clear)  # a forked process does not have this thread


def in_background(work: Callable[[], _T], *, worth: bool = True) -> Callable[[], _T]:
    """Queue a function for the background thread; return a function that returns its result.

    The returned function must be called once. If the background thread has not started the work
    yet, the returned function does the work itself.

    Args:
        work: function to queue, usually a call of one long kernel.
        worth: whether to queue the function. Otherwise the returned function does the work, which
            is faster if the work takes less than a few tenths of a millisecond.
    """
    queue = _queue() if worth else None
    begun = _Work(work, queue)
    if queue is not None:
        queue.put(begun)
    return begun.result
