"""Closed loop with the velocity sensor as one compiled kernel, for campaigns of many runs.

The kernel calls the compiled functions of the simulator and of the brake assistant, without line
cameras, odometry or messages. The results are bit-identical to those of `loop.run_closed_loop` with
``feedback: velocity_sensor``. A user's control law in Python is called between the two compiled
halves of a step, and a source of the twist in Python between two steps.
"""

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist import assist_state, assist_step
from omni_brake_assist.conditions import GOOD
from omni_brake_assist.imu_integration import add_reading, end_step, new_integral
from omni_brake_assist.laws.law import NO_HELP, Law, call_law
from omni_brake_assist.laws.own_law import own_law
from omni_core.kernels import by_reference, inlined, lean
from omni_core.quantities import FloatArray, IntArray
from omni_core.signals import MISSING, VALID, ImuSample, TwistSample, WheelSample
from omni_runs.experiment import ExperimentConfiguration
from omni_runs.history import FastRun, without_jumps
from omni_sim import run_progress, velocity_sensor
from omni_sim.driver.scripted import ScriptedDriver
from omni_sim.ground.friction import FrictionMap
from omni_sim.measurement import (
    Instruments,
    Readings,
    Truth,
    build_instruments,
    measure,
    write_world,
)
from omni_sim.push import NO_PUSH, Push
from omni_sim.vehicle.dynamics import advance, base_motion, energies, in_turned_frame
from omni_sim.vehicle.state import Control, State
from omni_sim.vehicle.vehicle import Vehicle

TwistSource = Callable[[int, FloatArray, FloatArray], TwistSample]
"""Function that returns the latest twist that has arrived. Its arguments are the time since the
start of the run [ns], the true twist [m/s, m/s, rad/s], shape (3,), and the measured wheel speeds
[rad/s], shape (N,). The loop calls it once per stamp."""

_CHUNK = 512  # number of stamps per call and per chunk of noise


@by_reference
class _Record(NamedTuple):
    """Arrays that a run fills stamp by stamp, for at most T control stamps and N wheels.

    Fields without a comment have the quantities and units of `FastRun`.
    """

    # x, y, yaw of `base_link` in `odom` [m, m, rad] and its true twist in the body frame [m/s, m/s,
    # rad/s], (T, 6).
    motion: FloatArray
    heading: FloatArray  # yaw as it is read from a recording, -pi to pi [rad], (T,)
    feedback: FloatArray  # (T, 3)
    condition: IntArray  # (T,)
    energy: FloatArray  # (T,)
    wheel_angle: FloatArray  # (T, N)
    wheel_speed: FloatArray  # (T, N)
    brake_torque: FloatArray  # (T, N)
    enable: FloatArray  # (T, N)
    error: FloatArray  # (T, N)


@by_reference
class _Loop(NamedTuple):
    """Inputs of the loop kernel except vehicle and law; T is the limit on the number of stamps."""

    period_ns: int
    steps: int
    pedal: FloatArray  # brake demand, 0 to 1, (T,)
    # Commanded twist [m/s, m/s, rad/s] in body axes; rotated in place at its stamp, (T, 3).
    command: FloatArray
    height: FloatArray  # height of the center of gravity [m], (T,)
    # External force in the world frame [N, N] and moment about the center of gravity [N m], (T, 3).
    push: FloatArray
    hold_world: bool  # whether the commanded velocity keeps its direction in the world
    start_yaw: float  # [rad]
    brake_torque: float  # torque of a brake with the pedal fully down [N m]
    clutch_threshold: float  # pedal position at which the clutch opens [1]
    clutch_stiffness: float  # torque of the engaged clutch per speed difference [N m s/rad]
    measures: bool  # whether IMU and encoders are simulated, because they are used or faulty
    enabled: bool
    end: run_progress.End


@by_reference
class _Sensors(NamedTuple):
    """Sensors with their state and noise.

    The noise of IMU and encoders is drawn for K stamps at a time, with D values per stamp. T is the
    limit on the number of stamps.
    """

    velocity: velocity_sensor.SensorConstants
    held: NDArray[np.void]  # last sample of the velocity sensor
    draws: FloatArray  # uniform noise of the velocity sensor by sample, -1 to 1, (T or 1, 3)
    drawn: IntArray  # number of samples taken so far, (1,)
    instruments: Instruments
    noise: FloatArray  # standard normal values for IMU and encoders, (K, D)
    integral: NDArray[np.void]  # IMU readings, integrated over the steps
    longest_ns: int  # gap between two IMU readings over which they are not integrated [ns]
    rest: NDArray[np.void]  # time since which the vehicle has been at rest


def run_fast_loop(
    configuration: ExperimentConfiguration, source: TwistSource | None = None, push: Push = NO_PUSH
) -> FastRun:
    """Run an experiment with the velocity sensor to its end.

    Args:
        configuration: configuration of the whole loop.
        source: replacement of the velocity sensor, for built-in laws only; None to keep the sensor.
        push: external force on the chassis.

    Raises:
        ConfigurationError: the feedback is optical, or a user's law is combined with `source`.
    """
    configuration.check_fast_loop(own_source=source is not None)
    driver = ScriptedDriver(configuration.maneuver)
    ground, step = configuration.ground, configuration.simulation.physics_step
    friction = FrictionMap(ground.friction, ground.patches)
    start = driver.start_pose, driver.start_twist
    vehicle = Vehicle(configuration.vehicle, friction, step, *start, ground.elevation)
    loop = _loop(configuration, driver, push)
    stamps = len(loop.pedal)
    record = _new_record(stamps, len(vehicle.wheel_names))
    assist = assist_state.make_constants(configuration.brake_assist, vehicle.kinematics.geometry)
    memory = assist_state.new_memory(assist)
    law = own_law(configuration.brake_assist, vehicle.kinematics.geometry)
    advance = _run_built_in if law is None else functools.partial(_run_own, law)
    if source is not None:
        advance = functools.partial(_run_measured, source)
    sensors = _sensors(configuration, stamps)
    seed = np.random.SeedSequence(configuration.seed).spawn(3)[2]  # stream as in the simulator
    noise = np.random.default_rng(seed)
    scratch = _new_scratch(configuration, sensors.instruments)
    run = _Run(vehicle.state, assist, memory, sensors, loop, scratch, record)
    onsets = np.ceil(np.round(1e9 * vehicle.brake_fault_onsets) / loop.period_ns).astype(int)
    changes = {stamp for stamp in onsets.tolist() if 0 < stamp < stamps}
    used, outcome = 0, run_progress.RUNNING
    for last in sorted({*range(_CHUNK, stamps, _CHUNK), *changes, stamps}):
        if loop.measures and used % _CHUNK == 0:  # in chunks, as most runs are short
            noise.standard_normal(out=sensors.noise)
        used, outcome = advance(run, used, last)
        if outcome != run_progress.RUNNING:
            break
        vehicle.apply_brake_faults(used * loop.period_ns * 1e-9)
    written = {name: rows[:used].copy() for name, rows in record._asdict().items()}
    motion, heading = written.pop("motion"), written.pop("heading")
    unmeasured = np.full((used, 3), np.nan)
    return FastRun(
        wheel_names=vehicle.wheel_names,
        stamp_ns=np.arange(used) * loop.period_ns,
        pose=np.column_stack((motion[:, :2], without_jumps(heading))),
        twist=motion[:, 3:],
        pedal=loop.pedal[:used],
        estimate=unmeasured,
        estimate_variance=unmeasured,
        stopped=outcome == run_progress.STOPPED,
        tipping_steps=vehicle.tipping_steps,
        failed=int(memory.step[0]["dead"]) - 1,
        **written,
    )


def _loop(configuration: ExperimentConfiguration, driver: ScriptedDriver, push: Push) -> _Loop:
    simulation = configuration.simulation
    period_ns = simulation.control_period_ns
    stamps = math.ceil(simulation.duration_limit * 1e9 / period_ns) + 1
    settled = min(-(-driver.settled_ns // period_ns), stamps - 1)
    start_yaw, time = float(driver.start_pose[2]), np.arange(stamps) * period_ns * 1e-9
    last, _ = driver.demand(settled * period_ns, start_yaw)
    pedal, command = np.full(stamps, last), np.zeros((stamps, 3))
    pedal[:settled], command[:settled] = driver.demand(0, start_yaw)
    for index in range(min(driver.first_change_ns // period_ns, settled), settled + 1):
        pedal[index], command[index] = driver.demand(index * period_ns, start_yaw)
    return _Loop(
        period_ns=period_ns,
        steps=simulation.steps_per_period,
        pedal=pedal,
        command=command,
        height=configuration.vehicle.height_at(time),
        push=push.at(time),
        hold_world=configuration.maneuver.hold_world_direction,
        start_yaw=start_yaw,
        brake_torque=configuration.vehicle.brake.max_torque,
        clutch_threshold=configuration.vehicle.drive.clutch_threshold,
        clutch_stiffness=configuration.vehicle.drive.stiffness,
        measures=configuration.brake_assist.fault_detection
        or bool(configuration.faults)
        or configuration.brake_assist.law != "sliding_mode",
        enabled=configuration.brake_assist.enabled,
        end=run_progress.run_end(configuration),
    )


def _new_record(stamps: int, wheels: int) -> _Record:
    each = (np.empty((stamps, wheels)) for _ in range(5))
    body = np.empty((stamps, 6)), np.empty(stamps), np.empty((stamps, 3))
    return _Record(*body, np.empty(stamps, np.int64), np.empty(stamps), *each)


def _sensors(configuration: ExperimentConfiguration, stamps: int) -> _Sensors:
    sensor = configuration.velocity_sensor
    uniform = np.zeros((1, 3))
    if sensor.linear_noise > 0.0 or sensor.yaw_rate_noise > 0.0:
        seed = np.random.SeedSequence(configuration.seed).spawn(1)[0]  # stream as in the simulator
        uniform = np.random.default_rng(seed).uniform(-1.0, 1.0, (stamps, 3))
    instruments = build_instruments(configuration)
    return _Sensors(
        velocity=velocity_sensor.sensor_constants(sensor),
        held=velocity_sensor.sensor_memory(),
        draws=uniform,
        drawn=np.zeros(1, np.int64),
        instruments=instruments,
        noise=np.zeros((_CHUNK, instruments.draws)),
        integral=new_integral(),
        longest_ns=round(configuration.brake_assist.feedback_timeout * 1e9),
        rest=run_progress.rest_memory(),
    )


@by_reference
class _Scratch(NamedTuple):
    """Buffers for the values of one control stamp, for N wheels."""

    taken: IntArray  # time stamps of twist and newest IMU reading [ns], (2,)
    covariance: FloatArray  # (3, 3)
    imu_ns: IntArray  # stamps of the IMU readings since the last stamp [ns], (M,)
    inertial: FloatArray  # yaw rates [rad/s] and specific forces [m/s^2] in these readings, (M, 3)
    imu: FloatArray  # these readings, integrated over the control period, (3,)
    wheel_speed: FloatArray  # measured wheel speed [rad/s], (N,)
    error: FloatArray  # (N,)
    enable: FloatArray  # (N,)
    steps: int  # number of physics steps in a control period
    # Motion in the last control period for an IMU with a rate of its own, as `Vehicle.advance`
    # returns it; otherwise empty, (steps + 1, 6) or (0, 6).
    trajectory: FloatArray
    start: FloatArray  # motion at the present stamp, in world axes, (1, 6)


def _new_scratch(configuration: ExperimentConfiguration, instruments: Instruments) -> _Scratch:
    wheels, most = len(configuration.vehicle.wheels), instruments.imu.most
    steps = configuration.simulation.steps_per_period
    return _Scratch(
        taken=np.zeros(2, np.int64),
        covariance=np.empty((3, 3)),
        imu_ns=np.zeros(most, np.int64),
        inertial=np.full((most, 3), np.nan),
        imu=np.full(3, np.nan),
        wheel_speed=np.full(wheels, np.nan),
        error=np.empty(wheels),
        enable=np.empty(wheels),
        steps=steps,
        trajectory=np.empty((steps + 1 if configuration.imu.rate > 0.0 else 0, 6)),
        start=np.empty((1, 6)),
    )


@by_reference
class _Run(NamedTuple):
    """State of a run of the fast loop in progress."""

    state: State
    assist: assist_state.Constants
    memory: assist_state.Memory
    sensors: _Sensors
    loop: _Loop
    scratch: _Scratch
    record: _Record


_NOTHING, _SENSED, _ACTED = range(3)


@lean
def _run_part(run: _Run, first: int, last: int, done: int, pauses: bool) -> tuple[int, int]:
    """Run the loop from stamp `first` to the stamp before `last`, and record each stamp.

    Args:
        run: state of the run.
        first: first stamp.
        last: stamp after the last one, whose noise may not have been drawn yet.
        done: what has been done at the first stamp: `_NOTHING`; `_SENSED` if the twist is in the
            buffers; `_ACTED` if the enables are in the buffers, too.
        pauses: whether to return at the next stamp as soon as its sensors have been simulated.

    Returns:
        Next stamp; outcome of the run, a constant of `omni_sim.run_progress`.
    """
    for stamp in range(first, last):
        if done == _NOTHING or stamp > first:
            _sense(run, stamp)
            if pauses:
                return stamp, run_progress.RUNNING
        if done != _ACTED:
            inputs = _compiled_inputs(run, stamp)
            run.record.condition[stamp] = assist_step.assist_step(
                run.assist, run.memory, inputs, run.scratch.error, run.scratch.enable
            )
        outcome = _record_and_advance(run, stamp)
        if outcome != run_progress.RUNNING:
            return stamp + 1, outcome
    return last, run_progress.RUNNING


@lean
def _sense(run: _Run, stamp: int) -> None:
    """Simulate the sensors at a stamp, and record the motion and the feedback."""
    state, sensors, loop, scratch = run.state, run.sensors, run.loop, run.scratch
    motion, feedback = run.record.motion[stamp], run.record.feedback[stamp]
    now_ns = stamp * loop.period_ns
    base_motion(state.body[0], state.plant.center, motion)
    velocity, held = sensors.velocity, sensors.held
    draw = sensors.draws[min(sensors.drawn[0], sensors.draws.shape[0] - 1)]
    sensors.drawn[0] += velocity_sensor.samples_now(velocity, held, now_ns)
    scratch.taken[0] = velocity_sensor.read(velocity, held, now_ns, motion[3:6], draw, feedback)
    if loop.measures:
        tilt = state.body[0].tilt_x, state.body[0].tilt_y
        path = scratch.trajectory[1:] if stamp > 0 else scratch.trajectory[:0]
        if path.shape[0] == 0:
            write_world(motion, scratch.start[0])
            path = scratch.start
        truth = Truth(stamp, loop.period_ns, path, loop.period_ns / loop.steps, tilt, state.wheels)
        noise = sensors.noise[stamp % sensors.noise.shape[0]]
        imu_ns, inertial = scratch.imu_ns, scratch.inertial
        readings = Readings(feedback, imu_ns, inertial, scratch.wheel_speed)
        for k in range(measure(sensors.instruments, truth, noise, readings)):
            rate, force = inertial[k, 0], inertial[k, 1:]
            add_reading(sensors.integral, sensors.longest_ns, imu_ns[k], rate, force)
        scratch.imu[0] = end_step(sensors.integral, now_ns, scratch.imu[1:])
        scratch.taken[1] = sensors.integral[0].stamp_ns
    velocity_sensor.state_covariance(velocity, feedback, scratch.covariance)


def _inputs(run: _Run, stamp: int) -> assist_state.Inputs:
    """Return the inputs of the assistant at a stamp, which contain the readings in the buffers."""
    loop, scratch = run.loop, run.scratch
    now_ns, validity = stamp * loop.period_ns, VALID if loop.measures else MISSING
    twist = TwistSample(scratch.taken[0], run.record.feedback[stamp], scratch.covariance, VALID)
    wheels = WheelSample(now_ns, scratch.wheel_speed, validity)
    imu = ImuSample(scratch.taken[1], scratch.imu[0], scratch.imu[1:], validity)
    return assist_state.Inputs(now_ns, loop.pedal[stamp], loop.enabled, GOOD, twist, wheels, imu)


_compiled_inputs = inlined(_inputs)


def _run_built_in(run: _Run, first: int, last: int) -> tuple[int, int]:
    """Run the loop with a law and sensors that are compiled."""
    return _run_part(run, first, last, _NOTHING, False)


def _run_measured(source: TwistSource, run: _Run, first: int, last: int) -> tuple[int, int]:
    """Run the loop with a source of the twist in Python."""
    record, scratch = run.record, run.scratch
    stamp, outcome = _run_part(run, first, last, _NOTHING, True)
    while stamp < last and outcome == run_progress.RUNNING:
        true = record.motion[stamp, 3:]
        twist = source(stamp * run.loop.period_ns, true, scratch.wheel_speed)
        record.feedback[stamp], scratch.covariance[:] = twist.value, twist.covariance
        scratch.taken[0] = twist.stamp_ns
        stamp, outcome = _run_part(run, stamp, last, _SENSED, True)
    return stamp, outcome


def _run_own(law: Law, run: _Run, first: int, last: int) -> tuple[int, int]:
    """Run the loop with a user's law in Python.

    The law is called between the two compiled halves of a step, `receive` and `act`.
    """
    error, enable = run.scratch.error, run.scratch.enable
    step = run.assist.laws.allocation.brake.pressure_step
    stamp, outcome = _run_part(run, first, last, _NOTHING, True)
    while stamp < last and outcome == run_progress.RUNNING:
        inputs = _inputs(run, stamp)
        error[:] = 0.0
        ready, motion = assist_step.receive(run.assist, run.memory, inputs)
        answer, _ = call_law(law, motion, error, enable, step) if ready else (NO_HELP, "")
        called = assist_state.LawCall(ready, motion, answer)
        condition = assist_step.act(run.assist, run.memory, inputs, called, error, enable)
        run.record.condition[stamp] = condition
        stamp, outcome = _run_part(run, stamp, last, _ACTED, True)
    return stamp, outcome


@lean
def _record_and_advance(run: _Run, stamp: int) -> int:
    """Record the state at a stamp, and advance the vehicle unless the run has ended.

    Returns:
        Outcome of the run, a constant of `omni_sim.run_progress`.
    """
    state, loop, scratch, record = run.state, run.loop, run.scratch, run.record
    stored = energies(state)
    record.energy[stamp] = stored.translation + stored.rotation + stored.spin + stored.elastic
    for i in range(scratch.enable.size):
        wheel = state.wheels[i]
        record.wheel_angle[stamp, i] = wheel.angle
        record.wheel_speed[stamp, i] = wheel.speed
        record.brake_torque[stamp, i] = wheel.brake
        record.enable[stamp, i] = scratch.enable[i]
        record.error[stamp, i] = scratch.error[i]
    motion = record.motion[stamp]
    half_turn = 0.5 * motion[2]  # as in `quaternion_from_yaw` and back
    record.heading[stamp] = 2.0 * math.atan2(math.sin(half_turn), math.cos(half_turn))
    now_ns, speed = stamp * loop.period_ns, run_progress.largest_speed(motion[3:6])
    outcome = run_progress.run_outcome(loop.end, run.sensors.rest, now_ns, loop.pedal[stamp], speed)
    if outcome == run_progress.RUNNING:
        _advance(state, loop, scratch, stamp, motion[2])
    return outcome


@lean
def _advance(state: State, loop: _Loop, scratch: _Scratch, stamp: int, yaw: float) -> None:
    """Advance the vehicle by one control period, as `Simulator.advance` does.

    Args:
        state: state of the vehicle, changed in place.
        loop: inputs. If `loop.hold_world` is true, the velocity command of this stamp, which keeps
            its direction in the world, is converted to the body frame in place.
        scratch: buffers, which contain the enables of this stamp.
        stamp: index of the control stamp.
        yaw: present heading of the vehicle in `odom` [rad].
    """
    pedal, twist, height = loop.pedal[stamp], loop.command[stamp], loop.height[stamp]
    f_x, f_y, moment = loop.push[stamp, 0], loop.push[stamp, 1], loop.push[stamp, 2]
    if loop.hold_world:
        twist[0], twist[1] = in_turned_frame(twist[0], twist[1], yaw - loop.start_yaw)
    torque = pedal * loop.brake_torque
    stiffness = loop.clutch_stiffness if pedal < loop.clutch_threshold else 0.0
    enable, in_world = scratch.enable, loop.hold_world
    control = Control(torque, enable, stiffness, twist, in_world, f_x, f_y, moment, height)
    advance(state, control, scratch.steps, scratch.trajectory)
