"""``./omni ros-params``: write parameter files for a real vehicle.

Convert a vehicle file, or the configuration of a run, to the parameter files of odometry and
assistant, to a URDF, and to the kinematics of mecanum_drive_controller or
omni_wheel_drive_controller; docs/real_vehicle.md explains their use.
"""

from pathlib import Path

from omni_core.brakes import TYPICAL
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, make_folder, write_text
from omni_core.configuration import ConfigurationError, check_choice
from omni_runs.workspace import ExperimentWorkspace


class Options(CommandOptions):
    """Options of ``omni ros-params``."""

    configuration: str = option(positional=True, metavar="CONFIGURATION")
    """a file of config/hardware/ or config/experiments/, a path to such a file or to the
    configuration.yaml of a run, or the folder of a vehicle"""
    out: Path = option(metavar="DIR")
    """folder for the files; it is created if it is missing"""
    source: str | None = option(None, metavar="NAME")
    """source of the twist, by its name in ./omni study feedback; a warning states whether
    assistance with this source does more harm than good"""
    feedback: Path | None = option(None, metavar="FILE")
    """result of ./omni study feedback --vehicle, required for --source; it must contain a vehicle
    with the name and the brakes of CONFIGURATION (default: results/feedback/summary.json in the
    workspace)"""
    without_imu: bool = option(False)
    """the vehicle has no IMU; the result for --source must have the same option"""
    brakes: str | None = option(None, choices=tuple(TYPICAL))
    """also write brake_adapter.yaml, the parameters of the brake adapter, for this kind of
    brakes"""
    force: bool = option(False)
    """write the files even if angles of the wheels seem to have a wrong sign or unit"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Write the parameter files and the URDF."""
    from omni_core.sensors import heading_remarks
    from omni_runs.graph.hardware import read_hardware, write_parameters
    from omni_sim.vehicle.rollers import roller_remarks
    from omni_tools.robot_files.controllers import PACKAGES, controller_file, controller_of

    hardware = read_hardware(options.configuration, workspace.experiment_library())
    for remark in roller_remarks(hardware.brake_assist.wheels):
        if not options.force:
            raise ConfigurationError("", f"{remark}; --force writes the files nonetheless")
        workspace.note(remark)
    if hardware.odometry is not None:
        for key in ("sensors", "flow_sensors"):
            for remark in heading_remarks(key, getattr(hardware.odometry, key)):
                workspace.note(remark)
    warning = ""
    if options.source is not None:
        from omni_runs.experiment import short_name
        from omni_sim.twist_sources import SOURCES
        from omni_tools.ros_params.feedback_results import warning_of

        check_choice("--source", options.source, SOURCES)

        summary = options.feedback or workspace.results(None, "feedback") / "summary.json"
        own, imu = short_name(options.configuration), not options.without_imu
        warning = warning_of(summary, own, options.source, hardware.brake_assist, imu)
    if warning:
        workspace.note(warning)
    folder = make_folder(options.out)
    written = write_parameters(hardware, folder, warning, options.brakes)
    controller = controller_of(hardware.brake_assist.wheels)
    if controller is None:
        workspace.note(
            f"no file for a controller: neither {' nor '.join(PACKAGES.values())} can move wheels "
            "of these directions, radii and positions"
        )
    else:
        path = folder / f"{PACKAGES[controller.kind]}.yaml"
        written.append(write_text(path, controller_file(controller)))
    return Report(details={"files": list(map(str, written))}, text=map(str, written))
