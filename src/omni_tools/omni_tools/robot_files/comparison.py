"""Differences between the wheels of a robot description and those of its controller."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import FloatArray, plain
from omni_tools.robot_files.controllers import CORNERS, DIFFERENT, OMNI, Controller, wrapped
from omni_tools.robot_files.described import PARALLEL, Described
from omni_tools.robot_files.links import Robot
from omni_tools.robot_files.wheels import DescribedWheel


def compare(
    found: Described,
    robot: Robot,
    wheels: Sequence[DescribedWheel],
    controller: Controller,
    base: str,
) -> None:
    """List differences between the wheels of a description and those of a controller."""
    x, y, theta = controller.offset
    places = {wheel.joint: turned(wheel.place[:2], theta) for wheel in wheels}
    center = np.mean(list(places.values()), axis=0)
    if math.dist(center, (-x, -y)) > 1e-3 + DIFFERENT * float(np.ptp(list(places.values()))):
        found.contradictions.append(
            f"center of the wheels in {base}: ({plain(center[0])}, {plain(center[1])}) m in "
            f"{robot.file}, ({plain(0.0 - x)}, {plain(0.0 - y)}) m in {controller.name}; "
            f"used: {robot.file}; measure from {base} to the axles"
        )
    if controller.base in robot.links and controller.base != base:
        apart = robot.pose(controller.base, base)[:2, 3]
        if np.linalg.norm(apart) > 1e-3:
            found.contradictions.append(
                f"{controller.name} moves {controller.base}, which is at ({plain(apart[0])}, "
                f"{plain(apart[1])}) m in {base}; used: {base}"
            )
    at = {
        key: places[joint] - center for key, joint in controller.joints.items() if joint in places
    }
    if controller.kind == OMNI:
        _compare_circle(found, robot.file, at, controller)
        return
    wrong = [key for key, place in at.items() if tuple(np.sign(place)) != CORNERS[key]]
    if wrong:
        found.contradictions.append(
            f"{', '.join(f'{controller.joints[key]} is {key}' for key in wrong)} in "
            f"{controller.name}, but elsewhere in {robot.file}; used: {robot.file}; turn each "
            "wheel by hand and look at the name of its velocity"
        )
    span = [float(one) for one in np.ptp(list(places.values()), axis=0)]
    described = {"wheelbase": span[0], "track": span[1], "lever": 0.5 * sum(span)}
    if controller.wheelbase is not None and controller.track is not None and controller.sum is None:
        del described["lever"]
    what = {"lever": "half of wheelbase plus track"}
    for key, value in described.items():
        theirs = getattr(controller, key)
        if theirs is not None:
            remedy = "measure it; a larger one of the controller may be tuned for slip in turns"
            values = {robot.file: value, controller.name: theirs}
            found.differ(what.get(key, key), values, robot.file, remedy)


def _compare_circle(
    found: Described, file: str, at: Mapping[str, FloatArray], controller: Controller
) -> None:
    if controller.robot_radius is not None:
        mean = float(np.mean([np.linalg.norm(place) for place in at.values()]))
        values = {file: mean, controller.name: controller.robot_radius}
        found.differ("distance of the wheels from the center", values, file, "measure it")
    if controller.wheel_offset is None:
        return
    first = math.degrees(controller.wheel_offset)
    for row, (key, place) in enumerate(at.items()):
        assumed = wrapped(first + 360.0 * row / len(at))
        angle = math.degrees(math.atan2(place[1], place[0]))
        if abs(wrapped(angle - assumed)) > PARALLEL:
            found.contradictions.append(
                f"{controller.joints[key]}: its direction from the center is {angle:.0f} deg in "
                f"{file}, {assumed:.0f} deg in {controller.name}; used: {file}; turn each wheel by "
                "hand and look at the name of its velocity"
            )
