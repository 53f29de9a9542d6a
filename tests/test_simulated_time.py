"""Every node continues if simulated time is in use and no node publishes it, at any time."""

from __future__ import annotations

import dataclasses
from contextlib import closing
from pathlib import Path

from bystander import Bystander
from diagnostic_msgs.msg import DiagnosticArray
from omni_process import WORKSPACE
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from omni_recording.folder import bag_summary, open_bag
from omni_ros.environment import node_environment
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup

DIAGNOSTICS = {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
SPEAKERS = ("brake_assist", "linescan_odometry")


class Listener(Bystander):
    """Counts the status messages of each node."""

    def __init__(self, domain: int) -> None:
        super().__init__("listener", domain)
        self.counts = dict.fromkeys(SPEAKERS, 0)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, RELIABLE)

    def _on_report(self, message: DiagnosticArray) -> None:
        self.counts[message.status[0].name] += 1

    def description(self) -> str:
        return f"messages of {self.counts}"

    def wait_for_all(self) -> None:
        """Wait for two more status messages of each node."""
        wanted = {name: count + 2 for name, count in self.counts.items()}
        self.wait(lambda: all(self.counts[name] >= wanted[name] for name in SPEAKERS))


def test_nodes_publish_and_record_without_a_clock(tmp_path: Path) -> None:
    configuration = ExperimentLibrary(WORKSPACE / "config").load("flow_sensors", "assisted")
    folder = tmp_path / "bag"
    nodes = graph.Nodes(configuration, tmp_path)
    processes = [
        # Stamps of two clocks may be recorded, and no node waits.
        (nodes.recorder(folder, chosen=DIAGNOSTICS), "strict:=false"),
        (nodes.odometry(), "subscribers:=0"),
        (nodes.brake_assist(), "subscribers:=0"),
    ]
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        started = []
        for process, given in processes:
            arguments = [*process.arguments, "-p", "use_sim_time:=true", "-p", given]
            started.append(group.start(dataclasses.replace(process, arguments=arguments)))
        with closing(Listener(domain)) as listener:
            listener.wait_for_all()
            for value in (False, True):
                for name in (*SPEAKERS, "recorder"):
                    used = Parameter("use_sim_time", value=value).to_parameter_msg()
                    asked = SetParameters.Request(parameters=[used])
                    (result,) = listener.call(
                        SetParameters, f"/{name}/set_parameters", asked
                    ).results
                    assert result.successful
                listener.wait_for_all()
        assert all(process.returncode is None for process in started)
    assert bag_summary(open_bag(folder)).counts["/diagnostics"] >= 2 * len(SPEAKERS)
