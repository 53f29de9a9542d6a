"""Campaigns of many runs on all cores or on a cluster; they can be resumed, divided and merged.

A study with many runs defines a function whose argument is a seed (or the number of a case). The
function makes one run and returns a row: a NamedTuple whose first field is ``seed`` and whose other
fields are int, float or str. `run_campaign` does the rest::

    class Row(NamedTuple):
        seed: int
        distance: float

    def work(seed: int) -> Row: ...          # at the top of a module, or a functools.partial of it

    class Options(CampaignOptions): ...      # --workers --scheduler --resume --seeds --merge

    rows = run_campaign(work, range(1000), Row, options, folder / "runs.csv", fingerprint, report)

Each worker processes chunks of seeds, and a chunk takes about a second. If a worker dies, its chunk
is given to another worker. Finished rows are appended to a table; a resumed campaign (``--resume``)
reads this table and runs the missing seeds. The finished table is in the order of the seeds, so it
does not depend on the distribution of the work. The jobs of a job array run parts (``--seeds
0:500`` and ``--seeds 500:1000``, each with its own folder); ``--merge`` combines the parts into one
table.
"""

import csv
import functools
import hashlib
import json
import math
import os
import re
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, TypeVar, get_type_hints

from omni_core import configuration
from omni_core.commands.command_options import option
from omni_core.configuration import Configuration, ConfigurationError, parameter, to_mapping
from omni_core.plugins import import_optional
from omni_tools.campaign.cost import timed
from omni_tools.campaign.processes import WorkerDiedError, share

CHUNK_TIME = 1.0
"""Target duration of a chunk of runs [s]."""

_ALONE = 2.0  # duration of the first runs, which determine an estimate for the others [s]
_FIRST_RUNS = 3  # minimum number of these first runs
_WORTH = 1.0  # estimated remaining work below which no worker is started [s]
_IN_FLIGHT = 3  # number of queued chunks per cluster worker, so that no worker is idle

Row = TypeVar("Row", bound=tuple[Any, ...])
Work = Callable[[int], Row]


class CampaignError(configuration.WorkError):
    """A campaign cannot continue; the message states the reason."""


class CampaignOptions(Configuration):
    """Command-line options of a study with many runs."""

    workers: int | None = parameter(None, minimum=1, maximum=1024)
    """processes on this machine (default: one per core); with 1 the runs stay in this process"""
    scheduler: str | None = option(None, metavar="tcp://HOST:PORT")
    """run on this dask.distributed cluster, whose workers have this workspace"""
    resume: bool = parameter(False)
    """keep the finished runs of an interrupted or shorter campaign, and run the missing seeds"""
    seeds: str = option("", metavar="A:B")
    """run only seeds A to B - 1 of the campaign"""
    merge: tuple[Path, ...] = option((), metavar="DIR")
    """also read the finished runs of another part from its folder"""

    def check_consistency(self) -> None:
        """Check that the options do not contradict each other.

        Raises:
            ConfigurationError: options contradict each other; the message names them.
        """
        if self.workers is not None and self.scheduler is not None:
            raise ConfigurationError(
                "--workers", "cannot be combined with --scheduler, which has its own workers"
            )
        if self.seeds and not re.fullmatch(r"\d{1,18}:\d{1,18}", self.seeds):
            raise ConfigurationError("--seeds", f"{self.seeds!r} must be two numbers such as 0:500")

    def piece(self, seeds: range) -> range:
        """Return those seeds of a campaign that the option ``--seeds`` selects.

        Args:
            seeds: seeds of the whole campaign.

        Raises:
            ConfigurationError: the option selects none of these seeds.
        """
        if not self.seeds:
            return seeds
        first, last = (int(number) for number in self.seeds.split(":"))
        chosen = range(max(first, seeds.start), min(last, seeds.stop))
        if not chosen:
            raise ConfigurationError(
                "--seeds",
                f"{self.seeds} contains none of the campaign's seeds {seeds.start}:{seeds.stop}",
            )
        return chosen


def digest(*parts: Any) -> str:
    """Return a digest of configurations and other JSON values that determine the runs."""
    text = json.dumps(parts, default=to_mapping)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def run_campaign(
    work: Work[Row],
    seeds: range,
    row: type[Row],
    options: CampaignOptions,
    path: Path,
    fingerprint: str,
    report: Callable[[float, str], None] = lambda _share, _words: None,
) -> list[Row]:
    """Run the seeds of a campaign that have no result yet, and return all results.

    Args:
        work: function that makes one run; the worker processes receive it.
        seeds: seeds of the whole campaign.
        row: type of a run's result, a NamedTuple whose first field is ``seed``.
        options: options that select the seeds to run, the workers, and earlier results to keep.
        path: path of the table of all runs, a CSV file.
        fingerprint: digest of all settings that determine the runs, except the seeds.
        report: function that is called with the completed share (0 to 1) and a text.

    Returns:
        The rows of the selected seeds, in the order of the seeds.

    Raises:
        ConfigurationError: the options are invalid, or a table belongs to another campaign.
        CampaignError: several workers in a row died with the same runs.
        KeyboardInterrupt: Ctrl-C was pressed; the message states how many runs are kept.
    """
    piece = options.piece(seeds)
    table: ResultTable[Row] = ResultTable(path, row, fingerprint, resume=options.resume)
    for folder in options.merge:
        table.take(folder / path.name)
    missing = [seed for seed in piece if seed not in table.results]

    def take(rows: list[Row]) -> None:
        table.add(rows)
        done = len(piece) - len(missing) + (len(table.results) - kept)
        report(done / len(piece), f"{done} of {len(piece)} runs")

    kept = len(table.results)
    try:
        with _interruptible():
            if missing:
                # The first run compiles all kernels. Otherwise all workers would compile them at
                # the same time.
                take([work(missing[0])])
                _run(work, missing[1:], options, take)
    except KeyboardInterrupt:
        count = len(table.results)
        raise KeyboardInterrupt(f"{count} runs are kept; --resume continues") from None
    finally:
        table.save()
    return [table.results[seed] for seed in piece]


def _run(
    work: Work[Row],
    seeds: Sequence[int],
    options: CampaignOptions,
    take: Callable[[list[Row]], None],
) -> None:
    """Run seeds on a cluster or on this machine.

    On this machine, the first seeds run in this process. Worker processes run the other seeds,
    unless the remaining work is shorter than the time to start the workers.

    Args:
        work: function that makes one run.
        seeds: seeds to run.
        options: number of workers, or address of a cluster.
        take: function called with the rows of finished runs, in any order.
    """
    if not seeds:
        return
    workers = options.workers or len(os.sched_getaffinity(0))
    done, spent = 0, 0.0
    while options.scheduler is None and done < len(seeds):
        known = spent >= _ALONE or done >= _FIRST_RUNS
        if workers > 1 and known and spent / done * (len(seeds) - done) > _WORTH:
            break
        rows, duration = _run_chunk(work, seeds[done : done + 1])
        take(rows)
        done, spent = done + 1, spent + duration
    if done == len(seeds):
        return
    if options.scheduler is not None:
        with connected(options.scheduler) as client:
            distribute(client, work, seeds[done:], take)
        return
    chunks = _Chunks(seeds[done:], workers)
    try:
        share(functools.partial(_run_chunk, work), chunks.next, workers, chunks.taking(take))
    except WorkerDiedError as error:
        raise CampaignError(str(error)) from None


class _Chunks:
    """Divides seeds into chunks of about equal duration, so that all workers finish together."""

    def __init__(self, seeds: Sequence[int], lanes: int) -> None:
        self._left = list(reversed(seeds))
        self._lanes = lanes
        self._size = 2  # used until the duration of a run is known

    def next(self) -> list[int]:
        """Return the seeds of the next chunk; empty at the end."""
        return [self._left.pop() for _ in range(min(self._size, len(self._left)))]

    def taking(
        self, take: Callable[[list[Row]], None]
    ) -> Callable[[tuple[list[Row], float]], None]:
        """Return a callback for finished chunks.

        It passes their rows to `take`, and adapts the size of later chunks to their duration.
        """

        def learn(answer: tuple[list[Row], float]) -> None:
            rows, duration = answer
            take(rows)
            fair = math.ceil(len(self._left) / (_IN_FLIGHT * self._lanes))
            apt = round(CHUNK_TIME / max(duration / len(rows), 1e-6))
            self._size = max(1, min(apt, fair, 4 * self._size, 1000))

        return learn


def connected(scheduler: str, timeout: float = 10.0) -> Any:
    """Return a context manager that yields a `distributed.Client` connected to a cluster.

    Args:
        scheduler: address of the scheduler.
        timeout: limit on the time to wait for an answer of the scheduler [s].

    Raises:
        ConfigurationError: no scheduler answers at the address, or Dask is not installed.
    """
    try:
        client = import_optional("distributed", "campaign").Client  # this import takes a second
        return client(scheduler, timeout=timeout)
    except ImportError:
        remedy = "needs the package distributed, which is not installed: ./omni install campaign"
        raise ConfigurationError("--scheduler", remedy) from None
    except (OSError, ValueError) as error:
        raise ConfigurationError("--scheduler", f"{scheduler}: {error}") from None


def distribute(
    client: Any, work: Work[Row], seeds: Sequence[int], take: Callable[[list[Row]], None]
) -> None:
    """Run seeds on a cluster, chunk by chunk.

    Args:
        client: a `distributed.Client`.
        work: function that makes a run.
        seeds: seeds to run.
        take: function called with the rows of each chunk when it is finished, in any order.

    Raises:
        CampaignError: several cluster workers in a row died with the same chunk.
    """
    from distributed.scheduler import KilledWorker

    # The function is sent with every chunk. If it were stored on a single worker, it would be lost
    # with this worker.
    executor = client.get_executor(pure=False)
    chunk = functools.partial(_run_chunk, work)
    lanes = max(1, sum(client.nthreads().values()))
    chunks = _Chunks(seeds, lanes)
    learn = chunks.taking(take)
    flying: set[Future[Any]] = set()
    try:
        while True:
            while len(flying) < _IN_FLIGHT * lanes and (part := chunks.next()):
                flying.add(executor.submit(chunk, part))
            if not flying:
                return
            finished, flying = wait(flying, return_when=FIRST_COMPLETED)
            for future in finished:
                learn(future.result())
    except KilledWorker as error:
        raise CampaignError(f"several workers died with these runs: {error}") from None
    finally:
        executor.shutdown(wait=False)  # cancels the other chunks


def _run_chunk(work: Work[Row], seeds: Sequence[int]) -> tuple[list[Row], float]:
    """Run some seeds in this process; return their rows and the duration [s]."""
    return timed(lambda: [work(seed) for seed in seeds])


class ResultTable(Generic[Row]):
    """Table of a campaign on disk, one row per run.

    Args:
        path: path of the CSV file.
        row: type of the result of a run.
        fingerprint: digest of all settings that determine the runs, except the seeds.
        resume: whether to continue an existing table.

    Raises:
        ConfigurationError: the existing table belongs to another campaign.
    """

    def __init__(self, path: Path, row: Any, fingerprint: str, *, resume: bool) -> None:
        self._path = path
        self._row = row
        self._head = f"# fingerprint {fingerprint}\n{','.join(row._fields)}\n"
        self.results: dict[int, Row] = {}
        if resume and path.exists():
            self._read(path, "--resume")
        self.save()

    def take(self, path: Path) -> None:
        """Add the runs in another table of the same campaign to this table.

        Raises:
            ConfigurationError: the table does not exist, or belongs to another campaign.
        """
        if not path.is_file():
            raise ConfigurationError("--merge", f"there is no {path}")
        self._read(path, "--merge")
        self.save()

    def add(self, rows: Sequence[Row]) -> None:
        """Add finished runs, and write them to the file."""
        self.results |= {result[0]: result for result in rows}
        with self._path.open("a", encoding="utf-8") as stream:
            stream.writelines(map(_line, rows))

    def save(self) -> None:
        """Rewrite the table in the order of the seeds."""
        temporary = self._path.with_suffix(".tmp")
        lines = (_line(self.results[seed]) for seed in sorted(self.results))
        temporary.write_text(self._head + "".join(lines), encoding="utf-8")
        temporary.replace(self._path)

    def _read(self, path: Path, option_name: str) -> None:
        text = path.read_text(encoding="utf-8")
        if not text.startswith(self._head):
            raise ConfigurationError(
                option_name, f"{path} is from a campaign with other settings; use another --out"
            )
        # The last line may be incomplete.
        body = text[len(self._head) : text.rfind("\n") + 1]
        kinds = get_type_hints(self._row).values()
        for cells in csv.reader(body.splitlines()):
            result = self._row(*(kind(cell) for kind, cell in zip(kinds, cells, strict=True)))
            self.results[result[0]] = result


@contextmanager
def _interruptible() -> Iterator[None]:
    """Return a context manager in which Ctrl-C raises KeyboardInterrupt."""
    previous = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


def _line(result: tuple[Any, ...]) -> str:
    # The repr of a float is exact. A comma in a text would split the cell.
    return ",".join(str(value).replace(",", ";").replace("\n", " ") for value in result) + "\n"
