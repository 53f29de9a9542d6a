"""Steps of the set-up, each of which is a program whose output goes to the log."""

import os
import select
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import IO

from setup import failures
from setup.pythons import say
from setup.workspace import Workspace

_PAUSE = 4.0  # shortest time between two lines of progress [s]
_CHUNK = 65536  # most output that is read at once [B]


def _lines(stream: IO[bytes]) -> Iterator[str]:
    """Yield the lines of a stream, and an empty text after each `_PAUSE` without a line."""
    rest, chunk = b"", b"\n"
    while chunk:
        if select.select([stream], [], [], _PAUSE)[0]:
            chunk = os.read(stream.fileno(), _CHUNK)
            *whole, rest = (rest + chunk).split(b"\n")
            yield from (line.decode(errors="replace") + "\n" for line in whole)
        else:
            yield ""
    yield rest.decode(errors="replace")


class Steps:
    """Runs one program after the other while the exclusive lock is held."""

    def __init__(self, workspace: Workspace, lock: int | None) -> None:
        """Store workspace and lock, and open the log.

        Args:
            workspace: workspace to make ready.
            lock: descriptor of the lock that this process holds; None without a lock file.
        """
        self.workspace = workspace
        self.lock = lock
        workspace.log.write_text("")

    def check(
        self,
        command: Sequence[object],
        environment: Mapping[str, str],
        doing: str,
        note: Callable[[str], str | None] = lambda _: None,
    ) -> None:
        """Run a program with its output in the log, and say every few seconds what it does.

        Args:
            command: Program and arguments.
            environment: All environment variables of the program.
            doing: What the program does at first, for messages.
            note: Function that returns what it does after a line of output; None for no change.

        Raises:
            SetupError: The program failed; the message explains its output.
        """
        words = [str(word) for word in command]
        output: list[str] = []
        begun = shown = time.monotonic()
        progress = doing
        with open(self.workspace.log, "a", errors="replace") as log:
            log.write("$ {}\n".format(" ".join(words)))
            log.flush()
            # The child inherits the lock. If this process is killed, the next start waits for the
            # end of the child before it changes the same folders.
            with subprocess.Popen(
                words,
                env=environment,
                cwd=str(self.workspace.root),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=[self.lock] if self.lock is not None else [],
            ) as program:
                assert program.stdout  # a pipe
                try:
                    for line in _lines(program.stdout):
                        log.write(line)
                        output.append(line)
                        progress = note(line.rstrip()) or progress
                        if time.monotonic() - shown >= _PAUSE:
                            shown = time.monotonic()
                            say(f"  {progress}, {shown - begun:.0f} s")
                except BaseException:
                    program.terminate()
                    raise
            log.write(f"[exit code {program.returncode}]\n")
        if program.returncode:
            raise failures.SetupError(
                failures.explain_install("".join(output), self.workspace.log, progress)
            )
