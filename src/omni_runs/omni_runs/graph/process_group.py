"""Operating-system processes that start and end together."""

import contextlib
import dataclasses
import json
import os
import re
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from omni_core.configuration import WorkError
from omni_runs.graph.fork_server import start_process

_COLORS = re.compile(r"\x1b\[[0-9;]*m")  # colors of DDS messages
_HALTED = "{} was halted by a signal during the run, which makes the run invalid"
# Limit on the time without a report [s]; kernels may have to be compiled first.
_REPORT_TIMEOUT = 300.0


class ProcessError(WorkError):
    """An executable was not found, or its process ended too early."""


@dataclasses.dataclass(frozen=True)
class NodeProcess:
    """Description of a node to start, as by ``ros2 run PACKAGE EXECUTABLE``.

    Attributes:
        name: name of the node, for messages.
        package: package in the ament index.
        executable: file name in ``lib/PACKAGE``.
        arguments: command-line arguments.
        own_code: whether the node runs a user's code; the output of this node is shown on the
            terminal.
    """

    name: str
    package: str
    executable: str
    arguments: Sequence[str] = ()
    own_code: bool = False


def find_executable(package: str, executable: str) -> Path:
    """Return the path of an executable, found in the ament index as by ``ros2 run``.

    Raises:
        ProcessError: no prefix of ``AMENT_PREFIX_PATH`` has the package or the executable.
    """
    prefixes = [path for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]
    for prefix in map(Path, prefixes):
        marker = prefix / "share" / "ament_index" / "resource_index" / "packages" / package
        path = prefix / "lib" / package / executable
        if marker.exists() and os.access(path, os.X_OK):
            return path
    raise ProcessError(
        f"package {package!r} with executable {executable!r} is in none of the "
        f"{len(prefixes)} prefixes of AMENT_PREFIX_PATH; start through ./omni, or build the "
        "workspace and source install/setup.bash"
    )


class RunningProcess:
    """A started node, with its exit code, reports and error output.

    Attributes:
        node: description of the node.
    """

    def __init__(
        self, node: NodeProcess, environment: Mapping[str, str], stop_timeout: float
    ) -> None:
        self.node = node
        self._stop_timeout = stop_timeout
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        self._output: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        # A file is used instead of a pipe, so that a node never waits for a slow reader.
        self._reports: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        command = [str(find_executable(node.package, node.executable)), *node.arguments]
        shown = {"PYTHONUNBUFFERED": "1"} if node.own_code else {}
        # Output of the user's code goes to standard error, since standard output contains the
        # document.
        output = (sys.stderr, sys.stderr) if node.own_code else (self._output, self._errors)
        with Path(os.devnull).open("rb") as nothing:
            streams = [stream.fileno() for stream in (nothing, *output, self._reports)]
            # Each node has its own process group. Ctrl-C then reaches only this process, which ends
            # the nodes in order. The nodes stay in the session: if this process dies, the kernel
            # sends SIGHUP and SIGCONT to a halted node, which then ends.
            self._process = start_process(command, {**environment, **shown}, streams)
        self._read_until = 0
        self._halted = False
        self._running_at = time.monotonic()  # time of the last check without a halt [s]

    @property
    def pid(self) -> int:
        """Process ID."""
        assert self._process.pid is not None  # it has been started
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, negative for a signal; None while the process runs."""
        return self._process.exitcode

    def note_halt(self) -> bool:
        """Return whether a signal such as SIGSTOP halts the process at present; remember a halt."""
        try:
            state = Path(f"/proc/{self.pid}/stat").read_bytes()
        except OSError:  # it has ended
            return False
        halted = state.rpartition(b")")[2].split()[0] == b"T"
        self._halted |= halted
        return halted

    def raise_if_halted(self, longest: float = 5.0) -> None:
        """Raise `ProcessError` if a signal has halted the process for more than `longest` [s]."""
        now = time.monotonic()
        if not self.note_halt():
            self._running_at = now
        if now - self._running_at > longest:
            raise ProcessError(f"{self.node.name} was halted by a signal")

    @property
    def was_halted(self) -> bool:
        """Whether the process is, or was at any call of `note_halt`, halted by a signal."""
        self.note_halt()
        return self._halted

    def new_reports(self) -> list[dict[str, Any]]:
        """Return the reports (`environment.report`) of the process since the last call."""
        text = _read_from(self._reports, self._read_until)
        complete = text.rfind(b"\n") + 1
        self._read_until += complete
        return [json.loads(line) for line in text[:complete].splitlines()]

    def error_output(self) -> str:
        """Return the standard error of the process; if it is empty, return standard output."""
        for stream in (self._errors, self._output):
            words = _COLORS.sub("", _read_from(stream, 0).decode(errors="replace")).strip()
            if words:
                return words
        return ""

    def signal(self, number: signal.Signals) -> None:
        """Send a signal, if the process still runs."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def request_stop(self) -> None:
        """Request the end of the process by SIGTERM.

        After a second request, a node no longer waits for acknowledgments of its subscribers.
        """
        self.note_halt()  # read now, because SIGCONT would clear this state
        self.signal(signal.SIGTERM)
        self.signal(signal.SIGCONT)  # a halted process could not end

    def wait_or_kill(self) -> int:
        """Wait until the process ends after `request_stop`, and return its exit code.

        If the process still runs after `stop_timeout`, it is killed.
        """
        deadline = time.monotonic() + self._stop_timeout
        while self.returncode is None and time.monotonic() < deadline:
            self.note_halt()
            time.sleep(0.02)
        self.signal(signal.SIGKILL)
        while self.returncode is None:
            time.sleep(0.001)
        return self.returncode


def _read_from(file: IO[bytes], offset: int) -> bytes:
    # pread does not move the file position, which the writing process shares.
    size = os.fstat(file.fileno()).st_size
    return os.pread(file.fileno(), max(0, size - offset), offset)


class ProcessGroup:
    """Starts processes in order; at the end of its ``with`` block, ends them in reverse order.

    The recorder must be started first, because it must end last.

    Args:
        environment: environment variables.
        stop_timeout: time after which a process is killed if it does not end as requested [s]; must
            exceed the time for which a node may wait for the acknowledgment of its last data.
    """

    def __init__(self, environment: Mapping[str, str], stop_timeout: float = 12.0) -> None:
        self._stop_timeout = stop_timeout
        self._environment = environment
        self.running: list[RunningProcess] = []

    def __enter__(self) -> "ProcessGroup":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        # A second Ctrl-C must not leave a node running; the first one takes effect afterward.
        with _interrupt_deferred(repeated=kind is not None):
            self.stop()

    def start(self, node: NodeProcess) -> RunningProcess:
        """Start the process of a further node.

        Raises:
            ProcessError: the executable of the node is not found.
        """
        with _interrupt_deferred():
            process = RunningProcess(node, self._environment, self._stop_timeout)
            self.running.append(process)
        return process

    def stop(self) -> None:
        """End all processes, in reverse order of their start.

        After a process has failed, others may wait for acknowledgments that never arrive. In this
        case, all processes except the first one (the recorder) are requested to end before the end
        of any process is awaited. If the recorder has already ended, the others receive a second
        request after 0.5 s, so that they no longer wait for acknowledgments.
        """
        if any(process.returncode not in (None, 0) for process in self.running):
            senders = self.running[1:]
            for process in senders:
                process.request_stop()
            if self.running[0].returncode is not None:
                deadline = time.monotonic() + 0.5
                for process in senders:
                    wait_for(process, deadline - time.monotonic())
                    process.request_stop()
            for process in senders:
                process.wait_or_kill()
        for process in reversed(self.running):
            process.request_stop()
            process.wait_or_kill()

    def raise_if_ended(self, besides: RunningProcess | None = None) -> None:
        """If a process has ended, raise `ProcessError` with its error output; note its halts.

        Args:
            besides: process that is not checked, because the caller waits for its end.
        """
        for process in self.running:
            process.note_halt()
            if process is not besides and process.returncode is not None:
                raise ProcessError(describe_end(process))

    def await_begin(self, recorder: RunningProcess, folder: Path) -> Iterator[None]:
        """Wait until the recorder has made the folder of its recording.

        Raises:
            ProcessError: a process ended, or a signal halted the recorder.
        """
        while not folder.is_dir():
            self.raise_if_ended()
            recorder.raise_if_halted()
            yield

    def follow(
        self, last: RunningProcess, on_report: Callable[[Mapping[str, Any] | str], None]
    ) -> Generator[None, None, dict[str, Any]]:
        """Wait for the end of a process, and return its last report.

        Args:
            last: process of the group that ends first, after a report with the key ``finished``.
            on_report: function that is called with each of its reports; before the first one, with
                the latest words of any process, such as the number of compiled kernels.

        Raises:
            ProcessError: another process ended earlier, a signal halted a process, or `last` makes
                no progress.
        """
        report: dict[str, Any] = {}
        received = time.monotonic()
        latest, words_of = "", dict.fromkeys(self.running, "")
        while last.returncode is None:
            yield
            self.raise_if_ended(besides=last)
            now = time.monotonic()
            for report in last.new_reports():
                on_report(report)
                received = now
            # Before the first step, a single halted node makes all other nodes wait.
            for process in (last,) if report else self.running:
                process.raise_if_halted()
                if not report and (words := process.error_output()) != words_of[process]:
                    words_of[process] = words
                    latest = f"{process.node.name}: {words.splitlines()[-1]}"
            if latest and not report:
                on_report(latest)
            if now - received > _REPORT_TIMEOUT:
                raise ProcessError(
                    f"the {last.node.name} has made no step for {_REPORT_TIMEOUT:g} s"
                )
        self.raise_if_ended(besides=last)
        report = (last.new_reports() or [report])[-1]
        if last.returncode != 0 or "finished" not in report:
            raise ProcessError(describe_end(last))
        if last.was_halted:
            raise ProcessError(_HALTED.format(last.node.name))
        return report

    def first_halt(self, besides: RunningProcess | None = None) -> str:
        """Return a sentence about the first process that was halted; empty if none was."""
        halted = (one.node.name for one in self.running if one is not besides and one.was_halted)
        name = next(halted, None)
        return _HALTED.format(name) if name else ""

    def raise_if_failed(self) -> None:
        """Raise `ProcessError` if one of the ended processes was halted or ended with an error."""
        if halt := self.first_halt():
            raise ProcessError(halt)
        for process in self.running:
            if process.returncode != 0:
                raise ProcessError(describe_end(process))


def check_counts(reports: Sequence[Mapping[str, Any]], sent: Mapping[str, int]) -> None:
    """Check that the recorder has stored all messages.

    Args:
        reports: reports of the recorder.
        sent: number of sent messages, keyed by topic.

    Raises:
        ProcessError: messages are missing in the recording.
    """
    recorded: Mapping[str, int] = reports[-1].get("recorded", {}) if reports else {}
    for topic, count in sent.items():
        if recorded.get(topic, 0) < count:
            kept = recorded.get(topic, 0)
            raise ProcessError(f"the recorder kept {kept} of {count} messages of {topic}")


def describe_end(process: RunningProcess) -> str:
    """Return a sentence that describes how a process ended."""
    code = process.returncode
    how = f"exit code {code}" if code is None or code >= 0 else f"signal {-code}"
    error_output = process.error_output().splitlines()
    silent = "its output is above" if process.node.own_code else "without a message"
    words = error_output[-1] if error_output else silent
    return f"{process.node.name} ended ({how}): {words}"


@contextlib.contextmanager
def _interrupt_deferred(*, repeated: bool = False) -> Iterator[None]:
    """Defer SIGINT and SIGTERM until the ``with`` block is left; only the first one takes effect.

    Args:
        repeated: whether an earlier signal is already being handled; if True, all are ignored.
    """
    arrived: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {n: signal.signal(n, lambda number, _: arrived.append(number)) for n in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    if arrived and not repeated:
        signal.raise_signal(signal.Signals(arrived[0]))


def wait_for(process: RunningProcess, timeout: float = 0.05) -> int | None:
    """Return the exit code of a process; None if it still runs after `timeout` [s]."""
    deadline = time.monotonic() + timeout
    while process.returncode is None and time.monotonic() < deadline:
        time.sleep(min(timeout, 0.02))
    return process.returncode
