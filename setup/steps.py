"""The steps of the set-up: programs whose output goes to the log."""

from __future__ import annotations

import ctypes
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence

from setup.pythons import say
from setup.workspace import Workspace

# What the stages take of the whole on two cores, with packages that come fast [1].
_SHARES = {"installing": 0.4, "building": 0.2, "compiling": 0.4}

_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
_LIBC = ctypes.CDLL(None)  # loaded here: a child between fork and exec should not


def _end_with_parent() -> None:
    """Ask the kernel for SIGTERM when the process that started this one dies."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


class Steps:
    """Runs one program after the other, under the exclusive lock."""

    def __init__(self, workspace: Workspace, lock: int | None, first: str) -> None:
        """Begin.

        Args:
            workspace: to make ready.
            lock: that is held.
            first: verb of the first stage; the stages before it are complete.
        """
        self.workspace = workspace
        self.lock = lock
        self.live = sys.stderr.isatty()
        verbs = list(_SHARES)
        self._todo = verbs[verbs.index(first) :]
        self._stages: list[tuple[str, float]] = []  # and when each began
        workspace.log.write_text("")

    def stage(self, words: str) -> None:
        """Print the next stage, which begins with a verb of `_SHARES`, and the completed share."""
        verb, total = words.split(maxsplit=1)[0], sum(_SHARES[verb] for verb in self._todo)
        done = sum(_SHARES[before] for before in self._todo[: self._todo.index(verb)])
        self._stages.append((words, time.monotonic()))
        say(f"{done / total:3.0%} {words}")

    def summary(self) -> str:
        """Return the duration of all stages, and the longest stage."""
        ends = [begin for _, begin in self._stages[1:]] + [time.monotonic()]
        took = {words: end - begin for (words, begin), end in zip(self._stages, ends, strict=True)}
        longest = max(took, key=lambda words: took[words])
        whole = ends[-1] - self._stages[0][1]
        return f"ready after {whole:.0f} s; longest: {longest}, {took[longest]:.0f} s"

    def start(
        self, command: Sequence[object], environment: Mapping[str, str]
    ) -> subprocess.Popen[str]:
        """Start a command, for `finish`.

        Args:
            command: Program and arguments.
            environment: All its variables.
        """
        # The child inherits the lock: should this process be killed, it is asked to end, and the
        # next start waits until it has before it touches the same folders.
        return subprocess.Popen(
            [str(word) for word in command],
            env=environment,
            cwd=str(self.workspace.root),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            universal_newlines=True,
            errors="replace",
            pass_fds=[self.lock] if self.lock is not None else [],
            preexec_fn=_end_with_parent,  # noqa: PLW1509 - there is one thread
        )

    def finish(
        self, program: subprocess.Popen[str], note: Callable[[str], str | None] = lambda _: None
    ) -> tuple[int, str]:
        """Wait for the end of a program, with its output in the log; return exit code and output.

        Args:
            program: of `start`.
            note: Turns a line of output into the progress to show after the step, if any.
        """
        output = []
        with open(self.workspace.log, "a", errors="replace") as log, program:
            log.write("$ {}\n".format(" ".join(map(str, program.args))))  # type: ignore[arg-type]
            log.flush()
            try:
                for line in program.stdout or ():
                    log.write(line)
                    output.append(line)
                    self.show(note(line.rstrip()))
            except BaseException:
                program.terminate()
                raise
            finally:
                self.show("")
            log.write(f"[exit code {program.wait()}]\n")
        return program.returncode, "".join(output)

    def run(
        self,
        command: Sequence[object],
        environment: Mapping[str, str],
        note: Callable[[str], str | None] = lambda _: None,
    ) -> tuple[int, str]:
        """Do `start` and `finish`."""
        return self.finish(self.start(command, environment), note)

    def show(self, progress: str | None) -> None:
        """Overwrite the live line on a terminal; an empty one wipes it."""
        if self.live and progress is not None:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write("\r\x1b[K" + (progress and "omni:   " + progress)[:width])
            sys.stderr.flush()
