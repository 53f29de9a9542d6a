"""Status of a node, which is published on `/diagnostics` at every change and periodically."""

import dataclasses
import time
from collections.abc import Hashable, Mapping

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from omni_core.configuration import Configuration, parameter
from omni_core.quantities import SECOND_NS
from omni_core.topics import DIAGNOSTICS
from omni_ros import messages, parameters, qos

OK, WARN, ERROR = range(3)  # levels
_SILENCE = 1.0  # s; time without an update after which a status is outdated


class StatusConfiguration(Configuration):
    """Period with which a node publishes its status."""

    diagnostics_period: float = parameter(0.5, unit="s", minimum=0.0, maximum=60.0)
    """Wall-clock period of /diagnostics; 0 to use the stamps of the inputs instead, for
    bit-identical runs"""


@dataclasses.dataclass(frozen=True)
class Status:
    """Health of a node: severity, description and details.

    Attributes:
        level: 0 OK, 1 warning, 2 error.
        message: one line of text.
        values: details as texts, keyed by name.
    """

    level: int
    message: str
    values: Mapping[str, str] = dataclasses.field(default_factory=dict)


def steady_clock() -> Clock:
    """Return a clock for watchdog timers; it also runs while simulated time is paused."""
    return Clock(clock_type=ClockType.STEADY_TIME)


class StatusReporter:
    """Publishes the status of a node.

    Unless `diagnostics_period` is 0, a timer with a monotonic clock also publishes the status, even
    before the first update and while simulated time is paused.

    Args:
        node: node that publishes, on which the parameter of `StatusConfiguration` is declared.
        first: status until the first update.
    """

    def __init__(self, node: Node, first: Status) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS.path, qos.RELIABLE)
        self._name = node.get_fully_qualified_name().removeprefix("/")
        self._status = first
        self._key: Hashable = None
        self._published_ns = -1
        self._logged = OK  # last level that was logged
        self._published = False  # whether a status was published since the last timer call
        self._updated: float | None = None  # time of the last update on a monotonic clock [s]
        period = parameters.declare_configuration(node, StatusConfiguration).diagnostics_period
        if period > 0.0:
            node.create_timer(period, self._repeat, clock=steady_clock())

    def update(self, stamp_ns: int, key: Hashable, status: Status) -> None:
        """Set the status; publish it if it has changed, or a second after its last publication.

        Args:
            stamp_ns: stamp of the status [ns].
            key: value whose change means that the status has changed.
            status: the status.
        """
        self._updated = time.monotonic()
        age_ns = stamp_ns - self._published_ns
        changed = key != self._key or self._published_ns < 0
        self._status = status
        # An unchanged status is published again after a second, for subscribers that join later.
        if changed or not 0 <= age_ns < SECOND_NS:
            if changed and key != self._key:
                self._log(status)
            self._key = key
            self._published_ns = stamp_ns
            self._publish(stamp_ns, status)

    def _log(self, status: Status) -> None:
        """Log a warning when a fault begins, and a message when it ends."""
        if status.level > OK:
            self._node.get_logger().warning(status.message)
        elif self._logged > OK:
            self._node.get_logger().info(status.message)
        self._logged = status.level

    def _repeat(self) -> None:
        silence = 0.0 if self._updated is None else time.monotonic() - self._updated
        if silence > _SILENCE:
            words = f"no input for {silence:.0f} s; last status: {self._status.message}"
            self._publish(
                self._now_ns(), dataclasses.replace(self._status, level=ERROR, message=words)
            )
        elif not self._published:
            self._publish(self._now_ns(), self._status)
        self._published = False

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _publish(self, stamp_ns: int, status: Status) -> None:
        self._published = True
        self._publisher.publish(
            messages.diagnostics(stamp_ns, self._name, status.level, status.message, status.values)
        )
