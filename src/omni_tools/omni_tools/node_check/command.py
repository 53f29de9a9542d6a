"""``./omni check-node``: check whether a user's node meets the contract of its topics.

Publish a recording in real time to an odometry node or a brake assistant: unchanged, with a gap in
one input, with unusable values in this input, and cut off during braking. Send valid and invalid
enables to a simulator. Report each violation of the contract in one sentence; the exit code is 1 if
there is any violation.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, entries
from omni_core.configuration import ConfigurationError
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration
    from omni_tools.node_check.exchange_node import Partner

WORK = "checking the node"


class Options(CommandOptions):
    """Options of ``omni check-node``."""

    node: str = option(
        positional=True, metavar="NODE", choices=("odometry", "simulator", "brake_assist")
    )
    """role of the node: `odometry`, `simulator` or `brake_assist`"""
    recording: Path | None = option(None, metavar="BAG")
    """recording of ./omni run that is published to the node (default: bags/small_stop/assisted)"""
    start: str | None = option(None, metavar="COMMAND")
    """command that starts the node in a separate ROS domain (default: the node already runs, in
    the domain of ROS_DOMAIN_ID)"""
    duration: float = option(10.0, unit="s", above=1.0, maximum=600.0)
    """duration for which messages of a simulator are checked, unless the simulator ends earlier"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Send inputs to the tested node, and report violations of its contract."""
    from omni_recording.folder import open_vehicle
    from omni_runs.replay.plan import recorded_configuration

    recording = options.recording or workspace.folder / "bags" / "small_stop" / "assisted"
    configuration = recorded_configuration(open_vehicle(recording))
    with _node(options.start) as (partner, alive):
        if options.node == "simulator":
            values, breaches = _check_simulator(partner, configuration, options.duration, alive)
        else:
            values, breaches = _check_answers(
                partner, recording, configuration, options.node, alive
            )
    return Report(
        metrics=entries({**values, "breaches.all": (len(breaches), "1")}),
        details={"node": options.node, "breaches": breaches},
        text=breaches or [f"the {options.node} meets its contract"],
        ok=not breaches,
    )


@contextmanager
def _node(command: str | None) -> Iterator[tuple[Partner, Callable[[], bool]]]:
    """Start the tested node; without a command, the user starts it.

    Args:
        command: command that starts the tested node; None if the user starts it.

    Yields:
        This program's node in the ROS domain of the tested node, and a function that returns
        whether the tested node still runs.
    """
    from omni_ros.environment import chosen_domain, node_environment
    from omni_runs.graph.domain import reserved_domain
    from omni_tools.node_check.exchange_node import Partner

    if command is None:
        with closing(Partner(chosen_domain(os.environ) or 0)) as partner:
            yield partner, lambda: True
        return
    # The reservation ends here, because ./omni run itself reserves the domain of its nodes. Other
    # runs do not choose this domain, because the node of this program is in it.
    with reserved_domain() as domain:
        partner = Partner(domain)
    with closing(partner):
        try:
            process = subprocess.Popen(
                shlex.split(command),
                env=node_environment(domain),
                stdin=subprocess.DEVNULL,
                stdout=sys.stderr,  # the report of this command goes to the standard output
            )
        except (OSError, ValueError, IndexError) as error:
            raise ConfigurationError("--start", f"cannot start {command!r}: {error}") from None
        try:
            yield partner, lambda: process.poll() is None
        finally:
            process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()


def _check_answers(
    partner: Partner,
    recording: Path,
    configuration: ExperimentConfiguration,
    node: str,
    alive: Callable[[], bool],
) -> tuple[dict[str, tuple[float, str]], list[str]]:
    from omni_core import topics
    from omni_runs.replay.plan import feedback_topic
    from omni_tools.node_check import contract
    from omni_tools.node_check.exchange_node import feed

    if node == "odometry":
        lines = [topics.lines(name) for name in configuration.odometry.sensors]
        flows = [topics.flow(name) for name in configuration.odometry.flow_sensors]
        inputs, output = [*lines, *flows], topics.TWIST
        faulty = paced = inputs[0]
    else:
        faulty, paced, output = feedback_topic(configuration), topics.PEDAL, topics.ENABLE
        inputs = [topics.WHEEL_STATES, topics.IMU, faulty, paced]
    exchange = feed(partner, recording, inputs, faulty, paced, output, alive)
    breaches = [*contract.common_breaches(exchange, node, output.name)]
    if node == "odometry":
        motion = contract.WheelMotion.of(recording, configuration.vehicle.wheels)
        breaches += contract.twist_breaches(exchange, motion)
    else:
        breaches += contract.enable_breaches(exchange, list(configuration.vehicle.wheels))
    return contract.metrics(exchange), breaches


def _check_simulator(
    partner: Partner,
    configuration: ExperimentConfiguration,
    duration: float,
    alive: Callable[[], bool],
) -> tuple[dict[str, tuple[float, str]], list[str]]:
    from omni_core import topics
    from omni_tools.node_check import contract
    from omni_tools.node_check.enables_node import Enables

    wheels = list(configuration.vehicle.wheels)
    partner.await_node(topics.PEDAL.path, alive, sent=[topics.ENABLE.path])
    enables = Enables(partner.node, wheels)
    seen = enables.watch(partner, duration, alive)
    breaches = [*contract.simulator_breaches(seen, wheels), *enables.breaches(seen)]
    return {f"messages.{key}": (len(found.messages), "1") for key, found in seen.items()}, breaches
