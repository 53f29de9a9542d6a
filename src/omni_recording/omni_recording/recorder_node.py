"""Node that records serialized messages into a rosbag2 folder.

Messages are not decoded, except for odometry messages that are also recorded as `/tf`. On SIGINT or
SIGTERM, the node stores the messages received so far, closes the recording, and reports
``{"recorded": {topic: count}}``, see `environment.report`, or logs it if no process reads reports.
"""

import contextlib
import os
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from omni_core.configuration import ConfigurationError
from omni_recording import clock, definitions, plan, write
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_recording.transforms import ODOMETRY_TYPE, RecordedTransforms
from omni_ros import parameters, process, publisher_guard
from omni_ros.environment import REPORT_VARIABLE, report
from omni_ros.messages import message_class
from omni_ros.qos import LATCHED, RELIABLE

_LONGEST_WRITING = 5.0  # limit on the time for writing full queues to a slow disk [s]
_LONGEST_WAIT = 1.0  # limit on the wait for messages in transit, even if publishers continue [s]
_QUIET = 0.2  # time without a message after which no further messages are expected [s]


class RecorderNode(Node):
    """Subscribes to the topics of a recording and writes their bytes into it."""

    def __init__(self) -> None:
        super().__init__("recorder")
        configuration = parameters.declare_configuration(self, plan.RecorderConfiguration)
        self.flush_period = configuration.flush_period
        self.received = 0
        self.failure: write.RecordingError | None = None
        latched = {self.resolve_topic_name(name) for name in configuration.latched_topics}
        kinds: dict[str, str] = {}
        for name, kind in zip(configuration.topics, configuration.types, strict=True):
            topic = self.resolve_topic_name(name)
            if topic in kinds:
                raise ConfigurationError("topics", f"names {topic} twice")
            kinds[topic] = kind
        classes = {kind: message_class(kind, "types") for kind in kinds.values()}
        known = {kind: _definition(kind) for kind in classes}
        topics = [
            _recorded_topic(topic, known[kind], configuration.reliability, topic in latched)
            for topic, kind in kinds.items()
        ]
        self._transforms = self._prepare_transforms(configuration, kinds)
        topics += self._transforms.topics
        try:
            self.writer = write.Rosbag2Writer(
                Path(configuration.folder),
                topics,
                chunk_size=configuration.chunk_size,
                compression=configuration.compression,
                synchronize=configuration.synchronize,
            )
            self._recording = plan.StampedRecording(
                self.writer, {topic.name: topic.definition for topic in topics}
            )
            self._transforms.begin(self._recording)
        except write.RecordingError as error:
            raise process.NodeError(str(error)) from error
        guarded = []
        for topic, kind in kinds.items():
            qos = QoSProfile(
                depth=configuration.queue_depth,
                reliability=ReliabilityPolicy[configuration.reliability.upper()],
                durability=DurabilityPolicy[_durability(topic in latched).upper()],
            )
            callback = partial(self._on_message, topic)
            subscription = self.create_subscription(classes[kind], topic, callback, qos, raw=True)
            if topic not in clock.SHARED_TOPICS:
                guarded.append(subscription)
        self._guard = publisher_guard.PublisherGuard(self, guarded)
        self._strict = configuration.strict

    def _prepare_transforms(
        self, configuration: plan.RecorderConfiguration, kinds: Mapping[str, str]
    ) -> RecordedTransforms:
        odometry = configuration.transforms_from and self.resolve_topic_name(
            configuration.transforms_from
        )
        if odometry and kinds[odometry] != ODOMETRY_TYPE:
            raise ConfigurationError(
                "transforms_from", f"names {odometry}, which is no {ODOMETRY_TYPE}"
            )
        return RecordedTransforms(odometry, configuration.fixed_frames, configuration.fixed_poses)

    def check_publishers(self) -> None:
        """Raise `NodeError` if a topic has a second publisher, which may belong to another run."""
        if self._strict and self.failure is None:
            problem = self._recording.problem or self._guard.second()
            if problem is not None:
                self.failure = write.RecordingError(problem)

    def finish(self) -> None:
        """Write the last messages and close the recording.

        Raises:
            RecordingError: the recording failed.
        """
        self._recording.finish()
        self.writer.close()

    def _on_message(self, topic: str, data: bytes) -> None:
        self.received += 1
        if self.failure is not None:
            return
        try:
            self._recording.add(topic, data)
            self._transforms.follow(self._recording, topic, data)
        except write.RecordingError as error:
            # The error is stored, because the executor would log a long traceback.
            self.failure = error


def record(node: RecorderNode, spinner: process.Spinner) -> None:
    """Record until a signal requests shutdown, then finish the recording and report the counts.

    Raises:
        NodeError: the recording failed; the message counts of the file are reported nevertheless.
    """
    try:
        _take(node, spinner)
        if node.failure is None:
            _drain(node, spinner)
        node.check_publishers()
        if node.failure is not None:
            raise node.failure
        node.finish()
    except write.RecordingError as error:
        raise process.NodeError(str(error)) from error
    finally:
        with contextlib.suppress(write.RecordingError):  # after any other error
            node.finish()
        report({"recorded": node.writer.counts})
        if REPORT_VARIABLE not in os.environ:
            _log(node)


def _log(node: RecorderNode) -> None:
    """Log how many messages are recorded, and the topics without any."""
    counts = node.writer.counts
    node.get_logger().info(f"recorded {sum(counts.values())} messages")
    if empty := [topic for topic, count in counts.items() if not count]:
        node.get_logger().warning(f"no message on {', '.join(empty)}")


def _take(node: RecorderNode, spinner: process.Spinner, pause: float = 0.02) -> None:
    """Store the received messages every `pause` [s]; waking up for each one would be slower."""
    # The clock is read here, because a timer of the node would have to wait behind the messages of
    # a busy graph.
    due = time.monotonic() + node.flush_period
    while not spinner.stop and node.failure is None:
        time.sleep(min(pause, node.flush_period))
        _take_arrived(node, spinner, due)
        if time.monotonic() >= due:
            node.check_publishers()
            node.writer.flush()
            due = time.monotonic() + node.flush_period


def _take_arrived(node: RecorderNode, spinner: process.Spinner, deadline: float) -> None:
    before = -1
    while node.received != before and time.monotonic() < deadline:
        before = node.received
        spinner.spin_once(0.0)


def _drain(node: RecorderNode, spinner: process.Spinner) -> None:
    """Store the messages that are still in the queues, so that the recording is complete.

    Args:
        node: the recorder.
        spinner: spinner, which runs the callbacks of received messages.
    """
    _take_arrived(node, spinner, time.monotonic() + _LONGEST_WRITING)
    deadline = time.monotonic() + _LONGEST_WAIT
    quiet_end = time.monotonic() + _QUIET
    while time.monotonic() < min(deadline, quiet_end):
        before = node.received
        spinner.spin_once()
        if node.received != before:
            quiet_end = time.monotonic() + _QUIET


def _definition(kind: str) -> definitions.MessageDefinition:
    try:
        return definitions.find_message_definition(kind)
    except definitions.MessageDefinitionError as error:
        raise ConfigurationError("types", str(error)) from None


def _recorded_topic(
    topic: str, definition: definitions.MessageDefinition, reliability: str, latched: bool
) -> RecordedTopic:
    qos = RecordedQos(
        depth=(LATCHED if latched else RELIABLE).depth,
        reliability=reliability,
        durability=_durability(latched),
    )
    return RecordedTopic(topic, definition, qos)


def _durability(latched: bool) -> str:
    return "transient_local" if latched else "volatile"


main = partial(process.run_process, RecorderNode, record)


if __name__ == "__main__":
    raise SystemExit(main())
