"""Parameter files for the nodes of a real vehicle, made from a single vehicle file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from linescan_odometry.configuration import OdometryConfiguration
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core import topics
from omni_core.brakes import BRAKES
from omni_core.commands.command_report import write_text
from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    check_choice,
    from_mapping,
    parameter,
)
from omni_core.description import IMU_FRAME, urdf
from omni_core.sensors import FlowSensor, Mount
from omni_ros.flat_parameters import NAMES
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary, recorded_experiment
from omni_runs.graph.nodes import parameters_text, values_of
from omni_runs.yaml_files import read_mapping
from omni_vehicle.brake_adapter import BrakeAdapterConfiguration
from omni_vehicle.twist_adapter import TwistAdapterConfiguration

DESCRIPTION = "robot.urdf"
FRAMES = "robot_state_publisher"
RECORDER = "recorder"
WARNING = "feedback_warning"  # parameter of the assistant
LOG_ONLY = "log_only"  # parameter file that is read after that of the assistant
ODOMETRY, BRAKE_ASSIST = "linescan_odometry", "brake_assist"
TWIST_ADAPTER, BRAKE_ADAPTER, _VEHICLE = "twist_adapter", "brake_adapter", "omni_vehicle"
_EACH = "<sensor>"  # stands for the name of each sensor in a topic
_REFUSED = 2  # exit code for an invalid configuration, which a restart cannot correct

# Topics that can be renamed, keyed by the name of the launch argument.
_TOPICS = {
    "pedal": topics.PEDAL.name,
    "wheel_states": topics.WHEEL_STATES.name,
    "imu": topics.IMU.name,
    "enable": topics.ENABLE.name,
    "error": topics.SLIDING.name,
    "test_ratios": topics.TEST_RATIOS.name,
    "odom": topics.ODOM.name,
    "sideslip": topics.SIDESLIP.name,
    "lines": topics.lines(_EACH).name,
    "camera_info": topics.camera_info(_EACH).name,
    "flow": topics.flow(_EACH).name,
    "joint_states": topics.JOINT_STATES.name,
    **{name: name for name in ("cmd_vel", "pedal_input", "estop", "drive_commands", "commands")},
}

# Launch arguments: default (None if the argument is required) and description.
ARGUMENTS = {
    "parameters": (None, "Folder of the parameter files"),
    "namespace": ("", "Namespace of the vehicle, such as robot1"),
    "frame_prefix": ("", "Prefix of every frame, such as robot1/"),
    "twist": (
        topics.TWIST.name,
        "Topic of the body twist; with another topic neither odometry nor twist_adapter is started",
    ),
    **{name: (topic, f"Topic instead of {topic}") for name, topic in _TOPICS.items()},
    "brake_adapter": (
        "",
        "File with the message types of the brake adapter, which starts it; empty: not started",
    ),
    "log_only": ("true", "true: report decisions, but release no brake; false: assist"),
    "robot_state_publisher": ("false", "true: publish the wheels' frames, from wheel_states"),
    "respawn": ("true", "Restart a node that has died; until then all brakes are on"),
}

_HARDWARE = "hardware"  # folder of the descriptions of real vehicles in the configuration
_PARTS = ("wheels", "sensors", "flow_sensors", "odometry", TWIST_ADAPTER, BRAKE_ASSIST)


@dataclasses.dataclass(frozen=True)
class Hardware:
    """Configuration of the nodes of a real vehicle.

    Attributes:
        brake_assist: configuration of the assistant.
        odometry: configuration of the odometry with line cameras and flow sensors; None if the
            twist comes from another source.
        twist_adapter: configuration of the node that computes the twist from a single flow sensor
            and a gyro; None with any other sensors.
    """

    brake_assist: BrakeAssistConfiguration
    odometry: OdometryConfiguration | None
    twist_adapter: TwistAdapterConfiguration | None = None

    @classmethod
    def of(cls, experiment: ExperimentConfiguration) -> Hardware:
        """Return the configuration of odometry and brake assistant in an experiment."""
        optical = experiment.feedback == "optical"
        return cls(experiment.brake_assist, experiment.odometry if optical else None)


@dataclasses.dataclass(frozen=True)
class HardwareNode:
    """A node that ``hardware.launch.py`` starts.

    Attributes:
        package: package of the node.
        executable: name of the executable in the package.
        name: name of the node.
        files: parameter files; later files override earlier ones.
        remappings: pairs of a topic's name in the node and its new name.
        ros_arguments: further arguments after ``--ros-args``.
    """

    package: str
    executable: str
    name: str
    files: tuple[Path, ...]
    remappings: tuple[tuple[str, str], ...] = ()
    ros_arguments: tuple[str, ...] = ()


def hardware_nodes(given: Mapping[str, str]) -> list[HardwareNode]:
    """Return the nodes that the launch arguments select.

    Args:
        given: values of the launch arguments, keyed by name.

    Raises:
        ConfigurationError: an argument is invalid, or a required file is not in the folder
            ``parameters``.
    """
    for name, (default, _) in ARGUMENTS.items():
        if default in ("true", "false") and given[name] not in ("true", "false"):
            raise ConfigurationError(name, f"is {given[name]!r}, must be true or false")
    folder = Path(given["parameters"]).resolve()
    if not (folder / f"{BRAKE_ASSIST}.yaml").is_file():
        raise ConfigurationError(
            "parameters",
            f"{folder} has no {BRAKE_ASSIST}.yaml; ./omni ros-params VEHICLE --out {folder} writes "
            "it",
        )
    # launch would write a mapping to a temporary file that is never removed, so -p is used.
    prefix = ("-p", f"frame_prefix:={given['frame_prefix']}") if given["frame_prefix"] else ()
    own = given["twist"] == topics.TWIST.name
    nodes = []
    sources = ((ODOMETRY, ODOMETRY, "odometry"), (_VEHICLE, TWIST_ADAPTER, TWIST_ADAPTER))
    for package, name, executable in sources:
        file = folder / f"{name}.yaml"
        if own and file.exists():
            renamed = _remappings(given, file)
            nodes.append(HardwareNode(package, executable, name, (file,), renamed, prefix))
    assistant = [BRAKE_ASSIST, *([LOG_ONLY] if given["log_only"] == "true" else [])]
    files = tuple(folder / f"{name}.yaml" for name in assistant)
    renamed = (*_remappings(given), *(() if own else ((topics.TWIST.name, given["twist"]),)))
    nodes.append(
        HardwareNode("omni_brake_assist", BRAKE_ASSIST, BRAKE_ASSIST, files, renamed, prefix)
    )
    if given["brake_adapter"]:
        files = (folder / f"{BRAKE_ADAPTER}.yaml", Path(given["brake_adapter"]).resolve())
        renamed = _remappings(given)
        nodes.append(HardwareNode(_VEHICLE, BRAKE_ADAPTER, BRAKE_ADAPTER, files, renamed))
    if given["robot_state_publisher"] == "true":
        files = (folder / f"{FRAMES}.yaml",)
        joints = ((topics.JOINT_STATES.name, given["wheel_states"]),)
        nodes.append(HardwareNode(FRAMES, FRAMES, FRAMES, files, joints, prefix))
    for path in (path for node in nodes for path in node.files):
        if not path.is_file():
            raise ConfigurationError("parameters", f"{path} is missing; repeat ./omni ros-params")
    return nodes


def _remappings(
    given: Mapping[str, str], parameters: Path | None = None
) -> tuple[tuple[str, str], ...]:
    """Return pairs of a topic and its new name, for all renamed topics of a node.

    Args:
        given: values of the launch arguments, keyed by name.
        parameters: parameter file of a node with sensors; None for a node without sensors.
    """
    sensors: list[str] = []
    if parameters is not None:
        values = read_mapping(parameters, "parameters")["/**"]["ros__parameters"]
        for key in (f"sensors.{NAMES}", f"flow_sensors.{NAMES}"):
            sensors += values.get(key, ())
        sensors += [values["sensor"]] if values.get("sensor") else []
    return tuple(
        (topic.replace(_EACH, sensor), given[name].replace(_EACH, sensor))
        for name, topic in _TOPICS.items()
        if given[name] != topic
        for sensor in (sensors if _EACH in topic else [""])
    )


def starts_again(exit_code: int, given: Mapping[str, str]) -> bool:
    """Return whether a node that ended is restarted.

    Args:
        exit_code: exit code of the node.
        given: values of the launch arguments, keyed by name.
    """
    return given["respawn"] == "true" and exit_code not in (0, _REFUSED)


def read_hardware(name: str, library: ExperimentLibrary) -> Hardware:
    """Return the configuration of the nodes of a vehicle, read from a file.

    Args:
        name: one of: name of a file in ``hardware/`` or ``experiments/`` of the configuration;
            folder of a vehicle; path of an experiment; path of the ``configuration.yaml`` of a run;
            path of a file with ``wheels``, and optionally ``sensors``, ``flow_sensors``,
            ``odometry`` and ``brake_assist``.
        library: library that contains the experiment and vehicle files.

    Raises:
        ConfigurationError: the name is unknown, or a file, key or value is invalid.
    """
    if name in library.parts(_HARDWARE):
        path = library.folder / _HARDWARE / f"{name}.yaml"
    else:
        path = Path(library.located("experiments", name))
        if not path.suffix:
            known = (*library.parts(_HARDWARE), *library.parts("experiments"), "a path or a folder")
            check_choice("CONFIGURATION", name, known)
            return Hardware.of(library.load(name))
    tree = read_mapping(path, "CONFIGURATION")
    if TWIST_ADAPTER in tree and ("variants" in tree or "vehicle" in tree):
        problem = "is for a file such as config/hardware/wheel_twist_agv.yaml, not an experiment"
        raise ConfigurationError(TWIST_ADAPTER, problem)
    if "variants" in tree:
        return Hardware.of(library.load(str(path)))
    if "vehicle" in tree:
        return Hardware.of(recorded_experiment(path))
    if "body" in tree:
        problem = f"{path} describes no sensors; give the folder of the vehicle, or an experiment"
        raise ConfigurationError("CONFIGURATION", problem)
    for key in tree:
        check_choice("", key, _PARTS)
    if not tree.get("wheels"):
        raise ConfigurationError("wheels", "is required: the wheels of the vehicle by name")
    brake_assist = _part(tree, BRAKE_ASSIST, BrakeAssistConfiguration, wheels=tree["wheels"])
    return _with_sources(tree, brake_assist)


def _with_sources(tree: Mapping[str, Any], assistant: BrakeAssistConfiguration) -> Hardware:
    """Return the nodes of a vehicle's file for its assistant and the sensors of the twist."""
    sensors = {kind: tree.get(kind) or {} for kind in ("sensors", "flow_sensors")}
    is_single = not sensors["sensors"] and len(sensors["flow_sensors"]) == 1
    if TWIST_ADAPTER in tree and not is_single:
        problem = "is for exactly one of flow_sensors and no line camera"
        raise ConfigurationError(TWIST_ADAPTER, problem)
    if is_single:
        adapter = _single_flow_sensor(tree, assistant)
        is_shared = assistant.shared_gyro or adapter.gyro == "imu"
        shared = dataclasses.replace(assistant, shared_gyro=is_shared)
        return Hardware(shared, None, adapter)
    if any(sensors.values()):
        return Hardware(assistant, _part(tree, "odometry", OdometryConfiguration, **sensors))
    if "odometry" in tree:
        raise ConfigurationError(
            "odometry", "needs the line cameras under sensors, or flow sensors under flow_sensors"
        )
    return Hardware(assistant, None)


class _OneFlowSensor(Configuration):
    flow_sensors: Mapping[str, FlowSensor] = parameter()
    """The only sensor of the velocity"""


def _single_flow_sensor(
    tree: Mapping[str, Any], assistant: BrakeAssistConfiguration
) -> TwistAdapterConfiguration:
    """Return the configuration of `twist_adapter` for the only sensor in a vehicle's file."""
    if "odometry" in tree:
        problem = "is not used with one flow sensor, whose twist the node twist_adapter computes"
        raise ConfigurationError("odometry", problem)
    ((name, sensor),) = from_mapping(
        _OneFlowSensor, {"flow_sensors": tree["flow_sensors"]}
    ).flow_sensors.items()
    shared = {field.name: getattr(sensor, field.name) for field in dataclasses.fields(Mount)}
    shared |= {
        "sensor": name,
        "maximum_speed": sensor.maximum_speed,
        "deviation": (sensor.deviation, sensor.deviation, TwistAdapterConfiguration.gyro_deviation),
        "imu_rotation_deg": assistant.imu_rotation_deg,
    }
    adapter: TwistAdapterConfiguration = _part(
        tree, TWIST_ADAPTER, TwistAdapterConfiguration, **shared
    )
    return adapter


def _part(tree: Mapping[str, Any], key: str, cls: Any, **shared: Any) -> Any:
    given = tree.get(key) or {}
    if not isinstance(given, dict):
        raise ConfigurationError(key, "must be a mapping of names to values")
    try:
        return from_mapping(cls, {**shared, **given})
    except ConfigurationError as error:
        # The values that both nodes share are at the top of the file.
        at_top = error.key.partition(".")[0] in shared.keys() - given.keys()
        raise error if at_top else error.below(key) from None


def brake_adapter(assistant: BrakeAssistConfiguration, brakes: str) -> BrakeAdapterConfiguration:
    """Return the configuration of the brake adapter for the nominal brakes of the assistant.

    Args:
        assistant: configuration of the assistant.
        brakes: kind of the brakes, a key of `BRAKES`.

    Raises:
        ConfigurationError: the assistant assumes another kind of brakes, or a coil that may switch
            in every step.
    """
    brake, needed = assistant.brake, BRAKES[brakes].typical["kind"]
    if brake.kind != needed:
        problem = f"{brakes} brakes need brake_assist.brake.kind {needed}, but it is {brake.kind}"
        remedy = "correct it, or brake.kind in the file of the vehicle"
        raise ConfigurationError("--brakes", f"{problem}: {remedy}")
    if BRAKES[brakes].is_coil and assistant.minimum_dwell_time == 0.0:
        problem = "is 0, must be the shortest time between two switching operations of the coils"
        raise ConfigurationError("brake_assist.minimum_dwell_time", problem)
    return BrakeAdapterConfiguration(
        wheels=tuple(assistant.wheels),
        kind=brakes,
        max_torque=brake.max_torque,
        ramp=brake.ramp / min(wheel.radius for wheel in assistant.wheels.values()),
        minimum_dwell_time=assistant.minimum_dwell_time,
    )


def write_parameters(
    hardware: Hardware, folder: Path, warning: str = "", brakes: str | None = None
) -> list[Path]:
    """Write the nodes' parameter files and a URDF of the vehicle; return their paths.

    The files are valid for nodes of any name and namespace.

    Args:
        hardware: configuration of the nodes.
        folder: folder of the files, created if it is missing.
        warning: sentence about the source of the twist, to be reported by the assistant; empty for
            none.
        brakes: kind of the brakes, for the parameters of the brake adapter; None for no such file.

    Raises:
        ConfigurationError: the assistant assumes another kind of brakes.
        OSError: the folder is not writable.
    """
    reported = {WARNING: warning} if warning else {}
    documents = {f"{BRAKE_ASSIST}.yaml": parameter_file(hardware.brake_assist, **reported)}
    assistant = hardware.brake_assist
    sensors = {IMU_FRAME: Mount(x=assistant.imu_x, y=assistant.imu_y, heading_deg=0.0)}
    if hardware.odometry is not None:
        documents[f"{ODOMETRY}.yaml"] = parameter_file(hardware.odometry)
        sensors |= hardware.odometry.all_sensors
    if hardware.twist_adapter is not None:
        documents[f"{TWIST_ADAPTER}.yaml"] = parameter_file(hardware.twist_adapter)
        sensors[hardware.twist_adapter.sensor] = hardware.twist_adapter
    description = urdf("vehicle", assistant.wheels, sensors)
    documents[DESCRIPTION] = description
    documents[f"{FRAMES}.yaml"] = parameters_text({"robot_description": description})
    documents[f"{LOG_ONLY}.yaml"] = parameters_text({"enabled": False})
    recorded = {
        "topics": [topic.ros_name for topic in topics.OF_REAL_VEHICLE],
        "types": [topic.type for topic in topics.OF_REAL_VEHICLE],
    }
    documents[f"{RECORDER}.yaml"] = parameters_text(recorded)
    if brakes:
        documents[f"{BRAKE_ADAPTER}.yaml"] = parameter_file(brake_adapter(assistant, brakes))
    return [write_text(folder / name, text) for name, text in documents.items()]


def parameter_file(configuration: Configuration, **others: Any) -> str:
    """Return the text of a parameter file for a node of any name and namespace.

    Args:
        configuration: configuration of the node.
        **others: further parameters, keyed by name.
    """
    return parameters_text(values_of(configuration) | others)
