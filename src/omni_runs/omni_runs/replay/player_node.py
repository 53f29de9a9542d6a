"""Node that publishes recorded messages unchanged to nodes that process them again.

A round consists of at most one message of each topic. It is sent when the result of the previous
round has arrived. Messages of one topic therefore cannot overtake messages of another topic, no
queue overflows, and the results do not depend on the speed of the replay. If no result arrives, for
example because a sensor is missing, the next round is sent after a timeout. At the end the node
reports ``{"published": {topic: count}, "results": ..., "timeouts": count}``, see
`environment.report`.
"""

import time
from collections import deque
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from omni_core import topics
from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import SECOND_NS
from omni_recording import folder, mcap
from omni_recording.error import BagError
from omni_ros import parameters, process, qos
from omni_ros.environment import report
from omni_ros.messages import leading_stamp, to_time


class PlayerConfiguration(Configuration):
    """Parameters of the player node."""

    bag: str = parameter()
    """Path of the recording to publish: a folder or an .mcap file"""
    inputs: tuple[str, ...] = parameter()
    """Topics to publish"""
    input_types: tuple[str, ...] = parameter()
    """Type of each input topic"""
    outputs: tuple[str, ...] = parameter()
    """Topics on which the nodes publish results"""
    output_types: tuple[str, ...] = parameter()
    """Type of each output topic"""
    rate: float = parameter(0.0, minimum=0.0, maximum=1000.0)
    """Speed as a multiple of the recorded one; 0 for as fast as the nodes can follow"""
    answer_timeout: float = parameter(10.0, unit="s", above=0.0, maximum=3600.0)
    """Limit on the time to wait for results"""
    round_timeout: float = parameter(0.5, unit="s", above=0.0, maximum=3600.0)
    """Time to wait for the result of a round before the next round is sent"""
    most_ahead: int = parameter(100, minimum=1, maximum=100_000)
    """Limit on the number of rounds without a result; the default is half the nodes' queue size"""
    most_ahead_first: int = parameter(20, minimum=1, maximum=100_000)
    """Limit on the number of rounds that are sent before the first result"""

    def check_consistency(self) -> None:
        """Check that the number of topics equals the number of types."""
        for key, names, kinds in (
            ("input_types", self.inputs, self.input_types),
            ("output_types", self.outputs, self.output_types),
        ):
            if len(names) != len(kinds):
                raise ConfigurationError(key, f"has {len(kinds)} entries for {len(names)} topics")


class PlayerNode(Node):
    """Publishes the inputs of a replay and counts the results."""

    def __init__(self) -> None:
        super().__init__("player")
        self.startup = parameters.declare_configuration(self, process.StartupConfiguration)
        configuration = parameters.declare_configuration(self, PlayerConfiguration)
        self.configuration = configuration
        self.clock = qos.advertise(self, topics.CLOCK)
        self.inputs = {
            topic: qos.advertise(self, topics.Topic(topic, kind, "player"))
            for topic, kind in zip(configuration.inputs, configuration.input_types, strict=True)
        }
        self.published = dict.fromkeys(self.inputs, 0)
        self.results = dict.fromkeys(configuration.outputs, 0)
        self._newest = dict.fromkeys(configuration.outputs, -1)  # stamps of results [ns]
        self._waiting: deque[int] = deque()  # stamps of rounds [ns]
        for topic, kind in zip(configuration.outputs, configuration.output_types, strict=True):
            replayed = topics.Topic(topic, kind, "the replayed node")
            qos.subscribe(self, replayed, partial(self._on_result, topic), raw=True)

    def publish_round(self, messages: list[mcap.RecordedMessage]) -> None:
        """Publish the clock, then the messages of a round."""
        self.clock.publish(Clock(clock=to_time(messages[0].log_ns)))
        for message in messages:
            self.inputs[message.channel.topic].publish(message.data)
            self.published[message.channel.topic] += 1
        # The stamp of a result is that of its newest input, or earlier.
        self._waiting.append(min(leading_stamp(message.data) or 0 for message in messages))

    @property
    def unanswered(self) -> int:
        """Number of sent rounds for which at least one output has not yet arrived."""
        answered = min(self._newest.values())
        while self._waiting and self._waiting[0] <= answered:
            self._waiting.popleft()
        return len(self._waiting)

    def _on_result(self, topic: str, data: bytes) -> None:
        self.results[topic] += 1
        self._newest[topic] = max(self._newest[topic], leading_stamp(data) or 0)


def play(node: PlayerNode, spinner: process.Spinner) -> None:
    """Publish the complete recording, wait for the last results, and report the counts.

    Raises:
        NodeError: the recording cannot be read, or a node does not answer.
    """
    # Each topic has one subscriber, which is a replayed node or, for the clock, the recorder.
    listened = [node.clock, *node.inputs.values()]
    node.startup.await_subscribers(listened, spinner, 1)
    try:
        timeouts = _publish_all(node, spinner)
    except BagError as error:
        raise process.NodeError(str(error)) from None
    spinner.spin_until(lambda: node.unanswered == 0, 2.0 * node.configuration.round_timeout)
    _await_silence(node, spinner)
    if not spinner.stop and not any(node.results.values()):
        raise process.NodeError(f"no result on {', '.join(node.results)}: the node does not answer")
    report({"published": node.published, "results": node.results, "timeouts": timeouts})


def _publish_all(node: PlayerNode, spinner: process.Spinner) -> int:
    """Publish all rounds; return the number of times that a result did not arrive in time."""
    bag = folder.open_vehicle(Path(node.configuration.bag))
    rate = node.configuration.rate
    ahead = 1
    chosen = (m for m in folder.bag_messages(bag) if m.channel.topic in node.inputs)
    start: float | None = None
    for messages in folder.in_rounds(folder.in_time_order(chosen)):
        if spinner.stop:
            break
        if rate > 0.0:
            # Times are relative to the first round, so that delays do not accumulate.
            recorded = messages[0].log_ns / SECOND_NS / rate
            start = time.monotonic() - recorded if start is None else start
            spinner.spin_until(lambda: False, start + recorded - time.monotonic())
        node.publish_round(messages)
        ahead = _await_result(node, spinner, ahead)
    return ahead - 1


def _await_result(node: PlayerNode, spinner: process.Spinner, ahead: int) -> int:
    """Wait until the next round may be sent: fewer than `ahead` rounds have no result yet.

    Args:
        node: the player.
        spinner: spinner, which runs the callbacks of received results.
        ahead: present limit on the number of rounds without a result.

    Returns:
        Limit for the next call: `ahead`, or `ahead` + 1 if the wait ended by a timeout.

    Raises:
        NodeError: the wait ended by a timeout, and the limit has reached its maximum.
    """
    limits, started = node.configuration, any(node.results.values())
    timeout = limits.answer_timeout
    most = limits.most_ahead if started else limits.most_ahead_first
    # A node without any result yet may only be slow to start, so wait longer.
    patient = ahead == most or (ahead == 1 and not started)
    followed = spinner.spin_until(
        lambda: node.unanswered < ahead, timeout if patient else limits.round_timeout
    )
    if followed or spinner.stop:
        return ahead
    if ahead >= most:
        raise process.NodeError(
            f"{node.unanswered} rounds of inputs have no result after {timeout:g} s on "
            f"{', '.join(node.results)}"
        )
    return ahead + 1


def _await_silence(node: PlayerNode, spinner: process.Spinner, quiet: float = 0.3) -> None:
    """Receive the remaining results until none arrives for `quiet` [s]."""
    before = -1
    while not spinner.stop and sum(node.results.values()) != before:
        before = sum(node.results.values())
        spinner.spin_until(lambda: False, quiet)


main = partial(process.run_process, PlayerNode, play)


if __name__ == "__main__":
    raise SystemExit(main())
