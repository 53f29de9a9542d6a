"""Values converted to a message and serialized are read back bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, JointState

from omni_ros.line_images import line_image, lines_of, read_line_image
from omni_ros.messages import (
    diagnostics,
    joint_state,
    planar_pose,
    planar_pose_of,
    planar_twist_with_covariance,
    to_nanoseconds,
    to_time,
    twist_of,
)


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamps_survive(stamp_ns: int) -> None:
    assert to_nanoseconds(to_time(stamp_ns)) == stamp_ns


def test_the_latest_stamp_with_too_many_nanoseconds_still_fits_into_a_message() -> None:
    latest = Time(sec=2**31 - 1, nanosec=2**32 - 1)
    assert to_time(to_nanoseconds(latest)) == Time(sec=2**31 - 1, nanosec=10**9 - 1)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_lines_survive_the_wire(dtype: Any) -> None:
    lines = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, (25, 335)).astype(dtype)
    for frame in ("left", "rear"):  # gaps of both lengths
        sent = line_image(123_456_789, frame, lines)
        decoded = deserialize_message(sent, Image)
        theirs = serialize_message(decoded)
        assert len(sent) == len(theirs) + -len(theirs) % 4  # as it is sent
        assert all(mine in (other, 0) for mine, other in zip(sent, theirs, strict=False))
        for received in (decoded, read_line_image(sent), read_line_image(theirs)):
            assert to_nanoseconds(received.header.stamp) == 123_456_789
            assert received.header.frame_id == frame
            recovered = lines_of(received)
            assert recovered.dtype == lines.dtype
            np.testing.assert_array_equal(recovered, lines)


@given(st.integers(0, 62))
def test_an_image_that_is_cut_off_is_refused_or_lacks_lines(size: int) -> None:
    wire = line_image(1, "left", np.zeros((2, 8), dtype=np.uint8))[:size]
    with pytest.raises((ValueError, RuntimeError)):
        lines_of(read_line_image(wire))


def test_big_endian_and_padded_rows_are_understood() -> None:
    lines = np.array([[1, 2, 300], [4, 5, 60000]], dtype=np.uint16)
    padded: NDArray[np.uint8] = np.zeros((2, 10), dtype=np.uint8)
    padded[:, :6] = lines.astype(">u2").view(np.uint8).reshape(2, 6)
    message = Image(height=2, width=3, encoding="mono16", is_bigendian=1, step=10)
    message.data = padded.tobytes()
    np.testing.assert_array_equal(lines_of(message), lines)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"encoding": "rgb8"}, "'rgb8' must be mono8 or mono16"),
        ({"height": 3}, "has 8 bytes in all"),
        ({"step": 3}, "needs at least 4 bytes"),
    ],
)
def test_an_image_of_another_size_than_stated_is_refused(
    change: dict[str, Any], words: str
) -> None:
    message = deserialize_message(line_image(0, "left", np.zeros((2, 4), dtype=np.uint8)), Image)
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(ValueError, match=words):
        lines_of(message)


@pytest.mark.parametrize("yaw", [-3.0, 0.0, 0.4, 3.1])
def test_a_pose_survives(yaw: float) -> None:
    pose = np.array([1.5, -0.25, yaw])
    np.testing.assert_allclose(planar_pose_of(planar_pose(pose)), pose, atol=1e-12)


def test_twist_and_covariance_survive() -> None:
    twist = np.array([1.5, -0.25, 0.125])
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.25], [0.5, -0.25, 2.0]])
    message = planar_twist_with_covariance(7, twist, covariance)
    _, recovered, recovered_covariance, _ = twist_of(message)
    np.testing.assert_array_equal(recovered, twist)
    np.testing.assert_array_equal(recovered_covariance, covariance)
    assert message.twist.covariance[35] == 2.0  # yaw rate is the sixth component
    # A filter that fuses the message must not take the other axes for exact zeros.
    assert min(message.twist.covariance[axis] for axis in (14, 21, 28)) >= 1e6


def test_joint_state_keeps_what_is_not_given_empty() -> None:
    names = ("a", "b")
    state = joint_state(1, names, effort=np.array([1.0, 0.0]))
    received = deserialize_message(serialize_message(state), JointState)
    assert list(received.name) == ["a", "b"]
    assert list(received.effort) == [1.0, 0.0]
    assert not received.position
    assert not received.velocity


@given(
    st.integers(0, 2**31 * 10**9 - 1),
    st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=9),
    st.dictionaries(st.sampled_from(["state", "age", "cause"]), st.sampled_from(["", "a", "bcd"])),
)
def test_a_status_is_what_the_middleware_would_write_but_for_its_gaps(
    stamp_ns: int, words: str, values: dict[str, str]
) -> None:
    written = diagnostics(stamp_ns, "brake_assist", 2, words, values)
    message = deserialize_message(written, DiagnosticArray)
    (status,) = message.status
    assert to_nanoseconds(message.header.stamp) == stamp_ns
    assert (status.name, status.hardware_id) == ("brake_assist", "brake_assist")
    assert (status.level, status.message) == (b"\2", words)
    assert {pair.key: pair.value for pair in status.values} == values
    theirs = serialize_message(message)
    assert len(written) == len(theirs) + -len(theirs) % 4  # as it is sent
    assert all(mine in (other, 0) for mine, other in zip(written, theirs, strict=False))
