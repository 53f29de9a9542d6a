"""``./omni check-vehicle``: find mistakes in the description of a vehicle from a short drive.

Compare a recording of three slow motions (forward, to the left, counter-clockwise, each from rest
to rest) and a stop with the vehicle's file: order and signs of the wheels, rollers, radii,
positions, twist sensor, IMU, order and dead times of the brakes. Each mistake is named with its
remedy.
"""

from __future__ import annotations

import math
import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from omni_bringup.command_report import Report, write_text
from omni_bringup.workspace import Workspace
from omni_platform.command_options import CommandOptions, option
from omni_platform.configuration import parameter

if TYPE_CHECKING:
    from omni_tools.commissioning.signals import Signals


WORK = "checking the vehicle"
_LIVE = Path("live")


class Options(CommandOptions):
    """Options of ``omni check-vehicle``."""

    recording: Path = option(positional=True, metavar="RECORDING")
    """rosbag2 folder with wheel_states, brake/pedal and, to check them too, odometry/twist, imu and
    brake/enable; or 'live' for a drive that follows, in the domain of ROS_DOMAIN_ID"""
    vehicle: str = option(metavar="NAME")
    """a file of config/vehicles/, a path that ends in .yaml, or a vehicle's folder"""
    distance: float = parameter(1.0, unit="m", above=0.0)
    """measured distance of the motions forward and to the left"""
    angle: float = parameter(90.0, unit="deg", above=0.0)
    """measured angle of the motion counter-clockwise"""
    namespace: str = option("", metavar="NAME")
    """namespace of the vehicle, for a live drive"""
    timeout: float = parameter(600.0, unit="s", above=0.0)
    """time within which a live drive must be complete"""
    out: Path | None = option(None, metavar="FILE")
    """corrected file of the vehicle (default: results/check-vehicle/RECORDING.yaml)"""


def run(options: Options, workspace: Workspace) -> Report:
    """Find the mistakes, and write a corrected file of the vehicle if its values are wrong."""
    from omni_tools.commissioning.mistakes import corrected, find_mistakes
    from omni_tools.commissioning.signals import MOTIONS, motions_of, read_signals

    vehicle = workspace.experiment_library().vehicle(options.vehicle)
    if options.recording == _LIVE:
        workspace.note(
            f"drive {options.distance:g} m or {options.angle:g} deg {', '.join(MOTIONS)}, each "
            "from rest to rest, then drive and brake"
        )
        signals = _received(options, tuple(vehicle.wheels))
    else:
        signals = read_signals(options.recording, tuple(vehicle.wheels))
    mistakes = find_mistakes(
        vehicle.wheels,
        signals,
        motions_of(signals),
        distance=options.distance,
        angle=math.radians(options.angle),
        brake=vehicle.brake,
    )
    values = workspace.experiment_library().vehicle_values(options.vehicle)
    changed = corrected(values, mistakes)
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
        details={"mistakes": [{"name": one.name, "remedy": one.remedy} for one in mistakes]},
        text=[f"{one.name}: {one.remedy}" for one in mistakes] or ["no mistake found"],
        files=files,
        ok=not mistakes,
    )


def _received(options: Options, wheels: tuple[str, ...]) -> Signals:
    from omni_bringup.node_check.drive_node import receive_drive
    from omni_bringup.node_check.exchange_node import Partner
    from omni_ros.environment import chosen_domain

    with closing(Partner(chosen_domain(os.environ) or 0, options.namespace)) as partner:
        return receive_drive(partner, wheels, options.timeout)
