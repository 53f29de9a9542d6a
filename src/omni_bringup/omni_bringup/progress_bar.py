"""What commands that take long say of themselves on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_EVERY = 5.0  # [s] between lines where there is no terminal


@contextmanager
def progress_bar(name: str) -> Iterator[Callable[[float, str], None]]:
    """Show a bar on a terminal, and a line every few seconds elsewhere.

    Args:
        name: of what is going on, until the first report.

    Yields:
        What takes the share done, 0..1, and a few words about it.
    """
    if not sys.stderr.isatty():
        yield progress_lines(name)
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=1.0, visible=False)

        def report(share: float, words: str) -> None:
            bar.update(task, completed=share, description=words, visible=True)

        yield report


@contextmanager
def at_work(program: str, words: str, every: float = _EVERY) -> Iterator[None]:
    """Say every few seconds that a command that cannot tell its share is still at work.

    Args:
        program: at the beginning of each line.
        words: what it is at.
        every: time between lines [s].
    """
    done = threading.Event()

    def say() -> None:
        begun = time.monotonic()
        while not done.wait(every):
            print(f"{program}: {words}, {time.monotonic() - begun:.0f} s", file=sys.stderr)

    thread = threading.Thread(target=say, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def progress_lines(
    name: str, clock: Callable[[], float] = time.monotonic
) -> Callable[[float, str], None]:
    """Return what prints a line every few seconds; the first after the first of them.

    Args:
        name: at the beginning of each line.
        clock: tells the time [s].
    """
    last = clock()

    def report(share: float, words: str) -> None:
        nonlocal last
        if clock() - last >= _EVERY:
            last = clock()
            print(f"{name}: {100.0 * share:.0f} %, {words}", file=sys.stderr, flush=True)

    return report
