"""Measure the time from SIGINT to the end of each node, with and without subscribers.

``./omni exec python benchmarks/stop_times.py`` prints median and maximum of 20 trials in seconds.
"""

import dataclasses
import os
import signal
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import output
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

from omni_core import topics
from omni_ros.environment import node_environment
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import NodeProcess, find_executable

SETTLING = 6.0  # [s] from the appearance of a node until it is ready


def main() -> None:
    """Measure and print the times of all nodes."""
    options = output.options(__doc__, repetitions=20)
    metrics: output.Metrics = {}
    with tempfile.TemporaryDirectory() as scratch:
        for subscribed in (False, True):
            for name in ("simulator", "linescan_odometry", "brake_assist", "recorder"):
                times = [
                    stop_time(name, Path(scratch) / f"{name}{subscribed}{i}", subscribed=subscribed)
                    for i in range(options.repetitions)
                ]
                case = f"{name}_{'subscribed' if subscribed else 'alone'}"
                metrics[f"stop_time_median.{case}"] = statistics.median(times), "s"
                metrics[f"stop_time_worst.{case}"] = max(times), "s"
    output.publish("stop_times", metrics, as_json=options.json)


def node_of(name: str, scratch: Path) -> NodeProcess:
    """Return a node of a graph that runs in real time."""
    endless = ("simulation.duration_limit=600", "maneuver.brake_time=500")
    configuration = output.load("straight_line", "assisted", *output.BLIND, *endless)
    if name == "simulator":
        return graph.Nodes(configuration, scratch).simulator(listeners=0)
    if name == "brake_assist":
        return graph.Nodes(configuration, scratch).brake_assist(listeners=0)
    optical = output.load("straight_line", "assisted")
    if name == "recorder":
        return graph.Nodes(optical, scratch).recorder(scratch / "bag")
    process = graph.Nodes(optical, scratch).odometry(listeners=1)
    # Without a subscriber the node would wait for one.
    return dataclasses.replace(process, arguments=[*process.arguments, "-p", "subscribers:=0"])


def stop_time(name: str, scratch: Path, *, subscribed: bool) -> float:
    """Return the time in which a running node ends after one SIGINT [s].

    Raises:
        RuntimeError: the node ends with an error.
    """
    scratch.mkdir()
    node = node_of(name, scratch)
    with reserved_domain() as domain:
        environment = node_environment(domain)
        os.environ.update(environment)
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        watcher = Node("watcher", context=context)
        if subscribed:
            for topic in (topics.WHEEL_STATES, topics.ENABLE, topics.JOINT_STATES):
                watcher.create_subscription(JointState, topic.name, lambda _: None, 10)
        command = [str(find_executable(node.package, node.executable)), *node.arguments]
        process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        try:
            own = watcher.get_name()
            while process.poll() is None and set(watcher.get_node_names()) <= {own}:
                time.sleep(0.01)
            time.sleep(SETTLING)
            started = time.monotonic()
            process.send_signal(signal.SIGINT)
            _, complaint = process.communicate(timeout=30.0)
            elapsed = time.monotonic() - started
        finally:
            process.kill()
            watcher.destroy_node()
            rclpy.shutdown(context=context)
        if process.returncode != 0:
            raise RuntimeError(f"{name} ended with {process.returncode}: {complaint}")
        return elapsed


if __name__ == "__main__":
    main()
