"""A call of a ROS service that is repeated until a reply confirms the requested value."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

# Time after which a reply counts as lost [s]; DDS may drop one while it connects two nodes. It is
# longer than the delays of a busy machine, because a repeated reset moves the vehicle twice.
_REPLY_TIMEOUT = 5.0


class ConfirmedCall:
    """Requests a value from a service until the service confirms it.

    The service may start later than the request is made, and a reply may be lost.

    Args:
        client: client of the service.
        request: function that returns the request for a value.
        succeeded: function that returns whether a reply confirms its request.
        confirm: function that is called with each confirmed value.

    Attributes:
        wanted: requested value; None if no value is requested, or if the value is confirmed.
    """

    def __init__(
        self,
        client: Any,
        request: Callable[[Any], Any],
        succeeded: Callable[[Any], bool],
        confirm: Callable[[Any], None],
    ) -> None:
        self.wanted: Any = None
        self._client, self._request = client, request
        self._succeeded, self._confirm = succeeded, confirm
        self._next_call = -math.inf

    def advance(self, now: float) -> None:
        """Call the service if a value is requested and no reply to a recent call is awaited.

        Args:
            now: time of the monotonic clock [s].
        """
        if self.wanted is None or now < self._next_call or not self._client.service_is_ready():
            return
        self._next_call = now + _REPLY_TIMEOUT
        future = self._client.call_async(self._request(self.wanted))
        future.add_done_callback(partial(self._on_reply, self.wanted))

    def _on_reply(self, value: Any, future: Any) -> None:
        if not self._succeeded(future.result()):
            return  # it is called again after the timeout
        self._next_call = -math.inf
        self._confirm(value)
        if self.wanted == value:
            self.wanted = None
