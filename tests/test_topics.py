"""The nodes publish and subscribe the topics of `omni_platform.topics`, with their types."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from omni_platform import topics

SOURCES = Path(__file__).parents[1] / "src"
SENSOR = "{name}"  # as the nodes write it in an f-string
KNOWN = {
    topic.name: topic
    for topic in (
        *(entry for entry in vars(topics).values() if isinstance(entry, topics.Topic)),
        *(topics.lines(SENSOR), topics.camera_info(SENSOR), topics.flow(SENSOR)),
    )
}
NODES = {
    "simulator": "omni_sim/omni_sim/simulator_node.py",
    "linescan_odometry": "linescan_odometry/linescan_odometry/odometry_node.py",
    "brake_assist": "omni_brake_assist/omni_brake_assist/brake_assist_node.py",
}
NAMED = r'(?:f?"([^"/][^"]*)"|topics\.(\w+)\.name)'
PUBLISHED = re.compile(rf"(?:advertise\(self|create\(|create_publisher\()[, ]*(\w+), {NAMED}")
SUBSCRIBED = re.compile(rf"subscribe\(self, (\w+), {NAMED}")


@pytest.mark.parametrize("node", NODES)
def test_a_node_uses_the_topics_of_the_list(node: str) -> None:
    text = (SOURCES / NODES[node]).read_text(encoding="utf-8")
    published, subscribed = (
        {name or getattr(topics, constant).name: kind for kind, name, constant in calls}
        for calls in (PUBLISHED.findall(text), SUBSCRIBED.findall(text))
    )
    assert len(published.keys() & KNOWN.keys()) >= 3
    for name, kind in (published | subscribed).items():
        if name in KNOWN:
            assert KNOWN[name].type.endswith(f"/{kind}"), name
    expected = {name for name, topic in KNOWN.items() if topic.publisher == node} - {"clock"}
    assert expected <= published.keys()
