"""Measure how long the messages of a run take in a graph of nodes that compute nothing.

A run over the graph is recorded. Then four processes exchange the same messages again, step by step
and with the same quality of service and executor: each node serializes and publishes what it had
published as soon as it has received what it waits for. The time of a step of this empty graph, plus
that of the same loop in one process, is the floor of a graph without overlap of its nodes.
"""

import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import output
from graph_real_time import process_factor

from omni_core.topics import Topic
from omni_recording.folder import bag_messages, open_bag
from omni_ros.environment import node_environment
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.run_variant import finish_runs, run_variant

_LINES = tuple(f"/line_scan/{name}/lines" for name in ("left", "right", "front"))
_TWIST, _ENABLE = "/odometry/twist", "/brake/enable"
_OF_ASSISTANT = (_ENABLE, "/brake_assist/error", "/brake_assist/test_ratios")
_OF_ODOMETRY = (_TWIST, "/odom")
# What each node receives in a step before it publishes; the recorder receives all topics.
_AWAITED = {
    "simulator": (_TWIST, _ENABLE),
    "linescan_odometry": _LINES,
    "brake_assist": (_TWIST, "/imu", "/wheel_states", "/brake/pedal"),
}

_Recorded = Mapping[str, tuple[str, Sequence[bytes]]]


def recorded(folder: Path) -> _Recorded:
    """Return type and messages of each topic with a message in every step, keyed by topic."""
    found: dict[str, tuple[str, list[bytes]]] = {}
    for message in bag_messages(open_bag(folder)):
        entry = found.setdefault(message.channel.topic, (message.channel.type_name, []))
        entry[1].append(message.data)
    steps = len(found[_ENABLE][1])
    del found["/tf"]  # written by the recorder; the messages do not exist in the wheels of ROS
    return {topic: entry for topic, entry in found.items() if len(entry[1]) == steps}


def node(name: str, messages: _Recorded, elapsed: Any) -> None:
    """Exchange the messages of one node in this process; the simulator's time is sent [s]."""
    import rclpy
    from rclpy.node import Node
    from rclpy.serialization import deserialize_message

    from omni_ros.messages import message_class
    from omni_ros.process import Spinner, StopFlag
    from omni_ros.qos import advertise, subscribe

    rclpy.init()
    own = Node(name)
    counts = dict.fromkeys(_AWAITED.get(name, messages), 0)

    def count(topic: str, _: object) -> None:
        counts[topic] += 1

    for topic in counts:
        raw = topic in _LINES or name == "recorder"
        kind = Topic(topic, messages[topic][0], _publisher(topic))
        subscribe(own, kind, partial(count, topic), raw=raw)
    published = [topic for topic in messages if _publisher(topic) == name]
    publishers = {
        topic: advertise(own, Topic(topic, messages[topic][0], name)) for topic in published
    }
    sent = {
        topic: [deserialize_message(one, message_class(messages[topic][0])) for one in row]
        for topic, (_, row) in messages.items()
        if topic in publishers
    }
    spinner = Spinner(own, StopFlag())
    for topic, publisher in publishers.items():
        listeners = 1 + sum(topic in awaited for awaited in _AWAITED.values())
        while publisher.get_subscription_count() < listeners:
            time.sleep(0.005)
    steps = len(messages[_ENABLE][1])
    begun = time.perf_counter()
    for step in range(steps):
        awaited = step if name == "simulator" else step + 1
        while min(counts.values()) < awaited:
            spinner.spin_once()
        for topic, publisher in publishers.items():
            publisher.publish(sent[topic][step])
    while min(counts.values()) < steps:
        spinner.spin_once()
    if name == "simulator":
        elapsed.put(time.perf_counter() - begun)
    time.sleep(0.5)  # until all messages are received
    os._exit(0)


def _publisher(topic: str) -> str:
    """Return the name of the node that publishes a topic."""
    if topic in _OF_ASSISTANT:
        return "brake_assist"
    return "linescan_odometry" if topic in _OF_ODOMETRY else "simulator"


def empty_graph(messages: _Recorded) -> float:
    """Return the time in which empty nodes exchange the messages of all steps [s]."""
    context = multiprocessing.get_context("fork")
    elapsed = context.Queue()
    with reserved_domain() as domain:
        os.environ.update(node_environment(domain))
        processes = [
            context.Process(target=node, args=(name, messages, elapsed))
            for name in ("recorder", *_AWAITED)
        ]
        for process in processes:
            process.start()
        seconds: float = elapsed.get(timeout=30.0)
        for process in processes:
            process.join()
    return seconds


def main() -> None:
    """Run graph, single process and empty graph in turn, and print the time of a step of each."""
    options = output.options(__doc__, repeats=5)
    configuration = output.load("straight_line", "assisted")
    process_factor(configuration)  # loads the kernels
    rows = []
    for _ in range(options.repeats):
        with tempfile.TemporaryDirectory() as folder:
            run = run_variant(configuration, "assisted", Path(folder) / "assisted")
            (result,) = finish_runs([run])
            messages = recorded(result.folder)
        steps = len(messages[_ENABLE][1])
        duration = float(result.history.time[-1])
        graph = duration / result.history.real_time_factor
        process = duration / process_factor(configuration)
        rows.append([1e3 * time / steps for time in (graph, process, empty_graph(messages))])
    metrics: output.Metrics = {}
    for name, times in zip(("graph", "process", "empty"), zip(*rows, strict=True), strict=True):
        metrics[f"step.{name}"] = statistics.median(times), "ms"
    ratios = [[graph / one, (one + empty) / one] for graph, one, empty in rows]
    for name, values in zip(("graph", "floor"), zip(*ratios, strict=True), strict=True):
        metrics[f"time_over_one_process.{name}"] = statistics.median(values), "1"
    output.publish("graph_floor", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
