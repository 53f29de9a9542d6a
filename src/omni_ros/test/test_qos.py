"""Test the quality of service of topics."""

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from omni_core.topics import Topic
from omni_ros.qos import advertise, subscribe

TOPICS = [Topic(name, "std_msgs/msg/Float64", "test_qos") for name in ("overridden", "other")]
OTHER_DEPTH = 200
"""Depth of a topic without an override."""


@pytest.fixture
def node() -> Iterator[Node]:
    """Return a node whose parameters override the depth of one publisher and one subscription."""
    context = rclpy.Context()
    rclpy.init(context=context)
    overrides = [
        Parameter("qos_overrides./overridden.publisher.depth", value=7),
        Parameter("qos_overrides./overridden.subscription.depth", value=8),
    ]
    made = Node("test_qos", context=context, parameter_overrides=overrides)
    yield made
    made.destroy_node()
    rclpy.shutdown(context=context)


def test_an_override_of_one_topic_leaves_the_others_unchanged(node: Node) -> None:
    overridden, other = (advertise(node, topic) for topic in TOPICS)
    assert (overridden.qos_profile.depth, other.qos_profile.depth) == (7, OTHER_DEPTH)


def test_an_override_of_one_subscription_leaves_the_others_unchanged(node: Node) -> None:
    overridden, other = (subscribe(node, topic, lambda _: None) for topic in TOPICS)
    assert (overridden.qos_profile.depth, other.qos_profile.depth) == (8, OTHER_DEPTH)
