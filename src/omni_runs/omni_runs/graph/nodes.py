"""Nodes of a run, their parameters, and the recorded topics."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

from omni_brake_assist.configuration import LAWS
from omni_core import topics
from omni_core.configuration import Configuration
from omni_core.quantities import SECOND_NS
from omni_recording.safe_yaml import in_yaml
from omni_ros.flat_parameters import flatten
from omni_runs.experiment import ExperimentConfiguration
from omni_runs.graph import process_group
from omni_sim.configuration import SimulatorConfiguration

_SHARED = (topics.CLOCK.path, topics.DIAGNOSTICS.path)
_IMU = "imu"  # frame ID of the IMU's messages
PLAIN: Mapping[str, Any] = {}  # parameters of the recorder
_RECORDER = 1  # number of subscriptions that the recorder adds to each topic


def recorded_topics(configuration: ExperimentConfiguration) -> dict[str, str]:
    """Return the message type of each recorded topic, keyed by the topic's absolute name."""
    found = [
        topic
        for topic in topics.DECLARED
        if topic.recorded and (not topic.needs or attrgetter(topic.needs)(configuration))
    ]
    for sensor in configuration.sensors:
        found += [topics.lines(sensor), topics.camera_info(sensor)]
    found += map(topics.flow, configuration.flow_sensors)
    return {topic.path: topic.type for topic in found}


@dataclasses.dataclass(frozen=True)
class Nodes:
    """Creates the processes of a run's nodes; each process reads its parameters from a file.

    Attributes:
        configuration: configuration of the whole loop.
        scratch: folder for the parameter files of the nodes.
        lockstep: whether the nodes wait for each other in each step, so that equal runs are
            bit-identical; if False, the steps follow the wall clock.
    """

    configuration: ExperimentConfiguration
    scratch: Path
    lockstep: bool = False

    def recorder(
        self,
        folder: Path,
        options: Mapping[str, Any] = PLAIN,
        chosen: Mapping[str, str] | None = None,
    ) -> process_group.NodeProcess:
        """Return the process that records all topics, or only `chosen`, into a rosbag2 folder.

        `options` are parameters of the recorder, such as the compression.
        """
        configuration = self.configuration
        chosen = recorded_topics(configuration) if chosen is None else chosen
        parameters: dict[str, Any] = {
            "folder": str(folder),
            "topics": [_relative(topic) for topic in chosen],
            "types": list(chosen.values()),
            **options,
        }
        if topics.GROUND_TRUTH.path in chosen:
            mounts = {**configuration.sensors, **configuration.flow_sensors}
            poses = {n: (m.x, m.y, m.heading) for n, m in mounts.items() if not m.carrier}
            imu = configuration.imu
            poses |= {_IMU: (imu.x, imu.y, 0.0)} if imu.enabled else {}
            parameters["transforms_from"] = topics.GROUND_TRUTH.name
            parameters["fixed_frames"] = list(poses)
            parameters["fixed_poses"] = [float(value) for pose in poses.values() for value in pose]
        infos = map(topics.camera_info, configuration.sensors)
        latched = [info.name for info in infos if info.path in chosen]
        if latched:  # an empty list has no type in a parameter file
            parameters["latched_topics"] = latched
        return self._node("recorder", "omni_recording", parameters)

    def odometry(self, listeners: int = 0) -> process_group.NodeProcess:
        """Return the process of the odometry node.

        Args:
            listeners: number of subscribers for which the node waits; 0 for as many as in a run.
        """
        listeners = listeners or _RECORDER + 1 + self.configuration.uses_lines
        parameters = values_of(self.configuration.odometry) | self._timing() | _listeners(listeners)
        own = self.configuration.own_odometry
        if own:
            parameters["own_odometry"] = own
        name = "linescan_odometry"
        return self._node(name, name, parameters, executable="odometry", own_code=bool(own))

    def brake_assist(self, listeners: int = _RECORDER + 1) -> process_group.NodeProcess:
        """Return the process of the brake assistant node.

        Args:
            listeners: number of subscribers for which the node waits.
        """
        configuration = self.configuration
        parameters = values_of(configuration.brake_assist) | self._timing() | _listeners(listeners)
        parameters.pop("imu_rotation_deg", None)  # the simulated IMU has the axes of base_link
        parameters |= {
            "await_imu": configuration.imu.enabled,
            "twist_period": configuration.twist_period,
            "imu_period": configuration.imu_period_ns / SECOND_NS,
        }
        remap = f"{topics.TWIST.name}:={topics.VELOCITY_SENSOR.name}"
        remaps = () if configuration.uses_lines else ("-r", remap)
        own = configuration.brake_assist.law not in LAWS
        return self._node("brake_assist", "omni_brake_assist", parameters, remaps, own_code=own)

    def simulator(
        self,
        *,
        driven: bool = False,
        lines_recorded: bool = True,
        listeners: int = _RECORDER + 1,
        own_assistant: bool = True,
    ) -> process_group.NodeProcess:
        """Return the process of the simulator node.

        Args:
            driven: whether the driver node sends the demands; otherwise they are scripted.
            lines_recorded: whether the recorder subscribes to the lines of the cameras.
            listeners: number of subscribers for which the node waits.
            own_assistant: whether the assistant subscribes to all inputs that it can use.
        """
        configuration = self.configuration
        parameters = values_of(configuration, SimulatorConfiguration) | _listeners(listeners)
        rendered = configuration.simulation.render_lines
        parameters |= {
            "mode": "lockstep" if self.lockstep else "real_time",
            "driver": "topics" if driven else "scripted",
            "lines_recorded": lines_recorded,
            "await_odometry": not configuration.uses_lines and rendered,
        }
        answered = [topics.IMU.name] if configuration.imu.enabled else []
        answered += [] if configuration.uses_lines else [topics.VELOCITY_SENSOR.name]
        if own_assistant and answered:
            parameters["answered"] = answered
        # The driver node selects between its page and a teleoperation node that publishes cmd_vel.
        remaps = ["-r", "cmd_vel:=driver/cmd_vel"] if driven else []
        return self._node("simulator", "omni_sim", parameters, remaps)

    def driver(self, options: Mapping[str, Any]) -> process_group.NodeProcess:
        """Return the process of the driver node, whose parameters include `options`."""
        vehicle, assistant = self.configuration.vehicle, self.configuration.brake_assist
        flat = flatten(assistant) | values_of(self.configuration.ground)
        parameters = {
            **{key: flat[key] for key in flat if key.startswith(("wheels.", "patches."))},
            "chassis_length": vehicle.chassis_length,
            "chassis_width": vehicle.chassis_width,
            "chassis_x": vehicle.chassis_x,
            "chassis_y": vehicle.chassis_y,
            "assist": assistant.enabled,
            **options,
        }
        return self._node("driver", "omni_tools", parameters)

    def of_run(
        self,
        folder: Path,
        recording: Mapping[str, Any] = PLAIN,
        external: Collection[str] = (),
    ) -> list[process_group.NodeProcess]:
        """Return the nodes of a scripted run in the order in which they are started.

        The recorder is the first node and the simulator the last one.

        Args:
            folder: rosbag2 folder to record to.
            recording: parameters of the recorder.
            external: names of nodes that are left out, because a user's node replaces them.
        """
        assistant = self.brake_assist()
        simulator = self.simulator(own_assistant=assistant.name not in external)
        started = [self.recorder(folder, recording), self.odometry(), assistant, simulator]
        return [node for node in started if node.name not in external]

    def of_drive(
        self, parameters: Mapping[str, Any], folder: Path | None, lines: bool = False
    ) -> list[process_group.NodeProcess]:
        """Return the nodes of ``omni drive`` in the order in which they are started.

        Args:
            parameters: parameters of the driver node.
            folder: rosbag2 folder of the recording; None for no recording.
            lines: whether to record the camera lines, which are the largest part of the data.
        """
        started = []
        if folder is not None:
            recorded = recorded_topics(self.configuration).items()
            chosen = {t: kind for t, kind in recorded if lines or not t.endswith("/lines")}
            started.append(self.recorder(folder, chosen=chosen))
        listeners = 1 + len(started)  # without the driver node, which may start later
        return [
            *started,
            self.driver(parameters),
            self.odometry(listeners + self.configuration.uses_lines),
            self.brake_assist(listeners),
            self.simulator(driven=True, lines_recorded=lines or not folder, listeners=listeners),
        ]

    def _timing(self) -> dict[str, Any]:
        """Return those parameters of a node that depend on the mode: lockstep or real time."""
        mode = {"diagnostics_period": 0.0} if self.lockstep else {"use_sim_time": True}
        return {"lockstep": self.lockstep, **mode}

    def _node(
        self,
        name: str,
        package: str,
        parameters: Mapping[str, Any],
        remaps: Sequence[str] = (),
        *,
        executable: str = "",
        own_code: bool = False,
    ) -> process_group.NodeProcess:
        path = self.scratch / f"{name}.yaml"
        path.write_text(parameters_text(parameters), encoding="utf-8")
        arguments = ["--ros-args", "--params-file", str(path), *remaps]
        return process_group.NodeProcess(name, package, executable or name, arguments, own_code)


def _relative(topic: str) -> str:
    """Return a topic name relative to the namespace; the names of shared topics remain absolute."""
    return topic if topic in _SHARED else topic.removeprefix("/")


def _listeners(count: int) -> dict[str, Any]:
    # The timeout is long because another node may have to compile kernels first.
    return {"subscribers": count, "match_timeout": 300.0}


def values_of(
    configuration: Configuration, part: type[Configuration] | None = None
) -> dict[str, Any]:
    """Return the values for a parameter file, keyed by dotted parameter name.

    Args:
        configuration: configuration of the node.
        part: base class whose fields are returned; None for all fields of the configuration.
    """
    # An empty list has no type in a parameter file; without an entry, the declared default is used.
    flat = flatten(configuration, part=part)
    return {key: value for key, value in flat.items() if value != []}


def parameters_text(parameters: Mapping[str, Any]) -> str:
    """Return the text of a parameter file that applies to a node of any name and namespace."""
    return in_yaml({"/**": {"ros__parameters": dict(parameters)}})
