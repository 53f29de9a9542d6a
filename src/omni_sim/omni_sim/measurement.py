"""Readings of IMU, encoders and velocity sensor at a stamp, with faults, in one kernel.

The noise at a stamp uses one row of standard normal values. It is therefore the same whether a
program draws the rows one by one or all at once.
"""

from typing import NamedTuple

from omni_core.kernels import by_reference, lean
from omni_core.quantities import SECOND_NS, FloatArray, IntArray
from omni_sim import faults as sensor_faults
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.encoders import Encoders, build_encoders, read_encoders
from omni_sim.imu import IMU_DRAWS, Imu, build_imu, is_due, read_imu
from omni_sim.vehicle.state import Structured


@by_reference
class Instruments(NamedTuple):
    """Constants and state of a vehicle's IMU, encoders and sensor faults."""

    imu: Imu
    encoders: Encoders
    faults: sensor_faults.Faults


class Truth(NamedTuple):
    """True motion of a vehicle at a stamp.

    Attributes:
        step: number of the stamp.
        period_ns: time between two stamps [ns].
        path: x, y [m], yaw [rad] of `base_link` and their time derivatives since the last stamp, in
            equal steps up to the present stamp, or at the present stamp alone, shape (n, 6).
        step_ns: time between two rows of `path` [ns].
        tilt: horizontal components of the normal of the plane in which the vehicle moves [1].
        wheels: true states of the wheels, records `state.WHEEL`, shape (N,).
    """

    step: int
    period_ns: int
    path: FloatArray
    step_ns: float
    tilt: tuple[float, float]
    wheels: Structured


class Readings(NamedTuple):
    """Buffers for the readings of a vehicle's sensors, including the effects of sensor faults.

    Attributes:
        twist: reading of the velocity sensor [m/s, m/s, rad/s], shape (3,).
        imu_ns: stamps of the IMU readings since the last stamp [ns], shape (M,) for at most M
            readings.
        inertial: their yaw rates [rad/s] and specific forces [m/s^2], shape (M, 3).
        wheels: wheel speeds [rad/s], shape (N,).
    """

    twist: FloatArray
    imu_ns: IntArray
    inertial: FloatArray
    wheels: FloatArray


def build_instruments(configuration: SimulatorConfiguration) -> Instruments:
    """Return the constants and initial states of a vehicle's sensors for the kernel."""
    wheels, period_ns = (
        len(configuration.vehicle.wheels),
        configuration.simulation.control_period_ns,
    )
    imu = build_imu(configuration.imu, period_ns)
    return Instruments(
        imu,
        build_encoders(configuration.encoders, wheels),
        sensor_faults.build_faults(
            configuration.faults, wheels, min(period_ns, imu.period_ns) / SECOND_NS
        ),
    )


def draws(instruments: Instruments) -> int:
    """Return the number of standard normal values that all readings at a stamp require."""
    return 2 * (IMU_DRAWS * instruments.imu.most + instruments.encoders.angle.size) + 3


@lean
def measure(instruments: Instruments, truth: Truth, draw: FloatArray, readings: Readings) -> int:
    """Write the readings of all sensors; this function must be called once per stamp.

    Args:
        instruments: sensors, changed in place.
        truth: true motion of the vehicle.
        draw: standard normal noise, shape (`draws`,).
        readings: output, the readings of all sensors.

    Returns:
        Number of IMU readings.
    """
    step, period_ns, _, _, _, turning = truth
    period, count, faults = period_ns / SECOND_NS, turning.size, instruments.faults
    wheel_draw, spare = draw[IMU_DRAWS : IMU_DRAWS + count], draw[IMU_DRAWS + count :]
    read_encoders(instruments.encoders, step, period, turning, wheel_draw, readings.wheels)
    noise = spare[:3], spare[IMU_DRAWS + 3 : IMU_DRAWS + 3 + count]
    if faults.table.shape[0] > 0:
        # A loop is used because numba would compile `corrupt` again for each constant argument.
        channels, values = (
            (sensor_faults.TWIST, sensor_faults.ENCODER),
            (readings.twist, readings.wheels),
        )
        for k in range(len(channels)):
            sensor_faults.corrupt(faults, channels[k], step, step * period_ns, noise[k], values[k])
    first, others = draw[:IMU_DRAWS], spare[IMU_DRAWS + 3 + count :]
    return _measure_inertial(
        instruments, truth, (first, spare[3 : 3 + IMU_DRAWS], others), readings
    )


@lean
def _measure_inertial(
    instruments: Instruments,
    truth: Truth,
    draw: tuple[FloatArray, FloatArray, FloatArray],
    readings: Readings,
) -> int:
    """Write the IMU readings since the last stamp, and return their number.

    The arguments are those of `measure`, except `draw`: noise of the first reading, noise of its
    faults, and both for all other readings, shape (3,), (3,) and (6 M - 6,).
    """
    imu, faults, rows, count = instruments.imu, instruments.faults, truth.path.shape[0], 0
    noise, fault_noise, others = draw
    for k in range(rows):
        stamp_ns = truth.step * truth.period_ns - round((rows - 1 - k) * truth.step_ns)
        if not is_due(imu, stamp_ns):
            continue
        reading, number = readings.inertial[count], imu.counters[1]
        read_imu(imu, stamp_ns, truth.path[k], truth.tilt, noise, reading)
        if faults.table.shape[0] > 0:
            for channel in (sensor_faults.GYRO, sensor_faults.ACCELEROMETER):
                axes = slice(0, 1) if channel == sensor_faults.GYRO else slice(1, 3)
                sensor_faults.corrupt(
                    faults, channel, number, stamp_ns, fault_noise[axes], reading[axes]
                )
        readings.imu_ns[count] = stamp_ns
        noise, fault_noise, others = others[:3], others[3:6], others[6:]
        count += 1
    return count
