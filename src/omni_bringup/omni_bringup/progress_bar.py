"""A bar on the terminal for commands that take long."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(name: str) -> Iterator[Callable[[float, str], None]]:
    """Show a bar on standard error, where that is a terminal, once something is reported.

    Args:
        name: of what is going on, until the first report.

    Yields:
        What takes the share done, 0..1, and a few words about it.
    """
    if not sys.stderr.isatty():
        yield lambda _share, _words: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=1.0, visible=False)

        def report(share: float, words: str) -> None:
            bar.update(task, completed=share, description=words, visible=True)

        yield report
