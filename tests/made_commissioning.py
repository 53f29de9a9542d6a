"""Commissioning drives of random robots with slipping rollers, right and with one mistake each."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from made_drives import described

from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_tools.commissioning.causes import Stated
from omni_tools.commissioning.mistakes import Findings, find_mistakes
from omni_tools.commissioning.signals import Motions, Signals

Wheels = dict[str, WheelMount]

MISTAKES = (
    *("radius", "wheel", "encoder", "encoders", "place", "lever"),
    *("direction", "roller", "x", "y", "direction all", "roller all", "swap"),
    *("stated f", "stated l", "stated t", "distance in mm", "angle in rad"),
    *("reversed 0", "reversed 1", "reversed 2"),
    *(
        "twist axes",
        "twist yaw",
        "twist fl",
        "twist t",
        "twist place",
        "imu yaw",
        "gyro",
        "imu axes",
    ),
)


class Case(NamedTuple):
    """A drive of a robot, and the keys of the cause that it has."""

    wheels: Wheels
    motions: Motions
    stated: Stated
    cause: str

    def findings(self) -> Findings:
        vehicle = dataclasses.replace(described())
        object.__setattr__(vehicle, "wheels", self.wheels)
        nothing = np.full((2, len(self.wheels)), math.nan)
        signals = Signals(
            np.array([0.0, 0.01]), nothing, nothing[:, :3], nothing[:, :3], nothing[:, 0], nothing
        )
        return find_mistakes(vehicle, signals, self.motions, self.stated)

    def named(self) -> bool:
        """Return whether the findings or a class contains the true cause."""
        found = self.findings()
        undecided = [cause for group in found.undecided for part in group for cause in part]
        return any(one.key == self.cause for one in (*found.mistakes, *found.remarks, *undecided))


def mecanum(x: float, y: float, radius: float, middle: bool = False) -> Wheels:
    rows = {"front": 1.0, "rear": -1.0} | ({"middle": 0.3} if middle else {})
    return {
        f"{row}_{side}": WheelMount(
            x=x * a, y=y * b, roller_angle_deg=-45.0 * math.copysign(b, a * b), radius=radius
        )
        for row, a in rows.items()
        for side, b in (("left", 1.0), ("right", -1.0))
    }


def omni(count: int, first: float, reach: float, radius: float) -> Wheels:
    angles = [first + 360.0 * k / count for k in range(count)]
    return {
        f"wheel_{k}": WheelMount(
            x=reach * math.cos(math.radians(angle)),
            y=reach * math.sin(math.radians(angle)),
            heading_deg=(angle + 90.0 + 180.0) % 360.0 - 180.0,
            roller_angle_deg=0.0,
            radius=radius,
        )
        for k, angle in enumerate(angles)
    }


def robot(random: np.random.Generator) -> Wheels:
    """Return a robot on four or six Mecanum wheels, or on three or four omni-wheels."""
    reach, radius = random.uniform(0.1, 1.0), random.uniform(0.03, 0.2)
    long = random.uniform(1.3, 2.0)
    kinds = (
        mecanum(reach, reach, radius),
        mecanum(reach * long, reach, radius),
        mecanum(reach * long, reach, radius, middle=True),
        omni(3, random.choice([0.0, 60.0, 90.0]), reach, radius),
        omni(4, 45.0, reach, radius),
        omni(4, 0.0, reach, radius),
    )
    return kinds[random.integers(len(kinds))]


def right_case(seed: int, slip: float = 1.3) -> Case:
    """Return a drive of a robot whose file is right.

    Rollers slip sideways and in the turn, up to the given ratio, and the distances differ by up to
    7 %. The user gives both, or only that of the motion forward.
    """
    random = np.random.default_rng(seed)
    wheels = robot(random)
    forward = random.uniform(0.5, 3.0)
    moved = np.array([forward, forward * random.uniform(0.93, 1.07), math.pi / 2])
    shared = bool(random.integers(2))
    stated = np.where(shared, [forward, forward, math.pi / 2], moved)
    stated *= random.normal(1.0, 0.005, 3)
    slips = np.array([1.0, *random.uniform(1.0, slip, 2)])
    motions = measured(random, wheels, moved, slips)
    return Case(wheels, motions, Stated(stated, shared), "")


def measured(
    random: np.random.Generator,
    wheels: Mapping[str, WheelMount],
    moved: FloatArray,
    slip: FloatArray,
) -> Motions:
    """Return what the sensors measure; the twist sensor or the gyro is absent in some drives."""
    motion = np.diag(moved)
    angle = slip[:, np.newaxis] * PlatformKinematics.of(wheels).wheel_speeds(motion)
    angle *= random.normal(1.0, 0.008, angle.shape)
    twist = motion + np.abs(np.diag(motion))[:, np.newaxis] * random.normal(0.0, 0.004, (3, 3))
    gyro = np.array([0.0, 0.0, moved[2] * random.normal(1.0, 0.005)])
    force = 0.3 * np.sign(motion)[:, :2] + random.normal(0.0, 0.02, (3, 2))
    twist, gyro = (v if random.uniform() < 0.7 else v * math.nan for v in (twist, gyro))
    return Motions(angle, twist, gyro, force, slice(0, 0))


def wrong_case(seed: int, slip: float = 1.0) -> Case:
    """Return a drive of a robot with one mistake."""
    random = np.random.default_rng(seed)
    while True:
        kind = MISTAKES[random.integers(len(MISTAKES))]
        case = right_case(int(random.integers(2**31)), slip)
        changed = with_mistake(random, case, kind)
        if changed is not None:
            return changed


def factor(random: np.random.Generator) -> float:
    return float(random.uniform(1.1, 1.3) ** random.choice([-1, 1]))


def with_mistake(random: np.random.Generator, case: Case, kind: str) -> Case | None:
    """Return a drive with this mistake; None if it does not change this drive."""
    for change in (of_wheels, of_options, of_sensors):
        changed = change(random, case, kind)
        if changed is not None:
            break
    sensors = {"twist": case.motions.twist, "imu": case.motions.gyro, "gyro": case.motions.gyro}
    absent = np.any(np.isnan(sensors.get(kind.split(maxsplit=1)[0], case.motions.angle)))
    return None if absent else changed


def of_wheels(random: np.random.Generator, case: Case, kind: str) -> Case | None:
    name, scale = str(random.choice(list(case.wheels))), factor(random)
    wheels, angle, key = case.wheels, case.motions.angle.copy(), kind
    part = kind.split(maxsplit=1)[0]
    if kind in ("radius", "lever"):
        fields: tuple[str, ...] = ("radius",) if kind == "radius" else ("x", "y")
        wheels = {one: scaled(mount, scale, fields) for one, mount in wheels.items()}
    elif kind in FIELDS:
        size, fields = FIELDS[kind]
        wheels = {**wheels, name: scaled(wheels[name], size or scale, fields)}
        key = f"{kind} {name}"
    elif kind == "roller all":
        wheels = {n: scaled(m, -1.0, ("roller_angle_deg",)) for n, m in wheels.items()}
    elif part in ("encoder", "encoders", "direction", "swap"):
        angle, key = misread(random, angle, kind, list(wheels))
    else:
        return None
    try:
        before, after = (
            PlatformKinematics(w).wheel_speeds(np.diag(case.stated.size))
            for w in (case.wheels, wheels)
        )
    except ValueError:  # a file that is refused when it is read
        return None
    moved = np.abs(after - before) + np.abs(angle - case.motions.angle)
    if np.max(moved / np.max(np.abs(before), axis=1, keepdims=True)) < 0.1:
        return None
    return Case(wheels, case.motions._replace(angle=angle), case.stated, key)


FIELDS: dict[str, tuple[float, tuple[str, ...]]] = {
    "wheel": (0.0, ("radius",)),
    "place": (1.4, ("x", "y")),
    "x": (-1.0, ("x",)),
    "y": (-1.0, ("y",)),
    "roller": (-1.0, ("roller_angle_deg",)),
}
"""Factor of a wheel's wrong values, 0 for a random one, and their names."""


def scaled(mount: WheelMount, scale: float, fields: tuple[str, ...]) -> WheelMount:
    return dataclasses.replace(mount, **{field: scale * getattr(mount, field) for field in fields})


def misread(
    random: np.random.Generator, angle: FloatArray, kind: str, names: list[str]
) -> tuple[FloatArray, str]:
    """Return the angles of wrong encoders, and the key of the cause."""
    row, other = random.choice(len(names), 2, replace=False).tolist()
    if kind == "swap":
        angle[:, [row, other]] = angle[:, [other, row]]
        return angle, kind
    if kind == "encoders":
        return angle * random.choice([4.0, 57.3, 0.1]), "radius"
    if kind == "direction all":
        return -angle, kind
    angle[:, row] *= 4.0 if kind == "encoder" else -1.0
    return angle, f"{'wheel' if kind == 'encoder' else kind} {names[row]}"


def of_options(random: np.random.Generator, case: Case, kind: str) -> Case | None:
    size, motions = case.stated.size.copy(), case.motions
    if kind.startswith("stated"):
        size["flt".index(kind[-1])] *= factor(random)
    elif kind == "distance in mm":
        size[:2] *= 1000.0
        return case._replace(stated=Stated(size, True), cause="distance")
    elif kind == "angle in rad":
        size[2] = math.radians(size[2])
        kind = "stated t"
    elif kind.startswith("reversed"):
        row = int(kind[-1])
        sign = np.where(np.arange(3) == row, -1.0, 1.0)
        fields = ("angle", "twist", "gyro", "force")
        reverse = {name: (getattr(motions, name).T * sign).T for name in fields}
        return case._replace(motions=motions._replace(**reverse), cause=kind)
    else:
        return None
    return case._replace(stated=Stated(size, False), cause=kind)


def of_sensors(random: np.random.Generator, case: Case, kind: str) -> Case | None:
    twist, gyro, force = (values.copy() for values in case.motions[1:4])
    scale = factor(random)
    if kind == "twist axes":
        a = math.radians(random.choice([-90.0, 90.0, 180.0, 10.0]))
        twist[:, :2] @= np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    elif kind == "twist yaw":
        twist[:, 2] *= -1.0
    elif kind == "twist fl":
        twist[:, :2] *= scale
    elif kind == "twist t":
        twist[:, 2] *= scale
    elif kind == "twist place":
        twist[:, :2] += np.outer(twist[:, 2], random.uniform(0.05, 0.3, 2))
    elif kind == "imu yaw":
        gyro *= -1.0
    elif kind == "gyro":
        gyro *= 57.3
    elif kind == "imu axes":
        force[:, random.integers(2)] *= -1.0
    else:
        return None
    return case._replace(
        motions=Motions(case.motions.angle, twist, gyro, force, slice(0, 0)), cause=kind
    )
