"""Trials that compare wheel models by forces and motions of a vehicle.

The forces of individual rollers depend on the wheel angle. Every trial is therefore repeated from
several random initial angles, and the means of forces and motions are compared.
"""

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from omni_core.quantities import GRAVITY, FloatArray
from omni_runs.experiment import changed
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import DEFAULT_PHYSICS_STEP, Vehicle

SINGLE, CONTACT, ROLLERS = "single", "roller_contact", "rollers"


@dataclasses.dataclass(frozen=True)
class WheelTrial:
    """Initial motion and inputs of a vehicle, which is simulated with several wheel models.

    Attributes:
        title: title for figures.
        twist: initial body twist, without slip [m/s, m/s, rad/s].
        command: commanded body twist while the pedal is up [m/s, m/s, rad/s].
        pedal: position of the brake pedal, 0 to 1.
        released: whether the brakes are released.
        push: force at the center of gravity, as a multiple of the vehicle's weight [1], in the
            initial body frame.
        duration: duration of the trial [s].
    """

    title: str
    twist: tuple[float, float, float] = (0.0, 0.0, 0.0)
    command: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pedal: float = 0.0
    released: bool = False
    push: tuple[float, float] = (0.0, 0.0)
    duration: float = 2.0


TRIALS = {
    "drive": WheelTrial("Drive forward to 2 m/s", command=(2.0, 0.0, 0.0), duration=1.5),
    "drive_sideways": WheelTrial("Drive sideways to 2 m/s", command=(0.0, 2.0, 0.0), duration=1.5),
    "brake": WheelTrial("Full braking from 5 m/s", twist=(5.0, 0.0, 0.0), pedal=1.0),
    "brake_gently": WheelTrial(
        "Partial braking (15 % pedal) from 5 m/s", twist=(5.0, 0.0, 0.0), pedal=0.15, duration=1.5
    ),
    "push": WheelTrial(
        "Pushed sideways, wheels free", pedal=0.1, released=True, push=(0.0, 0.15), duration=2.0
    ),
    "push_braked": WheelTrial(
        "Pushed sideways, wheels locked", pedal=1.0, push=(0.0, 1.5), duration=1.0
    ),
}


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Results of a trial, one row for each initial wheel angle.

    Attributes:
        time: time of the samples [s], shape (T,).
        motion: x, y [m], yaw [rad], v_x, v_y [m/s] and yaw rate [rad/s] of base_link in the world,
            shape (S, T, 6).
        force: mean force of all wheels on the vehicle over the trial, in the world [N],
            shape (S, 2).
        force_scale: mean magnitude of the sum of the wheel forces, or of the push if this is larger
            [N].
    """

    time: FloatArray
    motion: FloatArray
    force: FloatArray
    force_scale: float


def with_wheels(
    configuration: VehicleConfiguration, model: str, rollers: int
) -> VehicleConfiguration:
    """Return a copy of a vehicle's configuration with another wheel model.

    Args:
        configuration: the vehicle.
        model: `SINGLE`, `CONTACT` or `ROLLERS`.
        rollers: number of rollers of each wheel.
    """
    return changed(
        configuration,
        wheel_model="rollers" if model == ROLLERS else "single",
        contact="roller" if model == CONTACT else "ideal",
        rollers={"count": rollers},
    )


def start(
    configuration: VehicleConfiguration,
    trial: WheelTrial,
    wheel_angle: FloatArray | float = 0.0,
    physics_step: float = DEFAULT_PHYSICS_STEP,
) -> Vehicle:
    """Return the vehicle in the initial state of a trial.

    Args:
        configuration: the vehicle.
        trial: the trial.
        wheel_angle: initial angle of the wheels [rad], a number or shape (N,).
        physics_step: step of the physics [s].
    """
    vehicle = Vehicle(
        configuration, physics_step=physics_step, twist=trial.twist, wheel_angle=wheel_angle
    )
    vehicle.push(np.array(trial.push) * vehicle.masses.mass * GRAVITY)
    return vehicle


def advance(vehicle: Vehicle, trial: WheelTrial, duration: float) -> FloatArray:
    """Advance a vehicle by a duration [s] with the inputs of a trial.

    Returns:
        Trajectory as returned by `Vehicle.advance`, with one row per physics step.
    """
    enable = np.zeros if trial.released else np.ones
    steps, shares = round(duration / vehicle.physics_step), enable(len(vehicle.wheel_names))
    return vehicle.advance(steps, trial.pedal, shares, trial.command)


def outcome(
    configuration: VehicleConfiguration, trial: WheelTrial, angles: FloatArray, thinning: int = 10
) -> Outcome:
    """Run a trial from several initial wheel angles.

    Args:
        configuration: the vehicle.
        trial: the trial.
        angles: initial wheel angles [rad], shape (S, N).
        thinning: number of steps between two samples of the motion.
    """
    motion, force, scale = [], [], []
    for start_angle in angles:
        vehicle = start(configuration, trial, start_angle)
        path = advance(vehicle, trial, trial.duration)
        # The impulse of the wheels is the change of momentum of the center of gravity, minus the
        # impulse of the push.
        center = vehicle.masses.center
        gained = _center_velocity(path[-1], center) - _center_velocity(path[0], center)
        push = np.array(trial.push) * vehicle.masses.mass * GRAVITY
        mean = vehicle.masses.mass * gained / trial.duration - push
        motion.append(path[::thinning])
        force.append(mean)
        scale.append(max(float(np.linalg.norm(mean)), float(np.linalg.norm(push))))
    step = DEFAULT_PHYSICS_STEP * thinning
    time = np.arange(len(motion[0]), dtype=np.float64) * step
    return Outcome(time, np.array(motion), np.array(force), float(np.mean(scale)))


def _center_velocity(row: FloatArray, center: FloatArray) -> FloatArray:
    """Return the velocity of the center of gravity in the world [m/s], shape (2,).

    Args:
        row: pose and velocity of base_link in the world, a row of `Outcome.motion`, shape (6,).
        center: center of gravity in the body frame [m], shape (2,).
    """
    cos, sin = math.cos(row[2]), math.sin(row[2])
    g_x, g_y = cos * center[0] - sin * center[1], sin * center[0] + cos * center[1]
    return np.array([row[3] - row[5] * g_y, row[4] + row[5] * g_x])


def motion_difference(one: Outcome, other: Outcome) -> float:
    """Return the relative difference between the mean final positions of two outcomes [1].

    The distance between the positions is divided by the distance of `other` from the start.
    """
    a, b = one.motion[:, -1, :2].mean(axis=0), other.motion[:, -1, :2].mean(axis=0)
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def force_difference(one: Outcome, other: Outcome) -> float:
    """Return the difference of the mean forces as a share of `other.force_scale` [1]."""
    difference = one.force.mean(axis=0) - other.force.mean(axis=0)
    return float(np.linalg.norm(difference) / other.force_scale)


def start_angles(starts: int, wheels: int, seed: int) -> FloatArray:
    """Return random initial wheel angles over a full turn [rad], shape (starts, wheels)."""
    return np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (starts, wheels))


def stopping_distance(
    configuration: VehicleConfiguration,
    trial: WheelTrial,
    physics_step: float,
    wheel_angle: FloatArray | float = 0.0,
) -> float:
    """Return the distance between the first and last position in a trial [m].

    The arguments are those of `start`.
    """
    vehicle = start(configuration, trial, wheel_angle, physics_step)
    return float(np.linalg.norm(advance(vehicle, trial, trial.duration)[-1, :2]))


def movement(
    configuration: VehicleConfiguration,
    trial: WheelTrial,
    settling: float,
    wheel_angle: FloatArray | float = 0.0,
) -> tuple[float, float]:
    """Return how far a vehicle moves before and after it comes to rest with the brakes on.

    Args:
        configuration: the vehicle.
        trial: inputs; the duration of the trial is ignored.
        settling: time until the vehicle has come to rest [s].
        wheel_angle: initial angle of the wheels [rad], a number or shape (N,).

    Returns:
        Distance from the start to the place of rest [m]; largest displacement in the following
        minute [m].
    """
    vehicle = start(configuration, trial, wheel_angle)
    rest = advance(vehicle, trial, settling)[-1, :2]
    path = advance(vehicle, trial, 60.0)[:, :2]
    return float(np.linalg.norm(rest)), float(np.max(np.linalg.norm(path - rest, axis=1)))


def force_trace(
    configuration: VehicleConfiguration, wheel: int, turns: float
) -> tuple[FloatArray, FloatArray]:
    """Return the force of a wheel while the vehicle moves at 1 m/s against a constant push.

    The push points backward and equals a fifth of the vehicle's weight.

    Args:
        configuration: the vehicle.
        wheel: index of the wheel.
        turns: angle over which the force is recorded [rad].

    Returns:
        Angle of the wheel [rad], shape (T,), and its force on the vehicle in the body frame [N],
        shape (T, 2).
    """
    angle, force = [], []
    for vehicle in pulled(configuration, wheel, turns):
        angle.append(vehicle.wheels["angle"][wheel])
        force.append(vehicle.wheel_force_body[wheel])
    return np.array(angle), np.array(force)


def pulled(configuration: VehicleConfiguration, wheel: int, turns: float) -> Iterator[Vehicle]:
    """Yield the vehicle after each step of the motion of `force_trace`; same arguments."""
    trial = WheelTrial(
        "pull", twist=(1.0, 0.0, 0.0), command=(1.0, 0.0, 0.0), push=(-0.2, 0.0), duration=2.0
    )
    vehicle = start(configuration, trial)
    advance(vehicle, trial, trial.duration)
    first = vehicle.wheels["angle"][wheel]
    while abs(vehicle.wheels["angle"][wheel] - first) < turns:
        advance(vehicle, trial, vehicle.physics_step)
        yield vehicle
