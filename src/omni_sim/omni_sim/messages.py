"""Messages that only the simulator publishes: true motion, IMU, flow sensors, scene markers."""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from geometry_msgs.msg import Point, Pose, TwistWithCovarianceStamped, Vector3, Wrench
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState, MultiDOFJointState
from visualization_msgs.msg import Marker, MarkerArray

from omni_core import signals
from omni_core.description import IMU_FRAME, steering_joint
from omni_core.geometry import WheelMount
from omni_core.quantities import GRAVITY, FloatArray
from omni_ros.messages import BASE_FRAME, WORLD_FRAME, stamped
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.sensor_configuration import ImuConfiguration
from omni_sim.simulator import Observation

# Colors that color-blind people can distinguish (Okabe and Ito).
_BLUE = (0.0, 0.447, 0.698)
_ORANGE = (0.902, 0.624, 0.0)
_VERMILION = (0.835, 0.369, 0.0)
_GREEN = (0.0, 0.620, 0.451)
_SKY = (0.337, 0.706, 0.914)
_GRAY = (0.6, 0.6, 0.6)
_METERS_PER_NEWTON = 1e-4  # length of an arrow
_SECONDS_PER_ARROW = 0.1
_ARROW_SIZE = (0.03, 0.08, 0.1)  # diameters of shaft and head, length of the head [m]
_ARROW_HEIGHT = 0.45  # [m]


def imu_message(reading: signals.ImuSample, imu: ImuConfiguration, period_ns: int) -> Imu:
    """Return a message with angular velocity and specific force of the IMU, as in REP 145.

    The message has no orientation. The rates of roll and pitch are zero and have the variance of
    the gyro noise. The vertical specific force equals gravity.

    Args:
        reading: reading of the IMU.
        imu: errors of the IMU.
        period_ns: control period [ns].
    """
    message, factor = stamped(Imu, reading.stamp_ns, IMU_FRAME), imu.noise_factor(period_ns)
    message.orientation_covariance[0] = -1.0  # convention for "not measured"
    message.angular_velocity.z = reading.yaw_rate
    message.linear_acceleration.x = float(reading.acceleration[0])
    message.linear_acceleration.y = float(reading.acceleration[1])
    message.linear_acceleration.z = GRAVITY
    for axis in (0, 4, 8):
        message.angular_velocity_covariance[axis] = (factor * imu.gyro_noise) ** 2
        message.linear_acceleration_covariance[axis] = (factor * imu.noise) ** 2
    return message


def flow_message(name: str, flow: signals.Flow) -> TwistWithCovarianceStamped:
    """Return the measurement of a flow sensor along its own axes as a message."""
    message = stamped(TwistWithCovarianceStamped, flow.stamp_ns, name)
    message.twist.twist.linear.x, message.twist.twist.linear.y = map(float, flow.velocity)
    matrix = signals.UNMEASURED_VARIANCE * np.eye(6)
    matrix[:2, :2] = flow.covariance
    message.twist.covariance = matrix.ravel()
    return message


def ground_truth(observation: Observation) -> Odometry:
    """Return a message with the true pose of `base_link` in `odom` and its twist in `base_link`."""
    x, y, yaw = (float(value) for value in observation.pose)
    z, roll, pitch = (float(value) for value in observation.attitude)
    message = stamped(Odometry, observation.stamp_ns, WORLD_FRAME)
    message.child_frame_id = BASE_FRAME
    _place(message.pose.pose, (x, y, z), _quaternion(yaw, roll, pitch))
    message.twist.twist.linear.x = float(observation.twist[0])
    message.twist.twist.linear.y = float(observation.twist[1])
    message.twist.twist.angular.z = float(observation.twist[2])
    return message


def joint_angles(
    mounts: Mapping[str, WheelMount], wheels: JointState, steering: JointState | None
) -> JointState:
    """Return a message with the angles of all wheels and, below them, of all steering joints.

    Args:
        mounts: wheels of the vehicle, keyed by name.
        wheels: message on `wheel_states`, which is returned if no wheel is steered.
        steering: message on `steering_states`, or None if no wheel is steered.
    """
    if steering is None:
        return wheels
    message = JointState(header=wheels.header, name=[*wheels.name], position=[*wheels.position])
    for name, angle in zip(steering.name, steering.position, strict=True):
        if mounts[name].is_steered:
            message.name.append(steering_joint(name))
            message.position.append(angle)
    return message


def wheel_forces(wheels: Sequence[str], observation: Observation) -> MultiDOFJointState:
    """Return a message with the true force of the ground on each wheel, in the axes of `odom`."""
    message = stamped(MultiDOFJointState, observation.stamp_ns, WORLD_FRAME)
    message.joint_names = list(wheels)
    forces = observation.wheel_force_body @ _to_world(observation).T
    message.wrench = [Wrench(force=Vector3(x=float(x), y=float(y))) for x, y in forces]
    return message


def _to_world(observation: Observation) -> FloatArray:
    """Return the matrix that rotates vectors from `base_link` to `odom`, shape (2, 2)."""
    cos, sin = math.cos(observation.pose[2]), math.sin(observation.pose[2])
    return np.array([[cos, -sin], [sin, cos]])


def scene_markers(configuration: SimulatorConfiguration, observation: Observation) -> MarkerArray:
    """Return markers of platform, load, wheels, wheel forces, velocity and friction patches."""
    vehicle = configuration.vehicle
    x, y, yaw = (float(value) for value in observation.pose)
    to_world = _to_world(observation)
    origin = np.array([x, y])
    marker = partial(_marker, observation.stamp_ns)
    size = (vehicle.chassis_length, vehicle.chassis_width, 0.2)
    chassis = (*(origin + to_world @ vehicle.chassis_center), 0.3, yaw)
    markers = [marker("platform", 0, Marker.CUBE, _GRAY, size, chassis)]
    load = (*(origin + to_world @ [vehicle.load.x, vehicle.load.y]), vehicle.load.height, 0.0)
    markers.append(marker("load", 0, Marker.SPHERE, _GREEN, (0.3, 0.3, 0.3), load))
    for index, mount in enumerate(vehicle.wheels.values()):
        hub = origin + to_world @ [mount.x, mount.y]
        color = _VERMILION if observation.brake_torque[index] != 0.0 else _SKY
        size = (2.0 * mount.radius, 0.5 * mount.radius, 2.0 * mount.radius)
        heading = yaw + math.radians(mount.heading_deg) + observation.steering_angle[index]
        pose = (*hub, mount.radius, heading)
        markers.append(marker("wheels", index, Marker.CUBE, color, size, pose))
        arrow = marker("wheel_forces", index, Marker.ARROW, _BLUE, _ARROW_SIZE)
        force = to_world @ observation.wheel_force_body[index] * _METERS_PER_NEWTON
        arrow.points = [_point((*end, _ARROW_HEIGHT)) for end in (hub, hub + force)]
        markers.append(arrow)
    arrow = marker("velocity", 0, Marker.ARROW, _ORANGE, _ARROW_SIZE)
    velocity = to_world @ observation.twist[:2] * _SECONDS_PER_ARROW
    arrow.points = [_point((*end, _ARROW_HEIGHT)) for end in (origin, origin + velocity)]
    markers.append(arrow)
    for index, patch in enumerate(configuration.ground.patches.values()):
        kind = Marker.CYLINDER if patch.shape == "ellipse" else Marker.CUBE
        pose = (patch.x, patch.y, -0.01, math.radians(patch.heading_deg))
        size = (patch.length, patch.width, 0.01)
        markers.append(marker("friction_patches", index, kind, _SKY, size, pose))
    return MarkerArray(markers=markers)


def _marker(
    stamp_ns: int,
    namespace: str,
    index: int,
    kind: int,
    color: tuple[float, float, float],
    size: tuple[float, float, float],
    pose: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
) -> Marker:
    """Return a marker in the world frame.

    Args:
        stamp_ns: time of the marker [ns].
        namespace: name of the group of markers.
        index: number of the marker in this group.
        kind: shape, such as `Marker.CUBE`.
        color: red, green and blue, 0 to 1.
        size: extent along the marker's own x, y and z [m].
        pose: x, y, z [m] and yaw [rad].
    """
    message = stamped(Marker, stamp_ns, WORLD_FRAME)
    message.ns, message.id, message.type, message.action = namespace, index, kind, Marker.ADD
    tint, scale = message.color, message.scale
    (tint.r, tint.g, tint.b), tint.a = color, 0.9
    scale.x, scale.y, scale.z = map(float, size)
    _place(message.pose, pose[:3], (0.0, 0.0, math.sin(pose[3] / 2.0), math.cos(pose[3] / 2.0)))
    return message


def _place(message: Pose, position: Sequence[float], rotation: Sequence[float]) -> None:
    """Set the position [m] and the quaternion (x, y, z, w) of a pose."""
    place, turn = message.position, message.orientation
    place.x, place.y, place.z = map(float, position)
    turn.x, turn.y, turn.z, turn.w = rotation


def _point(coordinates: Sequence[float]) -> Point:
    x, y, z = map(float, coordinates)
    return Point(x=x, y=y, z=z)


def _quaternion(yaw: float, roll: float, pitch: float) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of an attitude [rad].

    The attitude results from the rotation by yaw, followed by the smallest rotation that gives the
    tilt of roll and pitch.
    """
    rise_x, rise_y = -math.sin(pitch), math.sin(roll) * math.cos(pitch)
    up = math.cos(roll) * math.cos(pitch)
    w = math.sqrt(0.5 * (1.0 + up))  # half the tilt angle, about (x, y, 0) in the body frame
    x, y = 0.5 * rise_y / w, -0.5 * rise_x / w
    cos, sin = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return cos * x - sin * y, sin * x + cos * y, w * sin, w * cos
