"""One more thread for long kernels, which let go of the interpreter while they run.

Python itself goes on in one thread at a time, and whoever waits for the other to let go of it costs
both some ten microseconds. So what is done aside is one kernel of some tenths of a millisecond with
hardly any Python around it: then two processors do two of them in the time of one. Where there is
but one processor, or others have work for each, the work is done where its result is asked for.
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
"""Environment variable that keeps a process to one thread if it is not empty."""


class _Work(Generic[_T]):
    """What is done once, by whoever comes first."""

    def __init__(self, work: Callable[[], _T], queue: SimpleQueue[_Work[Any]]) -> None:
        self._work = work
        self._queue = queue
        self._begun, self._under_way = threading.Lock(), threading.Lock()
        self._under_way.acquire()
        self._error: BaseException | None = None

    def do(self) -> None:
        """Do it, unless that has begun."""
        if not self._begun.acquire(blocking=False):
            return
        try:
            self._result = self._work()
        except BaseException as error:
            self._error = error
        self._under_way.release()

    def result(self) -> _T:
        """Return its result; meanwhile do what others wait for."""
        self.do()
        while self._under_way.locked():
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
    """Return what the other thread works through, None where there is none."""
    if len(os.sched_getaffinity(0)) < 2 or os.environ.get(ALONE):
        return None
    queue: SimpleQueue[_Work[Any]] = SimpleQueue()

    def work() -> None:
        while True:
            queue.get().do()

    threading.Thread(target=work, name="aside", daemon=True).start()
    return queue


os.register_at_fork(after_in_child=_queue.cache_clear)  # a fork does not have the thread


def aside(work: Callable[[], _T], *, worth: bool = True) -> Callable[[], _T]:
    """Begin a work, and return what hands over its result; called once.

    What nobody has begun by then is done by whoever asks.

    Args:
        work: mostly one long kernel.
        worth: whether it takes some tenths of a millisecond.
    """
    queue = _queue() if worth else None
    if queue is None:
        return work
    begun = _Work(work, queue)
    queue.put(begun)
    return begun.result
