"""Quality of service of the graph's topics, and topics whose service users may override."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

# Deep enough that a recorder which stalls for two seconds at 100 Hz loses nothing.
RELIABLE = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=200, reliability=ReliabilityPolicy.RELIABLE
)

# Hears cameras whose drivers offer best effort too, as sensor drivers do; may lose lines.
BEST_EFFORT = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=20, reliability=ReliabilityPolicy.BEST_EFFORT
)

# For what is said once: whoever comes later still gets it.
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def advertise(node: Node, kind: Any, topic: str, qos: QoSProfile = RELIABLE) -> Publisher:
    """Return a publisher whose history, depth and reliability are parameters of the node too.

    They are named ``qos_overrides./TOPIC.publisher.depth`` and so on, as ROS has them.
    """
    overridable = QoSOverridingOptions.with_default_policies()
    return node.create_publisher(kind, topic, qos, qos_overriding_options=overridable)


def listen(
    node: Node, kind: Any, topic: str, take: Callable[[Any], None], qos: QoSProfile = RELIABLE
) -> Subscription:
    """Return a subscription whose service is a parameter likewise, ``...subscription.depth``."""
    overridable = QoSOverridingOptions.with_default_policies()
    return node.create_subscription(kind, topic, take, qos, qos_overriding_options=overridable)
