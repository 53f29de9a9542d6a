"""Server of the driving page: files over HTTP, demands and state over a WebSocket.

Unless another address is given, the page can be reached only from this machine. In any case, a
request must contain the random token in the page's address. Another page in the same browser does
not know the token and has another origin. A page whose host name was rebound to this address (DNS
rebinding) still sends its own host name, and is rejected for this reason.
"""

import enum
import hmac
import http
import importlib.resources
import json
import math
import secrets
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any, NamedTuple

from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Origin

from omni_tools.drive.demand_source import DemandSource, Twist

_FILES = {
    "": ("index.html", "text/html; charset=utf-8"),
    "drive.js": ("drive.js", "text/javascript; charset=utf-8"),
    "drive.css": ("drive.css", "text/css; charset=utf-8"),
}
_SOCKET = "socket"


class CloseCode(enum.IntEnum):
    """Reasons why the server closes the connection to a page (RFC 6455, 7.4)."""

    INVALID_DATA = 1007
    TAKEN_OVER = 4001
    """Codes of applications begin at 4000"""


class PageError(ValueError):
    """The page sent an invalid message."""


class Demand(NamedTuple):
    """Demand in a message that the page has sent.

    Attributes:
        pedal: position of the brake pedal, 0 to 1.
        stick: deflection of the stick (forward, left, counter-clockwise), each -1 to 1.
        assist: requested position of the assist switch; None if none is requested.
        reset: identifier of a requested reset to the start; None if none is requested.
        choose: kind and name of a newly chosen item, such as a ground; None without a new choice.
    """

    pedal: float
    stick: Twist
    assist: bool | None = None
    reset: int | None = None
    choose: tuple[str, str] | None = None


def parse_demand(text: str | bytes) -> Demand:
    """Return the demand in a message of the page.

    Args:
        text: JSON such as ``{"pedal": 0, "stick": [1, 0, 0]}``, optionally with ``"assist": true``,
            ``"reset": 1`` and ``"choose": ["ground", "cork"]``.

    Raises:
        PageError: the text is not a message of this form.
    """
    try:
        document = json.loads(text)
        pedal = _within(document["pedal"], 0.0)
        forward, left, turn = (_within(value, -1.0) for value in document["stick"])
        assist, reset, choose = map(document.get, ("assist", "reset", "choose"))
    except Exception as error:  # a page may send anything
        raise PageError(f"not a demand: {type(error).__name__}") from None
    if not (assist is None or isinstance(assist, bool)):
        raise PageError("not a demand: assist")
    if not (reset is None or type(reset) is int):
        raise PageError("not a demand: reset")
    if choose is not None:
        if not (isinstance(choose, list) and [type(word) for word in choose] == [str, str]):
            raise PageError("not a demand: choose")
        choose = (choose[0], choose[1])
    return Demand(pedal, (forward, left, turn), assist, reset, choose)


def _within(value: Any, lowest: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    if not math.isfinite(value):
        raise ValueError
    return min(max(float(value), lowest), 1.0)


class DriveServer:
    """Serves the driving page; opening a second page closes the connection to the first one.

    Attributes:
        url: address of the page, including its token.
    """

    def __init__(
        self,
        source: DemandSource,
        *,
        largest: Twist,
        greeting: Mapping[str, Any],
        receive: Callable[[Demand], None],
        token: str,
        clock: Callable[[], float],
        address: tuple[str, int] = ("127.0.0.1", 0),
    ) -> None:
        """Open the port at which the page is served.

        Args:
            source: selector of the demand source.
            largest: body twist at full deflection of the page's stick [m/s, m/s, rad/s].
            greeting: first message sent to a page when it opens.
            receive: function that is called with each demand of the page.
            token: token in the address; empty for a random token.
            clock: function that returns a monotonic time [s].
            address: IP address of this machine, and TCP port; 0 for any free port.

        Raises:
            OSError: the port is in use.
        """
        self._source = source
        self._largest = largest
        self._greeting = json.dumps(greeting)
        self._receive = receive
        self._clock = clock
        self._driver: ServerConnection | None = None
        self._token = token or secrets.token_urlsafe(24)
        host = address[0]
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server(address, family=family)
        port = self._listener.getsockname()[1]
        self._address = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self.url = f"http://{self._address}/{self._token}/"

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Serve the page until the ``with`` block is left."""
        async with serve(
            self._drive,
            sock=self._listener,
            origins=[Origin(f"http://{self._address}")],
            process_request=self._answer,
            max_size=1024,
            compression=None,
            server_header=None,
            close_timeout=1.0,
        ):
            yield

    def show(self, state: Mapping[str, Any]) -> None:
        """Send the state of the vehicle to the page if a page is open."""
        if self._driver is not None:
            broadcast([self._driver], json.dumps(state, allow_nan=False))

    async def _drive(self, page: ServerConnection) -> None:
        before, self._driver = self._driver, page
        self._source.open_page()
        if before is not None:
            await before.close(CloseCode.TAKEN_OVER, "another page has taken over")
        try:
            await page.send(self._greeting)
            async for text in page:
                if page is self._driver:
                    self._take(text)
        except PageError as error:
            await page.close(CloseCode.INVALID_DATA, str(error))
        except ConnectionClosed:
            pass  # there was no closing handshake, for example because the browser was killed
        finally:
            if page is self._driver:
                self._driver = None
                self._source.close_page()

    def _take(self, text: str | bytes) -> None:
        demand = parse_demand(text)
        stick = demand.stick
        # Two keys pressed together give a stick of length 1.41. Diagonal motion must not be faster
        # than straight motion.
        reach = max(1.0, math.hypot(stick[0], stick[1]))
        twist = (
            stick[0] / reach * self._largest[0],
            stick[1] / reach * self._largest[1],
            stick[2] * self._largest[2],
        )
        self._source.take_page(demand.pedal, twist, self._clock())
        self._receive(demand)

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Return the response to a request (a file or an error); None to open the WebSocket."""
        if request.headers.get_all("Host") != [self._address]:
            return self._response(http.HTTPStatus.MISDIRECTED_REQUEST)
        path = request.path.partition("?")[0]
        token, _slash, name = path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return self._response(http.HTTPStatus.FORBIDDEN)
        if name == _SOCKET:
            return None
        if name not in _FILES:
            return self._response(http.HTTPStatus.NOT_FOUND)
        file, kind = _FILES[name]
        page = importlib.resources.files(__package__) / "page" / file
        return self._response(http.HTTPStatus.OK, page.read_bytes(), kind)

    def _response(
        self, status: http.HTTPStatus, body: bytes = b"", kind: str = "text/plain; charset=utf-8"
    ) -> Response:
        headers = Headers(
            {
                "Content-Type": kind,
                "Content-Length": str(len(body)),
                "Connection": "close",
                "Cache-Control": "no-store",
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
                "Content-Security-Policy": "default-src 'none'; script-src 'self'; "
                f"style-src 'self'; connect-src 'self' ws://{self._address}; img-src data:; "
                "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
            }
        )
        return Response(status.value, status.phrase, headers, body)
