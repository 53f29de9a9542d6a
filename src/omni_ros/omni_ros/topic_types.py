"""Detection of publishers whose message type differs from that of a subscription.

The middleware never connects a publisher to a subscription of another type, and reports nothing:
for the subscriber, the topic is silent.
"""

from typing import NamedTuple
from weakref import WeakKeyDictionary

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from omni_core.topics import DIAGNOSTICS
from omni_ros import messages

_PERIOD = 1.0  # time between two checks of the graph [s]


class _Expected(NamedTuple):
    """Message type that a node expects on a topic, and the node's parameter that selects it."""

    kind: str
    parameter: str


class _TypeWatch:
    """Compares the types of all publishers on the topics of a node with the expected types.

    While they differ, the watch publishes a status of its own on `/diagnostics`.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher: Publisher | None = None
        self._problem = ""
        self.expected: dict[str, _Expected] = {}
        node.create_timer(_PERIOD, self._check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _check(self) -> None:
        before = self._problem
        self._problem = "; ".join(filter(None, map(self._problem_of, self.expected)))
        if self._problem and self._problem != before:
            self._node.get_logger().error(self._problem)
        if self._problem or before:
            if self._publisher is None:
                self._publisher = self._node.create_publisher(DiagnosticArray, DIAGNOSTICS.path, 10)
            stamp_ns = self._node.get_clock().now().nanoseconds
            name = f"{self._node.get_fully_qualified_name().removeprefix('/')}: topic types"
            level, words = (2, self._problem) if self._problem else (0, "as expected")
            self._publisher.publish(messages.diagnostics(stamp_ns, name, level, words, {}))

    def _problem_of(self, topic: str) -> str:
        kind, parameter = self.expected[topic]
        publishers = self._node.get_publishers_info_by_topic(topic)
        others = {(p.topic_type, p.node_name) for p in publishers if p.topic_type != kind}
        if not others:
            return ""
        found = " and ".join(f"{other} by node {name}" for other, name in sorted(others))
        selected = f"correct the parameter {parameter} or" if parameter else "correct or remap"
        return f"{topic} is published as {found}, must be {kind}: {selected} the publisher"


_watches: WeakKeyDictionary[Node, _TypeWatch] = WeakKeyDictionary()


def watch_type(node: Node, subscription: Subscription, kind: str, parameter: str) -> None:
    """Report publishers of another type on `/diagnostics` and in the log, as long as they exist.

    Args:
        node: node with the subscription.
        subscription: the subscription.
        kind: message type of the subscription, such as ``geometry_msgs/msg/Twist``.
        parameter: name of the node's parameter that selects the type; empty if none does.
    """
    if node not in _watches:
        _watches[node] = _TypeWatch(node)
    _watches[node].expected[subscription.topic_name] = _Expected(kind, parameter)
