"""Combined rotation and translation by inverse kinematics, Figures 19 to 22.

This study repeats the validation of section 2.5.3 with a Mecanum forklift and a three-wheeled
robot. A constant velocity along x of the world, a sinusoidal velocity along y and a constant yaw
rate are converted to wheel speeds by Eqs. (34) and (35). The commands depend on the reference
alone, without feedback of position or heading. The tracking error is therefore the accumulated slip
of the tires. The vehicle starts in motion without slip, with its configured load.

The motion is also measured by two ideal area sensors, Eqs. (73)-(75), or by the first of them and
the forward displacement of the second, Eqs. (76)-(78). While the platform rotates, the
straight-line approximation of section 4.3.1 has an error that accumulates; `along_arc` removes it.
"""

import dataclasses
import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from omni_core.configuration import Configuration, parameter
from omni_core.geometry import turned
from omni_core.quantities import FloatArray
from omni_runs.figures import style
from omni_runs.figures.scene import Scene
from omni_runs.figures.top_view import top_view
from omni_runs.history import RunHistory
from omni_runs.metrics import Metric
from omni_sim.configuration import SimulationConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.study import StudyResult, StudyRun
from omni_tools import two_sensors

_PLATFORMS = {"mecanum": "mecanum_forklift", "three_wheel": "three_wheel_robot"}
_TITLES = {
    "mecanum": ("Mecanum forklift", "Figure 19", "Figure 20"),
    "three_wheel": ("Three-wheeled robot", "Figure 21", "Figure 22"),
}
_PERIOD = SimulationConfiguration.control_period  # time between two commands [s]
_WHEEL_LINES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (4, 1.5, 1, 1.5)), (0, (1.5, 1)))


@dataclasses.dataclass(frozen=True)
class SpinTranslate:
    """Reference motion: constant velocity along x, sinusoidal velocity along y, constant yaw rate.

    Attributes:
        speed: constant velocity along x of the world [m/s].
        amplitude: amplitude of the velocity along y of the world [m/s].
        period: period of the velocity along y [s].
        yaw_rate: constant yaw rate [rad/s].
    """

    speed: float
    amplitude: float
    period: float
    yaw_rate: float

    def pose(self, time: FloatArray) -> FloatArray:
        """Return the reference x, y [m] and yaw [rad] in the world at T times [s], shape (T, 3)."""
        wave = 2.0 * math.pi / self.period
        y = self.amplitude / wave * (1.0 - np.cos(wave * time))
        return np.column_stack((self.speed * time, y, self.yaw_rate * time))

    def twist(self, time: FloatArray, yaw: FloatArray) -> FloatArray:
        """Return the reference twist in the frame of a body [m/s, m/s, rad/s], shape (T, 3).

        Args:
            time: times [s], shape (T,).
            yaw: yaw of the body in the world frame [rad], shape (T,).
        """
        v_x = np.full(time.shape, self.speed)
        v_y = self.amplitude * np.sin(2.0 * math.pi / self.period * time)
        cos, sin = np.cos(yaw), np.sin(yaw)
        rate = np.full(time.shape, self.yaw_rate)
        return np.column_stack((cos * v_x + sin * v_y, cos * v_y - sin * v_x, rate))


@dataclasses.dataclass(frozen=True)
class Tracking:
    """A simulated maneuver and its reference, with T stamps and N wheels.

    Attributes:
        history: time history of the motion; enables and odometry estimates are NaN.
        reference: reference x, y [m], yaw [rad] of `base_link` in the world frame, shape (T, 3).
        wheel_command: wheel speeds from inverse kinematics [rad/s], shape (T, N).
    """

    history: RunHistory
    reference: FloatArray
    wheel_command: FloatArray

    @property
    def position_error(self) -> FloatArray:
        """Distance of `base_link` from the reference position [m], shape (T,)."""
        offset = self.history.pose - self.reference
        return np.asarray(np.hypot(offset[:, 0], offset[:, 1]), dtype=np.float64)

    @property
    def heading_error(self) -> FloatArray:
        """Actual minus reference yaw [rad], shape (T,)."""
        return np.asarray(self.history.pose[:, 2] - self.reference[:, 2], dtype=np.float64)

    @property
    def wheel_error(self) -> FloatArray:
        """Actual minus commanded wheel speeds [rad/s], shape (T, N)."""
        return np.asarray(self.history.wheel_speed - self.wheel_command, dtype=np.float64)


def track(
    configuration: VehicleConfiguration, maneuver: SpinTranslate, duration: float
) -> Tracking:
    """Simulate the maneuver with wheel speeds from inverse kinematics; return motion and reference.

    Args:
        configuration: the vehicle.
        maneuver: the reference.
        duration: duration of the maneuver [s].
    """
    periods = round(duration / _PERIOD)
    time = np.arange(periods + 1, dtype=np.float64) * np.float64(_PERIOD)
    reference = maneuver.pose(time)
    start = maneuver.twist(time[:1], reference[:1, 2])[0]
    vehicle = Vehicle(configuration, pose=reference[0], twist=start)
    steps = round(_PERIOD / vehicle.physics_step)
    # In each period, the command is the reference velocity in the middle of the period.
    command = maneuver.twist(time[:-1] + 0.5 * _PERIOD, reference[:-1, 2])
    released = np.zeros(len(configuration.wheels))
    pose, twist, speed = [vehicle.pose], [vehicle.twist], [vehicle.wheels["speed"]]
    for demand in command:
        vehicle.advance(steps, 0.0, released, demand, hold_world_direction=True)
        pose.append(vehicle.pose)
        twist.append(vehicle.twist)
        speed.append(vehicle.wheels["speed"])
    nothing = np.full_like(speed, np.nan)
    history = RunHistory.from_samples(
        wheel_names=vehicle.wheel_names,
        stamp_ns=np.round(1e9 * time).astype(np.int64),
        pose=pose,
        twist=twist,
        wheel_speed=speed,
        brake_torque=np.zeros_like(nothing),
        pedal=np.zeros(len(time)),
        **dict.fromkeys(("wheel_angle", "enable", "error"), nothing),
    )
    wheel_command = vehicle.drive_speeds(maneuver.twist(time, reference[:, 2]))
    return Tracking(history, reference, wheel_command)


class Options(Configuration):
    """Options of the study ``spin_translate``: the maneuver."""

    speed: float = parameter(1.0, unit="m/s", minimum=-5.0, maximum=5.0)
    """constant velocity along x of the world"""
    amplitude: float = parameter(0.8, unit="m/s", minimum=-5.0, maximum=5.0)
    """amplitude of the velocity along y of the world"""
    period: float = parameter(5.0, unit="s", minimum=0.5, maximum=1000.0)
    """period of the velocity along y of the world"""
    yaw_rate_deg: float = parameter(36.0, unit="deg/s", minimum=-180.0, maximum=180.0)
    """constant yaw rate"""
    duration: float = parameter(10.0, unit="s", minimum=0.1, maximum=600.0)
    """duration of the maneuver"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Simulate both platforms; write snapshots, commands, data and tracking errors."""
    maneuver = SpinTranslate(
        options.speed, options.amplitude, options.period, math.radians(options.yaw_rate_deg)
    )
    metrics: dict[str, Metric] = {}
    for name, vehicle in _PLATFORMS.items():
        experiment = study.experiments.load("straight_line", "unassisted", [f"vehicle={vehicle}"])
        tracking = track(experiment.vehicle, maneuver, options.duration)
        title, snapshots, commands = _TITLES[name]
        words = f"{title}: spin while translating (as {snapshots})"
        study.plot(f"snapshots_{name}", _draw_snapshots(Scene.of(experiment), tracking, words))
        words = f"{title}: wheel speeds of the maneuver (as {commands}) and tracking error"
        study.plot(f"commands_{name}", _draw_commands(tracking, words))
        metrics |= _metrics(name, tracking)
    return study.result(metrics)


def _metrics(name: str, tracking: Tracking) -> dict[str, Metric]:
    distance, speed = tracking.position_error, tracking.wheel_error
    heading = np.degrees(tracking.heading_error)
    steps = np.diff(tracking.history.pose[:, :2], axis=0)
    return {
        f"position_rms.{name}": Metric(_rms(distance), "m"),
        f"position_max.{name}": Metric(float(np.max(distance)), "m"),
        f"heading_rms.{name}": Metric(_rms(heading), "deg"),
        f"heading_max.{name}": Metric(float(np.max(np.abs(heading))), "deg"),
        f"wheel_speed_rms.{name}": Metric(_rms(speed), "rad/s"),
        f"path_length.{name}": Metric(float(np.sum(np.hypot(*steps.T))), "m"),
        **{
            f"two_sensor_error.{name}_{path}": Metric(error, "m")
            for path, error in two_sensor_errors(tracking).items()
        },
    }


def two_sensor_errors(tracking: Tracking, apart: float = 0.4) -> dict[str, float]:
    """Return the errors of the final position from dead reckoning with two area sensors [m].

    They are keyed by method: ``straight`` for Eqs. (73)-(75), ``arc`` for the same equations with
    `along_arc`, ``first_sensor`` for Eqs. (76)-(78) with `along_arc`.

    Args:
        tracking: the motion; each sensor measures its path along its own axes in every period.
        apart: distance of each sensor from the platform center, to the left and to the right [m].
    """
    ends = dict.fromkeys(("straight", "arc", "first_sensor"), tracking.history.pose[0])
    for twist in 0.5 * _PERIOD * (tracking.history.twist[1:] + tracking.history.twist[:-1]):
        x, y, turn = twist.tolist()
        left, right = (
            two_sensors.SensorDisplacement(x + side * turn, y) for side in (-apart, apart)
        )
        step = two_sensors.two_sensor_displacement(left, right, apart, apart)
        first = (
            two_sensors.first_sensor_displacement(left, right.x, 2.0 * apart)
            .along_arc()
            .at(0.0, -apart)
        )
        for path, moved in zip(ends, (step, step.along_arc(), first), strict=True):
            yaw = ends[path][2]
            ends[path] = ends[path] + np.append(turned(np.array(moved[:2]), yaw), moved.angle)
    return {path: math.dist(end[:2], tracking.history.pose[-1, :2]) for path, end in ends.items()}


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _draw_snapshots(scene: Scene, tracking: Tracking, title: str) -> Figure:
    """Draw the platform at several times on its path, as in Figures 19 and 21."""
    figure = top_view(scene, {"": tracking.history}, title=title)
    (axes,) = figure.axes
    axes.set_title("")
    look: dict[str, Any] = {"color": style.SKY, "linewidth": 4.0, "zorder": 7.9}
    axes.plot(*tracking.reference[:, :2].T, label="reference path", **look)
    axes.legend(loc="upper left")
    return figure


def _draw_commands(tracking: Tracking, title: str) -> Figure:
    """Draw wheel-speed commands (as in Figures 20 and 22) and the tracking errors over time."""
    y = ("wheel speed [rad/s]", "position\nerror [mm]", "heading\nerror [deg]")
    size, heights = (style.PAGE_WIDTH, 8.5), (3.0, 1.0, 1.0)
    figure, ((commands,), (position,), (heading,)) = style.panels(
        title, 3, size=size, x="time [s]", y=y, sharex=True, height_ratios=heights
    )
    history, time = tracking.history, tracking.history.time
    for row, name in enumerate(history.wheel_names):
        look: dict[str, Any] = {"color": style.wheel_color(row), "linewidth": 2.2}
        look["label"] = f"command {row + 1}, {name.replace('_', ' ')}"
        look["linestyle"] = _WHEEL_LINES[row % len(_WHEEL_LINES)]
        commands.plot(time, tracking.wheel_command[:, row], **look)
        reached = None if row else "wheel speed reached"
        thin: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8, "zorder": 3}
        commands.plot(time, history.wheel_speed[:, row], label=reached, **thin)
    position.plot(time, 1000.0 * tracking.position_error, color=style.BLACK)
    heading.plot(time, np.degrees(tracking.heading_error), color=style.BLACK)
    heading.set_xlim(time[0], time[-1])
    style.legend_below(figure, 6)
    return figure
