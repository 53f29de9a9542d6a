"""``./omni drive``: drive a vehicle in real time from a page in the browser.

Run the nodes in real time while a person drives the vehicle from a page in the browser or by
cmd_vel. Ctrl-C ends the command.
"""

from __future__ import annotations

import dataclasses
import ipaddress
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.brakes import TYPICAL, typical_changes
from omni_core.commands import command_report, interruption
from omni_core.commands.command_options import option, overrides_option
from omni_core.configuration import Configuration, ConfigurationError
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
    from omni_runs.graph.process_group import ProcessGroup


_RECORDED = (
    "Fixed, because this drive is recorded (--out) and a recording contains one vehicle on one "
    "ground. Start ./omni drive without --out to choose here."
)

# Ice is ahead of the left wheels only, so that an unassisted stop rotates the vehicle most.
_ICE = "ground.patches.ice={x: 14.0, y: 1.5, length: 8.0, width: 3.0, friction: 0.15}"


class Options(Configuration):
    """Options of ``omni drive``."""

    vehicle: str | None = option(None)
    """a file of config/vehicles/, a path, or the folder of a vehicle (default: the experiment's)"""
    experiment: str = option("small_stop")
    """experiment whose last variant determines ground, sensors and nodes"""
    ground: str | None = option(None)
    """a file of config/grounds/ (default: the experiment's)"""
    law: str | None = option(None)
    """control law: a built-in law, or your own as `my_module:MyLaw` (default: the experiment's)"""
    brakes: str | None = option(None, choices=tuple(TYPICAL))
    """brakes with the typical timing of this kind, as in ./omni new-vehicle (default: the
    vehicle's)"""
    no_ice: bool = option(False)
    """do not add the patch of ice that is otherwise added to a ground without patches"""
    overrides: tuple[str, ...] = overrides_option()
    max_speed: float = option(5.0, metavar="M/S", above=0.0, maximum=50.0)
    """speed at full deflection of the stick"""
    host: str = option("127.0.0.1", metavar="ADDRESS")
    """address of this machine at which the page is served, for example to a phone; anyone who
    knows the page's address with its token can drive"""
    port: int = option(0, metavar="PORT", minimum=0, maximum=65535)
    """TCP port of the page; 0 for any free port"""
    unstamped: bool = option(False)
    """receive cmd_vel as Twist, which older teleoperation nodes publish, not as TwistStamped"""
    out: Path | None = option(None, metavar="DIR")
    """record the drive to this rosbag2 folder"""
    lines: bool = option(False)
    """also record the lines of the cameras (1 MB/s), which a replay of the odometry needs"""


def run(options: Options, workspace: ExperimentWorkspace) -> command_report.Report:
    """Run the nodes until a signal ends the command or a node fails.

    Raises:
        ProcessError: a node has ended. If all nodes run, only a signal ends the command.
    """
    from omni_ros.environment import node_environment
    from omni_runs.graph.domain import reserved_domain
    from omni_runs.graph.nodes import Nodes
    from omni_runs.graph.process_group import ProcessGroup
    from omni_runs.graph.run_variant import write_beside_bag

    library = workspace.experiment_library()
    parameters: dict[str, Any] = {
        "max_speed": options.max_speed,
        "host": options.host,
        "port": options.port,
        "stamped_cmd_vel": not options.unstamped,
    }
    folder = options.out and options.out.resolve()
    if folder is not None and folder.exists():
        raise ConfigurationError("--out", f"{options.out} exists; choose another")
    _is_local(options.host)
    configuration = _compose(library, options, workspace)
    if folder is not None:
        command_report.make_folder(folder).rmdir()  # the recorder makes the folder itself
    remark = _RECORDED if folder else ""
    while True:
        choices = _choices(library, options, configuration) | {"remark": remark}
        with (
            interruption.clean_up_on_signals(),
            reserved_domain() as domain,
            tempfile.TemporaryDirectory(prefix="omni-") as scratch,
            ProcessGroup(node_environment(domain)) as group,
        ):
            nodes = Nodes(configuration, Path(scratch))
            for node in nodes.of_drive(parameters | choices, folder, options.lines):
                group.start(node)
            if folder is not None:
                write_beside_bag(configuration, folder, group.running[0])
            chosen = _choice(group, domain, parameters)
            try:
                wanted = dataclasses.replace(options, **chosen)
                configuration, options = _compose(library, wanted, workspace), wanted
                remark = ""
            except ConfigurationError as error:
                remark = f"{', '.join(chosen.values())} cannot be driven: {error}"


def _is_local(host: str) -> bool:
    """Return whether an address is reachable from this machine only.

    Raises:
        ConfigurationError: the text is not an IP address, or is the wildcard address.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        raise ConfigurationError("--host", f"{host!r} is not an IP address") from None
    if address.is_unspecified:
        raise ConfigurationError("--host", f"{host} means all addresses; choose a single one")
    return address.is_loopback


def _choices(
    library: ExperimentLibrary, options: Options, configuration: ExperimentConfiguration
) -> dict[str, Any]:
    """Return the driver node's parameters for the choices on the page, keyed by parameter name."""
    from omni_brake_assist.configuration import LAWS

    offered = {
        "vehicle": (options.vehicle, library.parts("vehicles")),
        "ground": (options.ground, library.parts("grounds")),
        "law": (configuration.brake_assist.law, list(LAWS)),
        "brakes": (options.brakes or configuration.vehicle.brake.kind, list(TYPICAL)),
    }
    found: dict[str, Any] = {"choices.names": list(offered)}
    for kind, (given, names) in offered.items():
        chosen = given or library.named(options.experiment, kind)
        found[f"choices.{kind}.chosen"] = chosen
        all_names = names if chosen in names else [chosen, *names]
        found[f"choices.{kind}.names"] = [chosen] if options.out else all_names
    return found


def _compose(
    library: ExperimentLibrary, options: Options, workspace: ExperimentWorkspace
) -> ExperimentConfiguration:
    chosen = {"vehicle": options.vehicle, "ground": options.ground, "brake_assist.law": options.law}
    changes = [f"{key}={value}" for key, value in chosen.items() if value is not None]
    changes += [*(typical_changes(options.brakes) if options.brakes else ()), *options.overrides]
    configuration = library.load(options.experiment, overrides=changes)
    if not configuration.ground.patches and not options.no_ice:
        configuration = library.load(options.experiment, overrides=[*changes, _ICE])
    configuration.check_drivable()
    names = [
        chosen[kind] or library.named(options.experiment, kind) for kind in ("vehicle", "ground")
    ]
    description = f"A drive: {', '.join(filter(None, names))}, {configuration.brake_assist.law}"
    configuration = dataclasses.replace(configuration, description=description)
    workspace.check([_at_full_stick(configuration, options.max_speed)])
    return configuration


def _at_full_stick(configuration: ExperimentConfiguration, speed: float) -> ExperimentConfiguration:
    """Return the configuration with a scripted motion at the speed of full stick deflection.

    The check for implausible values uses this motion, because a person's motion is not known.

    Args:
        configuration: configuration of the whole loop.
        speed: speed at full deflection [m/s]; the motion is first forward, then to the left.
    """
    from omni_sim.driver.configuration import DemandConfiguration, ManeuverConfiguration

    demands = DemandConfiguration(
        time=(0.0, 1.0), forward=(speed, 0.0), left=(0.0, speed), turn=(0.0,) * 2, pedal=(0.0,) * 2
    )
    return dataclasses.replace(configuration, maneuver=ManeuverConfiguration(demands=demands))


def _choice(group: ProcessGroup, domain: int, parameters: dict[str, Any]) -> dict[str, Any]:
    """Print the address of the page, watch the nodes, and return a choice made on the page.

    Args:
        group: processes of the nodes.
        domain: ROS domain of the nodes.
        parameters: parameters of the driver node; the token and the port of the page are added, so
            that the page keeps its address if the nodes are restarted.

    Raises:
        ProcessError: a node has ended.
    """
    from omni_runs.graph.process_group import wait_for

    reach = "this machine" if _is_local(parameters["host"]) else "any machine that reaches it"
    driver = next(process for process in group.running if process.node.name == "driver")
    while True:
        group.raise_if_ended()
        for document in driver.new_reports():
            if "choose" in document:
                return dict(document["choose"])
            if "token" not in parameters:
                # Standard output contains only the address, for programs that read it.
                print(document["url"], flush=True)
                place, parameters["token"] = document["url"].rstrip("/").rsplit("/", 1)
                parameters["port"] = int(place.rsplit(":", 1)[1])
            if "url" in document:
                print(
                    f"omni drive: open this address in a browser of {reach}; for cmd_vel: "
                    f"ROS_DOMAIN_ID={domain} ros2 run teleop_twist_keyboard teleop_twist_keyboard "
                    "--ros-args -p stamped:=true; "
                    "Ctrl-C ends",
                    file=sys.stderr,
                )
        wait_for(driver)
