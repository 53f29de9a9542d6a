"""Writer of serialized messages into a rosbag2 folder with one MCAP file.

The layout is that of rosbag2's MCAP storage: ``<folder>/metadata.yaml`` (version 9, quality of
service as text) and ``<folder>/<folder name>_0.mcap`` (profile ``ros2``, ``ros2msg`` schemas,
``cdr`` messages). Both files exist from the start. Every chunk is passed to the operating system as
a whole, so all data up to the last flush can be read even if the process is killed; `synchronize`
also protects against a power failure.
"""

from __future__ import annotations

import contextlib
import errno
import os
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcap.writer import MCAP0_MAGIC, CompressionType, IndexType, Writer

from omni_core.configuration import WorkError
from omni_core.files import replaced
from omni_recording import metadata
from omni_recording.safe_yaml import in_yaml

COMPRESSIONS = {
    "none": CompressionType.NONE,
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
}


# Data end without a checksum, footer without a summary, and the closing magic bytes.
_END_WITHOUT_SUMMARY = (
    struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + MCAP0_MAGIC
)


class RecordingError(WorkError):
    """A recording cannot be created or continued; the message states the reason."""


class Rosbag2Writer:
    """Writer of one recording.

    After a `RecordingError`, the file is truncated to its last complete chunk and closed, as far as
    the disk allows. It remains readable, and further writes raise the error again.

    Args:
        folder: folder of the recording; created with its parents; must be empty if it exists.
        topics: all topics that will be written.
        chunk_size: total size of messages at which a chunk ends [B].
        compression: compression of the chunks, a key of `COMPRESSIONS`.
        synchronize: whether to wait at every flush until the data are on the disk.

    Raises:
        RecordingError: the folder is not empty or cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        topics: Sequence[metadata.RecordedTopic],
        *,
        chunk_size: int = 1 << 20,
        compression: str = "none",
        synchronize: bool = False,
    ) -> None:
        self._folder = folder.absolute()
        self._file_name = f"{self._folder.name}_0.mcap"
        self._topics = tuple(topics)
        self._chunk_size = chunk_size
        self._synchronize = synchronize
        self._counts = {topic.name: 0 for topic in self._topics}
        if len(self._counts) != len(self._topics):
            raise RecordingError("a topic is given twice; each can be recorded only once")
        self._first_ns, self._last_ns = metadata.UNSET_TIME, 0
        self._pending = 0
        # Position and content of the complete part of the file that has been passed to the
        # operating system.
        self._safe_end, self._safe = 0, metadata.Extent(dict(self._counts))
        self._closed = False
        self._failure: RecordingError | None = None
        with self._failing_clearly():
            self._make_folder()
            # Closed by `close`, or by `_end_early` after a failure.
            self._file = (self._folder / self._file_name).open("xb")
        with self._ending_on_failure():
            self._writer = Writer(
                self._file,
                chunk_size=2**62,  # this class, not the MCAP writer, ends the chunks
                compression=COMPRESSIONS[compression],
                index_types=IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA,
            )
            self._writer.start(profile="ros2", library="omni_recording")
            self._channels = self._register_topics()
            self._commit()
            self._write_metadata()

    def __enter__(self) -> Rosbag2Writer:
        """Return this writer, which is closed when the block is left, even by an exception."""
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages in the file up to the last flush, keyed by topic."""
        return dict(self._safe.counts)

    def write(self, topic: str, stamp_ns: int, data: bytes, publish_ns: int | None = None) -> None:
        """Add a message to the recording.

        Args:
            topic: full name of one of the recording's topics.
            stamp_ns: log time [ns], not negative.
            data: the message as CDR with its encapsulation header, kept byte for byte.
            publish_ns: publish time [ns], not negative; the log time if None.

        Raises:
            RecordingError: the file can no longer be written.
            ValueError: the stamp is negative.
        """
        if self._closed:
            raise self._failure or RecordingError(f"the recording {self._folder} is closed")
        published = stamp_ns if publish_ns is None else publish_ns
        if min(stamp_ns, published) < 0:  # a later error would leave half a record in the chunk
            raise ValueError(f"the stamp {min(stamp_ns, published)} ns must not be negative")
        count = self._counts[topic]
        self._writer.add_message(self._channels[topic], stamp_ns, data, published, count)
        self._counts[topic] = count + 1
        self._first_ns = min(self._first_ns, stamp_ns)
        self._last_ns = max(self._last_ns, stamp_ns)
        self._pending += len(data) + 31  # header of a message record
        if self._pending >= self._chunk_size:
            self.flush()

    def flush(self) -> None:
        """End the chunk and pass it to the operating system; do nothing without new messages.

        Raises:
            RecordingError: the file can no longer be written.
        """
        if self._pending and not self._closed:
            with self._ending_on_failure():
                self._writer.flush()
                self._commit()

    def close(self) -> None:
        """Finish the file and the metadata; may be called repeatedly.

        Raises:
            RecordingError: the file could not be finished; it is readable up to its last chunk.
        """
        self.flush()
        if self._closed:
            return
        with self._ending_on_failure():
            information = in_yaml(self._information())
            self._writer.add_metadata("rosbag2", {"serialized_metadata": information})
            self._writer.finish()
            # Closing is the last chance to notice a full disk, so it is done before writing the
            # metadata.
            self._file.flush()
            self._synchronize_file(self._file.fileno())
            self._file.close()
        self._closed = True
        with self._failing_clearly():
            self._write_metadata()

    def _make_folder(self) -> None:
        try:
            # Only a folder that already exists must be empty, because other processes may add files
            # to a new folder immediately.
            self._folder.mkdir(parents=True)
        except FileExistsError:
            if any(self._folder.iterdir()):
                raise RecordingError(
                    f"{self._folder} is not empty, and recordings never overwrite files; choose "
                    "another folder or remove this one"
                ) from None

    def _register_topics(self) -> dict[str, int]:
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for topic in self._topics:
            definition = topic.definition
            if definition.type_name not in schemas:
                schemas[definition.type_name] = self._writer.register_schema(
                    definition.type_name, "ros2msg", definition.text.encode()
                )
            channels[topic.name] = self._writer.register_channel(
                topic.name,
                metadata.SERIALIZATION,
                schemas[definition.type_name],
                {
                    "offered_qos_profiles": in_yaml(metadata.qos_information(topic.qos)).strip(),
                    "topic_type_hash": definition.type_hash,
                },
            )
        return channels

    def _commit(self) -> None:
        """Write a finished chunk to the file, and store its end in `_safe_end`.

        This fails if the disk has no space for the end of an MCAP file after the chunk.
        """
        self._file.flush()
        descriptor, end = self._file.fileno(), self._file.tell()
        if os.pwrite(descriptor, _END_WITHOUT_SUMMARY, end) < len(_END_WITHOUT_SUMMARY):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.ftruncate(descriptor, end)
        self._synchronize_file(self._file.fileno())
        self._pending = 0
        self._safe_end = self._file.tell()
        self._safe = metadata.Extent(dict(self._counts), self._first_ns, self._last_ns)

    @contextlib.contextmanager
    def _failing_clearly(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            raise RecordingError(f"cannot record to {self._folder}: {reason}") from error

    @contextlib.contextmanager
    def _ending_on_failure(self) -> Iterator[None]:
        try:
            with self._failing_clearly():
                yield
        except RecordingError as error:
            self._failure = error
            self._end_early()
            raise

    def _end_early(self) -> None:
        """Truncate the file to its last complete chunk and finish it there, if possible."""
        self._closed = True
        path = self._folder / self._file_name
        with contextlib.suppress(OSError):
            self._file.close()
        # On a full disk, truncation frees space for the few bytes that follow. Each step is useful
        # even if the next one fails: a file without an end can still be read as a stream.
        with contextlib.suppress(OSError):
            os.truncate(path, self._safe_end)
            with path.open("ab", buffering=0) as file:
                file.write(_END_WITHOUT_SUMMARY)
        with contextlib.suppress(OSError):
            self._write_metadata()

    def _write_metadata(self) -> None:
        """Replace metadata.yaml atomically."""
        path = self._folder / "metadata.yaml"
        with replaced(path) as new, new.open("w", encoding="utf-8") as file:
            file.write(in_yaml({"rosbag2_bagfile_information": self._information()}))
            file.flush()
            self._synchronize_file(file.fileno())
        if self._synchronize:  # makes the new name durable
            folder = os.open(self._folder, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def _synchronize_file(self, descriptor: int) -> None:
        if self._synchronize:
            os.fsync(descriptor)

    def _information(self) -> dict[str, Any]:
        return metadata.bag_information(self._file_name, self._topics, self._safe)
