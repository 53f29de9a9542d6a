"""Who drives, and what the vehicle does when nobody does: the dead man's switch.

A page in a browser and a `cmd_vel` publisher (a teleoperation node) may both speak. Full braking
holds

- until one of them does,
- while a page is open and silent: a hidden tab, a halted browser, a lost connection,
- once a page has been closed, until a page opens again or `cmd_vel` has said zero: who drives on
  by `cmd_vel` must mean it,
- without a page, when `cmd_vel` has fallen silent: keep the key down.
"""

from __future__ import annotations

import dataclasses
import math

Twist = tuple[float, float, float]  # forward, left [m/s], counter-clockwise [rad/s]

FULL_BRAKING = 1.0
REST: Twist = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Demand:
    """What is asked of the vehicle, and why.

    Attributes:
        pedal: brake pedal, 0..1.
        twist: body twist (v_x, v_y, yaw rate) [m/s, m/s, rad/s].
        source: page, cmd_vel or nobody.
    """

    pedal: float
    twist: Twist
    source: str


_NOBODY = Demand(FULL_BRAKING, REST, "nobody")


class DriverSeat:
    """Decides whose demand holds.

    Args:
        page_timeout: silence of an open page after which the vehicle brakes [s].
        command_timeout: silence of `cmd_vel` after which it no longer counts [s].
    """

    def __init__(self, page_timeout: float, command_timeout: float) -> None:
        self._page_timeout = page_timeout
        self._command_timeout = command_timeout
        self._page_open = False
        self._page_left = False
        self._page_time = -math.inf
        self._page = _NOBODY
        self._command: Twist = REST
        self._command_time = -math.inf

    def open_page(self) -> None:
        """Let a page take the seat; it counts from its first demand on."""
        self._page_open, self._page_left = True, False
        self._page_time = -math.inf

    def close_page(self) -> None:
        """Take the page out of the seat."""
        self._page_open, self._page_left = False, True

    def take_page(self, pedal: float, twist: Twist, now: float) -> None:
        """Take the demand of the page.

        Args:
            pedal: brake pedal, 0..1.
            twist: body twist [m/s, m/s, rad/s].
            now: time of arrival [s], on a clock that only goes forward.
        """
        self._page = Demand(pedal, twist, "page")
        self._page_time = now

    def take_command(self, twist: Twist, now: float) -> None:
        """Take a `cmd_vel`; one that is no number counts as none."""
        if not all(math.isfinite(value) for value in twist):
            return
        self._command, self._command_time = twist, now
        if twist == REST:
            self._page_left = False

    def demand(self, now: float) -> Demand:
        """Return what holds at a time [s]."""
        commanded = now - self._command_time <= self._command_timeout
        if self._page_open:
            if now - self._page_time > self._page_timeout:
                return _NOBODY
            if self._page.pedal == 0.0 and self._page.twist == REST and commanded:
                return Demand(0.0, self._command, "cmd_vel")
            return self._page
        if commanded and not self._page_left:
            return Demand(0.0, self._command, "cmd_vel")
        return _NOBODY
