"""Message definitions agree with those of other implementations of ROS 2."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from omni_recording.definitions import (
    MessageDefinitionError,
    find_message_definition,
    installation_prefixes,
)

SEPARATOR = "=" * 80 + "\n"

# The documentation of the messages states whether their first bytes are a stamp.
STAMPED = {
    "builtin_interfaces/msg/Time": True,
    "diagnostic_msgs/msg/DiagnosticArray": True,
    "geometry_msgs/msg/TwistStamped": True,
    "geometry_msgs/msg/TwistWithCovarianceStamped": True,
    "nav_msgs/msg/Odometry": True,
    "rosgraph_msgs/msg/Clock": True,
    "sensor_msgs/msg/CameraInfo": True,
    "sensor_msgs/msg/Image": True,
    "sensor_msgs/msg/JointState": True,
    "visualization_msgs/msg/Marker": True,
    "geometry_msgs/msg/Twist": False,
    "geometry_msgs/msg/PoseArray": True,
    "std_msgs/msg/String": False,
    "visualization_msgs/msg/MarkerArray": False,
}


@pytest.mark.parametrize(("type_name", "stamped"), STAMPED.items())
def test_definitions_agree_with_an_independent_store(type_name: str, stamped: bool) -> None:
    definition = find_message_definition(type_name)
    store = get_typestore(Stores.ROS2_JAZZY)
    assert definition.type_hash == store.hash_rihs01(type_name)
    assert definition.stamped == stamped

    first, *others = definition.text.split(SEPARATOR)
    texts = {type_name: first}
    for part in others:
        head, text = part.split("\n", 1)
        texts[head.removeprefix("MSG: ").replace("/", "/msg/")] = text
    expected_parts = store.generate_msgdef(type_name, ros_version=2)[0].count(SEPARATOR) + 1
    assert len(texts) == expected_parts
    for name, text in texts.items():
        assert get_types_from_msg(text, name)[name] == store.fielddefs[name]


@pytest.mark.parametrize(
    "name", ["sensor_msgs/Image", "Image", "", "../msg/Image", "sensor_msgs/msg/", "a/msg/B/msg/C"]
)
def test_a_malformed_name_is_refused(name: str) -> None:
    with pytest.raises(MessageDefinitionError, match="is not the name of a message type"):
        find_message_definition(name)


def test_a_type_that_is_not_installed_names_the_places(tmp_path: Path) -> None:
    with pytest.raises(MessageDefinitionError, match=str(tmp_path)):
        find_message_definition("sensor_msgs/msg/Image", [tmp_path])


def test_a_broken_description_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "share" / "my_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Thing.json").write_text("{", encoding="utf-8")
    with pytest.raises(MessageDefinitionError, match=r"Thing\.json cannot be read"):
        find_message_definition("my_msgs/msg/Thing", [tmp_path])


def test_overlays_come_before_what_they_overlay() -> None:
    prefixes = installation_prefixes({"AMENT_PREFIX_PATH": "/overlay:/underlay:"})
    assert prefixes[:2] == (Path("/overlay"), Path("/underlay"))
    assert len(prefixes) == 3
