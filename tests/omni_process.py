"""The command line as a separate process, as the launcher starts it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any
from unittest import mock

from omni_bringup.cli import main
from omni_core.commands.exit_codes import ExitCode
from omni_ros.start import NODES

WORKSPACE = Path(__file__).resolve().parents[1]
RUN_TIMEOUT = 240.0  # [s] a run takes seconds; this only ends one that hangs
_STARTED: set[str] = set()


def omni_command(arguments: Sequence[str]) -> list[str]:
    """Return the command of ``./omni ARGUMENTS``."""
    return [sys.executable, "-m", "omni_bringup.cli", *arguments]


def omni_environment() -> dict[str, str]:
    """Return the environment of the command."""
    return {**os.environ, "OMNI_WORKSPACE": str(WORKSPACE)}


def omni(arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end; only its first run shows that it can be started as a process."""
    if arguments[0] in _STARTED:
        return omni_here(arguments)
    _STARTED.add(arguments[0])
    return subprocess.run(
        omni_command(arguments),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT,
        check=False,
        env=omni_environment(),
    )


def omni_here(arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, which has imported its modules already.

    Ctrl-C ends the tests, not only the command.
    """
    workspace = mock.patch.dict(os.environ, {"OMNI_WORKSPACE": str(WORKSPACE)})
    signals = mock.patch("omni_bringup.cli.leave_at_once_on_signals")
    # Files, because the processes of a command may write to them as well.
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        with redirect_stdout(out), redirect_stderr(errors), workspace, signals:
            try:
                main(list(arguments))
            except SystemExit as ended:
                code = int(ended.code or 0)
        if code == ExitCode.INTERRUPTED:
            raise KeyboardInterrupt
        out.seek(0)
        errors.seek(0)
        return subprocess.CompletedProcess(arguments, code, out.read(), errors.read())


def disturbed(
    arguments: Sequence[str], folder: Path, size: float, disturb: Callable[[], None]
) -> subprocess.CompletedProcess[str] | None:
    """Run a command in this process, which `disturb` disturbs once the recorders have written.

    Args:
        arguments: words of the command.
        folder: folder of its results.
        size: number of bytes after which it is disturbed.
        disturb: function that disturbs the nodes, which this process has started.

    Returns:
        The finished command; None if it had ended before the disturbance.
    """
    ended, reached = threading.Event(), threading.Event()

    def wait() -> None:
        wait_until(lambda: recorded_bytes(folder) > size or ended.is_set())
        if not ended.is_set():
            reached.set()
            disturb()

    thread = threading.Thread(target=wait)
    thread.start()
    try:
        finished = omni_here(arguments)
    finally:
        ended.set()
        thread.join()
    return finished if reached.is_set() else None


@contextlib.contextmanager
def running(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Run a process whose errors can be read; kill it at the end of the ``with`` block."""
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **options) as process:
        try:
            yield process
        finally:
            process.kill()  # its children may hold the pipe open, so nothing waits for its end


def run_process(
    folder: Path, *words: str
) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    """Run ``omni run`` with its results in a folder; kill it at the end of the ``with`` block."""
    return running(omni_command(["run", *words, "--out", str(folder)]), env=omni_environment())


@contextlib.contextmanager
def drive_process(recording: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """Run ``omni drive`` without cameras; it prints its address, and may record to a folder."""
    plain = ["--set", "feedback=velocity_sensor", "--set", "simulation.render_lines=false"]
    out = [] if recording is None else ["--out", str(recording)]
    process = subprocess.Popen(
        omni_command(["drive", *plain, *out]),
        env=omni_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=RUN_TIMEOUT)


def node_processes(session_of: int) -> list[int]:
    """Return the IDs of the processes that the bring-up process `session_of` has started."""
    mark = f"OMNI_PARENT_PID={session_of}".encode()
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and mark in (entry / "environ").read_bytes().split(b"\0"):
                found.append(int(entry.name))
        except OSError:
            continue  # it has just ended, or is not ours
    return found


def wait_until(condition: Callable[[], bool], timeout: float = RUN_TIMEOUT) -> None:
    """Poll until the condition holds; fail after `timeout` [s]."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)


def recorded_bytes(folder: Path) -> int:
    """Return the number of bytes that the recorders of a run have written so far."""
    return sum(path.stat().st_size for path in folder.glob("*/*.mcap"))


def processes_of(package: str, session_of: int, executable: str = "") -> list[int]:
    """Return the IDs of the processes of a bring-up that run an executable of a package.

    Args:
        package: package of the executable.
        session_of: ID of the bring-up process.
        executable: start of the file name; empty for every executable of the package.
    """
    names = {
        entry.name[:15]  # the kernel keeps 15 characters
        for entry in entry_points(group=NODES)
        if entry.module.startswith(f"{package}.") and entry.name.startswith(executable)
    }
    return [
        pid
        for pid in node_processes(session_of)
        if Path(f"/proc/{pid}/comm").read_text().strip() in names
    ]


def run_notebook(text: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the code of a notebook as a program, so that its classes are found in __main__.

    Args:
        text: contents of the notebook's file.
        folder: working directory of the program.
    """
    cells = json.loads(text)["cells"]
    return subprocess.run(
        [sys.executable, "-"],
        input="\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code"),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT,
        check=False,
        env=omni_environment() | {"MPLBACKEND": "Agg"},
    )
