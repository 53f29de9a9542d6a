"""Worker processes of a campaign on this machine.

They are forks of the process that made the first run, so that imports and loaded data are shared.
Each receives its work through a pipe and ends with its parent.
"""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from omni_platform.background import ALONE

_PATIENCE = 1.0  # [s] after which an idle worker checks that its parent still runs
_MOST_DEATHS = 3  # of workers, one after the other, over the same work

Run = Callable[[Sequence[int]], Any]


class WorkerDiedError(RuntimeError):
    """Several workers died one after the other on the same work."""


class _Worker:
    def __init__(self, run: Run) -> None:
        self._run = run
        self.seeds: Sequence[int] = ()
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("fork")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(self._run, theirs), daemon=True)
        self._process.start()
        theirs.close()

    def give(self, seeds: Sequence[int]) -> None:
        self.seeds, self._deaths = seeds, 0
        if seeds:
            self._send()

    def _send(self) -> None:
        with contextlib.suppress(BrokenPipeError):  # it has died; the caller gets the error
            self.connection.send(self.seeds)

    def replace(self) -> None:
        """Give the work of a dead worker to another one.

        Raises:
            WorkerDiedError: the work has ended a worker before.
        """
        self._deaths += 1
        if self._deaths == _MOST_DEATHS:
            raise WorkerDiedError(f"workers die of seeds {self.seeds[0]} to {self.seeds[-1]}")
        self.end()
        self._start()
        self._send()

    def end(self) -> None:
        self._process.kill()
        self._process.join()
        self.connection.close()


def share(
    run: Run, next_seeds: Callable[[], Sequence[int]], workers: int, take: Callable[[Any], None]
) -> None:
    """Run seeds on several cores.

    Args:
        run: makes the runs of some seeds; runs in the workers.
        next_seeds: returns the next seeds; empty at the end.
        workers: number of processes.
        take: called with each result of `run`, in any order.

    Raises:
        WorkerDiedError: the same seeds ended several workers in turn.
    """
    team: list[_Worker] = []
    try:
        for _ in range(workers):
            team.append(_Worker(run))
            team[-1].give(next_seeds())
        while busy := [worker for worker in team if worker.seeds]:
            ready = wait([worker.connection for worker in busy])
            for worker in busy:
                if worker.connection not in ready:
                    continue
                try:
                    answer = worker.connection.recv()
                except (EOFError, ConnectionResetError):
                    worker.replace()
                    continue
                if isinstance(answer, Exception):
                    raise answer
                worker.give(next_seeds())
                take(answer)
    finally:
        for worker in team:
            worker.end()


def _serve(run: Run, connection: Connection) -> None:
    # Ctrl-C reaches it too, and is not its to answer; nor does it need a second thread.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.environ[ALONE] = "1"
    parent = os.getppid()
    while True:
        try:
            # Its pipe does not end with that process: the other workers hold it, too.
            while not connection.poll(_PATIENCE):
                if os.getppid() != parent:
                    return
            seeds = connection.recv()
        except EOFError:
            return
        try:
            answer = run(seeds)
        except Exception as error:
            answer = error
        connection.send(answer)
