"""Measure the real-time latency of the brake assistant's node from a twist to the enables.

The benchmark publishes pedal, twist, wheel speeds and IMU of stops from 10 m/s at 100 Hz to a
separate node. It measures the wall-clock time from the publication of a twist until the enables
with its stamp are received, over two hops of DDS and under the load of this machine. If the
benchmark is started by ``chrt -f 50``, the node has real-time priority too.
"""

import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import output
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

from omni_core import topics
from omni_core.quantities import FloatArray
from omni_ros import messages
from omni_ros.environment import node_environment
from omni_ros.qos import RECENT, advertise, subscribe
from omni_runs.compiled import run_fast_loop
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup
from omni_runs.history import FastRun

PERIOD = 0.01  # [s]
SPEED_UP = 3.0  # [s] duration of the acceleration between two stops


class Vehicle(Node):
    """Publishes the signals of a vehicle, and measures when the assistant answers with enables.

    Args:
        wheels: names of the wheels.
        frames: signals of K steps, shape (K, 6 + N): brake demand [1], body twist (3) [m/s, m/s,
            rad/s], wheel speeds (N) [rad/s], specific force along x and y (2) [m/s^2].
    """

    def __init__(self, wheels: tuple[str, ...], frames: FloatArray) -> None:
        super().__init__("vehicle")
        self._wheels, self._frames = wheels, frames
        self.pedal = advertise(self, topics.PEDAL)
        self._states = advertise(self, topics.WHEEL_STATES)
        self._imu = advertise(self, topics.IMU)
        self._twist = advertise(self, topics.TWIST)
        subscribe(self, topics.ENABLE, self._on_enable, RECENT)
        self._due: dict[int, float] = {}
        self.answers: list[float] = []
        self.released = 0
        self._stamp_ns = 0

    def steps(self) -> Iterator[None]:
        """Publish the signals of one step per iteration, one stop after the other."""
        covariance = 1e-6 * np.eye(3)
        for frame in itertools.cycle(self._frames):
            self._stamp_ns += round(PERIOD * 1e9)
            stamp_ns, twist = self._stamp_ns, frame[1:4]
            imu = messages.stamped(Imu, stamp_ns, "imu")
            imu.angular_velocity.z = float(twist[2])
            imu.linear_acceleration.x, imu.linear_acceleration.y = frame[-2:].tolist()
            self.pedal.publish(messages.joint_state(stamp_ns, ("brake_pedal",), position=frame[:1]))
            self._states.publish(messages.joint_state(stamp_ns, self._wheels, velocity=frame[4:-2]))
            self._imu.publish(imu)
            message = messages.planar_twist_with_covariance(stamp_ns, twist, covariance)
            self._due[stamp_ns] = time.perf_counter()
            self._twist.publish(message)
            yield

    def _on_enable(self, message: JointState) -> None:
        asked = self._due.pop(messages.to_nanoseconds(message.header.stamp), None)
        if asked is not None:  # other enables come from a watchdog
            self.answers.append(time.perf_counter() - asked)
            self.released += min(message.effort) < 1.0

    def missing(self) -> int:
        """Return the number of twists without an answer."""
        return len(self._due)


def main() -> None:
    """Measure the latency and print its statistics."""
    options = output.options(__doc__, minutes=1.0)
    configuration = output.load("straight_line", "assisted")
    frames = stop_and_go(run_fast_loop(output.load("straight_line", "assisted", *output.BLIND)))
    with (
        tempfile.TemporaryDirectory() as scratch,
        reserved_domain() as domain,
        ProcessGroup(node_environment(domain)) as group,
    ):
        group.start(graph.Nodes(configuration, Path(scratch)).brake_assist(listeners=0))
        rclpy.init(domain_id=domain)
        vehicle = Vehicle(tuple(configuration.vehicle.wheels), frames)
        drive(vehicle, 60.0 * options.minutes)
        rclpy.try_shutdown()
    times = np.array(vehicle.answers)
    late = 0.05  # [s], enable_timeout, after which the valves open by themselves
    metrics: output.Metrics = {
        "answers.all": (len(times), "1"),
        "answers.missing": (vehicle.missing(), "1"),
        "answers.late": (int(np.sum(times > late)), "1"),
        "answers.releasing": (vehicle.released, "1"),
    }
    for name, share in (("p50", 50.0), ("p99", 99.0), ("p99_9", 99.9), ("longest", 100.0)):
        metrics[f"answer_time_{name}.all"] = 1e3 * float(np.percentile(times, share)), "ms"
    output.publish("assistant_answers", metrics, as_json=options.json)


def stop_and_go(run: FastRun) -> FloatArray:
    """Return the frames of a stop and of an acceleration to the initial speed, as in `Vehicle`."""
    moving = np.column_stack([run.twist, run.wheel_speed])
    share = np.arange(0.0, 1.0, PERIOD / SPEED_UP)[:, np.newaxis]
    moving = np.vstack([moving, moving[-1] + share * (moving[0] - moving[-1])])
    pedal = np.concatenate([run.pedal, np.zeros(len(share))])
    force = np.diff(moving[:, :2], axis=0, prepend=moving[-1:, :2]) / PERIOD
    return np.column_stack([pedal, moving, force])


def drive(vehicle: Vehicle, duration: float) -> None:
    """Publish one step of signals every `PERIOD` for a duration [s], and receive the answers."""
    executor = EventsExecutor()
    executor.add_node(vehicle)
    while (
        vehicle.pedal.get_subscription_count() < 1 or vehicle.count_publishers(topics.IMU.name) < 1
    ):
        executor.spin_once(timeout_sec=0.05)
    end = time.monotonic() + duration
    due = time.monotonic() + 1.0  # time for the discovery of all topics
    steps = vehicle.steps()
    while time.monotonic() < end:
        wait = due - time.monotonic()
        if wait > 0.0:
            executor.spin_once(timeout_sec=wait)
            continue
        due += PERIOD
        next(steps)
    for _ in range(100):
        executor.spin_once(timeout_sec=PERIOD)


if __name__ == "__main__":
    main()
