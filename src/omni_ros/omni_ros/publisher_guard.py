"""Detection of a second publisher on topics that must have only one."""

import time
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

_NAMELESS = "_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_"  # name of a new publisher's node in rcl
_PERIOD = 0.1  # time between two checks of the node's own topics [s]


class PublisherGuard:
    """Detects a second publisher on topics of a node that must have only one.

    Args:
        node: node that observes the graph.
        subscribed: subscriptions of the node that must have only one publisher.
        published: publishers of the node that must be the only ones on their topics.
    """

    def __init__(
        self, node: Node, subscribed: Sequence[Subscription], published: Sequence[Publisher] = ()
    ) -> None:
        self._node = node
        self._subscribed = subscribed
        self._published = published
        self._looked = -_PERIOD
        self._rival: str | None = None

    def second(self) -> str | None:
        """Return a sentence about a topic with several publishers; None if no topic has several."""
        for subscription in self._subscribed:
            if subscription.get_publisher_count() > 1:
                return self._sentence(subscription.topic_name)
        now = time.monotonic()
        if now - self._looked >= _PERIOD:
            self._looked = now
            topics = (publisher.topic_name for publisher in self._published)
            rivals = (topic for topic in topics if self._node.count_publishers(topic) > 1)
            self._rival = next(map(self._sentence, rivals), None)
        return self._rival

    def _sentence(self, topic: str) -> str:
        publishers = self._node.get_publishers_info_by_topic(topic)
        names = sorted(
            f"{s.node_namespace.rstrip('/')}/{s.node_name}".replace(_NAMELESS, "one without a name")
            for s in publishers
        )
        return f"{topic} has more than one publisher: {', '.join(names)}; it must have only one"
