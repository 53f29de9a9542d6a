"""Parameters of the recorder, and the stamps with which it writes messages."""

import heapq
from collections.abc import Mapping

from omni_core.configuration import Configuration, ConfigurationError, check_choice, parameter
from omni_core.quantities import LARGEST_OFFSET, SECOND_NS
from omni_recording.clock import SHARED_TOPICS
from omni_recording.definitions import MessageDefinition
from omni_recording.write import COMPRESSIONS, Rosbag2Writer
from omni_ros.messages import leading_stamp

RELIABILITIES = ("reliable", "best_effort")

_HELD_BACK_NS = SECOND_NS  # delay for sorting the messages of a shared topic by stamp


class RecorderConfiguration(Configuration):
    """Parameters of the recorder node."""

    folder: str = parameter()
    """Folder of the recording, created with its parents; must be empty if it exists"""
    topics: tuple[str, ...] = parameter()
    """Topics to record"""
    types: tuple[str, ...] = parameter()
    """Type of each topic, such as sensor_msgs/msg/Image"""
    latched_topics: tuple[str, ...] = parameter(())
    """Topics whose publishers offer transient_local durability"""
    reliability: str = parameter("reliable", choices=RELIABILITIES)
    """Reliability that the recorder requests"""
    queue_depth: int = parameter(2000, minimum=1, maximum=100_000)
    """Queue size of each topic"""
    compression: str = parameter("none", choices=tuple(COMPRESSIONS))
    """Compression of the chunks"""
    chunk_size: int = parameter(1 << 20, unit="B", minimum=1, maximum=1 << 27)
    """Total size of messages at which a chunk ends, even before the next flush"""
    flush_period: float = parameter(0.5, unit="s", above=0.0, maximum=1.0)
    """Limit on the time until a received message is written to the file"""
    synchronize: bool = parameter(False)
    """Whether every flush waits for the disk, so that a power failure loses no more messages than a
    crash of the recorder"""
    transforms_from: str = parameter("")
    """Topic of odometry messages whose poses are also recorded on /tf; empty for none"""
    fixed_frames: tuple[str, ...] = parameter(())
    """Frames fixed to base_link, recorded on /tf_static"""
    fixed_poses: tuple[float, ...] = parameter((), minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """x [m], y [m] and heading [rad] of each fixed frame, one after the other"""

    strict: bool = parameter(True)
    """Whether the recorder ends with an error when a topic has a second publisher or its stamps
    decrease, because the recording may then contain messages of another run"""

    def check_consistency(self) -> None:
        """Check that required values are not empty and that the lengths of the lists agree."""
        if not self.folder:
            raise ConfigurationError("folder", "is empty")
        if not self.topics:
            raise ConfigurationError("topics", "names nothing to record")
        if len(self.types) != len(self.topics):
            raise ConfigurationError(
                "types", f"has {len(self.types)} entries for {len(self.topics)} topics"
            )
        for topic in self.latched_topics:
            check_choice("latched_topics", topic, self.topics)
        if self.transforms_from:
            check_choice("transforms_from", self.transforms_from, self.topics)
        if len(self.fixed_poses) != 3 * len(self.fixed_frames):
            raise ConfigurationError(
                "fixed_poses",
                f"has {len(self.fixed_poses)} entries for {len(self.fixed_frames)} frames; three "
                "each are needed",
            )


class StampedRecording:
    """Writes each message with its own stamp, so that a recording does not depend on timing.

    A message that is a list of stamped messages receives the stamp of its first element if this
    stamp is plausible. A message without a stamp receives the latest stamp of any topic.

    Several nodes publish on a shared topic (`SHARED_TOPICS`). The messages on this topic are
    buffered until the stamps have advanced by one second, and are then written in the order of
    their stamps. The order therefore does not depend on the speed of the nodes.

    Args:
        writer: the recording.
        definitions: definition of the message type of each topic, keyed by topic.
    """

    def __init__(self, writer: Rosbag2Writer, definitions: Mapping[str, MessageDefinition]) -> None:
        self._writer = writer
        self._stamped = {topic for topic, one in definitions.items() if one.stamped}
        self._of_stamped = {topic for topic, one in definitions.items() if one.of_stamped}
        self._latest_ns = 0
        self._newest_ns: dict[str, int] = {}
        self._held: list[tuple[int, str, bytes]] = []  # a heap
        self.problem: str | None = None  # first evidence of messages from another run

    def add(self, topic: str, data: bytes, stamp_ns: int | None = None) -> None:
        """Write a message with its stamp, or buffer it.

        Args:
            topic: full name of one of the recording's topics.
            data: the message as CDR with its encapsulation header.
            stamp_ns: stamp of the message [ns]; None to read it from the beginning of the message.

        Raises:
            RecordingError: the file can no longer be written.
        """
        if stamp_ns is None and topic in self._stamped:
            stamp_ns = leading_stamp(data)
            if topic in SHARED_TOPICS and stamp_ns is not None:
                heapq.heappush(self._held, (stamp_ns, topic, data))
                return
            self._check_stamp(topic, stamp_ns)
        elif stamp_ns is None and topic in self._of_stamped:
            first_ns = leading_stamp(data, of_list=True)
            if first_ns is not None and abs(first_ns - self._latest_ns) <= _HELD_BACK_NS:
                stamp_ns = first_ns
        if stamp_ns is None:
            stamp_ns = self._latest_ns
        elif stamp_ns > self._latest_ns:
            self._latest_ns = stamp_ns
            self._release(stamp_ns - _HELD_BACK_NS)
        self._writer.write(topic, stamp_ns, data)

    def finish(self) -> None:
        """Write all messages that are still buffered.

        Raises:
            RecordingError: the file can no longer be written.
        """
        self._release(None)

    def _release(self, until_ns: int | None) -> None:
        while self._held and (until_ns is None or self._held[0][0] <= until_ns):
            stamp_ns, topic, data = heapq.heappop(self._held)
            self._writer.write(topic, stamp_ns, data)

    def _check_stamp(self, topic: str, stamp_ns: int | None) -> None:
        newest_ns = self._newest_ns.get(topic, 0)
        if topic in SHARED_TOPICS or self.problem is not None:
            return
        if stamp_ns is None:
            self.problem = f"{topic} has a message with a stamp before zero, or with none"
        elif stamp_ns < newest_ns:
            self.problem = (
                f"the stamps of {topic} decrease from {newest_ns / SECOND_NS:g} s to "
                f"{stamp_ns / SECOND_NS:g} s: the topic has another publisher"
            )
        else:
            self._newest_ns[topic] = stamp_ns
