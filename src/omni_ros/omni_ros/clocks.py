"""Publisher of simulated time, and the clock of a watchdog."""

import time
from collections.abc import Callable

from rclpy.node import Node
from rclpy.publisher import Publisher

from omni_core.topics import CLOCK
from omni_ros.qos import advertise


class SharedClock:
    """Publishes `/clock` only while no other node does, so that the time never decreases.

    If other simulators publish already, this simulator waits until they have ended.

    Args:
        node: the node that publishes.
        alone: whether the ROS domain is known to have no other simulator; the node then publishes
            at once instead of after `discovery`.
        discovery: time in which the nodes of a ROS domain discover each other [s].
        period: time between two checks of the publishers [s].
    """

    def __init__(
        self, node: Node, alone: bool, discovery: float = 0.5, period: float = 0.1
    ) -> None:
        self._node, self._period = node, period
        self._publisher: Publisher | None = advertise(node, CLOCK) if alone else None
        self._due = time.monotonic() + (0.0 if alone else discovery)

    def publisher(self) -> Publisher | None:
        """Return the publisher of `/clock`; None while another node publishes the time."""
        now = time.monotonic()
        if now >= self._due:
            self._due = now + self._period
            self._check_publishers()
        return self._publisher

    def _check_publishers(self) -> None:
        own = (self._node.get_namespace(), self._node.get_name())
        others = sorted(
            (tuple(other.endpoint_gid), other.node_namespace, other.node_name)
            for other in self._node.get_publishers_info_by_topic(CLOCK.path)
        )
        if self._publisher is None and not others:
            self._publisher = advertise(self._node, CLOCK)
        elif others and others[0][1:] != own:
            # Two simulators that start at once see the same order and select the same publisher.
            if self._publisher is not None:
                self._node.destroy_publisher(self._publisher)
                self._publisher = None
            _, namespace, name = others[0]
            self._node.get_logger().warning(
                f"{CLOCK.path} is published by {namespace.rstrip('/')}/{name}, so this "
                "simulator does not publish it",
                once=True,
            )


class RunningClock:
    """Monotonic clock that advances by at most `longest` between two readings.

    If the operating system suspends a process, the messages of that time wait in the queues, and
    the watchdog timer may be due before they are received. With an ordinary monotonic clock, the
    time of the suspension would count as silence of the publishers. A watchdog reads this clock at
    each message and at each tick of its timer. While the process runs, two readings are at most one
    period of the timer apart; a longer interval therefore counts as one period.

    Args:
        longest: limit on the counted time between two readings [s]; the period of the watchdog
            timer.
        steady: function that returns a monotonic time [s].
    """

    def __init__(self, longest: float, steady: Callable[[], float] = time.monotonic) -> None:
        self._longest = longest
        self._steady = steady
        self._read = steady()
        self._time = 0.0

    def now(self) -> float:
        """Return the time for which the process has run since this clock was created [s]."""
        read = self._steady()
        self._time += min(read - self._read, self._longest)
        self._read = read
        return self._time
