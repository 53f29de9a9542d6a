"""A node in the process of the tests, next to the nodes under test."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from omni_ros.environment import node_environment
from omni_runs.graph.process_group import NodeProcess, ProcessGroup


@contextmanager
def node_process(domain: int, *words: str) -> Iterator[None]:
    """Run ``python WORDS`` in a ROS domain; at the end, terminate it and require success."""
    process = subprocess.Popen(
        [sys.executable, *words], env=node_environment(domain), stdin=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        process.terminate()
        assert process.wait(20.0) == 0


@contextmanager
def vehicle_node(domain: int, name: str, *words: str) -> Iterator[None]:
    """Run a node of `omni_vehicle` as `node_process` does, but as a fork that imports nothing."""
    with ProcessGroup(node_environment(domain)) as group:
        group.start(NodeProcess(name, "omni_vehicle", name, ["--ros-args", *words]))
        yield
    group.raise_if_failed()


class Bystander:
    """A node in a ROS domain of other processes; derived classes publish and subscribe."""

    round_timeout = 30.0  # [s] only ends a test that hangs
    pause = 0.02  # [s] at most, between two looks at a condition
    # [s] until a request is sent again: a service that has not discovered the client's subscription
    # within 0.1 s drops the answer.
    repetition = 5.0

    def __init__(self, name: str, domain: int) -> None:
        self._context = Context()
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def description(self) -> str:
        """Return a text that explains why a condition did not become true."""
        raise NotImplementedError

    def wait(self, condition: Callable[[], object]) -> None:
        """Receive messages until the condition is true."""
        deadline = time.monotonic() + self.round_timeout
        while not condition():
            assert time.monotonic() < deadline, f"timed out; {self.description()}"
            self._executor.spin_once(timeout_sec=self.pause)

    def catch_up(self, state: Callable[[], object]) -> None:
        """Receive the messages that wait in the queues, until 50 spins do not change a state."""
        seen, unchanged = state(), 0
        while unchanged < 50:
            self._executor.spin_once(timeout_sec=0.005)  # runs one callback
            unchanged = unchanged + 1 if state() == seen else 0
            seen = state()

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Return the answer of a service."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready)
        answers, due = [client.call_async(request)], time.monotonic() + self.repetition

        def answered() -> bool:
            nonlocal due
            if time.monotonic() > due:
                answers.append(client.call_async(request))
                due = time.monotonic() + self.repetition
            return any(answer.done() for answer in answers)

        self.wait(answered)
        return next(answer.result() for answer in answers if answer.done())

    def close(self) -> None:
        self.node.destroy_node()
        self._context.try_shutdown()
