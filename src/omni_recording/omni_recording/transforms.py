"""Transforms that viewers need in a recording: `/tf` from odometry messages, and `/tf_static`.

The type of these topics is `tf2_msgs/msg/TFMessage`. The ROS wheels do not contain this type, so no
node can publish it. The recorder writes the transforms directly: the pose of every
`nav_msgs/msg/Odometry`, and the frames that are fixed to the platform.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any

from rosbags.typesys import Stores, get_typestore

from omni_recording import definitions, plan
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_ros.messages import BASE_FRAME, leading_stamp

ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
MOVING_TOPIC = "/tf"
STATIC_TOPIC = "/tf_static"

_TYPE = "tf2_msgs/msg/TFMessage"


@functools.cache
def _store() -> Any:
    """Return the message types, whose code is generated at their first use."""
    return get_typestore(Stores.ROS2_JAZZY)


class RecordedTransforms:
    """Transforms that a recording contains in addition to the received messages.

    Attributes:
        topics: topics that are added to the recording.
    """

    def __init__(
        self, odometry: str = "", frames: Sequence[str] = (), poses: Sequence[float] = ()
    ) -> None:
        """Create the transforms that the recording will contain.

        Args:
            odometry: full name of the odometry topic whose poses become transforms; empty for none.
            frames: names of the frames that are fixed to the platform.
            poses: x, y [m] and heading [rad] of each frame in `base_link`, one frame after the
                other.
        """
        self._odometry = odometry
        self.topics: list[RecordedTopic] = []
        self._fixed: bytes | None = None
        if not odometry and not frames:
            return  # loading the types of rosbags takes time
        self._store = _store()
        definition = definitions.MessageDefinition(
            type_name=_TYPE,
            text=self._store.generate_msgdef(_TYPE, ros_version=2)[0],
            type_hash=self._store.hash_rihs01(_TYPE),
            stamped=False,  # the stamps are inside a list
        )
        if odometry:
            self.topics.append(RecordedTopic(MOVING_TOPIC, definition, RecordedQos(100)))
        if frames:
            latched = RecordedQos(1, durability="transient_local")
            self.topics.append(RecordedTopic(STATIC_TOPIC, definition, latched))
            self._fixed = self._fixed_frames(frames, poses)

    def begin(self, recording: plan.StampedRecording) -> None:
        """Write the transforms of the fixed frames, if any, at the beginning of a recording.

        Raises:
            RecordingError: the file cannot be written.
        """
        if self._fixed is not None:
            recording.add(STATIC_TOPIC, self._fixed)

    def follow(self, recording: plan.StampedRecording, topic: str, data: bytes) -> None:
        """Write the pose of an odometry message as a transform; ignore messages of other topics.

        Raises:
            RecordingError: the file can no longer be written.
        """
        if topic != self._odometry:
            return
        try:
            odometry: Any = self._store.deserialize_cdr(data, ODOMETRY_TYPE)
        except Exception:  # invalid bytes are recorded but give no transform
            return
        pose = odometry.pose.pose
        place = (pose.position.x, pose.position.y, pose.position.z)
        transform = self._transform(
            odometry.header, odometry.child_frame_id, place, pose.orientation
        )
        recording.add(MOVING_TOPIC, self._message([transform]), leading_stamp(data))

    def _fixed_frames(self, frames: Sequence[str], poses: Sequence[float]) -> bytes:
        """Return the serialized message of all frames fixed to `base_link`, with the stamp 0."""
        types = self._store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=BASE_FRAME)
        transforms = []
        for index, frame in enumerate(frames):
            x, y, heading = poses[3 * index : 3 * index + 3]
            turn = types["geometry_msgs/msg/Quaternion"](
                x=0.0, y=0.0, z=math.sin(0.5 * heading), w=math.cos(0.5 * heading)
            )
            transforms.append(self._transform(header, frame, (x, y, 0.0), turn))
        return self._message(transforms)

    def _transform(
        self, header: Any, child: str, place: tuple[float, float, float], turn: Any
    ) -> Any:
        types = self._store.types
        translation = types["geometry_msgs/msg/Vector3"](*place)
        return types["geometry_msgs/msg/TransformStamped"](
            header=header,
            child_frame_id=child,
            transform=types["geometry_msgs/msg/Transform"](translation=translation, rotation=turn),
        )

    def _message(self, transforms: list[Any]) -> bytes:
        message = self._store.types[_TYPE](transforms=transforms)
        return bytes(self._store.serialize_cdr(message, _TYPE))
