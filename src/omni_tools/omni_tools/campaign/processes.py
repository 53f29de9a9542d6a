"""Worker processes of a campaign on one machine.

The workers are forks of the process that made the first run, so they share its imports and data. A
worker ends when its parent ends. If a worker dies, new workers replace all workers and continue the
unfinished work.
"""

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from omni_core.background import ALONE

Run = Callable[[Sequence[int]], Any]
_run: Run  # set in each worker; not pickled

_MOST_DEATHS = 3  # worker deaths without a result in between, after which the work ends


class WorkerDiedError(RuntimeError):
    """Several workers in a row died with the same seeds."""


def share(
    run: Run, next_seeds: Callable[[], Sequence[int]], workers: int, take: Callable[[Any], None]
) -> None:
    """Run all seeds in several worker processes.

    Args:
        run: function that runs a list of seeds; called in the workers.
        next_seeds: function that returns the next seeds to run; an empty list after the last seed.
        workers: number of worker processes.
        take: function called with each result of `run`, in any order.

    Raises:
        WorkerDiedError: several workers in a row died with the same seeds.
    """
    left: list[Sequence[int]] = []  # unfinished work of workers that died
    deaths = 0
    while True:
        flying: dict[Future[Any], Sequence[int]] = {}
        context = multiprocessing.get_context("fork")
        pool = ProcessPoolExecutor(workers, context, _prepare, (run, os.getpid()))
        try:
            while True:
                while len(flying) < workers and (left or (seeds := next_seeds())):
                    left = left or [seeds]  # kept until the pool accepts the seeds
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
            if deaths == _MOST_DEATHS:
                ends = min(map(min, left)), max(map(max, left))
                raise WorkerDiedError(
                    "several workers died with the seeds {} to {}".format(*ends)
                ) from None
        finally:
            for process in multiprocessing.active_children():
                process.kill()
            pool.shutdown()


def _prepare(run: Run, parent: int) -> None:
    global _run  # noqa: PLW0603
    _run = run
    # The parent handles Ctrl-C. If the parent dies, the kernel ends the worker (PR_SET_PDEATHSIG).
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    os.environ[ALONE] = "1"


def _work(seeds: Sequence[int]) -> Any:
    return _run(seeds)
