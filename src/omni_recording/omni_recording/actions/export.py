"""Export of all topics except images as CSV or Parquet, one file for each topic."""

import contextlib
import csv
import dataclasses
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from omni_core.configuration import InputError, WorkError
from omni_core.plugins import import_optional
from omni_recording.decode import DecodeError, MessageDecoder
from omni_recording.folder import bag_messages, bag_summary, open_bag
from omni_recording.limits import LIMITS
from omni_recording.mcap import RecordedChannel
from omni_recording.table import TooWideError, Value, flatten

LOG_TIME = "log_ns"

_TOPIC = re.compile(r"(/[A-Za-z0-9_]+)+")


class ExportError(InputError):
    """An export is not possible; the message states the reason."""


@dataclasses.dataclass(frozen=True)
class BagExport:
    """Files that an export has written.

    Attributes:
        files: path of each file, keyed by topic.
        rows: number of rows in each file, keyed by topic.
        skipped: reason why a topic has no file, keyed by topic.
        failed: the skipped topics whose messages a table could represent, and those that were
            explicitly chosen.
    """

    files: Mapping[str, Path]
    rows: Mapping[str, int]
    skipped: Mapping[str, str]
    failed: Collection[str]


def export_bag(
    path: Path | str, folder: Path, form: str = "csv", topics: Collection[str] = ()
) -> BagExport:
    """Write a table for each topic whose messages can be converted to rows of plain values.

    The recording is read twice. The first pass determines the columns, so that a damaged recording
    is rejected before anything is written. Only a few rows are in memory at a time.

    Args:
        path: a rosbag2 folder or a single ``.mcap`` file.
        folder: folder for the files; must be empty if it exists.
        form: ``csv`` or ``parquet``.
        topics: topics to export; empty for all topics that a table can represent.

    Raises:
        BagError: the recording is damaged or has another format.
        ExportError: the recording does not contain a topic, or the folder is not empty.
        WorkError: the files cannot be written.
    """
    bag = open_bag(path)
    make_table = _table_maker(form)
    summary = bag_summary(bag)
    chosen = [c for c in summary.channels if not topics or c.topic in topics]
    missing = sorted(set(topics) - {channel.topic for channel in chosen})
    if missing:
        raise ExportError(f"there is no topic {', '.join(missing)} in {bag.path}")
    if len(chosen) > LIMITS.topics:
        raise ExportError(f"there are more than {LIMITS.topics} topics; choose some of them")
    decoder = MessageDecoder()
    layouts = _Layouts(decoder, chosen)
    for message in bag_messages(bag):
        layouts.add(message)
    rows = dict.fromkeys(layouts.columns, 0)
    files = {topic: folder / f"{topic[1:].replace('/', '.')}.{form}" for topic in rows}
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ExportError(f"{folder} exists and is not an empty folder; choose another")
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as stack:
            tables = {
                topic: stack.enter_context(
                    contextlib.closing(make_table(files[topic], layouts.columns[topic]))
                )
                for topic in rows
            }
            for message in bag_messages(bag):
                topic = message.channel.topic
                if topic in tables:
                    cells = flatten(decoder, message.channel.type_name, decoder.decode(message))
                    row: dict[str, Value] = {name: value for name, _, value in cells}
                    tables[topic].add({LOG_TIME: message.log_ns, **row})
                    rows[topic] += 1
    except OSError as error:
        raise WorkError(f"cannot write to {folder}: {error.strerror or error}") from None
    failed = layouts.skipped.keys() - (layouts.too_wide - set(topics))
    return BagExport(files, rows, layouts.skipped, failed)


class _Layouts:
    """Determines the table columns of every topic."""

    def __init__(self, decoder: MessageDecoder, channels: Collection[RecordedChannel]) -> None:
        self._decoder = decoder
        self.columns: dict[str, dict[str, str]] = {}  # kind of each column, by topic
        self.skipped: dict[str, str] = {}
        self.too_wide: set[str] = set()
        kinds: dict[str, str] = {}
        for channel in channels:
            problem = decoder.problem(channel)
            if not problem and kinds.setdefault(channel.topic, channel.type_name) != (
                channel.type_name
            ):
                problem = "its messages are of several types"
            if not _TOPIC.fullmatch(channel.topic) or len(channel.topic) > LIMITS.topic:
                problem = "it is not the name of a ROS topic"
            if problem:
                self._skip(channel.topic, problem)
        for topic in kinds:
            if topic not in self.skipped:
                self.columns[topic] = {LOG_TIME: "int64"}

    def add(self, message: Any) -> None:
        topic = message.channel.topic
        columns = self.columns.get(topic)
        if columns is None:
            return
        try:
            decoded = self._decoder.decode(message)
            for name, kind, _ in flatten(self._decoder, message.channel.type_name, decoded):
                columns.setdefault(name, kind)
            if len(columns) > LIMITS.columns + 1:
                raise TooWideError(f"its messages need more than {LIMITS.columns} columns")
        except DecodeError as error:
            self._skip(topic, str(error))
        except TooWideError as error:
            self._skip(topic, str(error))
            self.too_wide.add(topic)

    def _skip(self, topic: str, why: str) -> None:
        self.skipped[topic] = why
        self.columns.pop(topic, None)


class _CsvTable:
    """CSV file with all digits of numbers; a missing value gives an empty cell."""

    def __init__(self, path: Path, columns: Mapping[str, str]) -> None:
        self._file = path.open("x", newline="", encoding="utf-8")
        self._writer = csv.DictWriter(self._file, list(columns), restval="")
        self._writer.writeheader()

    def add(self, row: Mapping[str, Value]) -> None:
        self._writer.writerow(row)

    def close(self) -> None:
        self._file.close()


class _ParquetTable:
    """Parquet file with typed columns; a missing value gives a null cell."""

    def __init__(self, path: Path, columns: Mapping[str, str]) -> None:
        import pyarrow
        import pyarrow.parquet

        kinds = {"bool": "bool_", "byte": "uint8", "char": "uint8"}  # others have the same name
        self._schema = pyarrow.schema(
            [(name, getattr(pyarrow, kinds.get(kind, kind))()) for name, kind in columns.items()]
        )
        self._make = pyarrow.RecordBatch.from_pylist
        self._writer = pyarrow.parquet.ParquetWriter(path, self._schema)
        self._rows: list[Mapping[str, Value]] = []

    def add(self, row: Mapping[str, Value]) -> None:
        self._rows.append(row)
        if len(self._rows) == LIMITS.rows:
            self._flush()

    def close(self) -> None:
        self._flush()
        self._writer.close()

    def _flush(self) -> None:
        self._writer.write_batch(self._make(self._rows, schema=self._schema))
        self._rows = []


def _table_maker(form: str) -> type[_CsvTable] | type[_ParquetTable]:
    if form == "csv":
        return _CsvTable
    try:
        import_optional("pyarrow.parquet", "parquet")
    except ImportError:
        raise ExportError("Parquet needs the package pyarrow: ./omni install parquet") from None
    return _ParquetTable
