"""``./omni estimate-load``: mass, center of gravity and wheel loads from a recorded motion.

Estimate mass, center of gravity and wheel loads, with standard errors, from a drive in which the
vehicle rolls freely (constant speed without motor torque) or brakes gently so that no wheel locks.
A drive of the empty vehicle calibrates radii, ground speed and brakes. The command writes a copy of
the vehicle's file with this load, and warns if the vehicle would swerve in an unassisted stop.
"""

from __future__ import annotations

import dataclasses
import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core import topics
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, estimate, estimate_table, write_text
from omni_core.configuration import ConfigurationError
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_sim.vehicle.configuration import VehicleConfiguration
    from omni_tools.load_estimate.data import DriveData
    from omni_tools.load_estimate.estimate import LoadEstimate

WORK = "estimating the load"
_LIVE = Path("live")
_UNEVEN = 3.0  # standard errors


class Options(CommandOptions):
    """Options of ``omni estimate-load``."""

    recordings: tuple[Path, ...] = option(positional=True, metavar="RECORDING")
    """rosbag2 folders with wheel_states, brake/pedal and a twist, of drives with the same load; or
    `live` to receive the drive from the running vehicle, in the domain of ROS_DOMAIN_ID"""
    vehicle: str = option(metavar="NAME")
    """a file of config/vehicles/, a path, or the folder of a vehicle; its body is the empty
    vehicle"""
    empty: Path | None = option(None, metavar="RECORDING")
    """drive of the empty vehicle, which calibrates the radii, the ground speed and the brakes"""
    twist: str = option(topics.TWIST.name, choices=tuple(topics.WITH_TWIST))
    """topic with the measured twist"""
    wear: float = option(0.05, unit="mm", above=0.0, maximum=50.0)
    """standard error of the radius of each wheel, by wear since the calibration; without --empty,
    that of the radii in the file"""
    stiffness_error: float = option(0.05, above=0.0, maximum=1.0)
    """relative standard error of the tires' vertical stiffness"""
    torque_error: float = option(0.05, above=0.0, maximum=1.0)
    """relative standard error of the torque of each brake, and of their common error or, with
    --empty, of its change since the calibration"""
    sensors: str | None = option(None, metavar="NAME")
    """a file of config/sensors/ with the cameras, if their lenses are not telecentric"""
    working_distance: float = option(0.1, unit="m", above=0.0, maximum=10.0)
    """height of these lenses above the ground"""
    speed: float = option(2.0, unit="m/s", above=0.0, maximum=20.0)
    """speed of the intended drive, for the warning"""
    max_rotation: float = option(10.0, unit="deg", above=0.0, maximum=360.0)
    """rotation in an unassisted stop above which the command warns"""
    namespace: str = option("", metavar="NAME")
    """namespace of the running vehicle, such as robot1; used only with `live`"""
    duration: float = option(60.0, unit="s", above=0.0, maximum=86400.0)
    """duration of the reception; used only with `live`, which publishes each estimate as
    diagnostics"""
    out: Path | None = option(None, metavar="FILE")
    """vehicle file with the load (default: results/estimate-load/RECORDING.yaml)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Estimate the load, write it as a vehicle file and warn of a swerve."""
    from omni_tools.load_estimate.estimate import center_of, load_of
    from omni_tools.load_estimate.swerve import with_load

    if options.empty and options.empty.resolve() in [one.resolve() for one in options.recordings]:
        raise ConfigurationError(
            "--empty", "is the drive with the load, too; give a drive of the empty vehicle"
        )
    vehicle = workspace.experiment_library().vehicle(options.vehicle)
    found = _estimate(options, workspace, vehicle)
    whole, load = center_of(found.moments, found.covariance), load_of(found, vehicle)
    metrics = _entries(vehicle, whole, load, found)
    carried = with_load(vehicle, _known(*load))
    default = f"{options.recordings[0].resolve().name}.yaml"
    path = options.out or workspace.results(None, "estimate-load") / default
    warning, rotation = warn(options, carried)
    metrics["rotation.unassisted"] = {"value": rotation, "unit": "deg"}
    hint = (
        "use this file as --vehicle of nav2-polygons and check-vehicle, and with the law "
        f"allocation set brake_assist.nominal_mass to {whole[0][0]:.0f}"
    )
    return Report(
        metrics=metrics,
        text=_text(metrics, found, warning, empty=carried.load.mass == 0.0),
        files=(_write(path, options, workspace, carried),),
        hints=() if vehicle.has_conventional_wheels else (hint,),
    )


def _known(load: Any, error: Any) -> Any:
    """Return mass and position of a load, which are 0 if its mass is below two standard errors."""
    return load if load[0] > 2.0 * error[0] else 0.0 * load


def warn(options: Options, loaded: VehicleConfiguration) -> tuple[str, float]:
    """Return a warning, empty if there is no reason, and the largest rotation in a stop [deg]."""
    from omni_tools.load_estimate.swerve import highest_speed, largest_rotation

    rotation, direction = largest_rotation(loaded, options.speed)
    if abs(rotation) <= options.max_rotation:
        return "", rotation
    slower = highest_speed(loaded, options.max_rotation, options.speed)
    return (
        f"warning: a stop without the assistant from {options.speed:g} m/s toward {direction:.0f} "
        f"deg turns the vehicle by {rotation:.0f} deg; up to {slower:.1f} m/s it turns by at most "
        f"{options.max_rotation:g} deg"
    ), rotation


def _estimate(
    options: Options, workspace: ExperimentWorkspace, vehicle: VehicleConfiguration
) -> LoadEstimate:
    from omni_tools.load_estimate.data import joined
    from omni_tools.load_estimate.estimate import Cameras, Uncertainty, estimate_load

    library, wheels = workspace.experiment_library(), tuple(vehicle.wheels)
    assumed = Uncertainty(1e-3 * options.wear, options.stiffness_error, options.torque_error)
    empty = _read(options.empty, wheels, options.twist) if options.empty else None
    cameras = None
    if options.sensors is not None:
        cameras = Cameras(library.sensors(options.sensors), options.working_distance)

    def evaluate(drive: DriveData) -> LoadEstimate:
        return estimate_load(drive, vehicle, assumed, empty, cameras)

    if options.recordings == (_LIVE,):
        return _receive(options, workspace, vehicle, evaluate)
    return evaluate(joined([_read(one, wheels, options.twist) for one in options.recordings]))


def _receive(
    options: Options, workspace: ExperimentWorkspace, vehicle: VehicleConfiguration, evaluate: Any
) -> LoadEstimate:
    """Return the estimate from a running vehicle, after all previous ones were published."""
    from omni_ros.environment import chosen_domain
    from omni_tools.load_estimate.estimate import load_of
    from omni_tools.load_estimate.live_node import receive
    from omni_tools.load_estimate.swerve import with_load
    from omni_tools.node_check.exchange_node import Partner

    def state(found: LoadEstimate) -> tuple[str, dict[str, str]]:
        load = _known(*load_of(found, vehicle))
        warning, rotation = warn(options, with_load(vehicle, load))
        words = ("mass [kg]", "forward [m]", "to the left [m]")
        values = {f"load, {word}": f"{value:.3g}" for word, value in zip(words, load, strict=True)}
        return warning, values | {"rotation without assistance [deg]": f"{rotation:.1f}"}

    with closing(Partner(chosen_domain(os.environ) or 0, options.namespace)) as partner:
        workspace.note(
            f"drive straight ahead and let the vehicle roll, or brake gently, for "
            f"{options.duration:g} s"
        )
        wheels = tuple(vehicle.wheels)
        return receive(partner, wheels, options.twist, options.duration, evaluate, state)


def _read(recording: Path, wheels: tuple[str, ...], twist: str) -> DriveData:
    from omni_recording.folder import open_vehicle
    from omni_runs.recorded_run import read_streams
    from omni_tools.load_estimate.data import REQUIRED, drive_data

    chosen = (*REQUIRED, topics.WITH_TWIST[twist])
    return drive_data(read_streams(open_vehicle(recording), chosen, chosen), wheels, twist)


def _entries(
    vehicle: VehicleConfiguration, whole: Any, load: Any, found: LoadEstimate
) -> dict[str, Any]:
    entries = {}
    described = vehicle.masses
    for case, (values, errors), known in (
        ("all", whole, (described.mass, *described.center)),
        ("load", load, (vehicle.load.mass, vehicle.load.x, vehicle.load.y)),
    ):
        for key, unit, k in (("mass", "kg", 0), ("forward", "m", 1), ("left", "m", 2)):
            # No load has no position.
            if k == 0 or _known(values, errors)[0] > 0.0:
                metric = estimate(values[k], unit, errors[k]) | {"described": float(known[k])}
                entries[f"{key}.{case}"] = metric
    for name, value, error in zip(vehicle.wheels, found.loads, found.load_errors, strict=True):
        entries[f"wheel_load.{name}"] = estimate(value, "N", error)
    return entries


def _text(metrics: dict[str, Any], found: LoadEstimate, warning: str, *, empty: bool) -> list[Any]:
    lines = [
        estimate_table(metrics),
        f"from {found.rolling:.1f} s of free rolling and {found.braking:.1f} s of braking",
    ]
    if empty:
        lines.append("no load: its mass is below two standard errors")
    if found.unevenness > _UNEVEN:
        lines.append(
            f"note: the radii differ from those of a rigid chassis on a plane by "
            f"{found.unevenness:.1f} standard errors: a wheel is worn, or the floor is uneven"
        )
    return [*lines, *([warning] if warning else [])]


def _write(
    path: Path, options: Options, workspace: ExperimentWorkspace, carried: VehicleConfiguration
) -> Path:
    """Write a copy of the vehicle's file with the estimated load."""
    import yaml

    values = workspace.experiment_library().vehicle_values(options.vehicle)
    load = dataclasses.asdict(carried.load)
    values["load"] = {name: round(float(value), 4) for name, value in load.items()}
    head = (
        f"# {options.vehicle} with the load from ./omni estimate-load;\n"
        "# its height and yaw inertia are not observable and are not estimated.\n"
    )
    return write_text(path, head + yaml.safe_dump(values, sort_keys=False, default_flow_style=None))
