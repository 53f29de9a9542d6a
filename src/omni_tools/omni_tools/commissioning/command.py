"""``./omni check-vehicle``: find errors in a vehicle's file from a short recorded motion.

Compare a vehicle's file with a recording of three slow motions (forward, to the left,
counter-clockwise, each from rest to rest) and of stops in different directions. The command checks
order, signs, radii, positions and rollers of the wheels, the twist sensor, the IMU, and the order
and dead times of the brakes. Each error is reported with its remedy. The command also reports
pairs of brakes for which these stops cannot show whether the two are swapped.
"""

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from omni_core import topics
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, write_text
from omni_core.commands.wrapped_table import WrappedTable
from omni_core.configuration import ConfigurationError
from omni_core.kinematics import require_omni_wheels
from omni_core.quantities import FloatArray
from omni_core.sensors import rotation_matrix
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_tools.commissioning.mistakes import Findings
    from omni_tools.commissioning.signals import Motions, Signals

WORK = "checking the vehicle"
_LIVE = Path("live")
_SHORTEST = 1e-3
"""Smallest measured distance [m] or angle [deg]; a kilometer per meter is the largest mistake of a
unit."""


class Options(CommandOptions):
    """Options of ``omni check-vehicle``."""

    recording: Path = option(positional=True, metavar="RECORDING")
    """rosbag2 folder with wheel_states and brake/pedal; odometry/twist, imu and brake/enable are
    checked if they are recorded; or `live` to receive the motion from the running vehicle, in the
    domain of ROS_DOMAIN_ID"""
    vehicle: str = option(metavar="NAME")
    """a file of config/vehicles/, a path, or the folder of a vehicle, whose experiment.yaml gives
    the axes of the IMU (brake_assist.imu_rotation_deg)"""
    distance: float = option(1.0, unit="m", minimum=-1000.0, maximum=1000.0)
    """distance, measured on the floor, of each straight motion for which no other one is given"""
    angle: float = option(90.0, unit="deg", minimum=-3600.0, maximum=3600.0)
    """measured angle of the turn, unless --turn gives it"""
    forward: float | None = option(None, unit="m", minimum=-1000.0, maximum=1000.0)
    """measured distance of the motion forward; negative if the vehicle moved backward"""
    left: float | None = option(None, unit="m", minimum=-1000.0, maximum=1000.0)
    """measured distance of the motion to the left; negative if the vehicle moved to the right"""
    turn: float | None = option(None, unit="deg", minimum=-3600.0, maximum=3600.0)
    """measured angle of the counter-clockwise turn; negative if it was clockwise"""
    placed: bool = option(False)
    """the positions of the wheels in the file are measured: wheels that turn too far in the turn
    then slip"""
    namespace: str = option("", metavar="NAME")
    """namespace of the running vehicle, such as robot1; used only with `live`"""
    timeout: float = option(600.0, unit="s", above=0.0, maximum=86400.0)
    """limit on the time until the motions are complete; used only with `live`"""
    out: Path | None = option(None, metavar="FILE")
    """corrected vehicle file (default: results/check-vehicle/RECORDING.yaml)"""

    def check_consistency(self) -> None:
        """Check that every motion has a distance or an angle."""
        super().check_consistency()
        for name in ("distance", "angle", "forward", "left", "turn"):
            value = getattr(self, name)
            if value is not None and abs(value) < _SHORTEST:
                problem = f"{value:g} is no motion, must be at least {_SHORTEST:g} in magnitude"
                raise ConfigurationError(f"--{name}", problem)

    @property
    def motions(self) -> tuple[float, float, float]:
        """Motions as the user measured them [m, m, rad]."""
        forward = self.distance if self.forward is None else self.forward
        left = self.distance if self.left is None else self.left
        return forward, left, math.radians(self.angle if self.turn is None else self.turn)


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Find errors in a vehicle file, and write a corrected copy if it has wrong values."""
    from omni_tools.commissioning import mistakes as known
    from omni_tools.commissioning.causes import Stated
    from omni_tools.commissioning.signals import motions_of, unchecked

    vehicle = workspace.experiment_library().vehicle(options.vehicle)
    require_omni_wheels(vehicle.wheels, "check-vehicle")
    signals = _signals(options, workspace, tuple(vehicle.wheels))
    motions = motions_of(signals, tuple(vehicle.wheels))
    drive = vehicle, signals, motions
    shared = options.forward is None and options.left is None
    found = known.find_mistakes(*drive, Stated(np.array(options.motions), shared, options.placed))
    missing = unchecked(signals, motions)
    undistinguished = []
    if not found.mistakes and topics.TWIST.name not in missing:
        undistinguished = known.undistinguished_brakes(*drive)
    values = workspace.experiment_library().vehicle_values(options.vehicle)
    changed = known.corrected(values, found)
    files = []
    if changed != values:
        name = f"{options.recording.resolve().name}.yaml"
        path = options.out or workspace.results(None, "check-vehicle") / name
        head = f"# {options.vehicle}, corrected by ./omni check-vehicle:\n"
        head += "".join(f"# - {one.name}: {one.remedy}\n" for one in found.mistakes)
        text = yaml.safe_dump(changed, sort_keys=False, default_flow_style=None)
        files.append(write_text(path, head + text))
    angles = _angles(tuple(vehicle.wheels), motions, found.predicted)
    sensors = _sensors(motions, options.motions)
    return Report(
        metrics={"mistakes.all": {"value": len(found.mistakes), "unit": "1"}},
        details={
            "mistakes": [{"name": one.name, "remedy": one.remedy} for one in found.mistakes],
            "undecided": _undecided(found),
            "remarks": [{"name": one.name, "remedy": one.remedy} for one in found.remarks],
            "angles": angles,
            "sensors": sensors,
            "undistinguished": undistinguished,
            "unchecked": missing,
        },
        text=[_table([*angles, *sensors]), *_words(found)],
        hints=[
            *(
                f"not checked, because {topic} lacks values: {what}"
                for topic, what in missing.items()
            ),
            *[
                "these stops cannot reveal a swap of the brakes "
                + ", ".join(map(" and ".join, undistinguished))
                + "; add stops in other directions, with the assistant enabled"
            ]
            * bool(undistinguished),
        ],
        files=files,
        ok=not found.mistakes and not found.uncertain,
    )


def _undecided(found: "Findings") -> list[dict[str, Any]]:
    """Return the alternatives of each class, and the measurements that distinguish them."""
    classes = []
    for group in found.undecided:
        parts = [[{"name": one.name, "remedy": one.remedy} for one in part] for part in group]
        checks = dict.fromkeys(one.check for part in group for one in part if one.check)
        classes.append({"alternatives": parts, "distinguished_by": list(checks)})
    return classes


def _words(found: "Findings") -> list[str]:
    """Return the result of the check, a line for each mistake, class and remark."""
    lines = [f"{one.name}: {one.remedy}" for one in found.mistakes]
    for group in _undecided(found):
        lines.append("undecided, because each of these has the same effect:")
        parts = [[f"{o['name']}: {o['remedy']}" for o in part] for part in group["alternatives"]]
        lines += [f"  - {'; and '.join(part) or 'none of the others'}" for part in parts]
        lines.append(f"  to decide: {'; '.join(group['distinguished_by'])}")
    lines += [f"{one.name}: {one.remedy}" for one in found.remarks]
    return lines if found.mistakes or found.undecided else [*lines, "no mistake found"]


def _angles(
    wheels: Sequence[str], motions: "Motions", predicted: FloatArray
) -> list[dict[str, Any]]:
    """Return measured and predicted angle [rad] and their ratio of each wheel and motion."""
    from omni_tools.commissioning.signals import MOTIONS

    rows = []
    for motion, angles, expected in zip(MOTIONS, motions.angle, predicted, strict=True):
        least = 1e-3 * float(np.max(np.abs(expected)))
        for wheel, angle, one in zip(wheels, angles.tolist(), expected.tolist(), strict=True):
            ratio = angle / one if abs(one) > least else None
            row = {"wheel": wheel, "motion": motion, "measured": angle, "predicted": one}
            rows.append({**row, "ratio": ratio, "unit": "rad"})
    return rows


def _sensors(motions: "Motions", stated: Sequence[float]) -> list[dict[str, Any]]:
    """Return measured and stated distance [m] or rotation [rad] of each sensor, and their ratio."""
    from omni_tools.commissioning.signals import MOTIONS

    forward, left = (math.hypot(*motions.twist[motion, :2]) for motion in (0, 1))
    measured = {
        "twist sensor": (forward, left, float(motions.twist[2, 2])),
        "gyro": (math.nan, math.nan, float(motions.gyro[2])),
    }
    rows: list[dict[str, Any]] = []
    for sensor, values in measured.items():
        for motion, value, one in zip(
            MOTIONS, values, (*map(abs, stated[:2]), stated[2]), strict=True
        ):
            row = {"sensor": sensor, "motion": motion, "measured": value, "predicted": one}
            unit = "rad" if motion == MOTIONS[2] else "m"
            rows.append({**row, "ratio": value / one, "unit": unit})
    return [row for row in rows if math.isfinite(row["measured"])]


def _table(rows: Sequence[Mapping[str, Any]]) -> WrappedTable:
    """Return a table of measured and predicted motions of wheels and sensors."""
    names = {
        "motion": [row["motion"] for row in rows],
        "wheel, sensor": [row.get("wheel") or row["sensor"] for row in rows],
        "unit": [row["unit"] for row in rows],
    }
    numbers = {
        "measured": [f"{row['measured']:.2f}" for row in rows],
        "predicted": [f"{row['predicted']:.2f}" for row in rows],
        "ratio": ["" if row["ratio"] is None else f"{row['ratio']:.3f}" for row in rows],
    }
    return WrappedTable(names, numbers)


def _signals(
    options: Options, workspace: ExperimentWorkspace, wheels: tuple[str, ...]
) -> "Signals":
    """Return the signals of a running vehicle or of a recording."""
    from omni_runs.experiment import CONFIGURATION
    from omni_tools.commissioning.signals import MOTIONS, read_signals

    axes = None
    simulated = (options.recording / CONFIGURATION).exists()  # with an IMU in axes of base_link
    if not simulated and (Path(options.vehicle) / "experiment.yaml").exists():
        experiment = workspace.experiment_library().load(options.vehicle)
        axes = rotation_matrix(experiment.brake_assist.imu_rotation_deg)
    if options.recording != _LIVE:
        return read_signals(options.recording, wheels, axes)
    from omni_ros.environment import chosen_domain
    from omni_tools.commissioning.drive_node import receive_drive
    from omni_tools.node_check.exchange_node import Partner

    with closing(Partner(chosen_domain(os.environ) or 0, options.namespace)) as partner:
        workspace.note(
            f"drive {', '.join(MOTIONS)}, each from rest to rest over a measured distance "
            "or angle, then drive and brake in two directions; 2 s at rest end the drive"
        )
        return receive_drive(partner, wheels, options.timeout, imu_axes=axes)
