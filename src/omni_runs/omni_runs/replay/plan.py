"""Inputs that a replay reads from a recording, and outputs that it computes."""

import dataclasses
from collections.abc import Mapping, Sequence

from omni_core import topics
from omni_core.configuration import ConfigurationError, check_choice
from omni_core.topics import Topic
from omni_recording.error import BagError
from omni_recording.folder import Bag, bag_summary
from omni_runs.experiment import CONFIGURATION, ExperimentConfiguration, recorded_experiment

ODOMETRY, BRAKE_ASSIST = "linescan_odometry", "brake_assist"
NODES = (ODOMETRY, BRAKE_ASSIST)


@dataclasses.dataclass(frozen=True)
class ReplayPlan:
    """Nodes that a replay runs, and the topics that it reads and publishes.

    Attributes:
        configuration: configuration of the nodes.
        nodes: names of the nodes to run, from `NODES`.
        inputs: message types of the topics that are read from the recording, keyed by topic.
        outputs: message types of the topics that the nodes publish, keyed by topic.
    """

    configuration: ExperimentConfiguration
    nodes: tuple[str, ...]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]


def replay_plan(configuration: ExperimentConfiguration, nodes: Sequence[str]) -> ReplayPlan:
    """Return the topics that a replay of these nodes reads and publishes.

    Raises:
        ConfigurationError: a node is unknown or named twice.
    """
    for node in nodes:
        check_choice("--nodes", node, NODES)
    if len(set(nodes)) != len(nodes):
        raise ConfigurationError("--nodes", "names a node twice")
    inputs: list[Topic] = []
    outputs: list[Topic] = []
    if ODOMETRY in nodes:
        inputs += map(topics.lines, configuration.odometry.sensors)
        inputs += map(topics.flow, configuration.odometry.flow_sensors)
        inputs += [topics.STEERING] if configuration.odometry.is_steered else []
        outputs.append(topics.TWIST)
        outputs += [topics.SIDESLIP] if configuration.odometry.sideslip else []
    if BRAKE_ASSIST in nodes:
        inputs += [topics.WHEEL_STATES, feedback_topic(configuration), topics.PEDAL]
        if configuration.brake_assist.fault_detection and configuration.imu.enabled:
            inputs.append(topics.IMU)
        outputs += [one for one in topics.published_by(BRAKE_ASSIST) if one.is_plain]
    # The output of one node may be the input of another; it is then not read from the recording.
    return ReplayPlan(
        configuration,
        tuple(nodes),
        {topic.path: topic.type for topic in inputs if topic not in outputs},
        {topic.path: topic.type for topic in outputs},
    )


def feedback_topic(configuration: ExperimentConfiguration) -> Topic:
    """Return the topic on which the brake assistant receives the twist."""
    return topics.TWIST if configuration.uses_lines else topics.VELOCITY_SENSOR


def check_inputs(bag: Bag, plan: ReplayPlan) -> dict[str, int]:
    """Check that a recording contains the inputs of a replay.

    Returns:
        Number of recorded messages, keyed by topic.

    Raises:
        BagError: topics have no messages (the error lists all of them), or a topic has a wrong
            type or encoding.
    """
    summary = bag_summary(bag)
    missing = [topic for topic in plan.inputs if not summary.counts.get(topic)]
    if missing:
        raise BagError(bag.path, f"contains no message on {', '.join(missing)}")
    for channel in summary.channels:
        needed = plan.inputs.get(channel.topic, channel.type_name)
        if channel.type_name != needed:
            raise BagError(
                bag.path, f"{channel.topic} is of type {channel.type_name}, must be {needed}"
            )
        if channel.topic in plan.inputs and channel.encoding != "cdr":
            raise BagError(bag.path, f"{channel.topic} is not encoded as cdr")
    return summary.counts


def recorded_configuration(
    bag: Bag,
    overrides: Sequence[str] = (),
    option: str = "BAG",
    remedy: str = "give a recording of ./omni run, drive or lines import",
) -> ExperimentConfiguration:
    """Return the configuration that is stored with a recording.

    Args:
        bag: the recording.
        overrides: ``dotted.key=value`` texts.
        option: option that the error message names.
        remedy: advice at the end of the message.

    Raises:
        ConfigurationError: no configuration is stored, or a key or value is invalid.
    """
    path = (bag.path if bag.path.is_dir() else bag.path.parent) / CONFIGURATION
    if not path.is_file():
        words = f"there is no {CONFIGURATION} next to the recording; {remedy}"
        raise ConfigurationError(option, words)
    return recorded_experiment(path, overrides)
