"""``./omni check-vehicle``: find errors in a vehicle's file from a short recorded motion.

Compare a vehicle's file with a recording of three slow motions (forward, to the left,
counter-clockwise, each from rest to rest) and of stops in different directions. The command checks
order, signs, radii, positions and rollers of the wheels, the twist sensor, the IMU, and the order
and dead times of the brakes. Each error is reported with its remedy. The command also reports
pairs of brakes for which these stops cannot show whether the two are swapped.
"""

import math
import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from omni_core import topics
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, write_text
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_tools.commissioning.signals import Signals

WORK = "checking the vehicle"
_LIVE = Path("live")


class Options(CommandOptions):
    """Options of ``omni check-vehicle``."""

    recording: Path = option(positional=True, metavar="RECORDING")
    """rosbag2 folder with wheel_states and brake/pedal; odometry/twist, imu and brake/enable are
    checked if they are recorded; or `live` to receive the motion from the running vehicle, in the
    domain of ROS_DOMAIN_ID"""
    vehicle: str = option(metavar="NAME")
    """a file of config/vehicles/, a path, or the folder of a vehicle"""
    distance: float = option(1.0, unit="m", above=0.0, maximum=1000.0)
    """distance, measured on the floor, of each of the motions forward and to the left"""
    angle: float = option(90.0, unit="deg", above=0.0, maximum=3600.0)
    """measured angle of the counter-clockwise motion"""
    namespace: str = option("", metavar="NAME")
    """namespace of the running vehicle, such as robot1; used only with `live`"""
    timeout: float = option(600.0, unit="s", above=0.0, maximum=86400.0)
    """limit on the time until the motions are complete; used only with `live`"""
    out: Path | None = option(None, metavar="FILE")
    """corrected vehicle file (default: results/check-vehicle/RECORDING.yaml)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Find errors in a vehicle file, and write a corrected copy if it has wrong values."""
    from omni_tools.commissioning import mistakes as known
    from omni_tools.commissioning.signals import motions_of, unchecked

    vehicle = workspace.experiment_library().vehicle(options.vehicle)
    signals = _signals(options, workspace, tuple(vehicle.wheels))
    motions = motions_of(signals)
    drive = vehicle, signals, motions
    mistakes = known.find_mistakes(*drive, options.distance, math.radians(options.angle))
    missing = unchecked(signals, motions)
    undistinguished = []
    if not mistakes and topics.TWIST.name not in missing:
        undistinguished = known.undistinguished_brakes(*drive)
    values = workspace.experiment_library().vehicle_values(options.vehicle)
    changed = known.corrected(values, mistakes)
    files = []
    if changed != values:
        name = f"{options.recording.resolve().name}.yaml"
        path = options.out or workspace.results(None, "check-vehicle") / name
        head = f"# {options.vehicle}, corrected by ./omni check-vehicle:\n"
        head += "".join(f"# - {one.name}: {one.remedy}\n" for one in mistakes)
        text = yaml.safe_dump(changed, sort_keys=False, default_flow_style=None)
        files.append(write_text(path, head + text))
    return Report(
        metrics={"mistakes.all": {"value": len(mistakes), "unit": "1"}},
        details={
            "mistakes": [{"name": one.name, "remedy": one.remedy} for one in mistakes],
            "undistinguished": undistinguished,
            "unchecked": missing,
        },
        text=[f"{one.name}: {one.remedy}" for one in mistakes] or ["no mistake found"],
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
        ok=not mistakes,
    )


def _signals(
    options: Options, workspace: ExperimentWorkspace, wheels: tuple[str, ...]
) -> "Signals":
    """Return the signals of a running vehicle or of a recording."""
    from omni_tools.commissioning.signals import MOTIONS, read_signals

    if options.recording != _LIVE:
        return read_signals(options.recording, wheels)
    from omni_ros.environment import chosen_domain
    from omni_tools.commissioning.drive_node import receive_drive
    from omni_tools.node_check.exchange_node import Partner

    with closing(Partner(chosen_domain(os.environ) or 0, options.namespace)) as partner:
        workspace.note(
            f"drive {options.distance:g} m or {options.angle:g} deg {', '.join(MOTIONS)}, each "
            "from rest to rest, then drive and brake in two directions; 2 s at rest end the drive"
        )
        return receive_drive(partner, wheels, options.timeout)
