"""Readings of IMU, encoders and velocity sensor at a stamp, with faults, in one kernel.

The noise at a stamp uses one row of standard normal values. It is therefore the same whether a
program draws the rows one by one or all at once.
"""

from typing import NamedTuple

from omni_platform.kernels import lean
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.encoders import Encoders, build_encoders, read_encoders
from omni_sim.faults import CHANNELS, Faults, build_faults, corrupt
from omni_sim.imu import IMU_DRAWS, Imu, build_imu, read_imu
from omni_sim.vehicle.state import Structured


class Instruments(NamedTuple):
    """Constants and state of a vehicle's IMU, encoders and sensor faults."""

    imu: Imu
    encoders: Encoders
    faults: Faults


class Truth(NamedTuple):
    """True motion of a vehicle at a stamp.

    Attributes:
        step: number of the stamp.
        period_ns: time between two stamps [ns].
        motion: x, y [m], yaw [rad] and body twist [m/s, m/s, rad/s] of `base_link`, shape (6,).
        tilt: horizontal components of the normal of the plane in which the vehicle moves [1].
        wheels: true states of the wheels, records `state.WHEEL`, shape (N,).
    """

    step: int
    period_ns: int
    motion: FloatArray
    tilt: tuple[float, float]
    wheels: Structured


class Readings(NamedTuple):
    """Buffers for the readings of a vehicle's sensors, including the effects of sensor faults.

    Attributes:
        twist: reading of the velocity sensor [m/s, m/s, rad/s], shape (3,).
        inertial: yaw rate [rad/s] and specific force [m/s^2], shape (3,).
        wheels: wheel speeds [rad/s], shape (N,).
    """

    twist: FloatArray
    inertial: FloatArray
    wheels: FloatArray


def build_instruments(configuration: SimulatorConfiguration) -> Instruments:
    """Return the constants and initial states of a vehicle's sensors for the kernel."""
    wheels = len(configuration.vehicle.wheels)
    return Instruments(
        build_imu(configuration.imu, configuration.simulation.control_period),
        build_encoders(configuration.encoders, wheels),
        build_faults(configuration.faults, wheels, configuration.simulation.control_period),
    )


def draws(wheels: int) -> int:
    """Return the number of standard normal values that all readings at a stamp require.

    Args:
        wheels: number of wheels.
    """
    return 2 * (IMU_DRAWS + wheels) + 3


@lean
def measure(instruments: Instruments, truth: Truth, draw: FloatArray, readings: Readings) -> None:
    """Write the readings of all sensors; this function must be called once per stamp.

    Args:
        instruments: sensors, changed in place.
        truth: true motion of the vehicle.
        draw: standard normal noise, shape (`draws(N)`,).
        readings: output, the readings of all sensors.
    """
    step, period_ns, motion, tilt, turning = truth
    twist, inertial, wheels = readings
    period, count = period_ns / SECOND_NS, turning.size
    wheel_draw, spare = draw[IMU_DRAWS : IMU_DRAWS + count], draw[IMU_DRAWS + count :]
    read_imu(instruments.imu, step, period, motion, tilt, draw[:IMU_DRAWS], inertial)
    read_encoders(instruments.encoders, step, period, turning, wheel_draw, wheels)
    faults = instruments.faults
    if faults.table.shape[0] > 0:
        # The order is that of the channels. A loop is used because numba would compile `corrupt`
        # again for each constant argument.
        noise = spare[0:3], spare[3:4], spare[4:6], spare[6:]
        values = twist, inertial[:1], inertial[1:], wheels
        for channel in range(len(CHANNELS)):
            corrupt(faults, channel, step, step * period_ns, noise[channel], values[channel])
