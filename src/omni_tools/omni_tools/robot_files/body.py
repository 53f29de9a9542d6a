"""Masses, chassis and sensors of a robot description."""

import math
import re

import numpy as np

from omni_core.quantities import plain
from omni_tools.robot_files.controllers import DIFFERENT, wrapped
from omni_tools.robot_files.described import INVALID, Described, some
from omni_tools.robot_files.links import Robot
from omni_tools.robot_files.wheels import Wheels

# Also ImuBase_frame, but neither simu_link nor simulator.
_IMU = re.compile(r"((?<![Ss])i|I)mu(?![a-z])|(?<![A-Z])IMU")
_CAMERA = re.compile(r"cam(era)?\d*($|[/_])|line_?scan|flow|otos|pmw3901|paa5100", re.IGNORECASE)
_LIGHTEST = 0.5  # smallest mass of a vehicle; less stands for an unknown mass [kg]
_DENSEST = 4000.0  # largest plausible density of a wheel; half of that of steel [kg/m^3]
_LOWEST = 0.5  # smallest plausible ratio of the center of gravity's height to a wheel radius [1]
_DOWN = -0.7  # limit on the vertical part of the direction of view of a camera at the ground
# Plausible ratios of the chassis to the wheelbase, or to the track [1].
_SPAN, _LARGEST_SPAN = 0.5, 2.0
_AROUND = "estimate: around the wheels"  # source of the size of a chassis without shapes


def ground_height(found: Described, robot: Robot, wheels: Wheels) -> float:
    """Return the height of the ground in base_link [m]; NaN if no radius is known."""
    radius = float(np.mean(found.radii or [math.nan]))
    places = np.array([wheel.place for wheel in wheels])
    axle = float(np.mean(places[:, 2]))
    footprint = next((name for name in robot.links if name.endswith("footprint")), None)
    if footprint is not None:
        height = round(axle - float(robot.pose(footprint)[2, 3]), 6) + 0.0
        if math.isnan(radius):
            if 0.0 < height < np.max(np.ptp(places, axis=0)):  # wheels that fit between the axles
                found.questions.append(
                    f"the axles are {plain(height, 4)} m above {footprint}: is this the radius of "
                    "the wheels? (--wheel-radius)"
                )
        elif abs(height - radius) > DIFFERENT * radius + 1e-3:
            found.contradictions.append(
                f"height of the axles: {plain(height, 4)} m above {footprint} in {robot.file}, but "
                f"the radius is {plain(radius, 4)} m; used: the radius; measure the height of the "
                "axle of the loaded wheel"
            )
    return axle - radius


def weigh(found: Described, robot: Robot, wheels: Wheels, ground: float) -> None:
    """Enter mass, center of gravity and moments of inertia, summed over all links."""
    mass, center, inertia = robot.body(list(robot.links))
    lacking = [n for n, one in robot.links.items() if not one.mass and (one.shapes or one.meshes)]
    if mass < _LIGHTEST:
        problem = f"{robot.file} contains no plausible mass ({plain(mass)} kg)"
        found.questions.append(f"{problem}; what does the robot weigh? (--mass)")
        return
    if lacking:
        found.questions.append(
            f"shapes without a mass: {some(lacking)}; "
            f"does the robot weigh {plain(mass, 4)} kg? (--mass)"
        )
    source = f"sum over the links of {robot.file}"
    height, radius = float(center[2]) - ground, max(found.radii, default=0.0)
    values = {"mass": mass, "x": float(center[0]), "y": float(center[1])}
    if height < _LOWEST * radius:
        found.contradictions.append(
            f"center of gravity: {plain(height)} m above the ground in {robot.file}, too "
            f"low on wheels of a radius of {plain(radius)} m; used: an estimate; correct the "
            "origins of the inertias"
        )
    elif not math.isnan(height):
        values["height"] = height
    found.enter(source, {f"body.{key}": round(one, 6) for key, one in values.items()})
    places = np.array([wheel.place[:2] for wheel in wheels])
    reach = float(np.max(np.hypot(*(places - places.mean(axis=0)).T))) + radius
    reach = max(reach, 0.5 * math.hypot(found.measured["length"], found.measured["width"]))
    if found.sources["chassis_length"] == _AROUND:
        reach *= _LARGEST_SPAN
    _enter_possible(found, "body.yaw_inertia", float(inertia[2, 2]), mass * reach**2, source)
    own, of_wheel, width = np.mean([(w.inertia, w.mass, w.width) for w in wheels], axis=0).tolist()
    heavy = of_wheel > (most := _DENSEST * math.pi * radius**2 * width) > 0.0
    if heavy:
        found.contradictions.append(
            f"mass of a wheel: {plain(of_wheel)} kg in links of {robot.file}, but its size permits "
            f"at most {plain(most)} kg; used: the links; weigh the robot (--mass)"
        )
    ring = of_wheel * radius**2
    _enter_possible(found, "wheel_inertia", own, ring, f"links of {robot.file}")
    if "wheel_inertia" not in found.values and ring > 0.0 and not heavy:
        source = f"estimate: a solid disc of {plain(of_wheel)} kg"
        found.enter(source, {"wheel_inertia": 0.5 * ring})


def _enter_possible(found: Described, key: str, inertia: float, most: float, source: str) -> None:
    """Enter a moment of inertia, unless no body of this mass and size can have it.

    Args:
        found: receives the moment, or a contradiction.
        key: key of the moment in the vehicle's file.
        inertia: described moment [kg m^2].
        most: moment of the mass at the edge of the body [kg m^2]; 0 if unknown.
        source: where the moment comes from.
    """
    if inertia > most > 0.0:
        found.contradictions.append(
            f"{key}: {plain(inertia)} kg m^2 in {source}, but mass and size permit at most "
            f"{plain(most)} kg m^2; used: an estimate; correct the inertia of the links"
        )
    elif inertia > 0.0:
        found.enter(source, {key: inertia})


def measure_chassis(found: Described, robot: Robot, wheels: Wheels) -> None:
    """Enter the extent of the shapes that are fixed to base_link, without the wheels."""
    of_wheels = {n for w in wheels for n in robot.below(robot.joints[w.joint].child)}
    links = [name for name in robot.rigid(robot.base) if name not in of_wheels]
    span = np.ptp([wheel.place[:2] for wheel in wheels], axis=0)
    meshes = [name for name in links if robot.links[name].meshes]
    for of in ("collision", "visual"):
        shapes = [shape.corners[:, :2] for shape in robot.shapes(links) if shape.of == of]
        corners = np.reshape(shapes, (-1, 2))
        if shapes and np.all(np.ptp(corners, axis=0) > _SPAN * span):
            found.enter_chassis(f"{of} shapes of {robot.file}", corners)
            break
    else:
        found.enter_chassis(_AROUND)
    if meshes or found.sources["chassis_length"] == _AROUND:
        what = f"the meshes of {some(meshes)}" if meshes else "the chassis"
        found.questions.append(
            f"{what} are not measured: how long and wide is the chassis? (--length, --width)"
        )


def find_sensors(found: Described, robot: Robot) -> None:
    """Enter the IMU, and the cameras that look at the ground."""
    rigid = robot.rigid(robot.base)
    imus = list(dict.fromkeys(name for name in (*rigid, *robot.links) if _IMU.search(name)))
    if imus and imus[0] in rigid:
        poses = [robot.pose(name) for name in imus]
        found.imu = poses[0]
        if max(math.dist(pose[:2, 3], poses[0][:2, 3]) for pose in poses) > 1e-3:
            found.contradictions.append(f"IMU: {', '.join(imus)}; used: {imus[0]}")
    else:
        problem = f"{some(imus)} turns on a joint" if imus else "no link is an IMU"
        found.questions.append(f"{problem}: is there one on the chassis, and where? (imu_x, imu_y)")
    ahead = []
    for name in (name for name in robot.links if _CAMERA.search(name)):
        if name in robot.parents and _CAMERA.search(robot.parents[name].parent):
            continue  # a further frame of the same camera
        pose = robot.pose(name)
        if pose[2, 2 if "optical" in name else 0] < _DOWN and name in rigid:
            heading = wrapped(math.degrees(math.atan2(pose[1, 1], pose[0, 1])))
            x, y = (round(float(value), 6) + 0.0 for value in pose[:2, 3])
            found.cameras[INVALID.sub("_", name)] = {"x": x, "y": y, "heading_deg": heading}
        else:
            ahead.append(name)
    if found.cameras:
        found.questions.append(
            f"by their axes, {some(list(found.cameras))} look at the ground: do they measure the "
            "speed over it?"
        )
    if ahead:
        found.questions.append(
            f"no view of the ground: {some(ahead)}; which sensor measures the speed over it? "
            "(docs/which_sensor.md)"
        )
