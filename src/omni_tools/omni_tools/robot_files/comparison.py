"""Differences between the wheels of a robot description and those of its controller."""

import math
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
    if controller.base in robot.links:
        apart = robot.pose(controller.base)[:2, 3]
        if np.linalg.norm(apart) > 1e-3:
            found.contradictions.append(
                f"{controller.name} moves {controller.base}, which is at ({plain(apart[0])}, "
                f"{plain(apart[1])}) m in {robot.base}; used: {robot.base}"
            )
    elif controller.base:
        found.contradictions.append(
            f"{controller.name} moves {controller.base}, which is no link of {robot.file}; used: "
            f"{robot.base}; correct base_frame_id, or the name of the link"
        )
    arms = {joint: place - center for joint, place in places.items()}
    wrong = _expected_elsewhere(arms, controller)
    if wrong:
        found.contradictions.append(
            f"{', '.join(wrong)} in {controller.name}, but elsewhere in {robot.file}; used: "
            f"{robot.file}; turn each wheel by hand and look at the name of its velocity"
        )
    wheelbase, track = np.ptp(list(arms.values()), axis=0).tolist()
    distance = float(np.mean([np.hypot(*arm) for arm in arms.values()]))
    remedy = "measure it; a larger one of the controller may be tuned for slip in turns"
    for what, described, assumed in (
        ("wheelbase", wheelbase, controller.wheelbase),
        ("track", track, controller.track),
        ("half of wheelbase plus track", 0.5 * (wheelbase + track), controller.sum),
        ("mean distance from the center", distance, controller.robot_radius),
    ):
        if assumed is not None:
            lengths = {robot.file: described, controller.name: assumed}
            found.differ(what, lengths, robot.file, remedy)


def _expected_elsewhere(arms: Mapping[str, FloatArray], controller: Controller) -> list[str]:
    """Return the wheels in other directions from the center than a controller expects, and where.

    Args:
        arms: positions of the wheels from their center [m], keyed by joint.
        controller: the controller.
    """
    if controller.kind == MECANUM:
        return [
            f"{joint} is {corner}"
            for corner, joint in controller.joints.items()
            if tuple(np.sign(arms[joint])) != CORNERS[corner]
        ]
    angles = {joint: math.degrees(math.atan2(*arm[::-1])) for joint, arm in arms.items()}
    expected = {joint: wrapped(one[0] + 90.0) for joint, one in controller.assumed.items()}
    return [
        f"{joint} is at {angle:.0f} deg instead of {angles[joint]:.0f} deg"
        for joint, angle in expected.items()
        if abs(wrapped(angles[joint] - angle)) > PARALLEL
    ]
