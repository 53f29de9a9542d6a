"""Send a recording with faults to a node, and record its answers.

The recording is published in real time, once for each phase: unchanged, with a gap in one input,
with unusable values in this input, and cut off in the middle. Stamps continue from phase to phase.
"""

import os
import struct
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock

from omni_platform.configuration import WorkError
from omni_platform.quantities import SECOND_NS
from omni_platform.topics import IMAGE, Topic
from omni_recording.folder import bag_messages, in_time_order, open_vehicle
from omni_ros.messages import leading_stamp, message_class, to_time
from omni_ros.qos import RELIABLE

PHASES = ("recorded", "gap", "unusable", "silence")
GAP = 0.3
"""Time without an input, or with unusable values [s]."""

_STAMP = struct.Struct("<iI")  # after the four bytes of the CDR header
_PAUSE_NS = 2 * SECOND_NS  # between two phases, longer than any time-out of a node
_LISTEN = 0.5  # [s] after the last input
_START = 60.0  # [s] within which a node must be there


@dataclass(frozen=True)
class Answer:
    """A message of the node.

    Attributes:
        phase: phase of `PHASES`, in which it was received.
        stamp_ns: time stamp of the message [ns].
        age: real time since the newest input with that stamp or an earlier one [s].
        silence: real time since the last input of any kind [s].
        message: the message.
    """

    phase: str
    stamp_ns: int
    age: float
    silence: float
    message: Any


@dataclass
class Exchange:
    """Messages sent to a node, and its answers.

    Attributes:
        sent: stamps of the inputs that are answered, by phase [ns].
        faults: first and last stamp of the gap, or of the unusable values, by phase [ns].
        answers: answers in the order in which they were received.
        publishers: whether each publisher of the answers' topic is reliable.
    """

    sent: dict[str, list[int]] = field(default_factory=dict)
    faults: dict[str, tuple[int, int]] = field(default_factory=dict)
    answers: list[Answer] = field(default_factory=list)
    publishers: list[bool] = field(default_factory=list)


class Partner:
    """Node of the checker in the ROS domain of the checked nodes."""

    def __init__(self, domain: int, namespace: str = "") -> None:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("node_check", context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin(self, until: float) -> None:
        """Take messages until a time of the steady clock [s]."""
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def await_node(self, topic: str, alive: Callable[[], bool]) -> list[bool]:
        """Wait for a publisher of a topic; return whether each of its publishers is reliable.

        Raises:
            WorkError: no publisher appears within a minute, or the node has ended.
        """
        deadline = time.monotonic() + _START
        while not (found := self.node.get_publishers_info_by_topic(topic)):
            if not alive():
                raise WorkError("the node ended before it published anything; see its output")
            if time.monotonic() > deadline:
                raise WorkError(f"nothing publishes {topic} in this ROS domain; start the node")
            self.spin(time.monotonic() + 0.1)
        self.spin(time.monotonic() + 1.0)  # until the node has found this one too
        found = self.node.get_publishers_info_by_topic(topic)
        reliable = QoSReliabilityPolicy.RELIABLE
        return [entry.qos_profile.reliability == reliable for entry in found]

    def close(self) -> None:
        """Leave the domain."""
        self.node.destroy_node()
        self._context.try_shutdown()


class _Exchanging:
    """An exchange under way: keeps the answers with the times of the inputs."""

    def __init__(self, output: Topic) -> None:
        self.exchange = Exchange()
        self.phase = PHASES[0]
        self.kind = message_class(output.type)
        self._arrivals: dict[int, float] = {}  # steady time of sending [s] by stamp
        self._last = 0.0  # steady time of the last input [s]

    def keep(self, data: bytes) -> None:
        now, stamp = time.monotonic(), leading_stamp(data) or 0
        known = max((sent for sent in self._arrivals if sent <= stamp), default=None)
        age = now - self._arrivals[known] if known is not None else 0.0
        message = deserialize_message(data, self.kind)
        answer = Answer(self.phase, stamp, age, now - self._last, message)
        self.exchange.answers.append(answer)

    def note(self, stamp: int) -> None:
        """Store when an input was sent."""
        self._last = self._arrivals[stamp] = time.monotonic()

    def begin(self, phase: str, fault: tuple[int, int]) -> list[int]:
        """Begin a phase; return the list for the stamps of the inputs that are answered."""
        self.phase = phase
        self._arrivals.clear()
        self.exchange.faults[phase] = fault
        return self.exchange.sent.setdefault(phase, [])


def feed(
    partner: Partner,
    recording: Path,
    inputs: Iterable[Topic],
    faulty: Topic,
    paced: Topic,
    output: Topic,
    alive: Callable[[], bool],
) -> Exchange:
    """Publish a recording in all phases, and keep the answers.

    Args:
        partner: this process's node.
        recording: rosbag2 folder.
        inputs: input topics of the node.
        faulty: input that gets the gap and the unusable values.
        paced: input whose messages the node answers.
        output: topic of the answers.
        alive: whether the node's process still runs.

    Raises:
        WorkError: the node does not publish `output`, or has ended.
    """
    exchanging, node = _Exchanging(output), partner.node
    publishers = {
        topic.path: node.create_publisher(message_class(topic.type), topic.path, RELIABLE)
        for topic in inputs
    }
    clock = node.create_publisher(Clock, "/clock", RELIABLE)
    exchanging.exchange.publishers = reliable = partner.await_node(output.path, alive)
    qos = RELIABLE if all(reliable) else qos_profile_sensor_data
    node.create_subscription(exchanging.kind, output.path, exchanging.keep, qos, raw=True)
    partner.spin(time.monotonic() + _LISTEN)  # until the node has found the subscription
    recorded = bag_messages(open_vehicle(recording))
    messages = list(in_time_order(m for m in recorded if m.channel.topic in publishers))
    begin, end = messages[0].log_ns, messages[-1].log_ns
    middle, gap = (begin + end) // 2, round(GAP * SECOND_NS)
    for number, phase in enumerate(PHASES):
        shift = number * (end - begin + _PAUSE_NS)
        sent = exchanging.begin(phase, (shift + middle, shift + middle + gap))
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
            partner.spin(start + (message.log_ns - begin) / SECOND_NS)
            clock.publish(Clock(clock=to_time(message.log_ns + shift)))
            publishers[path].publish(data[:4] + _STAMP.pack(*divmod(stamp, SECOND_NS)) + data[12:])
            exchanging.note(stamp)
            if path == paced.path:
                sent.append(stamp)
        partner.spin(time.monotonic() + _LISTEN)
    if not alive():
        raise WorkError("the node ended while it was checked; see its output")
    return exchanging.exchange


def subscribe(
    partner: Partner, topics: Mapping[str, Topic], qos: QoSProfile
) -> dict[str, list[tuple[float, Any]]]:
    """Return lists that grow by each message with its steady time [s], while the partner spins.

    Args:
        partner: this process's node.
        topics: topics by any key.
        qos: quality of service of the subscriptions.
    """
    seen: dict[str, list[tuple[float, Any]]] = {key: [] for key in topics}
    for key, topic in topics.items():
        partner.node.create_subscription(
            message_class(topic.type),
            topic.name,
            lambda message, key=key: seen[key].append((time.monotonic(), message)),
            qos,
        )
    return seen


def _unusable(topic: Topic, data: bytes) -> bytes:
    """Return a message with unusable content: NaN as velocity, or a truncated image."""
    message = deserialize_message(data, message_class(topic.type))
    if topic.type == IMAGE:
        message.data = message.data[: len(message.data) // 2]
    else:
        message.twist.twist.linear.x = float("nan")
    return bytes(serialize_message(message))
