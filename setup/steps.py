"""Steps of the set-up, each of which is a program whose output goes to the log."""

import ctypes
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence

from setup.workspace import Workspace

_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
_LIBC = ctypes.CDLL(None)  # loaded at import, because it must not happen between fork and exec


def _end_with_parent() -> None:
    """Ask the kernel for SIGTERM when the process that started this one dies."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


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
        self.live = sys.stderr.isatty()
        workspace.log.write_text("")

    def run(
        self,
        command: Sequence[object],
        environment: Mapping[str, str],
        note: Callable[[str], str | None] = lambda _: None,
    ) -> tuple[int, str]:
        """Run a program with its output in the log; return exit code and output.

        Args:
            command: Program and arguments.
            environment: All environment variables of the program.
            note: Function that returns the progress text for a line of output; None for no change.
        """
        words = [str(word) for word in command]
        output = []
        with open(self.workspace.log, "a", errors="replace") as log:
            log.write("$ {}\n".format(" ".join(words)))
            log.flush()
            # The child inherits the lock. If this process is killed, the child gets SIGTERM, and
            # the next start waits for its end before it changes the same folders.
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
                preexec_fn=_end_with_parent,  # noqa: PLW1509 - there is one thread
            ) as program:
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
            log.write(f"[exit code {program.returncode}]\n")
        return program.returncode, "".join(output)

    def show(self, progress: str | None) -> None:
        """Overwrite the progress line on a terminal; an empty text clears it."""
        if self.live and progress is not None:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write("\r\x1b[K" + (progress and "omni:   " + progress)[:width])
            sys.stderr.flush()
