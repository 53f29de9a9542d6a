"""The viewer configurations show topics that a run records."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import yaml
from omni_process import WORKSPACE
from rosbags.typesys import Stores, get_typestore

from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph.nodes import recorded_topics

VIEWERS = WORKSPACE / "config/viewers"
_STEP = re.compile(r"(\w+)(\[\d+\])?")
_TOPIC_KEYS = {"imageTopic", "topicToRender"}


def topic_paths(document: Any) -> Iterator[str]:
    """Return the paths that a layout's panels read, such as ``/topic.field[0].part``."""
    if isinstance(document, dict):
        for key, value in document.items():
            if key in _TOPIC_KEYS or (key == "value" and isinstance(value, str)):
                yield value
            elif key == "topics":
                yield from value
            yield from topic_paths(value)
    elif isinstance(document, list):
        for entry in document:
            yield from topic_paths(entry)


def panels(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        yield from panels(node["first"])
        yield from panels(node["second"])


def recorded(library: ExperimentLibrary) -> dict[str, str]:
    return recorded_topics(library.load("straight_line", "assisted"))


def test_the_foxglove_layout_reads_fields_that_are_recorded(library: ExperimentLibrary) -> None:
    topics = recorded(library)
    fields = get_typestore(Stores.ROS2_JAZZY).fielddefs
    paths = list(topic_paths(json.loads((VIEWERS / "foxglove.json").read_text())))
    assert len(paths) > 20
    for path in paths:
        topic, *steps = path.split(".")
        kind = topics[topic]
        for step in steps:
            match = _STEP.fullmatch(step)
            assert match, path
            (name, index), entries = match.groups(), dict(fields[kind][1])
            assert name in entries, path
            shape, inner = entries[name]
            assert (shape.name in ("ARRAY", "SEQUENCE")) == (index is not None), path
            kind = str(inner) if shape.name == "NAME" else ""  # nothing below a number


def test_the_foxglove_layout_places_the_panels_that_it_sets_up() -> None:
    document = json.loads((VIEWERS / "foxglove.json").read_text())
    placed = list(panels(document["layout"]))
    assert sorted(placed) == sorted(document["configById"])


def test_the_rviz_set_up_shows_topics_that_are_recorded(library: ExperimentLibrary) -> None:
    document = yaml.safe_load((VIEWERS / "rviz.rviz").read_text())["Visualization Manager"]
    shown = [display["Topic"]["Value"] for display in document["Displays"] if "Topic" in display]
    assert shown
    assert set(shown) <= set(recorded(library))
    assert document["Global Options"]["Fixed Frame"] == "odom"
