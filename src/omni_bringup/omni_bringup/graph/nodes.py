"""The nodes of a run, their parameters, and the topics that are recorded."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_brake_assist.configuration import LAWS
from omni_bringup.graph import hardware, process_group
from omni_loop.experiment import ExperimentConfiguration
from omni_platform import topics
from omni_platform.configuration import Configuration
from omni_ros.flat_parameters import flatten
from omni_sim.configuration import SimulatorConfiguration

_SHARED = (topics.CLOCK.path, topics.DIAGNOSTICS.path)
_IMU = "imu"  # frame ID of the IMU's messages
_RECORDER = 1  # subscriptions that the recorder adds to every topic


def recorded_topics(configuration: ExperimentConfiguration) -> dict[str, str]:
    """Return the message type of every topic of the graph, by absolute name."""
    found = [
        topics.CLOCK,
        topics.DIAGNOSTICS,
        topics.WHEEL_STATES,
        topics.PEDAL,
        topics.ENABLE,
        topics.SLIDING,
        topics.TEST_RATIOS,
        topics.COMMAND,
        topics.ODOM,
        topics.TWIST,
        topics.VELOCITY_SENSOR,
        topics.GROUND_TRUTH,
        topics.MARKERS,
    ]
    found += [topics.IMU] if configuration.imu.enabled else []
    found += [topics.SIDESLIP] if configuration.odometry.sideslip else []
    for sensor in configuration.sensors:
        found += [topics.lines(sensor), topics.camera_info(sensor)]
    found += map(topics.flow, configuration.flow_sensors)
    return {topic.path: topic.type for topic in found}


@dataclasses.dataclass(frozen=True)
class RecordingOptions:
    """How a run is recorded.

    Attributes:
        compression: compression of the chunks: none, zstd or lz4.
        synchronize: wait for the disk at every flush, so that a power cut loses no flushed data.
    """

    compression: str = "none"
    synchronize: bool = False


def recorder(
    configuration: ExperimentConfiguration,
    folder: Path,
    scratch: Path,
    options: RecordingOptions = RecordingOptions(),
    chosen: Mapping[str, str] | None = None,
) -> process_group.NodeProcess:
    """Return the process that records into a rosbag2 folder: every topic, or only `chosen`."""
    chosen = recorded_topics(configuration) if chosen is None else chosen
    parameters: dict[str, Any] = {
        "folder": str(folder),
        "topics": [_relative(topic) for topic in chosen],
        "types": list(chosen.values()),
        "compression": options.compression,
        "synchronize": options.synchronize,
    }
    if topics.GROUND_TRUTH.path in chosen:
        mounts = {**configuration.sensors, **configuration.flow_sensors}
        poses = {name: (mount.x, mount.y, mount.heading) for name, mount in mounts.items()}
        imu = configuration.imu
        poses |= {_IMU: (imu.x, imu.y, 0.0)} if imu.enabled else {}
        parameters["transforms_from"] = topics.GROUND_TRUTH.name
        parameters["fixed_frames"] = list(poses)
        parameters["fixed_poses"] = [float(value) for pose in poses.values() for value in pose]
    infos = map(topics.camera_info, configuration.sensors)
    latched = [info.name for info in infos if info.path in chosen]
    if latched:  # an empty list has no type in a parameter file
        parameters["latched_topics"] = latched
    return _node("recorder", "omni_recording", "recorder", parameters, scratch)


def odometry(
    configuration: ExperimentConfiguration, scratch: Path, *, lockstep: bool, listeners: int = 0
) -> process_group.NodeProcess:
    """Return the process of the line-scan odometry, which waits for its `listeners`."""
    listeners = listeners or _RECORDER + 1 + configuration.uses_lines
    parameters = _flat(configuration.odometry) | _timing(lockstep) | _listeners(listeners)
    if configuration.own_odometry:
        parameters["own_odometry"] = configuration.own_odometry
    return _node(
        "linescan_odometry",
        "linescan_odometry",
        "odometry",
        parameters,
        scratch,
        own_code=bool(configuration.own_odometry),
    )


def brake_assist(
    configuration: ExperimentConfiguration,
    scratch: Path,
    *,
    lockstep: bool,
    listeners: int = _RECORDER,
) -> process_group.NodeProcess:
    """Return the process of the brake assistant."""
    parameters = (
        _flat(configuration.brake_assist)
        | _timing(lockstep)
        | _listeners(listeners)
        | {"lockstep": lockstep}
        | {"await_imu": configuration.imu.enabled, "twist_period": configuration.twist_period}
    )
    remaps = []
    if not configuration.uses_lines:
        remaps = ["-r", f"{topics.TWIST.name}:={topics.VELOCITY_SENSOR.name}"]
    return _node(
        "brake_assist",
        "omni_brake_assist",
        "brake_assist",
        parameters,
        scratch,
        remaps,
        own_code=configuration.brake_assist.law not in LAWS,
    )


def simulator(
    configuration: ExperimentConfiguration,
    scratch: Path,
    *,
    lockstep: bool,
    driven: bool = False,
    lines_recorded: bool = True,
    listeners: int = _RECORDER + 1,
) -> process_group.NodeProcess:
    """Return the process of the simulator, scripted or `driven` by the node of the driver."""
    parameters = _flat(configuration, SimulatorConfiguration) | _listeners(listeners)
    parameters |= {
        "mode": "lockstep" if lockstep else "real_time",
        "driver": "topics" if driven else "scripted",
        "lines_recorded": lines_recorded,
        "await_odometry": not configuration.uses_lines and configuration.simulation.render_lines,
    }
    # The driver's node selects between its page and a teleoperation node on cmd_vel.
    remaps = ["-r", "cmd_vel:=driver/cmd_vel"] if driven else []
    return _node("simulator", "omni_sim", "simulator", parameters, scratch, remaps)


def driver(
    configuration: ExperimentConfiguration, scratch: Path, options: Mapping[str, Any]
) -> process_group.NodeProcess:
    """Return the process of the driver's node: page and `cmd_vel`; `options` are parameters."""
    wheels = flatten(configuration.brake_assist)
    ground = _flat(configuration.ground)
    shown = {key: value for key, value in wheels.items() if key.startswith("wheels.")}
    shown |= {key: value for key, value in ground.items() if key.startswith("patches.")}
    parameters = shown | {
        "chassis_length": configuration.vehicle.chassis_length,
        "chassis_width": configuration.vehicle.chassis_width,
        "assist": configuration.brake_assist.enabled,
        **options,
    }
    return _node("driver", "omni_bringup", "driver", parameters, scratch)


def run_nodes(
    configuration: ExperimentConfiguration,
    folder: Path,
    scratch: Path,
    *,
    lockstep: bool,
    recording: RecordingOptions = RecordingOptions(),
) -> list[process_group.NodeProcess]:
    """Return the nodes of a scripted run, listeners first: from the recorder to the simulator.

    Args:
        configuration: the whole loop.
        folder: rosbag2 folder to record to.
        scratch: folder for the parameter files of the nodes.
        lockstep: bit-for-bit repeatable steps; False paces them to the wall clock.
        recording: options of the recording.
    """
    return [
        recorder(configuration, folder, scratch, recording),
        odometry(configuration, scratch, lockstep=lockstep),
        brake_assist(configuration, scratch, lockstep=lockstep),
        simulator(configuration, scratch, lockstep=lockstep),
    ]


def player(
    bag: Path,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    rate: float,
    scratch: Path,
) -> process_group.NodeProcess:
    """Return the process that publishes the recorded inputs and watches the outputs."""
    parameters = {
        "bag": str(bag),
        "inputs": list(inputs),
        "input_types": list(inputs.values()),
        "outputs": list(outputs),
        "output_types": list(outputs.values()),
        "rate": rate,
    }
    return _node("player", "omni_bringup", "player", parameters, scratch)


def _relative(topic: str) -> str:
    """Return a topic name relative to the namespace, absolute for shared topics."""
    return topic if topic in _SHARED else topic.removeprefix("/")


def _timing(lockstep: bool) -> dict[str, Any]:
    """Return the parameters of a node for lockstep (no periodic diagnostics) or simulated time."""
    return {"diagnostics_period": 0.0} if lockstep else {"use_sim_time": True}


def _listeners(count: int) -> dict[str, Any]:
    # A long timeout, because another node may have to compile kernels first.
    return {"subscribers": count, "match_timeout": 300.0}


def _flat(configuration: Configuration, part: type[Configuration] | None = None) -> dict[str, Any]:
    # An empty list has no type in a parameter file. Without an entry the declared default holds.
    flat = flatten(configuration, part=part)
    return {key: value for key, value in flat.items() if value != []}


def _node(
    name: str,
    package: str,
    executable: str,
    parameters: Mapping[str, Any],
    scratch: Path,
    remaps: list[str] | None = None,
    *,
    own_code: bool = False,
) -> process_group.NodeProcess:
    path = scratch / f"{name}.yaml"
    path.write_text(hardware.parameters_text(parameters), encoding="utf-8")
    arguments = ["--ros-args", "--params-file", str(path), *(remaps or [])]
    return process_group.NodeProcess(name, package, executable, arguments, own_code)
