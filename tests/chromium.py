"""A headless Chromium that shows pages, controlled over a pipe by its DevTools protocol.

The pipe needs only the standard library. A client library would need a browser or driver of its own
version.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_TIMEOUT = 60.0  # [s] answers take milliseconds; this only ends what hangs
_REQUIRED = "OMNI_TEST_BROWSER"  # set if a missing browser is an error

Event = dict[str, Any]


class Chromium:
    """One page of a running browser; stores its requests and errors."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read = write, read
        self._rest = b""
        self._number = 0
        self._session = ""
        self.events: list[Event] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        # CPU time of the page, which does not depend on other programs.
        self.call("Performance.enable", timeDomain="threadTicks")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the DevTools protocol and return its result."""
        self._number += 1
        request: Event = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            request["sessionId"] = self._session
        os.write(self._write, json.dumps(request).encode() + b"\0")
        while True:
            message = self._receive()
            if message.get("id") != self._number:
                self.events.append(message)
                continue
            assert "error" not in message, f"{method}: {message['error']}"
            result: dict[str, Any] = message["result"]
            return result

    def open(self, page: Path) -> None:
        """Load a file and wait until page and script are loaded."""
        self.events.clear()
        self.call("Page.navigate", url=page.as_uri())
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._receive())

    def run(self, expression: str) -> Any:
        """Return the value of an expression of JavaScript in the page."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, expression: str) -> None:
        """Wait until an expression becomes true."""
        deadline = time.monotonic() + _TIMEOUT
        while not self.run(expression):
            assert time.monotonic() < deadline, f"timed out: {expression}"
            time.sleep(0.01)

    def press(self, key: str, code: str = "", modifiers: int = 0) -> None:
        """Press and release a key; `modifiers` is 8 with Shift."""
        text = {"text": key} if len(key) == 1 else {}
        common = {"key": key, "code": code or key, "modifiers": modifiers}
        self.call("Input.dispatchKeyEvent", type="keyDown", **common, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def click(self, selector: str, across: float = 0.5) -> None:
        """Click into an element; `across` is the place from its left (0) to its right edge (1)."""
        x, y = self.run(
            f"(e => {{ e.scrollIntoView({{block: 'center'}}); const b = e.getBoundingClientRect();"
            f"return [b.left + {across} * b.width, b.top + b.height / 2]; }})"
            f"(document.querySelector({json.dumps(selector)}))"
        )
        for kind, buttons in (("mousePressed", 1), ("mouseReleased", 0)):
            self.call(
                "Input.dispatchMouseEvent",
                **{"type": kind, "x": x, "y": y, "button": "left", "buttons": buttons},
                clickCount=1,
            )

    def show(self, width: int, height: int, *, dark: bool = False, phone: bool = False) -> None:
        """Set the size of the window [px] and the preferred color scheme."""
        scale = 2 if phone else 1
        size = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": phone}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    @property
    def requests(self) -> list[str]:
        """Addresses that the page has requested since it was opened."""
        found = [e for e in self.events if e.get("method") == "Network.requestWillBeSent"]
        return [event["params"]["request"]["url"] for event in found]

    @property
    def complaints(self) -> list[Event]:
        """Uncaught exceptions and all messages on the console."""
        kinds = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
        return [event for event in self.events if event.get("method") in kinds]

    @property
    def seconds_of_work(self) -> float:
        """CPU time of the page's main thread [s]."""
        metrics = self.call("Performance.getMetrics")["metrics"]
        return float(next(m["value"] for m in metrics if m["name"] == "TaskDuration"))

    def _receive(self) -> Event:
        while b"\0" not in self._rest:
            assert select.select([self._read], [], [], _TIMEOUT)[0], "the browser does not answer"
            data = os.read(self._read, 1 << 16)
            assert data, "the browser has ended"
            self._rest += data
        text, _, self._rest = self._rest.partition(b"\0")
        message: Event = json.loads(text)
        return message


def browser_program() -> str:
    """Return the program of a browser; without one skip the test, unless a browser is required."""
    for program in filter(None, map(shutil.which, _NAMES)):
        return program
    problem = f"there is no {_NAMES[0]}, which shows the page (Debian's package {_NAMES[0]})"
    if os.environ.get(_REQUIRED) == "required":
        pytest.fail(problem)
    pytest.skip(problem)


@contextlib.contextmanager
def chromium() -> Iterator[Chromium]:
    """Start a browser; without one the test is skipped, unless a browser is required."""
    program = browser_program()
    to_browser, from_browser = os.pipe(), os.pipe()
    with tempfile.TemporaryDirectory(prefix="omni-", ignore_cleanup_errors=True) as profile:
        command = [
            program,
            "--headless",
            "--remote-debugging-pipe",
            "--no-sandbox",  # containers and root allow none; the pages are our own
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            "--disable-component-update",
            "--no-first-run",
            f"--user-data-dir={profile}",
        ]
        read, write = to_browser[0], from_browser[1]
        # The browser takes descriptors 3 and 4 for its pipe; a shell is the simplest to move them.
        process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{read} 4>&{write}', "bash", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(read, write),
        )
        os.close(to_browser[0])
        os.close(from_browser[1])
        try:
            yield Chromium(to_browser[1], from_browser[0])
        finally:
            process.kill()
            process.wait()
            os.close(to_browser[1])
            os.close(from_browser[0])
