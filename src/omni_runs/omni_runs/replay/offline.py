"""Replay in one process, in which the nodes' cores process recorded inputs without topics."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import starmap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from linescan_odometry.odometry_node import estimate_messages
from linescan_odometry.port import OdometryPort
from omni_brake_assist.brake_assist import BrakeAssist
from omni_brake_assist.brake_assist_node import Sample, StepPairing, decision_messages
from omni_core import topics
from omni_core.signals import Flow, LineBatch, WheelSample
from omni_recording import metadata, write
from omni_recording.decode import decoded_messages
from omni_recording.definitions import find_message_definition
from omni_recording.error import BagError
from omni_recording.folder import Bag
from omni_ros import messages
from omni_ros.line_images import line_batch_of
from omni_runs.experiment import ExperimentConfiguration
from omni_runs.replay import lines as replay_lines
from omni_runs.replay import plan as plans

Messages = Mapping[str, Any]  # by topic name


def replay_offline(bag: Bag, plan: plans.ReplayPlan, folder: Path) -> None:
    """Run the cores of a plan's nodes and record their outputs.

    Args:
        bag: recording to replay.
        plan: nodes and topics of the replay.
        folder: empty folder for the rosbag2 recording of the results.

    Raises:
        BagError: the recording or a message in it cannot be read.
        RecordingError: the results cannot be written.
    """
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    cores = _cores(plan)
    qos = metadata.RecordedQos(replay_lines.DEPTH)
    outputs = [
        metadata.RecordedTopic(topic, find_message_definition(kind), qos)
        for topic, kind in plan.outputs.items()
    ]
    with write.Rosbag2Writer(folder, outputs) as writer:
        for recorded, message in decoded_messages(bag, plan.inputs, ordered=True):
            topic = recorded.channel.topic
            try:
                results = list(_take(cores, topic, message))
            except ValueError as error:
                raise BagError(bag.path, f"{topic} at {recorded.log_ns} ns: {error}") from None
            for output, answer in results:
                data = bytes(store.serialize_cdr(_with_arrays(answer), plan.outputs[output]))
                writer.write(output, messages.to_nanoseconds(answer.header.stamp), data)


Takers = Mapping[str, Callable[[Any], Iterable[Messages]]]
"""Functions that process the messages of a topic, by topic."""


def _cores(plan: plans.ReplayPlan) -> Takers:
    """Return the functions with which the cores of the nodes take their inputs."""
    configuration = plan.configuration
    assistant = _assistant(configuration) if plans.BRAKE_ASSIST in plan.nodes else {}
    return assistant | (_odometry(configuration) if plans.ODOMETRY in plan.nodes else {})


def _take(cores: Takers, topic: str, message: Any) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of each output that a message causes."""
    for answers in cores[topic](message):
        for name, result in answers.items():
            output = f"/{name}"
            yield output, result
            if output in cores:  # this output is an input of another core
                yield from _take(cores, output, result)


def _odometry(configuration: ExperimentConfiguration) -> dict[str, Callable[[Any], Any]]:
    port = OdometryPort(configuration.own_odometry, configuration.odometry)

    def taker(sensor: str, batch_of: Callable[[Any], LineBatch | Flow]) -> Callable[[Any], Any]:
        return lambda message: starmap(estimate_messages, port.take(sensor, batch_of(message)))

    odometry = configuration.odometry
    lines = {topics.lines(name).path: taker(name, line_batch_of) for name in odometry.sensors}
    if odometry.is_steered:

        def steer(message: Any) -> Any:
            angles = dict(zip(message.name, message.position, strict=False))
            stamp_ns = messages.to_nanoseconds(message.header.stamp)
            return starmap(estimate_messages, port.steer(stamp_ns, angles))

        lines[topics.STEERING.path] = steer
    return lines | {topics.flow(s).path: taker(s, messages.flow_of) for s in odometry.flow_sensors}


def _assistant(configuration: ExperimentConfiguration) -> dict[str, Callable[[Any], Any]]:
    assist = BrakeAssist(configuration.brake_assist)
    wheels = tuple(configuration.brake_assist.wheels)
    pairing = StepPairing(
        fault_detection=configuration.brake_assist.fault_detection,
        imu=configuration.imu.enabled,
        twist_period_ns=round(configuration.twist_period * 1e9),
        imu_period_ns=configuration.imu_period_ns,
        imu_timeout=configuration.brake_assist.feedback_timeout,
    )

    def taker(sample_of: Callable[[Any], Sample | None]) -> Callable[[Any], Iterable[Messages]]:
        def take(message: Any) -> Iterable[Messages]:
            sample = sample_of(message)
            demand = pairing.take(sample) if sample is not None else None
            return [decision_messages(assist.update(demand), wheels)] if demand else ()

        return take

    def checked_speeds_of(message: Any) -> WheelSample | None:
        fault = assist.check_wheel_names(message.name)
        return messages.wheel_speeds_of(message, wheels) if fault is None else None

    return {
        topics.WHEEL_STATES.path: taker(checked_speeds_of),
        topics.IMU.path: taker(messages.imu_reading_of),
        topics.PEDAL.path: taker(messages.pedal_of),
        plans.feedback_topic(configuration).path: taker(messages.twist_of),
    }


def _with_arrays(message: Any) -> Any:
    """Return a JointState with NumPy arrays, which the serializer of rosbags requires."""
    if not hasattr(message, "effort"):
        return message
    fields = ("position", "velocity", "effort")
    arrays = {name: np.array(getattr(message, name), dtype=np.float64) for name in fields}
    return SimpleNamespace(header=message.header, name=list(message.name), **arrays)
