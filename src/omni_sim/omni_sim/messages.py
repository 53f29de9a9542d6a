"""The simulator's own messages: truth, IMU, flow sensors and the scene for viewers."""

import math

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion, TwistWithCovarianceStamped, Vector3
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from omni_platform import quantities, signals
from omni_ros.messages import BASE_FRAME, WORLD_FRAME, header
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.imu import ImuConfiguration
from omni_sim.simulator import Observation
from omni_sim.vehicle.loads import GRAVITY

# Colors that color-blind readers can distinguish (Okabe and Ito).
_BLUE = (0.0, 0.447, 0.698)
_ORANGE = (0.902, 0.624, 0.0)
_VERMILION = (0.835, 0.369, 0.0)
_GREEN = (0.0, 0.620, 0.451)
_SKY = (0.337, 0.706, 0.914)
_GRAY = (0.6, 0.6, 0.6)
_METERS_PER_NEWTON = 1e-4
_SECONDS_PER_ARROW = 0.1


IMU_FRAME = "imu"
"""Frame of the unit: axes of `base_link`, at its mounting."""


def imu_message(stamp_ns: int, reading: quantities.FloatArray, imu: ImuConfiguration) -> Imu:
    """Return angular velocity and specific force of the IMU as in REP 145, without orientation.

    The rates of roll and pitch are zero with the variance of the gyro's noise. The vertical
    specific force is that of gravity.
    """
    message = Imu(header=header(stamp_ns, IMU_FRAME))
    message.orientation_covariance[0] = -1.0  # convention for "not measured"
    message.angular_velocity.z = float(reading[0])
    message.linear_acceleration.x = float(reading[1])
    message.linear_acceleration.y = float(reading[2])
    message.linear_acceleration.z = GRAVITY
    for axis in (0, 4, 8):
        message.angular_velocity_covariance[axis] = imu.gyro_noise**2
        message.linear_acceleration_covariance[axis] = imu.noise**2
    return message


def flow_message(name: str, flow: signals.Flow) -> TwistWithCovarianceStamped:
    """Return the measurement of a flow sensor in its own axes as a message."""
    message = TwistWithCovarianceStamped(header=header(flow.stamp_ns, name))
    message.twist.twist.linear.x, message.twist.twist.linear.y = map(float, flow.velocity)
    matrix = signals.UNMEASURED_VARIANCE * np.eye(6)
    matrix[:2, :2] = flow.covariance
    message.twist.covariance = matrix.ravel()
    return message


def ground_truth(observation: Observation) -> Odometry:
    """Return the simulator's true pose in `odom` and twist in `base_link`."""
    x, y, yaw = (float(value) for value in observation.pose)
    z, roll, pitch = (float(value) for value in observation.attitude)
    message = Odometry(header=header(observation.stamp_ns, WORLD_FRAME), child_frame_id=BASE_FRAME)
    message.pose.pose = Pose(position=Point(x=x, y=y, z=z), orientation=_standing(yaw, roll, pitch))
    message.twist.twist.linear.x = float(observation.twist[0])
    message.twist.twist.linear.y = float(observation.twist[1])
    message.twist.twist.angular.z = float(observation.twist[2])
    return message


def scene_markers(configuration: SimulatorConfiguration, observation: Observation) -> MarkerArray:
    """Return platform, load, wheels, wheel forces, velocity and friction patches for a viewer."""
    vehicle = configuration.vehicle
    x, y, yaw = (float(value) for value in observation.pose)
    to_world = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    origin = np.array([x, y])
    stamp_ns = observation.stamp_ns
    markers = [
        _box(
            stamp_ns,
            "platform",
            0,
            (x, y, 0.3),
            yaw,
            (vehicle.chassis_length, vehicle.chassis_width, 0.2),
            _GRAY,
        )
    ]
    load = origin + to_world @ np.array([vehicle.load.x, vehicle.load.y])
    markers.append(_sphere(stamp_ns, "load", (*load, vehicle.load.height), 0.3, _GREEN))
    for index, mount in enumerate(vehicle.wheels.values()):
        hub = origin + to_world @ np.array([mount.x, mount.y])
        locked = observation.brake_torque[index] != 0.0
        heading = yaw + math.radians(mount.heading_deg)
        size = (2.0 * mount.radius, 0.5 * mount.radius, 2.0 * mount.radius)
        color = _VERMILION if locked else _SKY
        markers.append(_box(stamp_ns, "wheels", index, (*hub, mount.radius), heading, size, color))
        force = to_world @ observation.wheel_force_body[index] * _METERS_PER_NEWTON
        markers.append(_arrow(stamp_ns, "wheel_forces", index, hub, force, _BLUE))
    velocity = to_world @ observation.twist[:2] * _SECONDS_PER_ARROW
    markers.append(_arrow(stamp_ns, "velocity", 0, origin, velocity, _ORANGE))
    for index, patch in enumerate(configuration.ground.patches.values()):
        heading = math.radians(patch.heading_deg)
        center = (patch.x, patch.y, -0.01)
        size = (patch.length, patch.width, 0.01)
        marker = _box(stamp_ns, "friction_patches", index, center, heading, size, _SKY)
        marker.type = Marker.CYLINDER if patch.shape == "ellipse" else Marker.CUBE
        markers.append(marker)
    return MarkerArray(markers=markers)


def _marker(
    stamp_ns: int, namespace: str, index: int, kind: int, color: tuple[float, float, float]
) -> Marker:
    red, green, blue = color
    return Marker(
        header=header(stamp_ns, WORLD_FRAME),
        ns=namespace,
        id=index,
        type=kind,
        action=Marker.ADD,
        color=ColorRGBA(r=red, g=green, b=blue, a=0.9),
        lifetime=Duration(),
    )


def _box(
    stamp_ns: int,
    namespace: str,
    index: int,
    center: tuple[float, float, float],
    yaw: float,
    size: tuple[float, float, float],
    color: tuple[float, float, float],
) -> Marker:
    marker = _marker(stamp_ns, namespace, index, Marker.CUBE, color)
    marker.pose = Pose(position=_point(center), orientation=_about_z(yaw))
    marker.scale = Vector3(x=float(size[0]), y=float(size[1]), z=float(size[2]))
    return marker


def _sphere(
    stamp_ns: int,
    namespace: str,
    center: tuple[float, float, float],
    diameter: float,
    color: tuple[float, float, float],
) -> Marker:
    marker = _marker(stamp_ns, namespace, 0, Marker.SPHERE, color)
    marker.pose = Pose(position=_point(center), orientation=_about_z(0.0))
    marker.scale = Vector3(x=diameter, y=diameter, z=diameter)
    return marker


def _arrow(
    stamp_ns: int,
    namespace: str,
    index: int,
    tail: np.ndarray,
    vector: np.ndarray,
    color: tuple[float, float, float],
) -> Marker:
    marker = _marker(stamp_ns, namespace, index, Marker.ARROW, color)
    height = 0.45
    marker.pose.orientation = _about_z(0.0)
    head = tail + vector
    marker.points = [_point((*tail, height)), _point((*head, height))]
    marker.scale = Vector3(x=0.03, y=0.08, z=0.1)
    return marker


def _point(coordinates: tuple[float, ...]) -> Point:
    x, y, z = (float(value) for value in coordinates)
    return Point(x=x, y=y, z=z)


def _standing(yaw: float, roll: float, pitch: float) -> Quaternion:
    """Return the rotation by the yaw, followed by the smallest rotation to roll and pitch."""
    rise_x, rise_y = -math.sin(pitch), math.sin(roll) * math.cos(pitch)
    up = math.cos(roll) * math.cos(pitch)
    w = math.sqrt(0.5 * (1.0 + up))  # half the angle of the tilt, about (x, y, 0) in the body
    x, y = 0.5 * rise_y / w, -0.5 * rise_x / w
    cos, sin = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return Quaternion(x=cos * x - sin * y, y=sin * x + cos * y, z=w * sin, w=w * cos)


def _about_z(yaw: float) -> Quaternion:
    return Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))
