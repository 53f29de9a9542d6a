"""Replay in one process: the nodes' cores process recorded inputs, without topics."""

from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from linescan_odometry import batching, registry
from linescan_odometry.messages import flow_of, line_batch_of
from linescan_odometry.sideslip.meter import SideslipMonitor, angles
from omni_brake_assist import brake_assist, step_pairing
from omni_brake_assist.messages import imu_reading_of, wheel_speeds_of
from omni_bringup.replay import lines as replay_lines
from omni_bringup.replay import plan as plans
from omni_loop.experiment import ExperimentConfiguration
from omni_platform import topics
from omni_platform.signals import Flow, LineBatch, TwistSample
from omni_recording import metadata, write
from omni_recording.decode import decoded_messages
from omni_recording.definitions import find_message_definition
from omni_recording.error import BagError
from omni_recording.folder import Bag
from omni_ros import messages

Result = tuple[str, int, Any]  # topic, stamp [ns], message


def replay_offline(bag: Bag, plan: plans.ReplayPlan, folder: Path) -> None:
    """Run the cores of a plan's nodes and record their outputs.

    Args:
        bag: recording to replay.
        plan: nodes and topics of the replay.
        folder: rosbag2 folder to be created for the results.

    Raises:
        BagError: the recording or a message in it cannot be read.
        RecordingError: the results cannot be written.
    """
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    cores = _Cores(plan)
    qos = metadata.RecordedQos(replay_lines.DEPTH)
    outputs = [
        metadata.RecordedTopic(topic, find_message_definition(kind), qos)
        for topic, kind in plan.outputs.items()
    ]
    with write.Rosbag2Writer(folder, outputs) as writer:
        for recorded, message in decoded_messages(bag, plan.inputs, ordered=True):
            topic = recorded.channel.topic
            try:
                results = cores.take(topic, message)
            except ValueError as error:
                raise BagError(bag.path, f"{topic} at {recorded.log_ns} ns: {error}") from None
            for output, stamp_ns, answer in results:
                data = bytes(store.serialize_cdr(answer, plan.outputs[output]))
                writer.write(output, stamp_ns, data)


class _Cores:
    """Cores of the nodes, with the function that processes each topic's messages."""

    def __init__(self, plan: plans.ReplayPlan) -> None:
        configuration = plan.configuration
        self._takers: dict[str, Callable[[Any], Iterable[Result]]] = {}
        self._brakes: _Brakes | None = None
        if plans.BRAKE_ASSIST in plan.nodes:
            self._brakes = _Brakes(configuration)
            self._takers[topics.WHEEL_STATES.path] = self._brakes.take_wheel_states
            self._takers[topics.IMU.path] = self._brakes.take_imu
            self._takers[topics.PEDAL.path] = self._brakes.take_pedal
            self._takers[plans.feedback_topic(configuration).path] = self._brakes.take_twist
        if plans.ODOMETRY in plan.nodes:
            odometry = _Odometry(configuration)
            for sensor in configuration.odometry.sensors:
                self._takers[topics.lines(sensor).path] = odometry.taker(sensor, line_batch_of)
            for sensor in configuration.odometry.flow_sensors:
                self._takers[topics.flow(sensor).path] = odometry.taker(sensor, flow_of)

    def take(self, topic: str, message: Any) -> list[Result]:
        results = list(self._takers[topic](message))
        # The output of one core may be an input of another.
        for result in list(results):
            if result[0] in self._takers:
                results += self._takers[result[0]](result[2])
        return results


class _Odometry:
    def __init__(self, configuration: ExperimentConfiguration) -> None:
        self._odometry = registry.make_odometry(configuration.own_odometry, configuration.odometry)
        self._has_wheels = bool(configuration.odometry.sideslip)
        self._sideslip = SideslipMonitor(configuration.odometry)
        self._collector = batching.BatchCollector.of(configuration.odometry)

    def taker(
        self, sensor: str, batch_of: Callable[[Any], LineBatch | Flow]
    ) -> Callable[[Any], Iterable[Result]]:
        return lambda message: self._take(sensor, batch_of(message))

    def _take(self, sensor: str, batch: LineBatch | Flow) -> Iterable[Result]:
        for batches in self._collector.add(sensor, batch):
            estimate = self._odometry.update(batches)
            stamp_ns = estimate.stamp_ns
            if self._has_wheels:
                sideslip = self._sideslip.measure(estimate)
                state = messages.joint_state(stamp_ns, list(sideslip), position=angles(sideslip))
                yield topics.SIDESLIP.path, stamp_ns, _with_arrays(state)
            answer = messages.planar_twist_with_covariance(
                stamp_ns, estimate.twist, estimate.covariance
            )
            yield topics.TWIST.path, stamp_ns, answer


class _Brakes:
    def __init__(self, configuration: ExperimentConfiguration) -> None:
        self._assist = brake_assist.BrakeAssist(configuration.brake_assist)
        self._wheels = tuple(configuration.brake_assist.wheels)
        limits = configuration.brake_assist
        self._pairing = step_pairing.StepPairing(
            fault_detection=limits.fault_detection,
            imu=configuration.imu.enabled,
            twist_period_ns=round(configuration.twist_period * 1e9),
        )

    def take_wheel_states(self, message: Any) -> Iterable[Result]:
        if self._assist.check_wheel_names(message.name) is not None:
            return ()
        speeds = wheel_speeds_of(message, self._wheels)
        if speeds is not None:
            self._pairing.take_wheels(speeds)
        return self._answer()

    def take_imu(self, message: Any) -> Iterable[Result]:
        self._pairing.take_imu(imu_reading_of(message))
        return self._answer()

    def take_pedal(self, message: Any) -> Iterable[Result]:
        pedal = float(message.position[0]) if len(message.position) else np.nan
        self._pairing.take_pedal(messages.to_nanoseconds(message.header.stamp), pedal)
        return self._answer()

    def take_twist(self, message: Any) -> Iterable[Result]:
        twist, covariance = messages.planar_twist_of(message)
        self._pairing.take_feedback(
            TwistSample(messages.to_nanoseconds(message.header.stamp), twist, covariance)
        )
        return self._answer()

    def _answer(self) -> Iterable[Result]:
        demand = self._pairing.next_demand()
        if demand is None:
            return
        decision = self._assist.update(demand)
        stamp_ns = decision.stamp_ns
        enable = messages.joint_state(stamp_ns, self._wheels, effort=decision.enable)
        error = messages.joint_state(stamp_ns, self._wheels, velocity=decision.error)
        yield topics.ENABLE.path, stamp_ns, _with_arrays(enable)
        yield topics.SLIDING.path, stamp_ns, _with_arrays(error)


def _with_arrays(message: Any) -> Any:
    """Return a JointState with NumPy arrays, which the serializer of rosbags requires."""
    fields = ("position", "velocity", "effort")
    arrays = {name: np.array(getattr(message, name), dtype=np.float64) for name in fields}
    return SimpleNamespace(header=message.header, name=list(message.name), **arrays)
