"""Start of nodes as forks of a process that has already imported their modules.

The imports take half a second of CPU time in each node. The fork server of `multiprocessing`
imports the modules of the usual nodes once, and forks itself for every start of a node. A forked
node has its own process group, arguments, environment and streams, and ``ps -e`` and ``pgrep`` show
the name of its executable. Executables that are not nodes of this workspace are started as new
programs.
"""

import contextlib
import functools
import itertools
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from multiprocessing import forkserver, reduction, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from omni_core.configuration import InputError, WorkError
from omni_ros.environment import PARENT_PID_VARIABLE, REPORT_VARIABLE
from omni_ros.start import NODES, start_node

# Variables that Python reads only at its start: if they differ, a node is not forked.
_READ_AT_START = ("LD_LIBRARY_PATH", "NUMBA_CACHE_DIR", "PYTHONPATH")

_T = TypeVar("_T")
_REPORTED = (InputError, WorkError, OSError)  # errors that commands report in one sentence


@functools.cache
def start_fork_server() -> None:
    """Start the fork server, which ends together with this process and its nodes."""
    multiprocessing.set_forkserver_preload(["omni_runs.graph.preloaded"])
    with replaced(os.environ, PARENT_PID_VARIABLE, str(os.getpid())):
        resource_tracker.ensure_running()  # within the next call, its start would unblock SIGINT
        # Ctrl-C reaches all processes of the terminal, but only this one ends the others.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def start_process(
    command: Sequence[str], environment: Mapping[str, str], descriptors: Sequence[int]
) -> ForkServerProcess:
    """Start a program.

    Args:
        command: path of an executable, and arguments.
        environment: environment variables; `REPORT_VARIABLE` and `PARENT_PID_VARIABLE` are added.
        descriptors: file descriptors for standard input, output, error, and reports.
    """
    return _start(_become, list(command), dict(environment), _Descriptors(descriptors))


def _start(
    function: Callable[..., None], *arguments: Any, daemon: bool = False
) -> ForkServerProcess:
    """Start a process that calls a function and then ends; a daemon ends with this process."""
    start_fork_server()
    process = ForkServerProcess(target=function, args=arguments, daemon=daemon)
    # The process must not run the main module of this process, as in multiprocessing.
    with replaced(sys.modules, "__main__", ModuleType("__main__")):
        process.start()
    return process


class Worker:
    """Calls functions, one after the other, in a fork of the server, which has their modules.

    The process starts with the first call. It ends after `close`, or together with this process.
    """

    def __init__(self) -> None:
        self._numbers, self._results = itertools.count(), list[Any]()

    @functools.cached_property
    def _connection(self) -> Connection:
        own, served = multiprocessing.Pipe()
        _start(_serve, served, daemon=True)
        served.close()
        return own

    def close(self) -> None:
        """End the process as soon as it waits for a call."""
        if "_connection" in vars(self):
            self._connection.close()

    def begin(self, function: Callable[[], _T]) -> Callable[[], _T]:
        """Begin to call a function; return a function that awaits the result.

        The function and its result are pickled. An error of the function that is in `_REPORTED` is
        raised again when the result is awaited; any other error is printed.
        """
        with contextlib.suppress(BrokenPipeError):  # the process has ended; see below
            self._connection.send(function)
        number = next(self._numbers)

        def result() -> _T:
            while len(self._results) <= number:
                try:
                    self._results.append(self._connection.recv())
                except (EOFError, ConnectionResetError):
                    raise WorkError("the process that computes results ended") from None
            if isinstance(self._results[number], _REPORTED):
                raise self._results[number]
            found: _T = self._results[number]
            return found

        return result


def _serve(connection: Connection) -> None:
    """Call the functions that a `Worker` sends, until it closes the connection."""
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            function = connection.recv()
            try:
                result = function()
            except _REPORTED as error:
                result = error
            connection.send(result)


@contextlib.contextmanager
def replaced(mapping: MutableMapping[str, Any], key: str, value: Any) -> Iterator[None]:
    """Replace or add an entry of a mapping for the duration of a ``with`` block."""
    before = mapping.get(key)
    mapping[key] = value
    try:
        yield
    finally:
        if before is None:
            del mapping[key]
        else:
            mapping[key] = before


class _Descriptors(list[int]):
    """File descriptors that the started process receives."""

    def __reduce__(self) -> Any:
        return _received, tuple(map(reduction.DupFd, self))


def _received(*descriptors: Any) -> list[int]:
    return [descriptor.detach() for descriptor in descriptors]


@functools.cache
def nodes() -> tuple[EntryPoint, ...]:
    """Return the entry points of all nodes; the search takes 50 ms."""
    return tuple(entry_points(group=NODES))


def node_module(executable: Path) -> str | None:
    """Return the module that an executable runs; None if it is no node of this workspace."""
    for entry in nodes():
        if entry.name != executable.name:
            continue
        installed = Path(str(entry.dist.locate_file(""))) if entry.dist else Path()
        if installed.is_relative_to(executable.parents[2]):
            return entry.module
    return None


def _become(command: list[str], environment: dict[str, str], descriptors: list[int]) -> None:
    """Run a program in this process, which is a new fork of the server; arguments as above."""
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # the server blocks it
    # The streams of the server stay open in no node, so that the server ends with its parent.
    for number, descriptor in enumerate(descriptors):
        os.dup2(descriptor, number)
    reports = len(descriptors) - 1
    os.closerange(reports + 1, os.sysconf("SC_OPEN_MAX"))
    os.set_inheritable(reports, True)
    changed = any(environment.get(name) != os.environ.get(name) for name in _READ_AT_START)
    os.environ.clear()
    os.environ.update(environment)
    os.environ.update({REPORT_VARIABLE: str(reports), PARENT_PID_VARIABLE: str(os.getppid())})
    module = None if changed else node_module(Path(command[0]))
    if module is None:
        os.execve(command[0], command, os.environ)
    Path("/proc/self/comm").write_text(Path(command[0]).name)
    sys.argv, sys.path[0] = command, str(Path(command[0]).parent)
    start_node(module)
