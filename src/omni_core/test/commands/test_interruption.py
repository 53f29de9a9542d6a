"""Signals end a command at once, except while it has nodes to end."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from omni_bringup.cli import main

PROGRAM = """
import signal
from omni_core.commands.interruption import clean_up_on_signals, leave_at_once_on_signals
# A shell that starts the tests in the background makes them ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
leave_at_once_on_signals()
try:
    with clean_up_on_signals():
        signal.raise_signal({number})
except (KeyboardInterrupt, SystemExit) as raised:
    print(type(raised).__name__, flush=True)
signal.raise_signal({number})
print("not reached")
"""


@pytest.mark.parametrize(
    ("number", "raised"),
    [(signal.SIGINT, "KeyboardInterrupt"), (signal.SIGTERM, "SystemExit")],
)
def test_signals_raise_an_exception_only_within_the_block(
    number: signal.Signals, raised: str
) -> None:
    program = PROGRAM.format(number=int(number))
    ended = subprocess.run(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, check=False
    )
    assert ended.stdout.split() == [raised]
    assert ended.returncode == 128 + number


def test_a_call_of_main_leaves_the_signals_of_its_process(
    capsys: pytest.CaptureFixture[str],
) -> None:
    signals = (signal.SIGINT, signal.SIGTERM)
    before = [*map(signal.getsignal, signals)]
    with pytest.raises(SystemExit):
        main(["completion"])
    assert "_omni" in capsys.readouterr().out
    assert [*map(signal.getsignal, signals)] == before
