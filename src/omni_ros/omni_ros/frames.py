"""Prefix of a vehicle's frame names, for graphs with several vehicles."""

from typing import Any

from omni_platform.configuration import Configuration, parameter


class FrameConfiguration(Configuration):
    """Names of the frames in the messages of a node."""

    frame_prefix: str = parameter("")
    """Prefix of all frame names, such as robot1/, so that several vehicles can share one /tf; must
    equal the parameter `frame_prefix` of robot_state_publisher"""


def prefix_frames(message: Any, prefix: str) -> None:
    """Put a prefix before each frame that a message names.

    Args:
        message: message, changed in place; frames are named in its header, or in a list of markers
            or transforms.
        prefix: prefix such as ``robot1/``; an empty prefix changes nothing.
    """
    if not prefix:
        return
    for part in (message, *getattr(message, "markers", ()), *getattr(message, "transforms", ())):
        if hasattr(part, "header") and part.header.frame_id:
            part.header.frame_id = prefix + part.header.frame_id
        if hasattr(part, "child_frame_id"):
            part.child_frame_id = prefix + part.child_frame_id
