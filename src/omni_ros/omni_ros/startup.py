"""How a node waits for its subscribers before it publishes."""

from collections.abc import Iterable

from rclpy.publisher import Publisher

from omni_platform.configuration import Configuration, parameter
from omni_ros import process


class StartupConfiguration(Configuration):
    """Parameters of the wait for subscribers, without which the first messages would be lost."""

    subscribers: int = parameter(0, minimum=0, maximum=100)
    """Subscriptions that each output must have before the node starts to work"""
    match_timeout: float = parameter(20.0, unit="s", above=0.0)
    """Longest wait for these subscriptions"""

    def await_subscribers(
        self, publishers: Iterable[Publisher], spinner: process.Spinner, count: int | None = None
    ) -> None:
        """Wait for `count` subscriptions, `subscribers` by default, of each publisher.

        Raises:
            MatchTimeoutError: names the topic without a subscription.
        """
        count = self.subscribers if count is None else count
        process.await_subscribers(publishers, count, spinner, self.match_timeout)
