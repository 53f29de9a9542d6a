"""A rosbag2 folder on disk: its metadata and its files.

Only regular files inside the folder are opened, even if ``metadata.yaml`` names others. A single
``.mcap`` file is treated as a recording without metadata.
"""

import dataclasses
import heapq
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from omni_core.quantities import SECOND_NS
from omni_recording import mcap, metadata
from omni_recording.error import BagError, McapError
from omni_recording.limits import LIMITS
from omni_recording.safe_yaml import SafeLoader

METADATA = "metadata.yaml"

# Topics of a vehicle; the text before a topic is the vehicle's namespace.
_VEHICLE_TOPIC = re.compile(
    r"(?P<namespace>.*?)/(wheel_states|brake/(pedal|enable)|odometry/twist|ground_truth/odom"
    r"|line_scan/[^/]+/lines)"
)
_INFORMATION = "rosbag2_bagfile_information"
_CONVERT = "; convert it: ./omni exec rosbags-convert --src {} --dst NEW --dst-storage mcap"


@dataclasses.dataclass(frozen=True)
class Bag:
    """Files and metadata of a recording.

    Attributes:
        path: path of the folder or of the single file.
        files: MCAP files of the recording in the order in which they were written.
        message_count: number of messages according to the metadata; None without metadata.
        counts: number of messages according to the metadata, keyed by topic; empty without
            metadata.
        ros_distro: ROS distribution of the recorder; empty if unknown.
        namespace: namespace, such as ``/robot1``, that is removed from the topic names of the
            messages and of the summary.
    """

    path: Path
    files: tuple[Path, ...]
    message_count: int | None = None
    counts: Mapping[str, int] = dataclasses.field(default_factory=dict)
    ros_distro: str = ""
    namespace: str = ""


def open_bag(path: Path | str) -> Bag:
    """Return the recording at a path, with its metadata and the list of its MCAP files.

    Args:
        path: a rosbag2 folder or a single ``.mcap`` file.

    Raises:
        BagError: there is no recording, or it cannot be read; the message states the reason.
    """
    path = Path(path)
    if path.is_dir():
        if not (path / METADATA).exists():
            raise BagError(path, f"not a rosbag2 recording, it has no {METADATA}{_remedy(path)}")
        return _from_metadata(path)
    if not path.exists():
        raise BagError(path, "there is no such folder")
    if path.suffix != ".mcap":
        raise BagError(path, "not a folder, and not an .mcap file")
    _require_regular(path, path)
    return Bag(path, (path,))


def _remedy(folder: Path) -> str:
    """Return a remedy for a folder without metadata; an empty text if there is no remedy."""
    try:
        inside = sorted(entry.name for entry in folder.iterdir() if (entry / METADATA).exists())
        cut_off = any(folder.glob("*.mcap"))
    except OSError:
        return ""
    if inside:
        return f"; name one of the recordings in it: {', '.join(inside)}"
    return "; ./omni bag recover restores it" if cut_off else ""


def open_vehicle(path: Path | str) -> Bag:
    """Return the recording of one vehicle, without the vehicle's namespace in the topic names.

    Args:
        path: a rosbag2 folder or a single ``.mcap`` file.

    Raises:
        BagError: there is no readable recording, or it contains several vehicles.
    """
    bag = open_bag(path)
    found = {
        match["namespace"]
        for topic in bag_summary(bag).counts
        if (match := _VEHICLE_TOPIC.fullmatch(topic))
    }
    if len(found) > 1:
        names = ", ".join(sorted(name or "/" for name in found))
        raise BagError(
            bag.path, f"contains the vehicles {names}; `ros2 bag convert` can extract one of them"
        )
    return dataclasses.replace(bag, namespace=found.pop() if found else "")


def bag_files(path: Path, problems: list[str] | None = None) -> tuple[Path, ...]:
    """Return the MCAP files of a recording without using its metadata, which may be missing.

    Args:
        path: a rosbag2 folder or a single ``.mcap`` file.
        problems: list to which the problems of unreadable files are added; such files are omitted.

    Raises:
        BagError: there are no files, or a file cannot be read and `problems` is None.
    """
    if not path.is_dir():
        return open_bag(path).files
    # rosbag2 numbers the files: bag_9.mcap comes before bag_10.mcap.
    files = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
    if not files:
        raise BagError(path, "there is no .mcap file in it")
    readable = []
    for file in files:
        try:
            _require_regular(path, file)
            readable.append(file)
        except BagError as error:
            if problems is None:
                raise
            problems.append(error.problem)
    return tuple(readable)


def bag_messages(bag: Bag) -> Iterator[mcap.RecordedMessage]:
    """Yield every message, file after file, in the order of the files.

    Raises:
        BagError: a file is damaged or incomplete at the next message, or has another format.
    """
    for file in bag.files:
        try:
            yield from mcap.McapMessages(file, namespace=bag.namespace)
        except (McapError, OSError) as error:
            raise file_problem(bag.path, file, error) from None


def bag_summary(bag: Bag) -> mcap.McapSummary:
    """Return the topics, message counts, and first and last log time of the whole recording.

    The values are read from the summaries of the files; a file without a summary is read
    completely.

    Raises:
        BagError: a file is damaged or incomplete, or has another format.
    """
    parts = []
    for file in bag.files:
        try:
            parts.append(mcap.read_summary(file, bag.namespace) or _counted(file, bag.namespace))
        except (McapError, OSError) as error:
            raise file_problem(bag.path, file, error) from None
    counts: dict[str, int] = {}
    for part in parts:
        for topic, count in part.counts.items():
            counts[topic] = counts.get(topic, 0) + count
    timed = [part for part in parts if any(part.counts.values())]
    channels = {(one.topic, one.type_name): one for part in parts for one in part.channels}
    first_ns = min((part.first_ns for part in timed), default=0)
    last_ns = max((part.last_ns for part in timed), default=0)
    chunks = sum(part.chunks for part in parts)
    words = tuple(sorted({word for part in parts for word in part.compressions}))
    return mcap.McapSummary(tuple(channels.values()), counts, first_ns, last_ns, chunks, words)


def file_problem(folder: Path, file: Path, error: McapError | OSError) -> BagError:
    """Convert an error in one file to a `BagError` about the recording."""
    if isinstance(error, McapError):
        hint = "; `omni bag recover` keeps the complete messages" if error.recoverable else ""
        return BagError(folder, f"{file.name} {error.problem}{hint}")
    return BagError(folder, f"{file.name} cannot be read: {error.strerror or error}")


def _counted(file: Path, namespace: str) -> mcap.McapSummary:
    reader = mcap.McapMessages(file, namespace=namespace)
    counts: dict[str, int] = {}
    first_ns, last_ns = 1 << 63, 0
    for message in reader:
        counts[message.channel.topic] = counts.get(message.channel.topic, 0) + 1
        first_ns, last_ns = min(first_ns, message.log_ns), max(last_ns, message.log_ns)
    for channel in reader.channels:
        counts.setdefault(channel.topic, 0)
    extent = first_ns if any(counts.values()) else 0, last_ns
    compressions = tuple(sorted(reader.compressions))
    return mcap.McapSummary(reader.channels, counts, *extent, reader.chunks, compressions)


def _from_metadata(folder: Path) -> Bag:
    information = _read_information(folder)

    def get(key: str, kind: type, default: Any) -> Any:
        value = information.get(key, default)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise BagError(folder, f"metadata.yaml: {key} is missing or is invalid")
        return value

    version = get("version", int, None)
    if version > metadata.VERSION:
        raise BagError(folder, f"metadata.yaml: version {version} is newer than {metadata.VERSION}")
    storage = get("storage_identifier", str, None)
    if storage != "mcap":
        raise BagError(
            folder,
            f"metadata.yaml: the storage {storage[:40]!r} is not supported, only mcap"
            + _CONVERT.format(folder),
        )
    if get("compression_mode", str, "").lower() not in ("", "none"):
        raise BagError(
            folder,
            "metadata.yaml: whole files or messages are compressed, which is not supported"
            + _CONVERT.format(folder),
        )
    names = get("relative_file_paths", list, None)
    if not names:
        raise BagError(folder, "metadata.yaml names no file")
    files = tuple(_file_within(folder, name, version) for name in names)
    number = get("message_count", int, None)
    counts = claimed_counts(folder, information)
    return Bag(folder, files, number, counts, str(information.get("ros_distro") or ""))


def claimed_counts(folder: Path, information: Mapping[str, Any] | None = None) -> Mapping[str, int]:
    """Return the number of messages according to the metadata of a recording, keyed by topic.

    Args:
        folder: rosbag2 folder, whose files may be missing.
        information: content of the metadata, if it is read already.

    Raises:
        BagError: the metadata is missing or invalid.
    """
    topics = (information or _read_information(folder)).get("topics_with_message_count", [])
    if not isinstance(topics, list):
        raise BagError(folder, "metadata.yaml: topics_with_message_count is invalid")
    return dict(_claimed_count(folder, topic) for topic in topics)


def _claimed_count(folder: Path, entry: Any) -> tuple[str, int]:
    try:
        name, count = entry["topic_metadata"]["name"], entry["message_count"]
    except (TypeError, KeyError, IndexError):
        name, count = None, None
    if not isinstance(name, str) or not isinstance(count, int) or count < 0:
        raise BagError(folder, "metadata.yaml: topics_with_message_count is invalid")
    return name, count


def _file_within(folder: Path, name: Any, version: int) -> Path:
    if not isinstance(name, str) or not name or "\0" in name:
        raise BagError(folder, "metadata.yaml: relative_file_paths is invalid")
    inside = PurePosixPath(name)
    if version < 4 and not inside.is_absolute():
        inside = PurePosixPath(inside.name)  # old names include the folder
    if inside.is_absolute() or len(inside.parts) != 1 or ".." in inside.parts:
        raise BagError(folder, f"metadata.yaml names {name[:80]!r}, which is not in the folder")
    path = folder / inside
    if not path.exists():
        raise BagError(folder, f"the file {inside} is missing")
    _require_regular(folder, path)
    return path


def _require_regular(folder: Path, path: Path) -> None:
    # Opening a pipe would wait forever, and reading a device would never end.
    try:
        mode = path.stat().st_mode
    except OSError as error:  # such as a broken or circular link
        raise BagError(folder, f"{path.name} cannot be read: {error.strerror}") from None
    if not stat.S_ISREG(mode):
        raise BagError(folder, f"{path.name} is not a regular file")


def read_plain_yaml(text: str) -> Any:
    """Return the content of a YAML text that consists of plain values.

    Raises:
        ValueError: the text contains anything else; the message states the reason in one line.
    """
    load: Callable[..., Any] = yaml.load
    try:
        return load(text, Loader=SafeLoader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        problem = " ".join(str(error).replace('in "<unicode string>", ', "in ").split())[:200]
        raise ValueError(f"is not valid YAML: {problem}") from None


def read_plain_file(path: Path) -> Any:
    """Return the content of a YAML file that consists of plain values.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not a regular file, exceeds the limit on its size, or contains
            anything else; the message states the reason in one line.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("is not a regular file")
    if status.st_size > LIMITS.text:
        raise ValueError(f"is larger than {LIMITS.text} bytes")
    try:
        return read_plain_yaml(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise ValueError("is not text") from None


def _read_information(folder: Path) -> Mapping[str, Any]:
    try:
        document = read_plain_file(folder / METADATA)
    except OSError as error:
        raise BagError(folder, f"metadata.yaml cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise BagError(folder, f"metadata.yaml {error}") from None
    information = document.get(_INFORMATION) if isinstance(document, dict) else None
    if not isinstance(information, dict):
        raise BagError(folder, f"metadata.yaml has no {_INFORMATION}")
    return information


def in_time_order(messages: Iterable[mcap.RecordedMessage]) -> Iterator[mcap.RecordedMessage]:
    """Yield messages in the order of log time; messages with equal times keep their order.

    In a file, messages of different topics may be out of order. To sort them, the messages of one
    second of recorded time are buffered, up to a total of `RecordingLimits.waiting` bytes.
    """
    waiting: list[tuple[int, int, mcap.RecordedMessage]] = []
    size, newest_ns = 0, 0
    for number, message in enumerate(messages):
        heapq.heappush(waiting, (message.log_ns, number, message))
        size += len(message.data)
        newest_ns = max(newest_ns, message.log_ns)
        while waiting[0][0] < newest_ns - SECOND_NS or size > LIMITS.waiting:
            _, _, oldest = heapq.heappop(waiting)
            size -= len(oldest.data)
            yield oldest
            if not waiting:
                break
    while waiting:
        yield heapq.heappop(waiting)[2]
