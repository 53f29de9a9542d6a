"""Services of a running simulator: pause, step, reset and placement of the vehicle.

`~/pause` (`std_srvs/SetBool`) halts and resumes the simulated time. `~/step` (`std_srvs/Trigger`)
advances a paused simulation by one control period. If the driver is not scripted, `~/reset`
(`std_srvs/Trigger`) moves the vehicle to its start, and a message on `initialpose`, which viewers
publish, moves it to another pose. The time is never reset, because other nodes could not follow.
"""

import time
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from omni_core.quantities import FloatArray
from omni_core.topics import Topic
from omni_ros import process, qos
from omni_ros.messages import planar_pose_of
from omni_sim.driver.configuration import FARTHEST

_POSE = Topic("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", "user's node")
_SHOWN = 40  # number of characters of a frame ID that a message shows
_SCRIPTED = "not possible in a scripted run; restart the node, or start it with driver: "


class RunControl:
    """Stores requests for the simulation loop: to pause, resume or step, or to place the vehicle.

    Args:
        node: node that provides the services.
        start: start pose x, y [m], yaw [rad], shape (3,); None if the vehicle may not be placed.
        frame: frame of the requested poses.
    """

    def __init__(self, node: Node, start: FloatArray | None, frame: str) -> None:
        self._node, self._start, self._frame = node, start, frame
        self._paused, self._steps = False, 0
        self._pose: FloatArray | None = None
        node.create_service(SetBool, "~/pause", self._on_pause)
        node.create_service(Trigger, "~/step", self._on_step)
        node.create_service(Trigger, "~/reset", self._on_reset)
        if start is not None:
            qos.subscribe(node, _POSE, self._on_pose)

    def wait(self, spinner: process.Spinner) -> float:
        """Wait while the simulation is paused; return the duration of the pause [s]."""
        if not self._paused:
            return 0.0
        began = time.monotonic()
        while self._paused and not self._steps and not spinner.stop:
            spinner.spin_once()
        self._steps = max(0, self._steps - 1)
        return time.monotonic() - began

    def take_pose(self) -> FloatArray | None:
        """Return a newly requested pose x, y [m], yaw [rad], shape (3,); None without a request."""
        pose, self._pose = self._pose, None
        return pose

    def _on_pause(self, request: Any, response: Any) -> Any:
        self._paused, self._steps = bool(request.data), 0
        response.success = True
        response.message = "simulation paused" if self._paused else "simulation resumed"
        return response

    def _on_step(self, _request: Any, response: Any) -> Any:
        response.success = self._paused
        response.message = "one step requested" if self._paused else "not paused: call ~/pause"
        self._steps += self._paused
        return response

    def _on_reset(self, _request: Any, response: Any) -> Any:
        response.success = self._start is not None
        response.message = (
            f"{_SCRIPTED}cmd_vel" if self._start is None else "vehicle placed at the start, at rest"
        )
        self._pose = self._start
        return response

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = planar_pose_of(message.pose.pose)
        frame, problem = message.header.frame_id, ""
        if frame not in ("", self._frame):
            problem = f"the frame {frame[:_SHOWN]!r} must be {self._frame!r} or empty"
        elif not (np.isfinite(pose).all() and np.abs(pose[:2]).max() <= FARTHEST):
            problem = f"the pose must be finite and within {FARTHEST:g} m of the origin"
        if problem:
            words = f"initialpose was ignored: {problem}"
            self._node.get_logger().error(words, throttle_duration_sec=1.0)
            return
        self._pose = pose
