"""Start of a node, which waits for its subscribers before it publishes."""

import time
from collections.abc import Iterable

from rclpy.publisher import Publisher

from omni_platform.configuration import Configuration, parameter
from omni_ros import process


class StartupConfiguration(Configuration):
    """Subscriptions that must exist before a node publishes, so that no message is missed."""

    subscribers: int = parameter(0, minimum=0, maximum=100)
    """Number of subscriptions that each output must have before the node starts to work"""
    match_timeout: float = parameter(20.0, unit="s", above=0.0, maximum=3600.0)
    """Limit on the time to wait for these subscriptions"""

    def await_subscribers(
        self, publishers: Iterable[Publisher], spinner: process.Spinner, count: int | None = None
    ) -> None:
        """Wait until each publisher has `count` subscriptions, so that no message is missed.

        Args:
            publishers: publishers to wait for.
            spinner: spinner, which notices a request to stop.
            count: number of subscriptions that each publisher must have; None for the value of the
                parameter `subscribers`.

        Raises:
            NodeError: a topic has too few subscriptions; the message names the topic.
        """
        count = self.subscribers if count is None else count
        for publisher in publishers:
            deadline = time.monotonic() + self.match_timeout
            # Discovery runs in DDS threads and does not wake the executor, so the count is polled.
            while publisher.get_subscription_count() < count and not spinner.stop:
                if time.monotonic() > deadline:
                    raise process.NodeError(
                        f"{publisher.topic_name} has {publisher.get_subscription_count()} of "
                        f"{count} expected subscribers after {self.match_timeout:g} s; is the "
                        "subscribing node running in the same ROS domain?"
                    )
                time.sleep(0.005)
