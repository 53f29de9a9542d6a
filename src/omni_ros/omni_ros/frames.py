"""Frame prefix of a vehicle, for graphs with several vehicles."""

from typing import Any

from omni_platform.configuration import Configuration, parameter


class FrameConfiguration(Configuration):
    """Names of the frames in the messages of a node."""

    frame_prefix: str = parameter("")
    """Prefix of all frames, such as robot1/, so that several vehicles can share one /tf; the
    same as in robot_state_publisher"""


def prefix_frames(message: Any, prefix: str) -> None:
    """Put a prefix before each frame that a message names.

    Args:
        message: any message; one with a header, or a list of markers or transforms.
        prefix: such as ``robot1/``; empty changes nothing.
    """
    if not prefix:
        return
    for part in (message, *getattr(message, "markers", ()), *getattr(message, "transforms", ())):
        if hasattr(part, "header") and part.header.frame_id:
            part.header.frame_id = prefix + part.header.frame_id
        if hasattr(part, "child_frame_id"):
            part.child_frame_id = prefix + part.child_frame_id
