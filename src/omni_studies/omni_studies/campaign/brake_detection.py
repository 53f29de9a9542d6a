"""When the loss of a brake could be observed, and when the assistant reports it."""

import math
from typing import NamedTuple

import numpy as np

from omni_brake_assist.conditions import CONDITIONS, AssistState
from omni_core.geometry import PlatformGeometry
from omni_runs.experiment import ExperimentConfiguration
from omni_runs.history import FastRun
from omni_sim.vehicle.plausibility import wheel_facts

_DEVIATIONS = 3.0  # observable change of acceleration, in standard deviations of the IMU [1]
_SLOWEST = 1.0  # speed below which a loss has little effect on the stop [m/s]
_FAILED = [k for k, row in enumerate(CONDITIONS) if row.state is AssistState.FAILED_BRAKE]


class Detection(NamedTuple):
    """Detection of a lost brake; the attributes are those of `StopWithFault`."""

    observable: float
    found: float


UNKNOWN = Detection(math.nan, math.nan)
"""Detection in a stop that loses no brake."""


def detection(run: FastRun, base: ExperimentConfiguration, wheel: int, time: float) -> Detection:
    """Return when a loss could be observed, and when it is reported [s after the loss].

    The loss can be observed from the first stamp on at which the vehicle is faster than 1 m/s, and
    the commanded force of the brake would change deceleration or yaw acceleration by three standard
    deviations of an IMU, whether the vehicle has one or not. The friction of the ground limits this
    force.

    Args:
        run: stop that loses the brake.
        base: experiment without the loss.
        wheel: index of the wheel.
        time: time of the loss after the start of the run [s].
    """
    vehicle, imu = base.vehicle, base.imu
    geometry = PlatformGeometry.from_wheels(vehicle.wheels).seen_from(vehicle.masses.center)
    fact = list(wheel_facts(vehicle, base.ground.friction).values())[wheel]
    torque = run.pedal * run.enable[:, wheel] * vehicle.brake.max_torque
    force = np.minimum(torque / abs(geometry.rim[wheel]), fact.grip)
    turn = force * abs(geometry.lever[wheel]) / vehicle.masses.yaw_inertia
    # The yaw acceleration is the difference of two readings of the gyro.
    rate = math.sqrt(2.0) * imu.gyro_noise / base.simulation.control_period
    changes = np.maximum(force / vehicle.masses.mass / imu.noise, turn / rate)
    since = 1e-9 * run.stamp_ns - time
    fast = np.hypot(run.twist[:, 0], run.twist[:, 1]) > _SLOWEST
    failed = np.isin(run.condition, _FAILED) & (run.failed == wheel)
    return Detection(_first(since, fast & (changes > _DEVIATIONS)), _first(since, failed))


def _first(since: np.ndarray, found: np.ndarray) -> float:
    """Return the first time at or after 0 at which something is found [s], or NaN."""
    times = since[found & (since >= -1e-9)]
    return float(times[0]) if times.size else math.nan
