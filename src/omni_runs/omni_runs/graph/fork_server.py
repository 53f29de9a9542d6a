"""Start of nodes as forks of a process that has already imported their modules.

The imports take half a second of CPU time in each node. The fork server imports the modules of all
nodes when it starts, and forks itself for every start of a node. The node becomes a child of the
requesting process. It has its own process group, arguments, environment and streams, and `ps` shows
it by its executable, as if ``ros2 run`` had started it. Executables that are not nodes of this
workspace are started as new programs instead.
"""

import contextlib
import ctypes
import functools
import gc
import importlib
import inspect
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from omni_core.configuration import WorkError
from omni_ros.environment import REPORT_VARIABLE
from omni_ros.start import NODES, start_lightly, start_node

_LIBC = ctypes.CDLL(None)
_PR_SET_NAME, _PR_SET_CHILD_SUBREAPER = 15, 36  # <linux/prctl.h>
_LONGEST_REQUEST = 1 << 20  # bytes; requests with their environments are shorter
_COMMAND_LENGTH = 2000  # bytes reserved for the command that `ps` shows
_IMPORTED_LATE = ("numpy.ma", "rosbags.typesys.stores.ros2_jazzy")  # by nodes in their work
# Variables that Python reads only at its start: if they differ, a node is not forked.
_READ_AT_START = ("LD_LIBRARY_PATH", "NUMBA_CACHE_DIR", "PYTHONPATH")


class ForkServer:
    """Interface of this process to its fork server, which ends together with this process."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        module = [sys.executable, "-u", "-m", __name__]
        with other:
            subprocess.Popen(
                [*module, str(other.fileno()), "-" * _COMMAND_LENGTH],
                env=environment,
                pass_fds=(other.fileno(),),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                preexec_fn=os.setpgrp,  # noqa: PLW1509 (process_group= came with Python 3.11)
            )

    def start(
        self, command: Sequence[str], environment: Mapping[str, str], descriptors: Sequence[int]
    ) -> int:
        """Start a program as a child of this process and return its process ID.

        Args:
            command: path of an executable, and arguments.
            environment: environment variables; `REPORT_VARIABLE` is added.
            descriptors: file descriptors for standard input, output, error, and reports.

        Raises:
            WorkError: the server has ended.
        """
        request = {"command": command, "environment": {**environment}, "folder": os.getcwd()}
        with _adopting_orphans():
            socket.send_fds(self._socket, [json.dumps(request).encode()], descriptors)
            answer = self._socket.recv(32)
        if not answer:
            raise WorkError("the process that starts the nodes was ended")
        return int(answer)


@contextlib.contextmanager
def _adopting_orphans() -> Iterator[None]:
    """Make this process, instead of init, the parent of descendants whose parent ends."""
    _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield
    finally:
        _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, 0)


def serve(connection: socket.socket) -> None:
    """Serve as the fork server: start the requested programs until the requesting process ends."""
    before = dict(os.environ)
    for name in (*(entry.module for entry in entry_points(group=NODES)), *_IMPORTED_LATE):
        with contextlib.suppress(Exception):  # the node itself reports the error
            importlib.import_module(name)
    inspect.getframeinfo(sys._getframe())  # finds the files of all modules, as the first log does
    gc.freeze()
    while True:
        data, descriptors, _, _ = socket.recv_fds(connection, _LONGEST_REQUEST, 4)
        if not data:
            return
        request = json.loads(data)
        changed = any(request["environment"].get(v) != before.get(v) for v in _READ_AT_START)
        module = None if changed else node_module(Path(request["command"][0]))
        parent = os.fork()
        if parent == 0:
            parent = os.getpid()
            if os.fork() == 0:  # an orphan as soon as `parent` ends
                while os.getppid() == parent:
                    time.sleep(0.0005)
                connection.send(str(os.getpid()).encode())
                connection.close()
                _become(request, descriptors, module)
            os._exit(0)
        os.waitpid(parent, 0)
        for descriptor in descriptors:
            os.close(descriptor)


@functools.cache
def node_module(executable: Path) -> str | None:
    """Return the module that an executable runs; None if it is no node of this workspace."""
    for entry in entry_points(group=NODES, name=executable.name):
        installed = Path(str(entry.dist.locate_file(""))) if entry.dist else Path()
        if installed.is_relative_to(executable.parents[2]):
            return entry.module
    return None


def _become(request: dict[str, Any], descriptors: Sequence[int], module: str | None) -> None:
    """Run the requested program in this process, which is a new fork of the server.

    Args:
        request: command, folder and environment of the program.
        descriptors: file descriptors for standard input, output, error, and reports.
        module: module of the node; None to start the command as a new program.
    """
    os.setpgid(0, 0)
    for number, descriptor in enumerate(descriptors[:3]):
        os.dup2(descriptor, number)
    reports = descriptors[3]
    os.set_inheritable(reports, True)
    command = request["command"]
    os.environ.clear()
    os.environ.update(request["environment"], **{REPORT_VARIABLE: str(reports)})
    os.chdir(request["folder"])
    if module is None:
        os.execve(command[0], command, os.environ)
    _show(command)
    sys.argv, sys.path[0] = command, str(Path(command[0]).parent)
    start_node(module)


def _show(command: Sequence[str]) -> None:
    """Make `ps` and `pkill` show this command instead of the server's command."""
    # Fields 48 and 49 of proc(5) are the addresses of the first and the last argument's end.
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    start, end = int(fields[45]), int(fields[46])
    words = "\0".join((sys.executable, *command)).encode()[: end - start - 1]
    ctypes.memset(start, 0, end - start)
    ctypes.memmove(start, words, len(words))
    _LIBC.prctl(_PR_SET_NAME, Path(command[0]).name.encode())


if __name__ == "__main__":
    start_lightly()
    serve(socket.socket(fileno=int(sys.argv[1])))
