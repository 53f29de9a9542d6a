"""Topics of a vehicle, each with its name, message type, publisher and durability.

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


class Topic(NamedTuple):
    """A topic of a vehicle.

    Attributes:
        name: name of the topic, relative to the namespace.
        type: type of its messages.
        publisher: node that publishes the topic.
        latched: whether the last message is kept for subscribers that join later.
        shared: whether all vehicles share the topic. A shared topic is outside their namespaces.
    """

    name: str
    type: str
    publisher: str
    latched: bool = False
    shared: bool = False

    @property
    def ros_name(self) -> str:
        """Name with which a node in the vehicle's namespace publishes or subscribes."""
        return self.path if self.shared else self.name

    @property
    def path(self) -> str:
        """Name of the topic for a vehicle without a namespace."""
        return f"/{self.name}"


CLOCK = Topic("clock", CLOCK_TYPE, "simulator", shared=True)
DIAGNOSTICS = Topic("diagnostics", DIAGNOSTICS_TYPE, "every node", shared=True)
WHEEL_STATES = Topic("wheel_states", JOINT_STATE, "simulator")
IMU = Topic("imu", "sensor_msgs/msg/Imu", "simulator")
PEDAL = Topic("brake/pedal", JOINT_STATE, "simulator")
DRIVER_PEDAL = Topic("driver/pedal", JOINT_STATE, "driver")
COMMAND = Topic("driver/command", TWIST_STAMPED, "simulator")
"""Commanded velocity that the vehicle's drives follow."""
VELOCITY_SENSOR = Topic("velocity_sensor/twist", TWIST_WITH_COVARIANCE, "simulator")
GROUND_TRUTH = Topic("ground_truth/odom", ODOMETRY, "simulator")
JOINT_STATES = Topic("joint_states", JOINT_STATE, "simulator")
"""Wheel angles for `robot_state_publisher`."""
ROBOT_DESCRIPTION = Topic("robot_description", "std_msgs/msg/String", "simulator", latched=True)
MARKERS = Topic("markers", "visualization_msgs/msg/MarkerArray", "simulator")
WHEEL_FORCES = Topic("wheel_forces", "sensor_msgs/msg/MultiDOFJointState", "simulator")
"""True force of the ground on each wheel, in the axes of `odom` [N]."""
TWIST = Topic("odometry/twist", TWIST_WITH_COVARIANCE, "linescan_odometry")
SIDESLIP = Topic("odometry/sideslip", JOINT_STATE, "linescan_odometry")
ODOM = Topic("odom", ODOMETRY, "linescan_odometry")
ENABLE = Topic("brake/enable", JOINT_STATE, "brake_assist")
SLIDING = Topic("brake_assist/error", JOINT_STATE, "brake_assist")
"""Error of each wheel, the switching function of the law [m/s]."""
TEST_RATIOS = Topic("brake_assist/test_ratios", JOINT_STATE, "brake_assist")
"""Test ratios of fault detection: normalized innovations squared divided by their gates [1]."""


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
