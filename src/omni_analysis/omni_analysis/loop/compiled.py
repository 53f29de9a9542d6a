"""The closed loop on the velocity sensor as one compiled kernel, for campaigns of many runs.

Vehicle and control law are those of the simulator and of the brake assistant, the same compiled
functions, behind the fail-safe of `fast_fail_safe`; what is left out is what such a run does not
need: line cameras, odometry and messages. A run gives the same bits as
`closed_loop.run_closed_loop` with ``feedback: velocity_sensor``.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_analysis.loop.experiment import ExperimentConfiguration
from omni_analysis.loop.fast_fail_safe import CLOCK_SIZE, TRUSTED, Judge, judge, make_judge
from omni_analysis.loop.history import RunHistory
from omni_brake_assist.braking_line import LINE_SIZE, forget_line
from omni_brake_assist.control_law import MEMORY_SIZE, ControlLaw, control_law, control_step
from omni_brake_assist.sliding_manifold import SlidingManifold
from omni_brake_assist.valve_dwell import VALVE_SIZE
from omni_brake_assist.weighting import weighting_function
from omni_platform.configuration import ConfigurationError
from omni_sim.driver.scripted import ScriptedDriver, in_turned_frame
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle import dynamics
from omni_sim.vehicle.base_motion import base_motion
from omni_sim.vehicle.factory import build_vehicle
from omni_sim.vehicle.roller_dynamics import Rollers, roller_energies
from omni_sim.vehicle.vehicle import KernelState
from omni_sim.wheel.brake_pressure import brake_torques

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Columns of the record of the body: pose, twist, feedback, trust, energy; and of each wheel.
_BODY_COLUMNS = 11
_TRUST, _STORED = 9, 10
_ANGLE, _SPEED, _TORQUE, _ENABLE, _ERROR = range(5)
_WHEEL_COLUMNS = 5


@dataclasses.dataclass(frozen=True, eq=False)
class FastRun:
    """Time histories of one run, T control stamps and N wheels.

    Attributes:
        wheel_names: of the columns.
        period_ns: control period [ns].
        pedal: the driver's brake demand 0..1, shape (T,).
        body: x, y, yaw of `base_link` in `odom` [m, m, rad], its twist in the body frame, the
            twist that the assistant was told [m/s, m/s, rad/s], whether it trusted it [1], and the
            energy of motion and of the tires' deflection [J], shape (T, 11).
        wheels: angle [rad], speed [rad/s], brake torque [N m], enable [1] and error s_i [m/s],
            shape (T, N, 5).
        stopped: whether the vehicle came to rest within the limit of the duration.
        tipping_steps: physics steps in which the vehicle would have tipped over.
    """

    wheel_names: tuple[str, ...]
    period_ns: int
    pedal: FloatArray
    body: FloatArray
    wheels: FloatArray
    stopped: bool
    tipping_steps: int

    @property
    def pose(self) -> FloatArray:
        """x, y, yaw of `base_link` in `odom` [m, m, rad], yaw not wrapped, shape (T, 3)."""
        return self.body[:, 0:3]

    @property
    def twist(self) -> FloatArray:
        """True twist in the body frame [m/s, m/s, rad/s], shape (T, 3)."""
        return self.body[:, 3:6]

    @property
    def feedback(self) -> FloatArray:
        """Twist that the brake assistant was told [m/s, m/s, rad/s], shape (T, 3)."""
        return self.body[:, 6:9]

    @property
    def trusted(self) -> BoolArray:
        """Whether the fail-safe let the assistant release brakes, shape (T,)."""
        trusted: BoolArray = self.body[:, _TRUST] != 0.0
        return trusted

    @property
    def energy(self) -> FloatArray:
        """Kinetic energy of body and wheels and that of the tires' deflection [J], shape (T,)."""
        return self.body[:, _STORED]

    @property
    def brake_start(self) -> int:
        """Index of the first stamp with the pedal down, the last one if there is none."""
        pressed = self.pedal > 0.0
        return int(np.argmax(pressed)) if pressed[-1] else len(pressed) - 1

    @property
    def orientation_change(self) -> float:
        """Magnitude of the change of yaw from the start of braking to the end [deg]."""
        return abs(math.degrees(self.pose[-1, 2] - self.pose[self.brake_start, 2]))

    @property
    def stopping_distance(self) -> float:
        """Straight line from the start of braking to the final position [m]."""
        return math.hypot(*(self.pose[-1, :2] - self.pose[self.brake_start, :2]))

    def history(self) -> RunHistory:
        """Return the run in the form that metrics and figures read; it has no odometry."""
        stamps = len(self.pedal)
        return RunHistory.from_samples(
            wheel_names=self.wheel_names,
            stamp_ns=np.arange(stamps) * self.period_ns,
            pose=self.pose,
            twist=self.twist,
            wheel_angle=self.wheels[:, :, _ANGLE],
            wheel_speed=self.wheels[:, :, _SPEED],
            brake_torque=self.wheels[:, :, _TORQUE],
            enable=self.wheels[:, :, _ENABLE],
            error=self.wheels[:, :, _ERROR],
            pedal=self.pedal,
            estimate=np.full((stamps, 3), np.nan),
            estimate_variance=np.full((stamps, 3), np.nan),
        )


class _Loop(NamedTuple):
    """What the loop kernel needs beside vehicle and law; T stamps at most."""

    period_ns: int
    steps: int
    pedal: FloatArray  # (T,)
    command: FloatArray  # of the drive, in the body axes of the start, (T, 3)
    hold_world: bool
    start_yaw: float
    brake_torque: float
    clutch_threshold: float
    clutch_stiffness: float
    sampled: BoolArray  # whether the velocity sensor takes a new sample, (T,)
    noise: FloatArray  # shares of the true value, Eqs. (60), (61), (T or 1, 3)
    offset: FloatArray  # (3,)
    failing: BoolArray  # whether the sensor reads nothing but the following, (T,)
    failed_reading: float
    rest_speed: float
    settling_time: float
    duration_limit: float


def run_fast_loop(configuration: ExperimentConfiguration) -> FastRun:
    """Run an experiment on the velocity sensor to its end.

    Args:
        configuration: the whole loop.

    Raises:
        ConfigurationError: the feedback is optical, or its stamps are too far apart for the
            assistant.
    """
    _check(configuration)
    driver = ScriptedDriver(configuration.maneuver)
    ground, simulation = configuration.ground, configuration.simulation
    vehicle = build_vehicle(
        configuration.vehicle,
        FrictionMap(ground.friction, ground.patches),
        simulation.physics_step,
        driver.start_pose,
        driver.start_twist,
        ground.elevation,
    )
    limits = configuration.brake_assist
    manifold = SlidingManifold(
        vehicle.kinematics.geometry, weighting_function(limits.weighting, limits.k)
    )
    loop = _loop(configuration, driver)
    stamps = len(loop.pedal)
    body = np.empty((stamps, _BODY_COLUMNS))
    wheels = np.empty((stamps, len(vehicle.wheel_names), _WHEEL_COLUMNS))
    law = control_law(limits, manifold.constants)
    reach = float(np.max(np.hypot(*vehicle.kinematics.geometry.position.T)))
    trust = make_judge(limits, configuration.velocity_sensor, reach)
    used, stopped = _run(vehicle.kernel_state, law, trust, loop, body, wheels)
    return FastRun(
        vehicle.wheel_names,
        loop.period_ns,
        loop.pedal[:used],
        body[:used].copy(),
        wheels[:used].copy(),
        stopped,
        vehicle.tipping_steps,
    )


def _check(configuration: ExperimentConfiguration) -> None:
    if configuration.feedback != "velocity_sensor":
        raise ConfigurationError(
            "feedback", f"is {configuration.feedback}, the fast loop has only the velocity_sensor"
        )
    limits = configuration.brake_assist
    if list(limits.wheels.items()) != list(configuration.vehicle.wheels.items()):
        raise ConfigurationError("brake_assist.wheels", "must be those of the vehicle")
    if configuration.simulation.control_period > limits.maximum_time_step:
        raise ConfigurationError(
            "simulation.control_period", "is longer than brake_assist.maximum_time_step"
        )


def _loop(configuration: ExperimentConfiguration, driver: ScriptedDriver) -> _Loop:
    simulation, sensor = configuration.simulation, configuration.velocity_sensor
    period_ns = simulation.control_period_ns
    stamps = math.ceil(simulation.duration_limit * 1e9 / period_ns) + 1
    settled = min(-(-driver.settled_ns // period_ns), stamps - 1)
    times = [index * period_ns for index in range(settled + 1)]
    start_yaw = float(driver.start_pose[2])
    pedal = np.full(stamps, driver.pedal(times[-1]))
    pedal[: settled + 1] = [driver.pedal(time) for time in times]
    command = np.zeros((stamps, 3))
    command[: settled + 1] = [driver.command_twist(time, start_yaw) for time in times]
    stamp_ns = np.arange(stamps) * period_ns
    start, end = sensor.failure_ns
    fails = (stamp_ns >= start) & (stamp_ns < end)
    samples = np.where(fails, -1, stamp_ns // round(sensor.sample_time * 1e9))
    share = np.array([sensor.linear_noise, sensor.linear_noise, sensor.yaw_rate_noise])
    noise = np.zeros((1, 3))
    if np.any(share > 0.0):
        seed = np.random.SeedSequence(configuration.seed).spawn(2)[0]  # as the simulator's
        noise = share * np.random.default_rng(seed).uniform(-1.0, 1.0, (stamps, 3))
    drive = configuration.vehicle.drive
    return _Loop(
        period_ns=period_ns,
        steps=simulation.steps_per_period,
        pedal=pedal,
        command=command,
        hold_world=configuration.maneuver.hold_world_direction,
        start_yaw=start_yaw,
        brake_torque=configuration.vehicle.brake.max_torque,
        clutch_threshold=drive.clutch_threshold,
        clutch_stiffness=drive.stiffness,
        sampled=np.diff(np.maximum.accumulate(samples), prepend=-1) > 0,
        noise=noise,
        offset=np.array([sensor.offset_x, sensor.offset_y, sensor.yaw_rate_offset]),
        failing=fails & (sensor.failure != "frozen"),
        failed_reading=math.nan if sensor.failure == "invalid" else 0.0,
        rest_speed=simulation.rest_speed,
        settling_time=simulation.settling_time,
        duration_limit=simulation.duration_limit,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(loop: _Loop, stamp: int, draw: int, held: FloatArray, row: FloatArray) -> int:
    """Write what the velocity sensor reads, Eqs. (60), (61); return the number of draws."""
    if loop.sampled[stamp]:
        noise = loop.noise[min(draw, loop.noise.shape[0] - 1)]
        for j in range(3):
            held[j] = row[3 + j] * (1.0 + noise[j]) + loop.offset[j]
        draw += 1
    for j in range(3):
        row[6 + j] = loop.failed_reading if loop.failing[stamp] else held[j]
    return draw


@njit(cache=True, nogil=True, error_model="numpy")
def _energy(
    plant: dynamics.Plant, body: FloatArray, wheels: FloatArray, rollers: Rollers | None
) -> float:
    """Return the energy of motion and of the tires' deflection [J]."""
    energy: float = 0.5 * plant.mass * (body[dynamics.V_X] ** 2 + body[dynamics.V_Y] ** 2)
    energy += 0.5 * plant.yaw_inertia * body[dynamics.YAW_RATE] ** 2
    energy += 0.5 * plant.wheel_inertia * np.sum(wheels[:, dynamics.SPEED] ** 2)
    if rollers is None:
        energy += 0.5 * plant.stiffness * np.sum(wheels[:, dynamics.DEFLECTION] ** 2)
    else:
        spin, elastic = roller_energies(rollers)
        energy += spin + elastic
    return energy


@njit(cache=True, nogil=True, error_model="numpy")
def _advance(
    state: KernelState, loop: _Loop, stamp: int, yaw: float, enable: FloatArray, scratch: FloatArray
) -> None:
    """Advance the vehicle by one control period, as `Simulator.advance` does."""
    pedal = loop.pedal[stamp]
    twist = loop.command[stamp].copy()
    if loop.hold_world:
        twist[0], twist[1] = in_turned_frame(twist[0], twist[1], yaw - loop.start_yaw)
    control = dynamics.Control(
        brake_torques(state.pressure, pedal * loop.brake_torque * enable, loop.steps),
        loop.clutch_stiffness if pedal < loop.clutch_threshold else 0.0,
        twist,
        loop.hold_world,
        0.0,
        0.0,
    )
    no_wheels = np.empty((0, enable.size, dynamics.WHEEL_SIZE))
    no_energy = np.empty((0, dynamics.ENERGIES))
    dynamics.advance(
        state.plant,
        state.terrain,
        state.losses,
        control,
        state.body,
        state.contacts,
        state.rollers,
        state.wheels,
        state.counters,
        scratch,
        no_wheels,
        no_energy,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _run(
    state: KernelState,
    law: ControlLaw,
    trust: Judge,
    loop: _Loop,
    body: FloatArray,
    wheels: FloatArray,
) -> tuple[int, bool]:
    """Run the loop; fill the records and return the number of stamps and whether it stopped."""
    plant = state.plant
    memory, valves = np.zeros(MEMORY_SIZE), np.zeros((wheels.shape[1], VALVE_SIZE))
    error, enable = np.empty(wheels.shape[1]), np.empty(wheels.shape[1])
    scratch = np.empty((loop.steps + 1, 6))
    held, last, clock = np.zeros(3), np.zeros(3), np.zeros(CLOCK_SIZE, np.int64)
    draw, followed_ns, last_ns, still_since = 0, 0, 0, -1.0
    for stamp in range(loop.pedal.size):
        now_ns = stamp * loop.period_ns
        row = body[stamp]
        base_motion(state.body, plant.centre_x, plant.centre_y, row)
        draw = _measure(loop, stamp, draw, held, row)
        pedal = loop.pedal[stamp]
        braking = pedal >= law.pedal_threshold
        good = judge(trust, last, clock, now_ns, row[6:9], braking)
        dt = 0.0
        if good:  # as `BrakeAssist._step`
            dt = (now_ns - followed_ns) * 1e-9
            followed_ns = now_ns
            if dt > trust.maximum_time_step:
                forget_line(memory[:LINE_SIZE])
                dt = 0.0
        trusted = clock[TRUSTED] != 0
        control_step(
            law,
            memory,
            valves,
            float(now_ns - last_ns),
            braking,
            good,
            trusted,
            dt,
            row[6],
            row[7],
            row[8],
            error,
            enable,
        )
        last_ns = now_ns
        row[_TRUST] = 1.0 if trusted else 0.0
        row[_STORED] = _energy(plant, state.body, state.wheels, state.rollers)
        wheels[stamp, :, _ANGLE] = state.wheels[:, dynamics.ANGLE]
        wheels[stamp, :, _SPEED] = state.wheels[:, dynamics.SPEED]
        wheels[stamp, :, _TORQUE] = state.wheels[:, dynamics.BRAKE]
        wheels[stamp, :, _ENABLE] = enable
        wheels[stamp, :, _ERROR] = error
        # As `run_progress.RunProgress`.
        time = now_ns / 1e9
        if pedal <= 0.0 or math.hypot(row[3], row[4]) + abs(row[5]) > loop.rest_speed:
            still_since = -1.0
        elif still_since < 0.0:
            still_since = time
        if still_since >= 0.0 and time - still_since >= loop.settling_time:
            return stamp + 1, True
        if time >= loop.duration_limit:
            return stamp + 1, False
        _advance(state, loop, stamp, row[2], enable, scratch)
    return loop.pedal.size, False
