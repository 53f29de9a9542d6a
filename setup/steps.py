"""The steps of the set-up: programs whose output goes to the log."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence

from setup.workspace import Workspace


class Steps:
    """Runs one program after the other, under the exclusive lock."""

    def __init__(self, workspace: Workspace, lock: int | None) -> None:
        self.workspace = workspace
        self.lock = lock
        self.live = sys.stderr.isatty()
        workspace.log.write_text("")

    def run(
        self,
        command: Sequence[object],
        environment: Mapping[str, str],
        note: Callable[[str], str | None] = lambda _: None,
    ) -> tuple[int, str]:
        """Run a command with its output in the log; return its exit code and output.

        Args:
            command: Program and arguments.
            environment: All its variables.
            note: Turns a line of output into the progress to show after the step, if any.
        """
        words = [str(word) for word in command]
        output = []
        with open(self.workspace.log, "a", errors="replace") as log:
            log.write("$ {}\n".format(" ".join(words)))
            log.flush()
            # The child inherits the lock: should this process be killed, the next start waits
            # until the child has ended before it touches the same folders.
            with subprocess.Popen(
                words,
                env=environment,
                cwd=str(self.workspace.root),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                universal_newlines=True,
                errors="replace",
                pass_fds=[self.lock] if self.lock is not None else [],
            ) as process:
                try:
                    for line in process.stdout or ():
                        log.write(line)
                        output.append(line)
                        self.show(note(line.rstrip()))
                except BaseException:
                    process.terminate()
                    raise
                finally:
                    self.show("")
            log.write(f"[exit code {process.returncode}]\n")
        return process.returncode, "".join(output)

    def show(self, progress: str | None) -> None:
        """Overwrite the live line on a terminal; an empty one wipes it."""
        if self.live and progress is not None:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write("\r\x1b[K" + (progress and "omni:   " + progress)[:width])
            sys.stderr.flush()
