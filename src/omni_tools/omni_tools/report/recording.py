"""Data that a report shows of a recording: its `RunHistory` and further time series."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from itertools import compress, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omni_brake_assist.conditions import AssistState
from omni_core.configuration import InputError, from_mapping
from omni_core.quantities import FloatArray, IntArray
from omni_core.topics import DECLARED, JOINT_STATE, MARKERS, WHEEL_FORCES, Signal, Topic
from omni_recording import decode, folder
from omni_recording.error import BagError
from omni_runs import drift, experiment, recorded_run
from omni_runs.history import SIGNALS, RunHistory
from omni_runs.limit.bounds import limit_share
from omni_runs.metrics import Metric, rest_stamp
from omni_runs.recorded_run import Stream, read_streams
from omni_runs.stops import drive_metrics, named_stops, stop_metrics

SHOWN = tuple(
    (topic, signal)
    for topic in DECLARED
    if topic.recorded and topic.type == JOINT_STATE
    for signal in topic.signals
    if signal.name not in SIGNALS
)
"""Signals that a report shows beside the history, each with its topic."""

_METERS_PER_NEWTON = 1e-4  # scale of the arrows in recordings without forces [m/N]


class Series(NamedTuple):
    """Time series of K values, whose M stamps differ from the control stamps of the history.

    Attributes:
        stamp_ns: stamps [ns], increasing, shape (M,).
        values: values in the unit of their source, shape (M, K).
        names: names of the columns; empty if the columns belong to the run's wheels.
    """

    stamp_ns: IntArray
    values: FloatArray
    names: tuple[str, ...] = ()

    def during(self, history: RunHistory) -> Series | None:
        """Return the part of the series in the time span of a history; None for an empty part."""
        first, last = history.stamp_ns[[0, -1]]
        part = (self.stamp_ns >= first) & (self.stamp_ns <= last)
        return Series(self.stamp_ns[part], self.values[part], self.names) if any(part) else None


def read_wheel_forces(bag_folder: Path | str, wheels: int) -> Series | None:
    """Read the forces of the ground on the wheels.

    Recordings of the first version contain only arrows of these forces, among their markers.

    Args:
        bag_folder: rosbag2 folder, or a single ``.mcap`` file.
        wheels: number of wheels.

    Returns:
        Components x and y of each wheel's force in `odom` [N], wheel by wheel in the order of the
        recording; None if the forces of this number of wheels were not recorded.

    Raises:
        BagError: the recording cannot be read.
    """
    bag = folder.open_vehicle(bag_folder)
    topic = WHEEL_FORCES if folder.bag_summary(bag).counts.get(WHEEL_FORCES.path) else MARKERS
    found: dict[int, list[float]] = {}
    for recorded, message in decode.decoded_messages(bag, (topic.path,)):
        if recorded.channel.type_name != topic.type:
            continue
        stamped, forces = (_wrenches if topic == WHEEL_FORCES else _arrows)(message)
        stamp_ns = decode.header_stamp_ns(stamped)
        if stamp_ns is not None and len(forces) == 2 * wheels:
            found[stamp_ns] = forces
    if not found:
        return None
    stamps, values = zip(*sorted(found.items()), strict=True)
    return Series(np.array(stamps, dtype=np.int64), np.array(values, dtype=np.float64))


def _wrenches(message: Any) -> tuple[Any, list[float]]:
    """Return the stamped part of a message of wheel forces, and the components x and y [N]."""
    return message, [c for wrench in message.wrench for c in (wrench.force.x, wrench.force.y)]


def _arrows(message: Any) -> tuple[Any, list[float]]:
    """Return the stamped part of a message of markers, and the forces that its arrows show [N]."""
    arrows = [m.points for m in message.markers if m.ns == "wheel_forces" and len(m.points) == 2]
    lengths = [length for a, b in arrows for length in (b.x - a.x, b.y - a.y)]
    stamped = message.markers[0] if message.markers else None
    return stamped, [length / _METERS_PER_NEWTON for length in lengths]


def read_series(bag_folder: Path | str) -> dict[str, Series]:
    """Return the recorded signals in `JointState` messages that no history contains.

    One of them is ``test_ratio``: the normalized innovations squared of fault detection divided by
    their gates [1], NaN without an innovation.

    Returns:
        Series keyed by the name of the signal, without signals that were not recorded.

    Raises:
        BagError: the recording cannot be read, or the names in the messages of a topic differ.
    """
    bag = folder.open_vehicle(bag_folder)
    streams = read_streams(bag, (topic for topic, _ in SHOWN))
    return {
        signal.name: _series_of(bag, topic, signal, streams[topic.name])
        for topic, signal in SHOWN
        if topic.name in streams
    }


def _series_of(bag: folder.Bag, topic: Topic, signal: Signal, stream: Stream) -> Series:
    names = tuple(stream.messages[0].name)
    rows = [getattr(message, signal.field) for message in stream.messages]
    for message, values in zip(stream.messages, rows, strict=True):
        if tuple(message.name) != names or len(values) != len(names):
            raise BagError(bag.path, f"{topic.path} names different sources")
    return Series(stream.stamp_ns, np.array(rows, dtype=np.float64), names)


_ASSISTING = (
    AssistState.ASSISTING.value,
    AssistState.DEAD_RECKONING.value,
    AssistState.NO_RELEASE.value,
)
_MOST_VALUES = 4000
_LONGEST_TEXT = 200  # characters of a key or value


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReportedRun:
    """Data of one run in a report.

    Attributes:
        name: name, unique within the report.
        history: time histories of the run.
        metrics: metrics of the run, keyed by quantity.
        forces: forces of the wheels on the vehicle; None if they were not recorded.
        series: recorded signals that the history does not contain, keyed by name (`read_series`).
        configuration: configuration of the whole loop; None unless it is stored with the recording
            and has the same wheels.
        values: available values of the configuration as texts, keyed by dotted key.
        notes: sentences about missing data.
    """

    name: str
    history: RunHistory
    metrics: Mapping[str, Metric]
    forces: Series | None = None
    series: Mapping[str, Series] = dataclasses.field(default_factory=dict)
    configuration: experiment.ExperimentConfiguration | None = None
    values: Mapping[str, str] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()


def stops_apart(whole: ReportedRun) -> list[ReportedRun]:
    """Return each stop of a recording as a run of its own, for a report."""
    stops = named_stops(whole.history, whole.name)
    return [_part(whole, stop, name) for name, stop in stops.items()]


def compared_runs(path: Path, name: str) -> dict[str, dict[str, Metric]]:
    """Return the metrics and the odometry drift of each stop of a recording, keyed by stop name.

    For a recording with several stops, the result also has an entry for the whole recording, with
    the number of stops, the length of the path, and the drift.

    Args:
        path: rosbag2 folder, or a single ``.mcap`` file.
        name: name of the recording.

    Raises:
        BagError: the recording cannot be read, or does not contain a run.
    """
    history = recorded_run.read_run(path)
    stops = named_stops(history, name)
    compared: dict[str, dict[str, Metric]] = {}
    if len(stops) > 1:
        compared[name] = drive_metrics(history, len(stops)) | drift.drift_metrics(history)
    for words, stop in stops.items():
        compared[words] = _measured(stop) | drift.drift_metrics(stop)
    return compared


def _measured(
    history: RunHistory, configuration: experiment.ExperimentConfiguration | None = None
) -> dict[str, Metric]:
    metrics = stop_metrics(history)
    start = history.brake_start
    rest = None if start is None else rest_stamp(history.twist, start)
    if start is not None and any(history.assist_state):
        braking = history.assist_state[start : None if rest is None else rest + 1]
        assisting = sum(state in _ASSISTING for state in braking) / len(braking)
        metrics["assisting_share"] = Metric(assisting, "1")
    if configuration is not None:
        distance = metrics["stopping_distance"].value
        metrics["limit_share"] = limit_share(history, configuration, distance)
    return metrics


def _part(whole: ReportedRun, history: RunHistory, name: str) -> ReportedRun:
    """Return a run that contains one stop of a recording."""
    if history is whole.history:
        return whole
    forces = whole.forces
    parts = {name: series.during(history) for name, series in whole.series.items()}
    return dataclasses.replace(
        whole,
        name=name,
        history=history,
        metrics=_measured(history, whole.configuration),
        forces=forces and forces.during(history),
        series={name: part for name, part in parts.items() if part},
    )


def read_reported_run(path: Path, name: str) -> ReportedRun:
    """Return a recording and the configuration stored with it as one run.

    Args:
        path: rosbag2 folder, or a single ``.mcap`` file.
        name: name, unique within the report.

    Raises:
        BagError: the recording cannot be read, or does not contain a run.
    """
    history = recorded_run.read_run(path)
    forces = read_wheel_forces(path, len(history.wheel_names))
    notes = [] if forces else ["no wheel forces were recorded"]
    configuration, values, problem = read_configuration(
        path / experiment.CONFIGURATION, history.wheel_names
    )
    if problem:
        notes.append(f"vehicle, ground, slips and loads are not shown: {problem}")
    return ReportedRun(
        name=name,
        history=history,
        metrics=_measured(history, configuration),
        forces=forces,
        series=read_series(path),
        configuration=configuration,
        values=values,
        notes=tuple(notes),
    )


def run_names(paths: Sequence[Path]) -> list[str]:
    """Return unique names of recordings: the shortest final parts of their paths that all differ.

    Raises:
        InputError: a recording is given twice.
    """
    places = [path.resolve() for path in paths]
    if len(set(places)) < len(places):
        raise InputError("a recording is given twice")
    depth = 1
    while len(names := {"/".join(place.parts[-depth:]) for place in places}) < len(places):
        depth += 1
    return ["/".join(place.parts[-depth:]) for place in places] if names else []


def differing_values(paths: Sequence[Path]) -> tuple[dict[str, list[str]], dict[Path, str]]:
    """Return the values in which the configurations of recordings differ.

    Args:
        paths: paths of the recordings.

    Returns:
        Values that differ, one text for each recording, keyed by dotted key; the text is empty if a
        configuration does not contain the value. Reasons why configurations cannot be read, keyed
        by recording.
    """
    found, problems = [], {}
    for path in paths:
        folder = path if path.is_dir() else path.parent
        try:
            found.append(
                dict(
                    islice(_flattened(_read_tree(folder / experiment.CONFIGURATION)), _MOST_VALUES)
                )
            )
        except ValueError as error:
            found.append({})
            problems[path] = str(error)[:_LONGEST_TEXT]
    keys = dict.fromkeys(key for values in found for key in values)
    rows = {key: [values.get(key, "") for values in found] for key in keys}
    readable = [path not in problems for path in paths]
    differing = {key: row for key, row in rows.items() if len(set(compress(row, readable))) > 1}
    return differing, problems


def read_configuration(
    path: Path, wheel_names: Sequence[str]
) -> tuple[experiment.ExperimentConfiguration | None, dict[str, str], str]:
    """Return the configuration that is stored with a recording, and its values as texts.

    Args:
        path: path of the configuration file.
        wheel_names: wheel names of the recording, in any order.

    Returns:
        Configuration; None if it is invalid or does not match the recording. Its readable values as
        texts, keyed by dotted key. Reason why there is no configuration; otherwise empty.
    """
    values: dict[str, str] = {}
    try:
        tree = _read_tree(path)
        values = dict(islice(_flattened(tree), _MOST_VALUES))
        configuration = from_mapping(experiment.ExperimentConfiguration, tree)
        if set(configuration.vehicle.wheels) != set(wheel_names):
            raise ValueError("the configuration names other wheels than the recording")
    except ValueError as error:  # includes ConfigurationError
        return None, values, str(error)[:_LONGEST_TEXT]
    return configuration, values, ""


def _read_tree(path: Path) -> dict[str, Any]:
    try:
        tree = folder.read_plain_file(path)
    except OSError:
        raise ValueError(f"there is no {experiment.CONFIGURATION} next to the recording") from None
    except ValueError as error:
        raise ValueError(f"{experiment.CONFIGURATION} {error}") from None
    if not isinstance(tree, dict):
        raise ValueError(f"{experiment.CONFIGURATION} does not name any value")
    return tree


def _flattened(tree: Mapping[Any, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Yield the dotted key and the text of each value in a tree.

    The pairs are yielded one by one, because YAML aliases can make the tree of a small file huge.
    """
    for name, value in tree.items():
        key = f"{above}.{name}" if above else str(name)
        if isinstance(value, dict) and value:
            yield from _flattened(value, key)
        else:
            yield key[:_LONGEST_TEXT], _text(value)[:_LONGEST_TEXT]


def _text(value: Any) -> str:
    if isinstance(value, (dict, list)):
        plain = isinstance(value, list) and not any(isinstance(e, (dict, list)) for e in value)
        return str(value[:32]) if plain else f"({len(value)} values)" if value else "(none)"
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)
