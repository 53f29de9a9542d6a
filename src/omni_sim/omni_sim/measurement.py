"""Readings of IMU, encoders and velocity sensor at a stamp, with faults, in one kernel.

The noise at a stamp uses one row of standard normal values. It is therefore the same whether a
program draws the rows one by one or all at once.

Wheel encoders: mean speed of each wheel over a control period, from integer counts.

A reading is ``(floor(theta / q) - floor(theta_before / q)) q / T`` plus white noise. ``theta`` is
the angle of the wheel at the stamp, ``theta_before`` the angle at the previous stamp, ``T`` the
time between both stamps, and ``q`` the angle of one count. With infinite resolution, a reading is
the true speed at the stamp plus noise.

Inertial measurement unit (IMU): yaw rate and specific force at its mounting position.

A reading of the accelerometer is the mean since the previous reading, as in an IMU that averages
its samples. The specific force in the body axes at the middle of this period is

    f = R(psi)^T ((V - V_before) / T - g)

``V`` and ``V_before`` are the velocities of the mounting position in the ground plane, at the end
and at the start of the period ``T``. ``R(psi)`` is the rotation by the yaw angle, and ``g`` the
component of gravity along the ground plane, which may slope. The reading is ``f``, rotated by the
error of the mounting angle. The gyro gives the yaw rate at the stamp. Both sensors have a scale
error, a bias, white noise and a latency. The nodes that receive the readings do not know these
errors. The noise has a constant density, so more frequent readings are noisier.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.kernels import by_reference, kernel, lean, linked
from omni_core.quantities import GRAVITY, SECOND_NS, FloatArray, IntArray
from omni_core.signals import ImuSample
from omni_sim import faults as sensor_faults
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.sensor_configuration import EncoderConfiguration, ImuConfiguration
from omni_sim.vehicle.state import State, Structured
from omni_sim.velocity_sensor import VelocitySensor

IMU_DRAWS = 3
"""Number of standard normal values that a reading needs."""


@by_reference
class Imu(NamedTuple):
    """Constants and state of the IMU, in the form that the kernel uses.

    Attributes:
        enabled: whether the vehicle has an IMU.
        period_ns: time between two readings [ns].
        most: limit on the number of readings in a control period.
        x: mounting position, forward of base_link [m].
        y: mounting position, left of base_link [m].
        cos: cosine of the error of the mounting angle [1].
        sin: sine of the error of the mounting angle [1].
        rate: bias [rad/s], noise [rad/s] and scale error [1] of the gyro, shape (3,).
        force: bias of x and y [m/s^2], noise [m/s^2] and scale error [1] of the accelerometer,
            shape (4,).
        memory: yaw [rad] and velocity of the mounting position [m/s] at the last reading, shape
            (3,).
        counters: stamp of the last reading [ns] and number of readings, shape (2,).
        late: latest readings, a ring buffer, shape (latency in readings + 1, 3).
    """

    enabled: bool
    period_ns: int
    most: int
    x: float
    y: float
    cos: float
    sin: float
    rate: FloatArray
    force: FloatArray
    memory: FloatArray
    counters: IntArray
    late: FloatArray


def build_imu(configuration: ImuConfiguration, control_period_ns: int) -> Imu:
    """Return the constants and the initial state of the IMU for the kernel.

    Args:
        configuration: mounting and errors of the IMU.
        control_period_ns: control period [ns].
    """
    c = configuration
    angle, period_ns = math.radians(c.misalignment_deg), c.period_ns(control_period_ns)
    factor, most = c.noise_factor(control_period_ns), -(-control_period_ns // period_ns)
    rate = np.array([c.gyro_bias, factor * c.gyro_noise, c.gyro_scale])
    force = np.array([c.bias_x, c.bias_y, factor * c.noise, c.scale])
    late = np.zeros((round(c.latency * SECOND_NS / period_ns) + 1, 3))
    cos, sin = math.cos(angle), math.sin(angle)
    memory, counters = np.zeros(3), np.zeros(2, np.int64)
    return Imu(c.enabled, period_ns, most, c.x, c.y, cos, sin, rate, force, memory, counters, late)


class Encoders(NamedTuple):
    """Constants and state of the wheel encoders, in the form that the kernel uses.

    Attributes:
        angle_step: angle of a count [rad], 0 for infinite resolution.
        noise: standard deviation of a reading [rad/s].
        angle: wheel angle at the last stamp, rounded down to counts [rad], shape (N,).
    """

    angle_step: float
    noise: float
    angle: FloatArray


def build_encoders(configuration: EncoderConfiguration, wheels: int) -> Encoders:
    """Return the constants and the initial state of the encoders for the kernel."""
    resolution = configuration.resolution
    count = 2.0 * math.pi / resolution if resolution else 0.0
    return Encoders(count, configuration.noise, np.zeros(wheels))


@by_reference
class Instruments(NamedTuple):
    """Constants and state of a vehicle's IMU, encoders and sensor faults.

    Attributes:
        imu: IMU.
        encoders: encoders of the wheels.
        faults: faults of the sensors.
        draws: number of standard normal values that all readings at a stamp require.
    """

    imu: Imu
    encoders: Encoders
    faults: sensor_faults.Faults
    draws: int


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
        2 * (IMU_DRAWS * imu.most + wheels) + 3,
    )


class Sensors:
    """Velocity sensor, IMU and encoders of a vehicle, which are read once per control stamp.

    Attributes:
        path: motion since the last stamp, `Truth.path`; changed by the owner if the IMU has a rate
            of its own.
        twist: last reading of the velocity sensor.
        imu: IMU readings between the last two stamps; NaN if the vehicle has no IMU.
        wheel_speed: last readings of the encoders [rad/s], shape (N,).
    """

    def __init__(
        self,
        configuration: SimulatorConfiguration,
        velocity_seed: np.random.SeedSequence,
        instrument_seed: np.random.SeedSequence,
    ) -> None:
        """Create sensors that have not been read yet.

        Args:
            configuration: configuration of the simulator.
            velocity_seed: seed of the velocity sensor's noise.
            instrument_seed: seed of the noise of IMU and encoders.
        """
        self._velocity = VelocitySensor(
            configuration.velocity_sensor, np.random.default_rng(velocity_seed)
        )
        self._instruments = build_instruments(configuration)
        self._noise = np.random.default_rng(instrument_seed)
        self._period_ns = configuration.simulation.control_period_ns
        self._step_ns = self._period_ns / configuration.simulation.steps_per_period
        self._stamp_ns = -1
        self.path: FloatArray = np.zeros((1, 6))

    def measure(self, stamp_ns: int, motion: FloatArray, state: State) -> None:
        """Read all sensors, unless they have already been read at this stamp.

        Args:
            stamp_ns: time since the start of the run [ns].
            motion: pose and twist of the vehicle, `Vehicle.motion`.
            state: state of the vehicle.
        """
        if self._stamp_ns == stamp_ns:
            return
        self._stamp_ns = stamp_ns
        instruments = self._instruments
        self.twist = self._velocity.measure(stamp_ns, motion[3:])
        self.wheel_speed: FloatArray = np.empty(len(state.wheels))
        imu_ns, inertial = (
            np.empty(instruments.imu.most, np.int64),
            np.empty((instruments.imu.most, 3)),
        )
        if len(self.path) == 1:
            write_world(motion, self.path[0])
        step = stamp_ns // self._period_ns
        tilt = float(state.body["tilt_x"][0]), float(state.body["tilt_y"][0])
        count = measure(
            instruments,
            Truth(step, self._period_ns, self.path, self._step_ns, tilt, state.wheels),
            self._noise.standard_normal(instruments.draws),
            Readings(self.twist.value, imu_ns, inertial, self.wheel_speed),
        )
        self.imu = tuple(
            ImuSample(int(taken_ns), float(rate), np.array(force))
            for taken_ns, (rate, *force) in zip(imu_ns[:count], inertial[:count], strict=True)
        )
        # Faults may have changed the reading.
        self._velocity.state_covariance(self.twist.value, self.twist.covariance)


@linked
@lean
def measure(instruments: Instruments, truth: Truth, draw: FloatArray, readings: Readings) -> int:
    """Write the readings of all sensors; this function must be called once per stamp.

    Args:
        instruments: sensors, changed in place.
        truth: true motion of the vehicle.
        draw: standard normal noise, shape (`Instruments.draws`,).
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
        last_ns, number = imu.counters
        if number > 0 and stamp_ns // imu.period_ns <= last_ns // imu.period_ns:
            continue  # a reading is taken at the first stamp at or after its due time
        reading = readings.inertial[count]
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


@lean
def read_encoders(
    encoders: Encoders,
    step: int,
    period: float,
    wheels: Structured,
    draw: FloatArray,
    reading: FloatArray,
) -> None:
    """Write the readings of the encoders; this function must be called once per stamp.

    Args:
        encoders: encoders, changed in place.
        step: number of the stamp. At the first stamp, no previous angle exists, so the reading is
            the true speed.
        period: time between two stamps [s].
        wheels: true states of the wheels, records `state.WHEEL`, shape (N,).
        draw: standard normal noise, shape (N,).
        reading: output, the wheel speeds [rad/s], shape (N,).
    """
    for i in range(wheels.size):
        reading[i] = wheels[i].speed
        if encoders.angle_step > 0.0:
            whole = math.floor(wheels[i].angle / encoders.angle_step) * encoders.angle_step
            if step > 0:
                reading[i] = (whole - encoders.angle[i]) / period
            encoders.angle[i] = whole
        reading[i] += encoders.noise * draw[i]


@lean
def write_world(motion: FloatArray, row: FloatArray) -> None:
    """Write a motion with its velocity in world axes to `row`.

    Args:
        motion: x, y [m], yaw [rad] and body twist [m/s, m/s, rad/s] of `base_link`, shape (6,).
        row: output, x, y [m], yaw [rad] and their time derivatives, shape (6,).
    """
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    row[0], row[1], row[2], row[5] = motion[0], motion[1], motion[2], motion[5]
    row[3] = cos * motion[3] - sin * motion[4]
    row[4] = sin * motion[3] + cos * motion[4]


@kernel
def read_imu(
    imu: Imu,
    stamp_ns: int,
    motion: FloatArray,
    tilt: tuple[float, float],
    draw: FloatArray,
    reading: FloatArray,
) -> None:
    """Take a reading of the IMU.

    Args:
        imu: IMU, changed in place.
        stamp_ns: stamp of the reading [ns].
        motion: x, y [m], yaw [rad] of `base_link` and their time derivatives, shape (6,).
        tilt: horizontal components of the normal of the plane in which the vehicle moves [1].
        draw: standard normal noise, shape (3,).
        reading: output, yaw rate [rad/s] and specific force along x and y [m/s^2], shape (3,); NaN
            if the vehicle has no IMU.
    """
    (last_ns, count), counters = imu.counters, imu.counters
    counters[0], counters[1] = stamp_ns, count + 1
    if not imu.enabled:
        reading[:] = math.nan
        return
    yaw, rate = motion[2], motion[5]
    cos, sin = math.cos(yaw), math.sin(yaw)
    world_x = motion[3] - rate * (cos * imu.y + sin * imu.x)
    world_y = motion[4] + rate * (cos * imu.x - sin * imu.y)
    f_x, f_y = -GRAVITY * tilt[0], -GRAVITY * tilt[1]
    middle = yaw
    if count > 0:
        period = (stamp_ns - last_ns) * 1e-9
        f_x += (world_x - imu.memory[1]) / period
        f_y += (world_y - imu.memory[2]) / period
        middle = 0.5 * (yaw + imu.memory[0])
    imu.memory[0], imu.memory[1], imu.memory[2] = yaw, world_x, world_y
    cos, sin = math.cos(middle), math.sin(middle)
    body_x, body_y = cos * f_x + sin * f_y, cos * f_y - sin * f_x
    bias_x, bias_y, noise, scale = imu.force[0], imu.force[1], imu.force[2], 1.0 + imu.force[3]
    late = imu.late.shape[0]
    now = imu.late[count % late]
    now[0] = (1.0 + imu.rate[2]) * rate + imu.rate[0] + imu.rate[1] * draw[0]
    now[1] = scale * (imu.cos * body_x + imu.sin * body_y) + bias_x + noise * draw[1]
    now[2] = scale * (imu.cos * body_y - imu.sin * body_x) + bias_y + noise * draw[2]
    # Before the first delayed reading is due, the oldest reading is repeated.
    due = imu.late[max(count - late + 1, 0) % late]
    for axis in range(3):
        reading[axis] = due[axis]
