"""Commands that take long report their progress."""

from __future__ import annotations

import io
import threading

import pytest

from omni_core.commands.workspace import at_work


class Listener(io.StringIO):
    """Standard error that records when something was written."""

    def __init__(self) -> None:
        super().__init__()
        self.reported = threading.Event()

    def write(self, text: str) -> int:
        written = super().write(text)
        self.reported.set()
        return written


def test_a_command_at_work_reports_its_progress_until_it_is_done(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    listener = Listener()
    monkeypatch.setattr("sys.stderr", listener)
    with at_work("omni fit-tire", "fitting the tire", every=0.001):
        assert listener.reported.wait(30.0)
    said = listener.getvalue()
    assert said.startswith("omni fit-tire: fitting the tire, ")
