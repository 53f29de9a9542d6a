"""Selection of the driver's demands: from a page or `cmd_vel`, with a dead man's switch.

Both a page in a browser and a publisher of `cmd_vel` (a teleoperation node) may send demands. An
open page has priority; while it demands neither motion nor braking, `cmd_vel` is used. The vehicle
brakes fully

- until one of these two sources sends its first demand,
- while a page is open but sends nothing (hidden tab, halted browser, lost connection),
- after a page was closed, until a page opens again or a zero `cmd_vel` is received, so that a
  teleoperation node takes over only after a deliberate stop,
- if no page is open and no `cmd_vel` is received, so that a teleoperation key must be held down.
"""

import dataclasses
import math

Twist = tuple[float, float, float]  # forward, left [m/s], counter-clockwise [rad/s]

REST: Twist = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Demand:
    """Demand of the driver and its source.

    Attributes:
        pedal: position of the brake pedal, 0 to 1.
        twist: demanded body twist (v_x, v_y, yaw rate) [m/s, m/s, rad/s].
        source: `page` (the page in the browser), `cmd_vel` or `none`.
    """

    pedal: float
    twist: Twist
    source: str


_NO_SOURCE = Demand(1.0, REST, "none")


class DemandSource:
    """Selects the source of the driver's demands: a page in the browser, `cmd_vel`, or none.

    Args:
        page_timeout: time without a demand from an open page after which the vehicle brakes [s].
        command_timeout: time without a `cmd_vel` message after which the last one is ignored [s].
    """

    def __init__(self, page_timeout: float, command_timeout: float) -> None:
        self._page_timeout = page_timeout
        self._command_timeout = command_timeout
        self._page_open = False
        self._page_left = False
        self._page_time = -math.inf
        self._page = _NO_SOURCE
        self._command: Twist = REST
        self._command_time = -math.inf

    def open_page(self) -> None:
        """Record that a page was opened; the vehicle brakes until the first demand of this page."""
        self._page_open, self._page_left = True, False
        self._page_time = -math.inf

    def close_page(self) -> None:
        """Record that the page was closed; it is no longer the source of demands."""
        self._page_open, self._page_left = False, True

    def take_page(self, pedal: float, twist: Twist, now: float) -> None:
        """Store a demand that the page has sent.

        Args:
            pedal: position of the brake pedal, 0 to 1.
            twist: demanded body twist (v_x, v_y, yaw rate) [m/s, m/s, rad/s].
            now: time at which the demand arrived, on the monotonic clock [s].
        """
        self._page = Demand(pedal, twist, "page")
        self._page_time = now

    def take_command(self, twist: Twist, now: float) -> None:
        """Store a twist from `cmd_vel` that arrived at `now` [s]; ignore it if it is not finite."""
        if not all(math.isfinite(value) for value in twist):
            return
        self._command, self._command_time = twist, now
        if twist == REST:
            self._page_left = False

    def demand(self, now: float) -> Demand:
        """Return the demand that is valid at the time `now` of the monotonic clock [s]."""
        commanded = now - self._command_time <= self._command_timeout
        if self._page_open:
            if now - self._page_time > self._page_timeout:
                return _NO_SOURCE
            if self._page.pedal == 0.0 and self._page.twist == REST and commanded:
                return Demand(0.0, self._command, "cmd_vel")
            return self._page
        if commanded and not self._page_left:
            return Demand(0.0, self._command, "cmd_vel")
        return _NO_SOURCE
