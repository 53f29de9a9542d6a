"""Differences between the wheels of a robot description and those of its controller."""

import math
import re
from collections.abc import Mapping

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import FloatArray, plain
from omni_tools.robot_files.controllers import CORNERS, DIFFERENT, MECANUM, Controller, wrapped
from omni_tools.robot_files.described import PARALLEL, Described
from omni_tools.robot_files.links import Robot
from omni_tools.robot_files.wheels import Wheels


def compare(found: Described, robot: Robot, wheels: Wheels, controller: Controller) -> None:
    """List differences between the wheels of a description and those of a controller."""
    x, y, theta = controller.offset
    places = {wheel.joint: turned(wheel.place[:2], theta) for wheel in wheels}
    center = np.array(np.round(np.mean(list(places.values()), axis=0), 6)) + 0.0
    if math.dist(center, (-x, -y)) > 1e-3 + DIFFERENT * float(np.ptp(list(places.values()))):
        found.contradictions.append(
            f"center of the wheels in {robot.base}: ({plain(center[0])}, {plain(center[1])}) m in "
            f"{robot.file}, ({plain(0.0 - x)}, {plain(0.0 - y)}) m in {controller.name}; "
            f"used: {robot.file}; measure from {robot.base} to the axles"
        )
    frame = re.split(r"[/>)}]", controller.base)[-1]
    if frame in robot.links:
        apart = robot.pose(frame)[:2, 3]
        if np.linalg.norm(apart) > 1e-3:
            found.contradictions.append(
                f"{controller.name} moves {frame}, which is at ({plain(apart[0])}, "
                f"{plain(apart[1])}) m in {robot.base}; used: {robot.base}"
            )
    elif not any(name.endswith(frame) for name in robot.links):
        found.contradictions.append(
            f"{controller.name} moves {frame}, which is no link of {robot.file}; used: "
            f"{robot.base}; correct base_frame_id, or the name of the link"
        )
    arms = {joint: place - center for joint, place in places.items()}
    _compare_directions(found, robot.file, arms, controller)
    _compare_lengths(found, robot.file, np.array(list(arms.values())), controller)


def _compare_directions(
    found: Described, file: str, arms: Mapping[str, FloatArray], controller: Controller
) -> None:
    """List wheels in other directions from the center than a controller assumes.

    Args:
        found: receives the sentences.
        file: name of the robot description.
        arms: positions of the wheels from their center [m], keyed by joint.
        controller: the controller.
    """
    remedy = f"used: {file}; turn each wheel by hand and look at the name of its velocity"
    if controller.kind == MECANUM:
        wrong = [
            f"{joint} is {corner}"
            for corner, joint in controller.joints.items()
            if tuple(np.sign(arms[joint])) != CORNERS[corner]
        ]
        if wrong:
            found.contradictions.append(
                f"{', '.join(wrong)} in {controller.name}, but elsewhere in {file}; {remedy}"
            )
        return
    for joint, (heading, _) in controller.assumed.items():
        angle = math.degrees(math.atan2(*arms[joint][::-1]))
        if abs(wrapped(angle - heading - 90.0)) > PARALLEL:
            found.contradictions.append(
                f"{joint}: its direction from the center is {angle:.0f} deg in {file}, "
                f"{wrapped(heading + 90.0):.0f} deg in {controller.name}; {remedy}"
            )


def _compare_lengths(found: Described, file: str, arms: FloatArray, controller: Controller) -> None:
    """List distances of the wheels that differ from those of a controller.

    Args:
        found: receives the sentences.
        file: name of the robot description.
        arms: positions of the N wheels from their center [m], shape (N, 2).
        controller: the controller.
    """
    wheelbase, track = np.ptp(arms, axis=0).tolist()
    remedy = "measure it; a larger one of the controller may be tuned for slip in turns"
    for what, described, assumed in (
        ("wheelbase", wheelbase, controller.wheelbase),
        ("track", track, controller.track),
        ("half of wheelbase plus track", 0.5 * (wheelbase + track), controller.sum),
        ("mean distance from the center", np.hypot(*arms.T).mean(), controller.robot_radius),
    ):
        if assumed is not None:
            found.differ(what, {file: described, controller.name: assumed}, file, remedy)
