"""Topics of a vehicle and the signals in their messages, each declared once.

From these declarations, the nodes derive their publishers and the messages of plain values, and the
other packages derive the recorded topics, the columns of a run's history and the plots of a report.
A topic of plain values (`Topic.is_plain`) needs no other code: the node that its declaration names
publishes it, each run records it, and a report shows it.

All topics are reliable unless a node's parameter ``qos_overrides`` or the odometry's parameter
`best_effort_cameras` changes this. `omni_ros.qos` defines the depths of the queues.
"""

from typing import NamedTuple

CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
DIAGNOSTICS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"
IMAGE = "sensor_msgs/msg/Image"
JOINT_STATE = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
TWIST_WITH_COVARIANCE = "geometry_msgs/msg/TwistWithCovarianceStamped"

PER_WHEEL, PER_NAME = ("per wheel",), ("per name in the message",)
_TWIST = ("v_x", "v_y", "yaw rate")
_TWIST_UNIT = "m/s, m/s, rad/s"


class Signal(NamedTuple):
    """Values in the messages of a topic.

    Attributes:
        name: name of the signal, and of its array in a run's history if the history contains it.
        field: field of the message that contains the values.
        unit: unit of the values, one for each column or one for all columns.
        columns: names of the columns; `PER_WHEEL` for one column per wheel; `PER_NAME` for one
            column per name in the message; empty for a single number.
        attribute: attribute of the publisher's sample that contains the values; empty if it has the
            name of the signal.
    """

    name: str
    field: str
    unit: str
    columns: tuple[str, ...] = ()
    attribute: str = ""


class Topic(NamedTuple):
    """A topic of a vehicle.

    Attributes:
        name: name of the topic, relative to the namespace.
        type: type of its messages.
        publisher: node that publishes the topic.
        signals: signals in its messages.
        latched: whether the last message is kept for subscribers that join later.
        shared: whether all vehicles share the topic. A shared topic is outside their namespaces.
        joints: names in its messages, of one joint for each value; none for the wheels.
        recorded: whether a run records the topic.
        needs: key of a configuration value without which the topic has no messages, such as
            ``imu.enabled``; empty if it always has messages.
    """

    name: str
    type: str
    publisher: str
    signals: tuple[Signal, ...] = ()
    latched: bool = False
    shared: bool = False
    joints: tuple[str, ...] = ()
    recorded: bool = True
    needs: str = ""

    @property
    def ros_name(self) -> str:
        """Name with which a node in the vehicle's namespace publishes or subscribes."""
        return self.path if self.shared else self.name

    @property
    def path(self) -> str:
        """Name of the topic for a vehicle without a namespace."""
        return f"/{self.name}"

    @property
    def is_plain(self) -> bool:
        """Whether `omni_ros.messages.packed` converts a sample of the publisher to a message."""
        known = self.signals and all(one.columns != PER_NAME for one in self.signals)
        return bool(known) and self.type in (JOINT_STATE, TWIST_STAMPED)


CLOCK = Topic("clock", CLOCK_TYPE, "simulator", shared=True)
DIAGNOSTICS = Topic("diagnostics", DIAGNOSTICS_TYPE, "every node", shared=True)
_WHEELS = (
    Signal("wheel_angle", "position", "rad", PER_WHEEL),
    Signal("wheel_speed", "velocity", "rad/s", PER_WHEEL, "encoder_speed"),
    Signal("brake_torque", "effort", "N m", PER_WHEEL),
)
WHEEL_STATES = Topic("wheel_states", JOINT_STATE, "simulator", _WHEELS)
_STEERING = (
    Signal("steering_angle", "position", "rad", PER_WHEEL),
    Signal("steering_rate", "velocity", "rad/s", PER_WHEEL),
)
STEERING = Topic("steering_states", JOINT_STATE, "simulator", _STEERING, needs="vehicle.is_steered")
"""Steering angle of each wheel, counter-clockwise from the wheel's heading; 0 if not steered."""
_PEDAL = (Signal("pedal", "position", "1"),)
PEDAL = Topic("brake/pedal", JOINT_STATE, "simulator", _PEDAL, joints=("brake_pedal",))
_ENABLE = (Signal("enable", "effort", "1", PER_WHEEL),)
ENABLE = Topic("brake/enable", JOINT_STATE, "brake_assist", _ENABLE)
_ERROR = (Signal("error", "velocity", "m/s", PER_WHEEL),)
SLIDING = Topic("brake_assist/error", JOINT_STATE, "brake_assist", _ERROR)
"""Error of each wheel, the switching function of the law [m/s]."""
_RATIO = (Signal("test_ratio", "position", "1", PER_NAME),)
TEST_RATIOS = Topic("brake_assist/test_ratios", JOINT_STATE, "brake_assist", _RATIO)
"""Test ratios of fault detection: normalized innovations squared divided by their gates [1]."""
_COMMAND = (Signal("command", "twist", _TWIST_UNIT, _TWIST),)
COMMAND = Topic("driver/command", TWIST_STAMPED, "simulator", _COMMAND)
"""Commanded velocity that the vehicle's drives follow."""
ODOM = Topic("odom", ODOMETRY, "linescan_odometry")
_ESTIMATE = (
    Signal("estimate", "twist.twist", _TWIST_UNIT, _TWIST),
    Signal("estimate_variance", "twist.covariance", "m^2/s^2, m^2/s^2, rad^2/s^2", _TWIST),
)
TWIST = Topic("odometry/twist", TWIST_WITH_COVARIANCE, "linescan_odometry", _ESTIMATE)
VELOCITY_SENSOR = Topic("velocity_sensor/twist", TWIST_WITH_COVARIANCE, "simulator")
_TRUTH = (
    Signal("pose", "pose.pose", "m, m, rad", ("x", "y", "yaw")),
    Signal("twist", "twist.twist", _TWIST_UNIT, _TWIST),
)
GROUND_TRUTH = Topic("ground_truth/odom", ODOMETRY, "simulator", _TRUTH)
MARKERS = Topic("markers", "visualization_msgs/msg/MarkerArray", "simulator")
WHEEL_FORCES = Topic("wheel_forces", "sensor_msgs/msg/MultiDOFJointState", "simulator")
"""True force of the ground on each wheel, in the axes of `odom` [N]."""
IMU = Topic("imu", "sensor_msgs/msg/Imu", "simulator", needs="imu.enabled")
_ANGLE = (Signal("sideslip", "position", "rad", PER_NAME),)
SIDESLIP = Topic(
    "odometry/sideslip", JOINT_STATE, "linescan_odometry", _ANGLE, needs="odometry.sideslip"
)
DRIVER_PEDAL = Topic("driver/pedal", JOINT_STATE, "driver", recorded=False)
JOINT_STATES = Topic("joint_states", JOINT_STATE, "simulator", recorded=False)
"""Angles of wheels and steering joints for `robot_state_publisher`."""
ROBOT_DESCRIPTION = Topic(
    "robot_description", "std_msgs/msg/String", "simulator", latched=True, recorded=False
)

WITH_TWIST = {one.name: one for one in (TWIST, VELOCITY_SENSOR, GROUND_TRUTH)}
"""Topics from which a tool can take the measured twist, keyed by name."""

DECLARED = tuple(one for one in tuple(vars().values()) if isinstance(one, Topic))
"""All topics except those of single sensors and of the user's nodes, in the order of recording."""

OF_REAL_VEHICLE = (WHEEL_STATES, PEDAL, ENABLE, TWIST, IMU, DIAGNOSTICS)
"""Topics that are recorded on a real vehicle."""


def published_by(node: str) -> tuple[Topic, ...]:
    """Return the topics of a vehicle that a node publishes, except those of single sensors."""
    return tuple(one for one in DECLARED if one.publisher == node and not one.shared)


def cmd_vel(*, stamped: bool) -> Topic:
    """Return the topic of a velocity command, with or without a stamp."""
    return Topic("cmd_vel", TWIST_STAMPED if stamped else "geometry_msgs/msg/Twist", "user's node")


def lines(sensor: str) -> Topic:
    """Return the topic of a line camera's lines."""
    return Topic(f"line_scan/{sensor}/lines", IMAGE, "simulator")


def camera_info(sensor: str) -> Topic:
    """Return the topic of a line camera's description."""
    return Topic(
        f"line_scan/{sensor}/camera_info", "sensor_msgs/msg/CameraInfo", "simulator", latched=True
    )


def flow(sensor: str) -> Topic:
    """Return the topic of an optical-flow sensor's velocity."""
    return Topic(f"flow/{sensor}/twist", TWIST_WITH_COVARIANCE, "simulator")
