"""Transmission of a recording with faults to the tested node, and reception of its answers.

The recording is published in real time, once for each phase: unchanged, with a gap in one input,
with unusable values in this input, and cut off in the middle. The stamps continue across the
phases.
"""

import itertools
import os
import struct
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy import qos as policies
from rclpy.context import Context
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.validate_namespace import validate_namespace
from rosgraph_msgs.msg import Clock

from omni_core.configuration import ConfigurationError, WorkError
from omni_core.quantities import SECOND_NS
from omni_core.topics import IMAGE, Topic
from omni_recording.folder import bag_messages, in_time_order, open_vehicle
from omni_ros.environment import check_participant
from omni_ros.messages import leading_stamp, message_class, to_time
from omni_ros.qos import RELIABLE

PHASES = ("recorded", "gap", "unusable", "silence")
GAP = 0.3
"""Duration of the gap, or of the unusable values [s]."""

_STAMP = struct.Struct("<iI")  # the message follows the four bytes of the CDR header
_PAUSE_NS = 2 * SECOND_NS  # time between two phases; longer than any timeout of a node
_LISTEN = 0.5  # s; time of reception after the last input
# s; if a busy machine delays this process for longer, all further messages are sent later, because
# a burst of late messages would fill the queues of the tested node
_LARGEST_LAG = 0.02
_START = 60.0  # s; time within which the node must appear


@dataclass(frozen=True)
class Answer:
    """A message that the tested node published.

    Attributes:
        phase: phase in which the message was received, one of `PHASES`.
        stamp_ns: time stamp of the message [ns].
        age: time from the sending of an input to the publication of this message [s]; the input is
            the newest one with a stamp not later than `stamp_ns`.
        silence: time from the sending of the last input to the publication of this message [s].
        message: the message.
    """

    phase: str
    stamp_ns: int
    age: float
    silence: float
    message: Any


@dataclass
class Received:
    """Messages received on a topic.

    Attributes:
        messages: time of publication on the publisher's clock [ns] and message, in the order of
            arrival.
        publishers: whether each publisher is reliable, one entry for each.
        silent: whether publishers still exist, although no message has arrived recently.
    """

    messages: list[tuple[int, Any]]
    publishers: list[bool]
    silent: bool = False


class Exchange:
    """Messages that were sent to the tested node, and the node's answers.

    Attributes:
        sent: stamps of the inputs that require an answer [ns], keyed by phase.
        faults: first and last stamp of the gap or of the unusable values [ns], keyed by phase.
        answers: answers in the order in which they were received.
        publishers: whether each publisher on the topic of the answers is reliable.
        incompatible: topic and reason for each subscription of the tested node that receives no
            inputs because of its QoS.
        kind: message class of the answers.
    """

    def __init__(self, output: Topic, publishers: list[bool]) -> None:
        self.sent: dict[str, list[int]] = {}
        self.faults: dict[str, tuple[int, int]] = {}
        self.answers: list[Answer] = []
        self.publishers = publishers
        self.incompatible: list[tuple[str, str]] = []
        self.kind = message_class(output.type)
        self._phase = PHASES[0]
        self._departures: dict[int, int] = {}  # send time on the system's clock [ns] by stamp
        self._last = 0  # send time of the last input on this clock [ns]

    def keep(self, data: bytes, info: Mapping[str, int]) -> None:
        """Store an answer of the tested node, with `age` and `silence` as defined in `Answer`.

        Both are computed from the time of publication, because the time of reception
        depends on how long the answer waits in this process.

        Args:
            data: serialized answer.
            info: information on the message, including its time of publication [ns].
        """
        published, stamp = info["source_timestamp"], leading_stamp(data) or 0
        known = max((sent for sent in self._departures if sent <= stamp), default=None)
        age = (published - self._departures[known]) / SECOND_NS if known is not None else 0.0
        silence = (published - self._last) / SECOND_NS
        message = deserialize_message(data, self.kind)
        self.answers.append(Answer(self._phase, stamp, age, silence, message))

    def note(self, stamp: int) -> None:
        """Store the present time as the send time of the input with this stamp [ns]."""
        self._last = self._departures[stamp] = time.time_ns()

    def begin(self, phase: str, fault: tuple[int, int]) -> list[int]:
        """Record that a phase of the test starts.

        Args:
            phase: one of `PHASES`.
            fault: first and last stamp of the gap or of the unusable values [ns].

        Returns:
            List to which the caller must append the stamp of each input that requires an answer.
        """
        self._phase = phase
        self._departures.clear()
        self.faults[phase] = fault
        return self.sent.setdefault(phase, [])


class Partner:
    """Node of this program in the ROS domain of the tested node.

    Raises:
        ConfigurationError: ROS does not accept the namespace, the static peers or the folder for
            the logs.
    """

    def __init__(self, domain: int, namespace: str = "") -> None:
        try:
            validate_namespace("/" + namespace.removeprefix("/"))
        except InvalidNamespaceException as error:
            problem = str(error).splitlines()[0].removeprefix("Invalid namespace: namespace ")
            raise ConfigurationError("--namespace", f"{namespace!r} {problem}") from error
        check_participant(os.environ)
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("node_check", context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin(self, until: float) -> None:
        """Receive messages until a time of the monotonic clock [s]."""
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def await_node(self, topic: str, alive: Callable[[], bool], sent: Iterable[str]) -> list[bool]:
        """Wait until a topic has a publisher; return whether each publisher is reliable.

        Args:
            topic: output of the tested node.
            alive: function that returns whether the process of the tested node still runs.
            sent: topics that this program publishes, which are the inputs of the tested node.

        Raises:
            WorkError: no publisher appears within a minute, the tested node has ended, or another
                node of the domain also publishes an input of the tested node.
        """
        deadline, domain = time.monotonic() + _START, self._context.get_domain_id()
        print(f"waiting for a node that publishes {topic} in ROS domain {domain}", file=sys.stderr)
        while not self.publishers(topic):
            if not alive():
                raise WorkError("the node ended before it published anything; see its output")
            if time.monotonic() > deadline:
                raise WorkError(
                    f"nothing publishes {topic} in ROS domain {domain} "
                    f"within {_START:g} s; start the node in this domain"
                )
            self.spin(time.monotonic() + 0.1)
        self.spin(time.monotonic() + 1.0)  # until the node has discovered this one too
        for path in sent:
            for other in self.node.get_publishers_info_by_topic(path):
                if other.node_name != self.node.get_name():
                    raise WorkError(
                        f"{other.node_name} publishes {path}, which this check sends itself; start "
                        "the checked node alone, or a run with --replace brake_assist=external"
                    )
        return self.publishers(topic)

    def publishers(self, topic: str) -> list[bool]:
        """Return for each discovered publisher of a topic whether it is reliable."""
        found = self.node.get_publishers_info_by_topic(topic)
        reliable = policies.QoSReliabilityPolicy.RELIABLE
        return [entry.qos_profile.reliability == reliable for entry in found]

    def close(self) -> None:
        """End the node and leave its ROS domain."""
        self.node.destroy_node()
        self._context.try_shutdown()


def feed(
    partner: Partner,
    recording: Path,
    inputs: Iterable[Topic],
    faulty: Topic,
    paced: Topic,
    output: Topic,
    alive: Callable[[], bool],
) -> Exchange:
    """Publish a recording to the tested node in all phases; return the inputs and its answers.

    Args:
        partner: node of this process, which publishes the inputs and receives the answers.
        recording: rosbag2 folder.
        inputs: input topics of the tested node.
        faulty: input in which the gap and the unusable values are inserted.
        paced: input whose messages the tested node answers.
        output: topic of the answers.
        alive: function that returns whether the process of the tested node still runs.

    Raises:
        WorkError: the tested node does not publish `output`, or has ended.
    """
    publishers = {
        topic.path: partner.node.create_publisher(message_class(topic.type), topic.path, RELIABLE)
        for topic in inputs
    }
    clock = partner.node.create_publisher(Clock, "/clock", RELIABLE)
    exchange = _exchange(partner, output, publishers, alive)
    recorded = bag_messages(open_vehicle(recording))
    messages = list(in_time_order(m for m in recorded if m.channel.topic in publishers))
    begin, end = messages[0].log_ns, messages[-1].log_ns
    middle, gap = (begin + end) // 2, round(GAP * SECOND_NS)
    for number, phase in enumerate(PHASES):
        shift = number * (end - begin + _PAUSE_NS)
        sent = exchange.begin(phase, (shift + middle, shift + middle + gap))
        start = time.monotonic()
        for message in messages:
            path = message.channel.topic
            if phase == "silence" and message.log_ns > middle:
                break
            at_fault = path == faulty.path and 0 <= message.log_ns - middle < gap
            if at_fault and phase == "gap":
                continue
            spoilt = at_fault and phase == "unusable"
            data = _unusable(faulty, message.data) if spoilt else message.data
            stamp = (leading_stamp(data) or 0) + shift
            partner.spin(due := start + (message.log_ns - begin) / SECOND_NS)
            start += max(0.0, time.monotonic() - due - _LARGEST_LAG)
            clock.publish(Clock(clock=to_time(message.log_ns + shift)))
            publishers[path].publish(data[:4] + _STAMP.pack(*divmod(stamp, SECOND_NS)) + data[12:])
            exchange.note(stamp)
            if path == paced.path:
                sent.append(stamp)
        partner.spin(time.monotonic() + _LISTEN)
    exchange.incompatible = list(_incompatible(partner.node, publishers))
    if not alive():
        raise WorkError("the node ended while it was checked; see its output")
    return exchange


def _exchange(
    partner: Partner, output: Topic, publishers: Mapping[str, Publisher], alive: Callable[[], bool]
) -> Exchange:
    """Wait until the tested node receives the inputs; return an exchange that stores its answers.

    Args:
        partner: node of this process, which receives the answers.
        output: topic of the answers.
        publishers: publishers of the inputs, keyed by topic.
        alive: function that returns whether the process of the tested node still runs.
    """
    exchange = Exchange(output, partner.await_node(output.path, alive, publishers))
    for entry in partner.node.get_publishers_info_by_topic(output.path):
        if entry.topic_type != output.type:
            raise WorkError(
                f"{output.path} is published as {entry.topic_type}; must be {output.type}"
            )
    qos = RELIABLE if all(exchange.publishers) else policies.qos_profile_sensor_data
    partner.node.create_subscription(exchange.kind, output.path, exchange.keep, qos, raw=True)
    partner.spin(time.monotonic() + _LISTEN)  # until the node has discovered the subscription
    deadline = time.monotonic() + _START
    while not any(publisher.get_subscription_count() for publisher in publishers.values()):
        if time.monotonic() > deadline:
            break  # the node subscribes to no input, so it will answer none
        partner.spin(time.monotonic() + 0.1)
    return exchange


def subscribe(partner: Partner, topic: Topic, qos: policies.QoSProfile) -> list[tuple[int, Any]]:
    """Subscribe to a topic; return the list to which received messages are appended.

    An entry consists of the time of publication [ns] and the message. Unlike the time of reception,
    the time of publication does not depend on how long messages wait in this process.

    Args:
        partner: node of this process, which subscribes.
        topic: topic to subscribe to.
        qos: quality of service of the subscription.
    """
    seen: list[tuple[int, Any]] = []

    def keep(message: Any, info: dict[str, int]) -> None:
        seen.append((info["source_timestamp"], message))

    partner.node.create_subscription(message_class(topic.type), topic.ros_name, keep, qos)
    return seen


def _incompatible(node: Node, topics: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield topic and reason for each subscription whose QoS does not match that of a publisher."""
    for topic in topics:
        publishers = node.get_publishers_info_by_topic(topic)
        subscriptions = node.get_subscriptions_info_by_topic(topic)
        for pair in itertools.product(publishers, subscriptions):
            fits, reason = policies.qos_check_compatible(*(end.qos_profile for end in pair))
            if fits == policies.QoSCompatibility.ERROR:
                yield topic, reason.removeprefix("ERROR: ").rstrip("; ")


def _unusable(topic: Topic, data: bytes) -> bytes:
    """Return a message with unusable content: NaN as velocity, or a truncated image."""
    message = deserialize_message(data, message_class(topic.type))
    if topic.type == IMAGE:
        message.data = message.data[: len(message.data) // 2]
    else:
        message.twist.twist.linear.x = float("nan")
    return bytes(serialize_message(message))
