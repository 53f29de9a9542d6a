"""Files of a vehicle from the files of a robot."""

import functools
import itertools
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omni_runs.yaml_files import merge, nest
from omni_tools.robot_files.controllers import read_controllers
from omni_tools.robot_files.described import KEYS, Described, rounded
from omni_tools.robot_files.description import describe
from omni_tools.robot_files.links import Robot, roll_pitch_yaw
from omni_tools.robot_files.refusal import refused
from omni_tools.robot_files.xacro_files import read_description
from omni_tools.vehicles.estimates import KnownValues, Measured

_WIDTH = 110  # characters of a line of comment
_PARAMETERS = (".yaml", ".yml")


def described_vehicle(
    words: Sequence[str],
    kind: str | None = None,
    radius: float | None = None,
    *,
    trust: bool = False,
    skip_missing: bool = False,
) -> Described:
    """Return the vehicle that the files of a robot describe.

    Args:
        words: names of files, and arguments of xacro files as ``ARGUMENT:=VALUE``.
        kind: type of the wheels if the user gives it.
        radius: radius of the wheels if the user gives it [m].
        trust: whether expressions of any kind are evaluated in xacro files.
        skip_missing: whether missing packages of xacro files are left out.

    Raises:
        ConfigurationError: a file is invalid, or the files describe no vehicle on omni-wheels.
    """
    pairs = (word.partition(":=") for word in words if ":=" in word)
    arguments = {name: value for name, _, value in pairs}
    paths = [Path(word) for word in words if ":=" not in word]
    read = {one: read_controllers(one) for one in paths if one.suffix.lower() in _PARAMETERS}
    descriptions = [path for path in paths if path not in read]
    if len(descriptions) > 1:
        names = ", ".join(path.name for path in descriptions)
        problem = f"{names} are several robots, each with a base_link; give the file of one"
        raise refused(f"{problem}; it may include others")
    robot, skipped = None, list[str]()
    for path in descriptions:
        text = read_description(path, arguments, trust, skipped if skip_missing else None)
        robot = Robot(path.name, text, partial=bool(skipped))
    found = describe(robot, list(itertools.chain(*read.values())), kind, radius)
    found.questions += [
        f"the package {package} is left out: which masses, shapes and sensors does it add?"
        for package in dict.fromkeys(skipped)
    ]
    found.questions += [
        f"{path.name} contains no known controller of omni-wheels: which file has the radius of "
        "the wheels and their distances?"
        for path, controllers in read.items()
        if not controllers
    ]
    return found


def known_values(name: str, found: Described, measured: Measured) -> KnownValues:
    """Return the values of a vehicle's files that replace estimates.

    Args:
        name: name of the vehicle, used in comments.
        found: vehicle that the files describe.
        measured: size, mass and radius, of which the user may have given some.
    """
    wheels = {
        wheel: {**values, "radius": values.get("radius", measured.wheel_radius)}
        for wheel, values in found.wheels.items()
    }
    # The files do not know the distribution of a mass that the user gives.
    changed = [key for one, key in KEYS.items() if getattr(measured, one) != found.values.get(key)]
    given = tuple(key.partition(".")[0] for key in changed)
    values = {key: value for key, value in found.values.items() if not key.startswith(given)}
    sources = {key: text for key, text in found.sources.items() if not key.startswith(given)}
    for axis in "xy":
        if f"chassis_{axis}" in values and f"body.{axis}" not in values:
            values[f"body.{axis}"] = values[f"chassis_{axis}"]
            sources[f"body.{axis}"] = "estimate: the middle of the chassis"
    if "wheel_inertia" in values:
        values["wheel_inertia"] = max(values["wheel_inertia"], 1e-6)
    vehicle = functools.reduce(merge, itertools.starmap(nest, values.items()), {"wheels": wheels})
    problems = [f"contradiction: {one}" for one in found.contradictions]
    problems += [f"missing: {one}" for one in found.questions]
    heading = f"{name}, made by ./omni new-vehicle --from. Values without a comment are given."
    experiment: dict[str, Any] = {}
    if found.imu is not None:
        x, y = (rounded(float(value)) for value in found.imu[:2, 3])
        experiment = {"imu": {"x": x, "y": y}, "brake_assist": {"imu_x": x, "imu_y": y}}
        angles = [rounded(angle) for angle in roll_pitch_yaw(found.imu)]
        if any(angles):
            experiment["brake_assist"]["imu_rotation_deg"] = angles
    lines = [line for text in (heading, *problems) for line in textwrap.wrap(text, _WIDTH)]
    return KnownValues("\n".join(lines), vehicle, found.cameras, experiment, sources)
