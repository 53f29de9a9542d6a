"""What a replay of nodes takes from a recording and what it makes anew."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from omni_analysis.loop.experiment import (
    ExperimentConfiguration,
    ExperimentLibrary,
    recorded_experiment,
)
from omni_bringup.graph.run_folder import CONFIGURATION
from omni_platform.configuration import ConfigurationError, did_you_mean
from omni_recording.error import BagError
from omni_recording.folder import Bag, bag_summary

ODOMETRY, BRAKE_ASSIST = "linescan_odometry", "brake_assist"
NODES = (ODOMETRY, BRAKE_ASSIST)

_JOINTS = "sensor_msgs/msg/JointState"
_TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
_LARGEST_CONFIGURATION = 1 << 22  # [B]


@dataclasses.dataclass(frozen=True)
class ReplayPlan:
    """Topics of a replay.

    Attributes:
        configuration: of the nodes.
        nodes: those that run, some of `NODES`.
        inputs: type by topic of what comes from the recording.
        outputs: type by topic of what the nodes answer.
    """

    configuration: ExperimentConfiguration
    nodes: tuple[str, ...]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]


def replay_plan(configuration: ExperimentConfiguration, nodes: Sequence[str]) -> ReplayPlan:
    """Return the topics that a replay of these nodes reads and writes.

    Raises:
        ConfigurationError: a node is unknown or named twice.
    """
    for node in nodes:
        if node not in NODES:
            hint = did_you_mean(node, NODES)
            raise ConfigurationError("--nodes", f"{node!r} is not one of {', '.join(NODES)}{hint}")
    if len(set(nodes)) != len(nodes):
        raise ConfigurationError("--nodes", "names a node twice")
    inputs: dict[str, str] = {}
    outputs: dict[str, str] = {}
    if ODOMETRY in nodes:
        for sensor in configuration.odometry.sensors:
            inputs[lines_topic(sensor)] = "sensor_msgs/msg/Image"
        for sensor in configuration.odometry.flow_sensors:
            inputs[flow_topic(sensor)] = _TWIST
        outputs["/odometry/twist"] = _TWIST
        if configuration.odometry.sideslip:
            outputs["/odometry/sideslip"] = _JOINTS
    if BRAKE_ASSIST in nodes:
        inputs |= {"/wheel_states": _JOINTS, feedback_topic(configuration): _TWIST}
        inputs["/brake/pedal"] = _JOINTS
        if configuration.brake_assist.second_opinion and configuration.imu.enabled:
            inputs["/imu"] = "sensor_msgs/msg/Imu"
        outputs |= {"/brake/enable": _JOINTS, "/brake_assist/error": _JOINTS}
    # What one node answers, the other hears from it and not from the recording.
    inputs = {topic: kind for topic, kind in inputs.items() if topic not in outputs}
    return ReplayPlan(configuration, tuple(nodes), inputs, outputs)


def lines_topic(sensor: str) -> str:
    """Return the topic of a camera's lines."""
    return f"/line_scan/{sensor}/lines"


def flow_topic(sensor: str) -> str:
    """Return the topic of what a flow sensor measures."""
    return f"/flow/{sensor}/twist"


def feedback_topic(configuration: ExperimentConfiguration) -> str:
    """Return the topic that the brake assistant listens to for the twist."""
    return "/odometry/twist" if configuration.hears_lines else "/velocity_sensor/twist"


def check_inputs(bag: Bag, plan: ReplayPlan) -> dict[str, int]:
    """See that a recording holds what a replay needs, and return all its counts by topic.

    Raises:
        BagError: a topic is missing, empty or of another type; names all that are missing.
    """
    summary = bag_summary(bag)
    missing = [topic for topic in plan.inputs if not summary.counts.get(topic)]
    if missing:
        raise BagError(bag.path, f"holds no message on {', '.join(missing)}")
    for channel in summary.channels:
        needed = plan.inputs.get(channel.topic, channel.type_name)
        if channel.type_name != needed:
            raise BagError(
                bag.path, f"{channel.topic} is of type {channel.type_name}, must be {needed}"
            )
        if channel.topic in plan.inputs and channel.encoding != "cdr":
            raise BagError(bag.path, f"{channel.topic} is not encoded as cdr")
    return summary.counts


def replay_configuration(
    bag: Bag, library: ExperimentLibrary, experiment: str | None, overrides: Sequence[str]
) -> ExperimentConfiguration:
    """Return the configuration for a replay.

    Args:
        bag: the recording; the configuration that lies beside it is used.
        library: of the experiments.
        experiment: take the last variant of this one instead; None for that of the recording.
        overrides: ``dotted.key=value`` texts.

    Raises:
        ConfigurationError: there is none, or a key or value does not fit.
    """
    if experiment is not None:
        return library.load(experiment, library.variants(experiment)[-1], overrides)
    remedy = "name an experiment whose sensors and wheels are those of the recording"
    return recorded_configuration(bag, overrides, "--experiment", remedy)


def recorded_configuration(
    bag: Bag, overrides: Sequence[str], option: str, remedy: str
) -> ExperimentConfiguration:
    """Return the configuration that lies beside a recording.

    Args:
        bag: the recording.
        overrides: ``dotted.key=value`` texts.
        option: that stands in for it where there is none.
        remedy: what to do with the option, in words.

    Raises:
        ConfigurationError: there is none, or a key or value does not fit.
    """
    path = (bag.path if bag.path.is_dir() else bag.path.parent) / CONFIGURATION
    if not path.is_file():
        words = f"there is no {CONFIGURATION} beside the recording; {remedy}"
        raise ConfigurationError(option, words)
    try:
        if path.stat().st_size > _LARGEST_CONFIGURATION:
            raise ConfigurationError(str(path), f"is larger than {_LARGEST_CONFIGURATION} bytes")
        return recorded_experiment(path.read_text(encoding="utf-8"), overrides)
    except OSError as error:
        raise ConfigurationError(str(path), f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigurationError(str(path), "is not text") from None


def node_listeners(plan: ReplayPlan, node: str) -> int:
    """Return how many will listen to each output of a node: recorder, player, other nodes."""
    hears_odometry = BRAKE_ASSIST in plan.nodes and (
        feedback_topic(plan.configuration) == "/odometry/twist"
    )
    return 2 + (node == ODOMETRY and hears_odometry)
