"""Quality of service of the topics, with parameters to override it."""

from collections.abc import Callable
from copy import copy
from typing import Any

from rclpy import qos as policies
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from omni_core.topics import Topic
from omni_ros.messages import message_class
from omni_ros.topic_types import watch_type

# All profiles keep the newest messages and are reliable unless stated otherwise. At 100 Hz, a
# recorder may stall for two seconds without a loss.
RELIABLE = policies.QoSProfile(depth=200)
# For topics of which only the newest message is used; a halted node then has 0.1 s to process.
RECENT = policies.QoSProfile(depth=10)
# Also compatible with best-effort publishers, such as most sensor drivers; lines may be lost.
BEST_EFFORT = policies.QoSProfile(depth=20, reliability=policies.ReliabilityPolicy.BEST_EFFORT)
# For messages that are published once; subscribers that join later receive them too.
LATCHED = policies.QoSProfile(depth=1, durability=policies.DurabilityPolicy.TRANSIENT_LOCAL)
# Policies that parameters may set; deadline and liveliness report a silent node to other nodes.
_OVERRIDABLE = (
    policies.QoSPolicyKind.HISTORY,
    policies.QoSPolicyKind.DEPTH,
    policies.QoSPolicyKind.RELIABILITY,
    policies.QoSPolicyKind.DEADLINE,
    policies.QoSPolicyKind.LIVELINESS,
    policies.QoSPolicyKind.LIVELINESS_LEASE_DURATION,
)


def advertise(node: Node, topic: Topic) -> Publisher:
    """Return a publisher whose quality of service can be overridden by parameters.

    The names of the parameters are those of ROS, such as ``qos_overrides./TOPIC.publisher.depth``.
    The policies are history, depth, reliability, liveliness, deadline [ns] and
    liveliness_lease_duration [ns].
    """
    # rclpy writes the parameters into the profile, which other topics share.
    profile = copy(LATCHED if topic.latched else RELIABLE)
    options = QoSOverridingOptions(_OVERRIDABLE)
    kind = message_class(topic.type)
    return node.create_publisher(kind, topic.ros_name, profile, qos_overriding_options=options)


def subscribe(
    node: Node,
    topic: Topic,
    take: Callable[[Any], None],
    qos: policies.QoSProfile = RELIABLE,
    *,
    raw: bool = False,
    type_parameter: str = "",
) -> Subscription:
    """Return a subscription whose quality of service can be overridden by parameters.

    A publisher of another message type is reported (`omni_ros.topic_types`).

    Args:
        node: node that subscribes.
        topic: topic with its message type.
        take: function that receives the messages.
        qos: quality of service without an override.
        raw: whether messages are received in serialized form.
        type_parameter: name of the node's parameter that selects the message type; empty if none
            does.
    """
    options, kind = QoSOverridingOptions(_OVERRIDABLE), message_class(topic.type)
    subscription = node.create_subscription(
        kind, topic.ros_name, take, copy(qos), qos_overriding_options=options, raw=raw
    )
    watch_type(node, subscription, topic.type, type_parameter)
    return subscription
