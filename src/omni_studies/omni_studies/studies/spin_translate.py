"""Spin while translating on both platforms by inverse kinematics, Figures 19 to 22.

The validation of section 2.5.3: a constant velocity along x of the world, a sinusoidal velocity
along y and a constant yaw rate, turned into wheel speeds by Eqs. (34) and (35). The commands come
from the reference alone, without any feedback of position or heading, so the tracking error is the
accumulated slip of the tires. The vehicle starts in motion without slip, with its configured load.
"""

import dataclasses
import math

import numpy as np

from omni_figures.run_figures import scene_of
from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, parameter
from omni_platform.quantities import FloatArray
from omni_sim.configuration import SimulationConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.study import StudyResult, StudyRun
from omni_studies.wheels.spin_translate_figures import draw_commands, draw_snapshots
from omni_studies.wheels.tracking import Tracking

_PLATFORMS = {"mecanum": "mecanum_forklift", "three_wheel": "three_wheel_robot"}
_TITLES = {
    "mecanum": ("Mecanum forklift", "Figure 19", "Figure 20"),
    "three_wheel": ("Three-wheeled robot", "Figure 21", "Figure 22"),
}
_PERIOD = SimulationConfiguration.control_period  # time between two commands [s]
# The vehicle counts as following its command below these.
_POSITION_LIMIT, _HEADING_LIMIT, _SPEED_LIMIT = 0.05, 1.0, 0.05  # [m], [deg], [rad/s]


@dataclasses.dataclass(frozen=True)
class SpinTranslate:
    """The maneuver: reference pose and velocity in closed form.

    Attributes:
        speed: constant velocity along x of the world [m/s].
        amplitude: amplitude of the velocity along y of the world [m/s].
        period: period of the velocity along y [s].
        yaw_rate: constant [rad/s].
    """

    speed: float
    amplitude: float
    period: float
    yaw_rate: float

    def pose(self, time: FloatArray) -> FloatArray:
        """Return x, y [m], yaw [rad] in the world frame at times [s] (T,), shape (T, 3)."""
        wave = 2.0 * math.pi / self.period
        y = self.amplitude / wave * (1.0 - np.cos(wave * time))
        return np.column_stack((self.speed * time, y, self.yaw_rate * time))

    def twist(self, time: FloatArray, yaw: FloatArray) -> FloatArray:
        """Return the twist in the frame of a body with a yaw [rad] (T,), shape (T, 3)."""
        v_x = np.full(time.shape, self.speed)
        v_y = self.amplitude * np.sin(2.0 * math.pi / self.period * time)
        cos, sin = np.cos(yaw), np.sin(yaw)
        rate = np.full(time.shape, self.yaw_rate)
        return np.column_stack((cos * v_x + sin * v_y, cos * v_y - sin * v_x, rate))


def track(
    configuration: VehicleConfiguration, maneuver: SpinTranslate, duration: float
) -> Tracking:
    """Drive the maneuver by inverse kinematics and record the tracking.

    Args:
        configuration: the vehicle.
        maneuver: the reference.
        duration: [s].
    """
    periods = round(duration / _PERIOD)
    time = np.arange(periods + 1, dtype=np.float64) * np.float64(_PERIOD)
    reference = maneuver.pose(time)
    start = maneuver.twist(time[:1], reference[:1, 2])[0]
    vehicle = Vehicle(configuration, pose=reference[0], twist=start)
    steps = round(_PERIOD / vehicle.physics_step)
    # Over a period the drive holds the velocity of its middle, in the direction of the world.
    command = maneuver.twist(time[:-1] + 0.5 * _PERIOD, reference[:-1, 2])
    released = np.zeros(len(configuration.wheels))
    pose, twist, speed = [vehicle.pose], [vehicle.twist], [vehicle.wheels["speed"]]
    for demand in command:
        vehicle.advance(steps, 0.0, released, demand, hold_world_direction=True)
        pose.append(vehicle.pose)
        twist.append(vehicle.twist)
        speed.append(vehicle.wheels["speed"])
    return Tracking(
        wheel_names=vehicle.wheel_names,
        time=time,
        reference=reference,
        pose=np.array(pose),
        twist=np.array(twist),
        wheel_command=vehicle.drive_speeds(maneuver.twist(time, reference[:, 2])),
        wheel_speed=np.array(speed),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """The maneuver."""

    speed: float = parameter(1.0, unit="m/s", minimum=-5.0, maximum=5.0)
    """constant velocity along x of the world"""
    amplitude: float = parameter(0.8, unit="m/s", minimum=-5.0, maximum=5.0)
    """of the velocity along y of the world"""
    period: float = parameter(5.0, unit="s", minimum=0.5, maximum=1000.0)
    """of the velocity along y"""
    yaw_rate_deg: float = parameter(36.0, unit="deg/s", minimum=-180.0, maximum=180.0)
    """constant yaw rate"""
    duration: float = parameter(10.0, unit="s", minimum=0.1, maximum=600.0)
    """time driven"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Drive both platforms and write snapshots, commands, data and tracking errors."""
    maneuver = SpinTranslate(
        options.speed, options.amplitude, options.period, math.radians(options.yaw_rate_deg)
    )
    metrics: dict[str, Metric] = {}
    for name, vehicle in _PLATFORMS.items():
        experiment = study.experiments.load("straight_line", "unassisted", [f"vehicle={vehicle}"])
        tracking = track(experiment.vehicle, maneuver, options.duration)
        title, snapshots, commands = _TITLES[name]
        words = f"{title}: spin while translating (as {snapshots})"
        study.figure(f"snapshots_{name}.png", draw_snapshots(scene_of(experiment), tracking, words))
        words = f"{title}: wheel speeds of the maneuver (as {commands}) and tracking error"
        study.figure(f"commands_{name}.png", draw_commands(tracking, words))
        study.table(f"{name}.csv", *_table(tracking))
        metrics |= _metrics(name, tracking)
    return study.result(metrics)


def _metrics(name: str, tracking: Tracking) -> dict[str, Metric]:
    distance, speed = tracking.position_error, tracking.wheel_error
    heading = np.degrees(tracking.heading_error)
    steps = np.diff(tracking.pose[:, :2], axis=0)
    return {
        f"position_rms.{name}": Metric(_rms(distance), "m", at_most=_POSITION_LIMIT),
        f"position_max.{name}": Metric(float(np.max(distance)), "m"),
        f"heading_rms.{name}": Metric(_rms(heading), "deg", at_most=_HEADING_LIMIT),
        f"heading_max.{name}": Metric(float(np.max(np.abs(heading))), "deg"),
        f"wheel_speed_rms.{name}": Metric(_rms(speed), "rad/s", at_most=_SPEED_LIMIT),
        f"path_length.{name}": Metric(float(np.sum(np.hypot(*steps.T))), "m"),
    }


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _table(tracking: Tracking) -> tuple[list[str], list[list[float]]]:
    """Return the header and one row per control stamp, angles in rad."""
    wheels = tracking.wheel_names
    header = ["time_s", "x_ref_m", "y_ref_m", "yaw_ref_rad", "x_m", "y_m", "yaw_rad"]
    header += [f"{wheel}_command_rad_s" for wheel in wheels]
    header += [f"{wheel}_speed_rad_s" for wheel in wheels]
    reached = tracking.pose, tracking.wheel_command, tracking.wheel_speed
    return header, np.column_stack((tracking.time, tracking.reference, *reached)).tolist()
