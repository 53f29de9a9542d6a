"""Transforms in a recording give the poses of the odometry, for any reader."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from omni_core.configuration import ConfigurationError
from omni_recording.definitions import find_message_definition
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_recording.plan import RecorderConfiguration, StampedRecording
from omni_recording.transforms import RecordedTransforms
from omni_recording.write import Rosbag2Writer

STORE = get_typestore(Stores.ROS2_JAZZY)
TRANSFORMS = "tf2_msgs/msg/TFMessage"
TRUTH = "/ground_truth/odom"
ODOMETRY = "nav_msgs/msg/Odometry"


def odometry(stamp_ns: int, place: tuple[float, float, float], yaw: float) -> bytes:
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    message = types[ODOMETRY](
        header=types["std_msgs/msg/Header"](stamp, "odom"),
        child_frame_id="base_link",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](
            pose=types["geometry_msgs/msg/Pose"](
                position=types["geometry_msgs/msg/Point"](*place),
                orientation=types["geometry_msgs/msg/Quaternion"](
                    0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)
                ),
            ),
            covariance=np.zeros(36),
        ),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](
            twist=types["geometry_msgs/msg/Twist"](
                types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0),
                types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0),
            ),
            covariance=np.zeros(36),
        ),
    )
    return bytes(STORE.serialize_cdr(message, ODOMETRY))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A recording of two poses, the second with the earlier stamp, and of an invalid message."""
    transforms = RecordedTransforms(TRUTH, ["front", "left"], [0.65, 0.0, 0.5, 0.0, 0.5, -1.0])
    topics = [RecordedTopic(TRUTH, find_message_definition(ODOMETRY), RecordedQos(10))]
    writer = Rosbag2Writer(tmp_path / "bag", [*topics, *transforms.topics])
    recording = StampedRecording(writer, {TRUTH: find_message_definition(ODOMETRY)})
    transforms.begin(recording)
    for data in (
        odometry(20_000_000, (3.0, -4.0, 0.25), 2.0),
        odometry(10_000_000, (1.0, 0.0, 0.0), -0.5),
        b"\0\1\0\0 no odometry",
    ):
        recording.add(TRUTH, data)
        transforms.follow(recording, TRUTH, data)
    writer.close()
    return tmp_path / "bag"


def read(bag: Path, topic: str) -> list[tuple[int, Any]]:
    with Reader(bag) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return [
            (stamp, STORE.deserialize_cdr(data, TRANSFORMS))
            for _, stamp, data in reader.messages(connections)
        ]


def test_a_pose_is_recorded_as_a_transform_of_the_same_stamp(bag: Path) -> None:
    found = read(bag, "/tf")
    assert [stamp for stamp, _ in found] == [10_000_000, 20_000_000]
    for (stamp_ns, message), (x, y, z), yaw in zip(
        found, [(1.0, 0.0, 0.0), (3.0, -4.0, 0.25)], [-0.5, 2.0], strict=True
    ):
        (one,) = message.transforms
        assert (one.header.frame_id, one.child_frame_id) == ("odom", "base_link")
        assert one.header.stamp.nanosec == stamp_ns
        place = one.transform.translation
        assert (place.x, place.y, place.z) == (x, y, z)
        turn = one.transform.rotation
        assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(yaw)


def test_fixed_frames_stand_at_the_beginning_for_whoever_comes_late(bag: Path) -> None:
    ((stamp, message),) = read(bag, "/tf_static")
    assert stamp == 0
    front, left = message.transforms
    assert (front.header.frame_id, front.child_frame_id) == ("base_link", "front")
    assert (left.transform.translation.x, left.transform.translation.y) == (0.0, 0.5)
    turn = left.transform.rotation
    assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(-1.0)


def test_the_types_are_those_that_ros_knows(bag: Path) -> None:
    with Reader(bag) as reader:
        for connection in reader.connections:
            if connection.msgtype != TRANSFORMS:
                continue
            assert connection.digest == STORE.hash_rihs01(TRANSFORMS)
            found = get_types_from_msg(connection.msgdef.data, TRANSFORMS)
            assert found == {name: STORE.fielddefs[name] for name in found}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"transforms_from": "/odom"}, r"^transforms_from: '/odom' is not one of"),
        ({"fixed_frames": ("front",), "fixed_poses": (1.0,)}, r"^fixed_poses: has 1 entries"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(change: dict[str, Any], words: str) -> None:
    plain: dict[str, Any] = {"folder": "bag", "topics": (TRUTH,), "types": (ODOMETRY,)}
    with pytest.raises(ConfigurationError, match=words):
        RecorderConfiguration(**(plain | change))
