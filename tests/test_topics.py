"""The topics of `omni_core.topics` have valid types, and their nodes publish them."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from omni_core import topics
from omni_ros.messages import message_class, packed

SOURCES = Path(__file__).parents[1] / "src"
OF_SENSORS = {
    "lines": topics.lines("front"),
    "camera_info": topics.camera_info("front"),
    "flow": topics.flow("left"),
}
KNOWN = OF_SENSORS | {
    name: entry for name, entry in vars(topics).items() if isinstance(entry, topics.Topic)
}
NODES = {
    "simulator": "omni_sim/omni_sim/simulator_node.py",
    "linescan_odometry": "linescan_odometry/linescan_odometry/odometry_node.py",
    "brake_assist": "omni_brake_assist/omni_brake_assist/brake_assist_node.py",
    "driver": "omni_tools/omni_tools/drive/driver_node.py",
}


@pytest.mark.parametrize("name", KNOWN)
def test_the_type_of_a_topic_is_installed(name: str) -> None:
    assert message_class(KNOWN[name].type).__name__ == KNOWN[name].type.rpartition("/")[2]


@pytest.mark.parametrize("node", NODES)
def test_a_node_publishes_its_topics(node: str) -> None:
    text = (SOURCES / NODES[node]).read_text(encoding="utf-8")
    used = set(re.findall(r"\btopics\.(\w+)", text))
    if f'published_by("{node}")' in text:  # then the node publishes each plain topic
        used |= {name for name, topic in KNOWN.items() if topic.is_plain}
    expected = {name for name, topic in KNOWN.items() if topic.publisher == node} - {"CLOCK"}
    assert expected
    assert expected <= used


def test_each_topic_has_a_name_of_its_own() -> None:
    assert len({topic.name for topic in KNOWN.values()}) == len(KNOWN)


def test_each_signal_has_a_name_of_its_own() -> None:
    names = [signal.name for topic in KNOWN.values() for signal in topic.signals]
    assert len(set(names)) == len(names)


def test_a_plain_message_has_a_value_for_each_name() -> None:
    heights = topics.Signal("height", "position", "m", ("front", "rear"))
    topic = topics.Topic(
        "heights", topics.JOINT_STATE, "node", (heights,), joints=("front", "rear")
    )
    message = packed(topic, SimpleNamespace(stamp_ns=3, height=np.array([0.1, 0.2])), ())
    assert (message.header.stamp.nanosec, list(message.name)) == (3, ["front", "rear"])
    assert list(message.position) == [0.1, 0.2]
    assert not len(message.velocity)
    assert not len(message.effort)
