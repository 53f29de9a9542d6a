"""Workspace, the folder whose configuration a command reads, and progress of a command."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

Progress = Callable[[float, str], None]
"""Function that receives the completed share, 0 to 1, and a short text."""


@dataclass(frozen=True)
class Workspace:
    """Folder with `config`, `bags` and `results`, and the command that is run in this folder.

    Attributes:
        folder: path of the workspace.
        program: name of the command, such as ``omni run``, with which its remarks begin.
    """

    folder: Path
    program: str = "omni"

    @property
    def config(self) -> Path:
        """Folder of the configuration files in this workspace."""
        return self.folder / "config"

    def note(self, remark: str) -> None:
        """Print a remark on standard error."""
        print(f"{self.program}: note: {remark}", file=sys.stderr)

    def results(self, out: Path | None, *parts: str) -> Path:
        """Return the folder `out` for results; if it is None, a folder below ``results``."""
        return out or self.folder.joinpath("results", *parts)

    def progress(self) -> AbstractContextManager[Progress]:
        """Return a context manager that shows a progress bar, named after the command."""
        return progress_bar(self.program.split()[-1])


def workspace_folder() -> Path:
    """Return the workspace that the launcher has set; without the launcher, the current folder."""
    return Path(os.environ.get("OMNI_WORKSPACE", "."))


@contextmanager
def progress_bar(name: str) -> Iterator[Progress]:
    """Show a progress bar on a terminal, or lines elsewhere, with the estimated time left.

    Args:
        name: name of the work.

    Yields:
        Function to be called with the completed share (0 to 1) and a text on the progress.
    """
    if not sys.stderr.isatty():
        yield _progress_lines(name)
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=1.0, visible=False)

        def report(share: float, words: str) -> None:
            bar.update(task, completed=share, description=f"{name}: {words}", visible=True)

        yield report


@contextmanager
def at_work(program: str, words: str, every: float = 5.0) -> Iterator[None]:
    """Print every few seconds that a command of unknown duration is still running.

    Args:
        program: program name at the beginning of each line.
        words: description of the work.
        every: time between lines [s].
    """
    done = threading.Event()

    def follow() -> None:
        begun = time.monotonic()
        while not done.wait(every):
            print(f"{program}: {words}, {time.monotonic() - begun:.0f} s", file=sys.stderr)

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def _progress_lines(name: str) -> Progress:
    """Return a function that prints a line with `name`, progress and estimated time left.

    The interval between lines is at least 5 s and a twentieth of the elapsed time.
    """
    begun = last = time.monotonic()

    def report(share: float, words: str) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < max(5.0, 0.05 * (last - begun)):
            return
        last = now
        left = f", about {(now - begun) * (1.0 / share - 1.0):.0f} s left" if share > 0.01 else ""
        print(f"{name}: {100.0 * share:.0f} %, {words}{left}", file=sys.stderr, flush=True)

    return report
