"""Bytes after a message are ignored as in ROS; incomplete messages and other bytes are rejected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from made_recordings import JOINTS, STORE, described, mcap, message
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from omni_recording.actions.check import check_bag
from omni_recording.decode import decoded_messages
from omni_recording.folder import open_bag


def joint_state(**fields: list[float]) -> Any:
    return JointState(name=["left", "right"], **fields)


def trajectory() -> Any:
    points = [JointTrajectoryPoint(velocities=[1.0] * (k % 2)) for k in range(20)]
    return JointTrajectory(joint_names=["left"], points=points)


@pytest.mark.parametrize(
    "sent",
    [
        joint_state(velocity=[1.0, 2.0]),
        joint_state(position=[1.0, 2.0]),
        joint_state(),
        trajectory(),
        Float64MultiArray(),
    ],
    ids=lambda sent: type(sent).__name__,
)
def test_a_message_is_read_that_ros_serialized_with_empty_arrays(tmp_path: Path, sent: Any) -> None:
    data = serialize_message(sent)
    kind = "/msg/".join((type(sent).__module__.split(".")[0], type(sent).__name__))
    path = mcap(tmp_path / "a.mcap", described(kind=kind), message(data))
    assert not check_bag(path).problems
    ((_, read),) = decoded_messages(open_bag(path), ["/wheel_states"])
    exact = bytes(STORE.serialize_cdr(read, kind))
    assert len(exact) < len(data), "there is no byte after the message"
    assert deserialize_message(exact, type(sent)) == sent


def test_an_incomplete_message_and_foreign_bytes_are_rejected(tmp_path: Path) -> None:
    data = bytes(serialize_message(joint_state(velocity=[1.0, 2.0], effort=[3.0, 4.0])))
    exact = data.rstrip(b"\0")
    for wrong in (exact[: len(exact) - 8], data + bytes(2 * len(data)), b"\0\3" + data[2:], b""):
        path = mcap(tmp_path / "a.mcap", described(kind=JOINTS), message(data), message(wrong))
        (problem,) = check_bag(path).problems
        assert "1 messages cannot be decoded" in problem
