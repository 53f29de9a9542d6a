"""Worker processes of a campaign on this machine.

They are forks of the process that made the first run, so that imports and loaded data are shared.
Each ends with its parent; if one dies, the work of all is given to others.
"""

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from omni_platform.background import ALONE

Run = Callable[[Sequence[int]], Any]
_run: Run  # of a worker: as a fork it needs no pickling


class WorkerDiedError(RuntimeError):
    """Several workers died one after the other on the same work."""


def share(
    run: Run,
    next_seeds: Callable[[], Sequence[int]],
    workers: int,
    take: Callable[[Any], None],
    most_deaths: int = 3,
) -> None:
    """Run seeds on several cores.

    Args:
        run: makes the runs of some seeds; runs in the workers.
        next_seeds: returns the next seeds; empty at the end.
        workers: number of processes.
        take: called with each result of `run`, in any order.
        most_deaths: number of workers, one after the other, that may die without a result.

    Raises:
        WorkerDiedError: the same seeds ended several workers in turn.
    """
    left: list[Sequence[int]] = []  # what the workers that died should have done
    deaths = 0
    while True:
        flying: dict[Future[Any], Sequence[int]] = {}
        context = multiprocessing.get_context("fork")
        pool = ProcessPoolExecutor(workers, context, _prepare, (run, os.getpid()))
        try:
            while True:
                while len(flying) < workers and (left or (seeds := next_seeds())):
                    left = left or [seeds]  # until the pool has accepted them
                    flying[pool.submit(_work, left[-1])] = left[-1]
                    left.pop()
                if not flying:
                    return
                for future in wait(flying, return_when=FIRST_COMPLETED).done:
                    take(future.result())
                    del flying[future]
                    deaths = 0
        except BrokenProcessPool:
            left += flying.values()
            deaths += 1
            if deaths == most_deaths:
                ends = min(map(min, left)), max(map(max, left))
                raise WorkerDiedError("workers die of seeds {} to {}".format(*ends)) from None
        finally:
            for process in multiprocessing.active_children():
                process.kill()
            pool.shutdown()


def _prepare(run: Run, parent: int) -> None:
    global _run  # noqa: PLW0603
    _run = run
    # Ctrl-C is answered by the parent; a killed parent (PR_SET_PDEATHSIG) ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    os.environ[ALONE] = "1"


def _work(seeds: Sequence[int]) -> Any:
    return _run(seeds)
