"""A campaign of many runs on all cores or on a cluster, which can be interrupted.

Workers take chunks of seeds. A chunk whose worker dies goes to another one. What is finished is
appended to a table as it comes in; a campaign that goes on reads it and runs what is missing. The
finished table is in the order of the seeds, so that it does not depend on who ran what.
"""

from __future__ import annotations

import csv
import os
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TextIO, get_type_hints

from distributed import Client, LocalCluster, as_completed
from distributed.scheduler import KilledWorker

from omni_analysis.campaign.random_braking import RandomBraking
from omni_analysis.campaign.robustness import Outcome, outcome
from omni_platform.configuration import ConfigurationError

CHUNK = 25
"""Runs that a worker does at a time, some tenths of a second."""

_CONNECT_TIME = 10.0  # [s]
_SILENT = 50  # level of log messages that distributed keeps to itself
# What workers do first: Ctrl-C reaches them too, and it is not theirs to answer.
_PRELOAD = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"


class CampaignError(RuntimeError):
    """The campaign cannot go on."""


def run_chunk(seeds: Sequence[int], braking: RandomBraking) -> list[Outcome]:
    """Run some seeds in this process."""
    return [outcome(braking, seed) for seed in seeds]


@contextmanager
def connected(scheduler: str | None, workers: int | None) -> Iterator[Client]:
    """Connect to a cluster.

    Args:
        scheduler: address of an existing one; None starts one on this machine and ends it again.
        workers: processes of the latter; None for one on every core.

    Raises:
        ConfigurationError: nobody answers at the address.
    """
    with ExitStack() as stack:
        if scheduler is None:
            scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix="omni_campaign_"))
            target: Any = stack.enter_context(
                LocalCluster(
                    n_workers=workers or len(os.sched_getaffinity(0)),
                    threads_per_worker=1,
                    dashboard_address=":0",
                    local_directory=scratch,
                    silence_logs=_SILENT,
                    preload=_PRELOAD,
                )
            )
        else:
            target = scheduler
        try:
            client = Client(target, timeout=_CONNECT_TIME)
        except (OSError, ValueError) as error:
            raise ConfigurationError("--scheduler", f"{scheduler}: {error}") from None
        yield stack.enter_context(client)


def run_campaign(
    client: Client,
    braking: RandomBraking,
    seeds: Iterable[int],
    on_results: Callable[[list[Outcome]], None],
) -> None:
    """Run seeds on a cluster.

    Args:
        client: of the cluster.
        braking: makes the runs.
        seeds: to run.
        on_results: called with the results of every chunk as it is finished, in any order.

    Raises:
        CampaignError: a chunk has cost the cluster one worker after the other.
    """
    wanted = list(seeds)
    chunks = [wanted[start : start + CHUNK] for start in range(0, len(wanted), CHUNK)]
    # Sent with every chunk: what lay on one worker only would die with it.
    futures = client.map(run_chunk, chunks, braking=braking, pure=False)
    try:
        for _, results in as_completed(futures, with_results=True):
            on_results(results)
    except KilledWorker as error:
        raise CampaignError(f"workers die of these runs: {error}") from None
    finally:
        client.cancel(futures)


class ResultTable:
    """The table of a campaign on disk, one row per run.

    Args:
        path: of the CSV file.
        fingerprint: of everything that the runs depend on besides their seeds.
        resume: whether to go on with what is there.

    Raises:
        ConfigurationError: the file to go on with is of another campaign.
    """

    def __init__(self, path: Path, fingerprint: str, *, resume: bool) -> None:
        self._path = path
        self._head = f"# fingerprint {fingerprint}\n{','.join(Outcome._fields)}\n"
        self.results: dict[int, Outcome] = {}
        if resume and path.exists():
            text = path.read_text(encoding="utf-8")
            if not text.startswith(self._head):
                raise ConfigurationError(
                    "--resume", f"{path} is not of this campaign: vehicles or limits have changed"
                )
            # The last line may have been cut off.
            body = text[len(self._head) : text.rfind("\n") + 1]
            for row in csv.DictReader(body.splitlines(), fieldnames=Outcome._fields):
                result = _parse(row)
                self.results[result.seed] = result
        self.save()
        self._stream: TextIO | None = None

    def __enter__(self) -> ResultTable:
        self._stream = self._path.open("a", encoding="utf-8", newline="")
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream is not None:
            self._stream.close()
        self.save()

    def add(self, results: Iterable[Outcome]) -> None:
        """Take finished runs in, and write them at once."""
        if self._stream is None:
            raise ValueError("the table is not open")
        for result in results:
            self.results[result.seed] = result
            self._stream.write(_line(result))
        self._stream.flush()

    def save(self) -> None:
        """Write the table anew, in the order of the seeds."""
        temporary = self._path.with_suffix(".tmp")
        rows = (_line(self.results[seed]) for seed in sorted(self.results))
        temporary.write_text(self._head + "".join(rows), encoding="utf-8")
        temporary.replace(self._path)


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt for a while, whatever it does otherwise."""
    previous = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


def _line(result: Outcome) -> str:
    return ",".join(str(value) for value in result) + "\n"  # the repr of a float is exact


def _parse(row: Mapping[str, str]) -> Outcome:
    kinds = get_type_hints(Outcome)
    return Outcome(**{name: kinds[name](text) for name, text in row.items()})
