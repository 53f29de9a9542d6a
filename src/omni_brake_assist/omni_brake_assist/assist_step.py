"""One step of the brake assistant as a compiled kernel: fail-safe, line, law, valves.

`BrakeAssist` calls it with the messages that it has received, and the simulation of many runs calls
it with the readings of its sensors. So there is only one fail-safe, and both give the same bits. A
user's law is called between the two halves, `receive` and `act`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.braking_line import (
    advance_line,
    forget_line,
    new_line,
    perpendicular,
    store_line,
)
from omni_brake_assist.conditions import (
    ASSISTING,
    CONTRADICTED,
    DEAD_BRAKE,
    DEAD_RECKONING,
    DEMAND_BACK,
    DISABLED,
    GOOD,
    INACTIVE,
    INTERNAL_ERROR,
    LAW_ERROR,
    NO_BRAKE_HELPS,
    NO_EFFECT,
    SLOW,
)
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.fail_safe import (
    Limits,
    check_inputs,
    close_gate,
    make_limits,
    new_gate,
    since,
)
from omni_brake_assist.filter_bank.bank import estimate
from omni_brake_assist.filter_bank.state import (
    FAULTY,
    NO_ESTIMATE,
    NO_TWIST,
    BankConstants,
    BankMemory,
    Readings,
    Twist,
    bank_constants,
    bank_memory,
)
from omni_brake_assist.laws import built_in
from omni_brake_assist.laws.built_in import (
    LawConstants,
    LawMemory,
    law_constants,
    law_memory,
)
from omni_brake_assist.laws.law import ASSIST, FAILED, HELD, NO_HELP, Motion
from omni_brake_assist.monitors.brake_monitor import (
    NO_WHEEL,
    BrakeConstants,
    BrakedWheels,
    brake_constants,
    brake_memory,
    watch_brakes,
)
from omni_brake_assist.monitors.effect_monitor import (
    EffectConstants,
    EffectStep,
    effect_constants,
    effect_memory,
    watch_effect,
)
from omni_brake_assist.sliding_manifold import fastest_wheel
from omni_brake_assist.valve_dwell import new_valves, open_valves, switch_valves
from omni_platform.geometry import PlatformGeometry
from omni_platform.kernels import inlined, kernel, lean, lean_inline, linked
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_platform.signals import VALID, ImuSample, TwistSample, WheelSample

# Share of the speed at the start below which all brakes act in a stop without the twist [1]: an
# error of dead reckoning must not keep the vehicle rolling, and little energy is left by then.
_RECKONED_SHARE = 0.15

_STEP = np.dtype(
    [
        ("followed_ns", "i8"),  # stamp of the last good feedback [ns]
        ("switched_ns", "i8"),  # stamp of the last update of the valves [ns]
        ("slow", "?"),  # whether the speed has fallen below the threshold
        ("reckoned", "?"),  # whether the motion is estimated without the twist
        ("contradicted", "?"),  # whether there is no valid estimate
        ("no_effect", "?"),
        ("fault", "i8"),  # first fault that is present, a row of `conditions.CONDITIONS`
        ("faulty", "?"),  # whether a fault had all brakes on in the last step
        ("start_speed", "f8"),  # speed when the line was stored [m/s]
        ("observed_ns", "i8"),  # stamp of the last step [ns]
        ("assisting", "?"),  # whether the law has been called since the pedal went down
        ("answer", "i8"),  # last answer of the law
        ("dead", "i8"),  # number of the wheel whose brake has failed, from 1; 0 for none
    ]
)


class Constants(NamedTuple):
    """Constants of a step.

    Attributes:
        limits: limits of a valid feedback.
        laws: constants of the control laws.
        fault_detection: whether the filter bank and the monitors are used.
        bank: constants of the filter bank.
        effect: constants of the effect monitor.
        brakes: constants of the brake monitor.
        r_x: wheel positions [m], shape (N,).
        r_y: wheel positions in y [m], shape (N,).
        pedal_threshold: pedal position from which the driver brakes [1].
        minimum_reference_speed: speed below which there is no line to keep [m/s].
        maximum_time_step: longest time over which the heading is integrated [s].
        speed_threshold: speed of the fastest wheel center below which all brakes act [m/s].
        speed_hysteresis: excess over this threshold at which assisting resumes [m/s].
        dwell: shortest time between two switchings of a valve [ns].
    """

    limits: Limits
    laws: LawConstants
    fault_detection: bool
    bank: BankConstants
    effect: EffectConstants
    brakes: BrakeConstants
    r_x: FloatArray
    r_y: FloatArray
    pedal_threshold: float
    minimum_reference_speed: float
    maximum_time_step: float
    speed_threshold: float
    speed_hysteresis: float
    dwell: float


class Memory(NamedTuple):
    """State of the assistant between steps; see `new_memory`.

    Attributes:
        gate: state of the gate, a record of `fail_safe.GATE_STATE`, shape (1,).
        step: stamps and flags, shape (1,).
        line: line of motion to keep, see `braking_line`, shape (1,).
        valves: state of the valves, see `valve_dwell`, shape (N,).
        laws: state of the control laws.
        bank: state of the filter bank, see `filter_bank`.
        effect: state of the effect monitor, see `effect_monitor`, shape (1,).
        brakes: state of the brake monitor, see `brake_monitor`, shape (N + 1,).
        law_speeds: wheel speeds for the law [rad/s], NaN where faulty or unknown, shape (N,).
        commanded: enables of the last step [1], shape (N,).
        answer: current estimate of the twist [m/s, m/s, rad/s], shape (3,).
        speeds: received wheel speeds [rad/s], NaN where not received, shape (N,).
        workspace: reading of the IMU and variance of the twist, shape (2, 3).
        held: errors and enables that the law wrote last, shape (2, N).
    """

    gate: NDArray[np.void]
    step: NDArray[np.void]
    line: NDArray[np.void]
    valves: NDArray[np.void]
    laws: LawMemory
    bank: BankMemory
    effect: NDArray[np.void]
    brakes: FloatArray
    law_speeds: FloatArray
    commanded: FloatArray
    answer: FloatArray
    speeds: FloatArray
    workspace: FloatArray
    held: FloatArray


_Course = tuple[bool, float, float, float, float, float, float]


class Inputs(NamedTuple):
    """Inputs of a step.

    Attributes:
        now_ns: stamp of the demand [ns].
        pedal: the driver's brake demand, 0 to 1; 1 if it cannot be read.
        enabled: whether brakes may be released.
        outside: condition found outside the kernel, INVALID_DEMAND or UNKNOWN_WHEEL, else GOOD.
        feedback: latest twist.
        wheels: latest speeds of the wheels.
        imu: latest reading of the inertial sensor.
    """

    now_ns: int
    pedal: float
    enabled: bool
    outside: int
    feedback: TwistSample
    wheels: WheelSample
    imu: ImuSample


class Asked(NamedTuple):
    """Input of a law for this step, and whether its answer may be used.

    Attributes:
        ready: whether the law is called in this step.
        motion: input of the law.
        answer: ASSIST, NO_HELP, FAILED or HELD.
    """

    ready: bool
    motion: Motion
    answer: int


def make_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> Constants:
    """Return a configuration in the layout of the kernel."""
    r_x, r_y = np.ascontiguousarray(geometry.position.T)
    return Constants(
        make_limits(configuration, float(np.max(np.hypot(r_x, r_y)))),
        law_constants(configuration, geometry),
        configuration.fault_detection,
        bank_constants(configuration, geometry),
        effect_constants(geometry),
        brake_constants(configuration, geometry),
        r_x,
        r_y,
        configuration.pedal_threshold,
        configuration.minimum_reference_speed,
        configuration.maximum_time_step,
        configuration.speed_threshold,
        configuration.speed_hysteresis,
        float(round(configuration.minimum_dwell_time * SECOND_NS)),
    )


def new_memory(wheels: int) -> Memory:
    """Return the memory of an assistant of N wheels that has received nothing."""
    return Memory(
        new_gate(),
        np.zeros(1, _STEP),
        new_line(),
        new_valves(wheels),
        law_memory(wheels),
        bank_memory(wheels),
        effect_memory(),
        brake_memory(wheels),
        np.zeros(wheels),
        np.ones(wheels),
        np.zeros(3),
        np.zeros(wheels),
        np.zeros((2, 3)),
        np.zeros((2, wheels)),
    )


@linked
@lean
def assist_step(
    constants: Constants, memory: Memory, inputs: Inputs, error: FloatArray, enable: FloatArray
) -> int:
    """Decide which brakes act, section 3.3.

    Args:
        constants: from `make_constants`.
        memory: from `new_memory`, changed in place.
        inputs: inputs of this step.
        error: receives ``s_i`` [m/s], shape (N,); zeros while not braking or without valid motion.
        enable: receives the share of brake pressure that passes, 0 to 1, shape (N,).

    Returns:
        Number of the condition that holds, a row of `conditions.CONDITIONS`.
    """
    error[:] = 0.0
    ready, course = _receive(constants, memory, inputs)
    first, dt, v_x, v_y, yaw_rate, p_x, p_y = course
    motion = Motion(first, dt, v_x, v_y, yaw_rate, p_x, p_y, inputs.pedal, memory.law_speeds)
    answer = NO_HELP
    if ready:
        answer = built_in.step(constants.laws, memory.laws, motion, error, enable)
    return int(act(constants, memory, inputs, Asked(ready, motion, answer), error, enable))


@kernel
def receive(constants: Constants, memory: Memory, inputs: Inputs) -> tuple[bool, Motion]:
    """Check the inputs and update the line of motion.

    Args:
        constants: from `make_constants`.
        memory: changed in place.
        inputs: inputs of this step.

    Returns:
        Whether to call the law, and its input.
    """
    ready, course = _receive(constants, memory, inputs)
    first, dt, v_x, v_y, yaw_rate, p_x, p_y = course
    return ready, Motion(first, dt, v_x, v_y, yaw_rate, p_x, p_y, inputs.pedal, memory.law_speeds)


@inlined
def _receive(constants: Constants, memory: Memory, inputs: Inputs) -> tuple[bool, _Course]:
    """Return whether a law may act in this step, and its `Motion` without pedal and wheels."""
    step, line, feedback = memory.step[0], memory.line[0], inputs.feedback
    braking = inputs.pedal >= constants.pedal_threshold
    weighed = constants.fault_detection and _is_felt(constants, inputs)
    good = check_inputs(constants.limits, memory.gate, inputs.now_ns, feedback, braking, weighed)
    gate_open = memory.gate[0].cause == GOOD
    stamp_ns, twist = feedback.stamp_ns, feedback.value
    elapsed = max(since(inputs.now_ns, step.observed_ns) * 1e-9, 0.0)
    if constants.fault_detection:
        chosen = _estimate_motion(constants, memory, inputs, good and gate_open, braking)
        step.contradicted = chosen == NO_ESTIMATE
        alone = chosen == NO_TWIST or not (good and gate_open) or memory.gate[0].uncertain
        step.reckoned = chosen != NO_ESTIMATE and alone
        if memory.bank.record[0].inertial:
            good = gate_open = chosen != NO_ESTIMATE
            stamp_ns, twist = inputs.now_ns, memory.answer
        elif chosen == NO_ESTIMATE:
            good = False
    v_x, v_y, yaw_rate = twist[0], twist[1], twist[2]
    watched = constants.fault_detection and (not braking or (good and gate_open))
    _watch(constants, memory, inputs, braking, elapsed if watched else -1.0, (v_x, v_y, yaw_rate))
    dt = 0.0
    if good:
        dt = since(stamp_ns, step.followed_ns) * 1e-9
        step.followed_ns = stamp_ns
        if not 0.0 <= dt <= constants.maximum_time_step:
            forget_line(line)  # the heading is not known across the gap
            dt = 0.0
    if not braking:
        forget_line(line)
        step.slow = False
    elif good:
        if line.stored:
            advance_line(line, dt, yaw_rate)
        elif gate_open:
            store_line(line, constants.minimum_reference_speed, v_x, v_y, yaw_rate)
            step.assisting = False
            step.start_speed = math.hypot(v_x, v_y)
    ready = braking and good and gate_open
    first = not step.assisting
    step.assisting = ready or (step.assisting and braking)
    p_x, p_y = perpendicular(line)
    return ready, (first, dt, v_x, v_y, yaw_rate, p_x, p_y)


@inlined
def _watch(
    constants: Constants,
    memory: Memory,
    inputs: Inputs,
    braking: bool,
    elapsed: float,
    twist: tuple[float, float, float],
) -> None:
    """Update wheel speeds for the law and, unless `elapsed` is negative, the brake monitor."""
    step, law_speeds = memory.step[0], memory.law_speeds
    for i in range(law_speeds.size):
        law_speeds[i] = inputs.wheels.speed[i]
        if memory.bank.faulty[i] > FAULTY:
            law_speeds[i] = math.nan
    if not braking:
        step.dead = 0
    if elapsed < 0.0:
        return
    dt = min(elapsed, constants.maximum_time_step)
    pedal = inputs.pedal if braking else 0.0
    wheels = BrakedWheels(memory.commanded, memory.speeds, memory.bank.record[0].scale)
    if step.dead == 0:
        dead = watch_brakes(constants.brakes, memory.brakes, dt, pedal, wheels, twist)
        step.dead = dead + 1 if dead != NO_WHEEL else 0


@lean
def _is_felt(constants: Constants, inputs: Inputs) -> bool:
    """Return whether there is a current reading of the IMU."""
    imu, timeout = inputs.imu, constants.limits.timeout_ns
    return bool(imu.validity == VALID and abs(since(inputs.now_ns, imu.stamp_ns)) <= timeout)


@inlined
def _estimate_motion(
    constants: Constants, memory: Memory, inputs: Inputs, received: bool, braking: bool
) -> int:
    """Estimate the current motion, and update the monitor of the effect by the last step."""
    step, feedback = memory.step[0], inputs.feedback
    now_ns, timeout = inputs.now_ns, constants.limits.timeout_ns
    speeds, inertial, variance = memory.speeds, memory.workspace[0], memory.workspace[1]
    wheels, imu = inputs.wheels, inputs.imu
    known = wheels.validity == VALID and abs(since(now_ns, wheels.stamp_ns)) <= timeout
    released = False
    for i in range(speeds.size):
        speeds[i] = wheels.speed[i] if known else math.nan
        released = released or memory.commanded[i] < 1.0
    known = _is_felt(constants, inputs)
    for j in range(3):
        value = imu.yaw_rate if j == 0 else imu.acceleration[j - 1]
        inertial[j] = value if known else math.nan
        variance[j] = feedback.covariance[j, j] if received else 0.0
    dt = min(max(since(now_ns, step.observed_ns) * 1e-9, 0.0), constants.maximum_time_step)
    step.observed_ns = now_ns
    pedal = inputs.pedal if braking else 0.0
    step.no_effect = watch_effect(
        constants.effect,
        memory.effect,
        EffectStep(dt, pedal, released),
        speeds,
        inertial[1:],
    )
    return int(
        estimate(
            constants.bank,
            memory.bank,
            now_ns,
            Readings(pedal, memory.commanded, inertial, speeds),
            Twist(received, feedback.stamp_ns, feedback.value, variance),
            memory.answer,
        )
    )


@lean_inline
def act(
    constants: Constants,
    memory: Memory,
    inputs: Inputs,
    asked: Asked,
    error: FloatArray,
    enable: FloatArray,
) -> int:
    """Command the enables of the law, or all brakes if it may not act; then apply dwell times.

    Args:
        constants: from `make_constants`.
        memory: changed in place.
        inputs: inputs of this step.
        asked: input of the law and its answer.
        error: errors written by the law [m/s], shape (N,).
        enable: enables written by the law; receives those of the valves [1], shape (N,).

    Returns:
        Number of the condition that holds, as `assist_step`.
    """
    outcome = _outcome(constants, memory, inputs, asked, error, enable)
    step = memory.step[0]
    step.faulty = INACTIVE < outcome < SLOW
    elapsed = float(max(since(inputs.now_ns, step.switched_ns), 0))
    step.switched_ns = inputs.now_ns
    if outcome in (ASSISTING, DEAD_RECKONING):
        switch_valves(memory.valves, constants.dwell, elapsed, enable)
    else:
        enable[:] = 1.0
        open_valves(memory.valves, constants.dwell, elapsed)
    for i in range(enable.size):
        memory.commanded[i] = enable[i]
    return int(outcome)


@inlined
def _outcome(
    constants: Constants,
    memory: Memory,
    inputs: Inputs,
    asked: Asked,
    error: FloatArray,
    enable: FloatArray,
) -> int:
    ready, motion, answer = asked
    if ready:
        answer = _hold(memory, answer, error, enable)
    slow = ready and _is_slow(constants, memory.step[0], motion)
    helps = ready and answer == ASSIST
    if answer == FAILED:
        close_gate(memory.gate[0], INTERNAL_ERROR, 0.0, 0.0, 0.0)
        error[:] = 0.0
    if helps:
        if not _are_shares(error, enable):
            close_gate(memory.gate[0], LAW_ERROR, 0.0, 0.0, 0.0)
            error[:] = 0.0
        helps = _is_any_on(enable)  # the vehicle never rolls unbraked
    step = memory.step[0]
    step.fault = _first_fault(step, memory.gate[0].cause, inputs.outside)
    if not inputs.enabled:
        return DISABLED
    if inputs.pedal < constants.pedal_threshold:
        return INACTIVE
    # The filter bank replaces a twist that the gate rejects. For faults that precede those of the
    # twist in the table there is no replacement.
    if step.fault < DEMAND_BACK or not ready:
        return int(min(step.fault, CONTRADICTED))
    if slow:
        return SLOW
    if not helps:
        return NO_BRAKE_HELPS
    return DEAD_RECKONING if step.reckoned else ASSISTING


@lean
def _first_fault(step: Any, cause: int, outside: int) -> int:
    """Return the first fault of the table that is present, GOOD if none is."""
    fault = min(outside, cause)
    if step.no_effect:
        fault = min(fault, NO_EFFECT)
    if step.dead != 0:
        fault = min(fault, DEAD_BRAKE)
    return int(min(fault, CONTRADICTED) if step.contradicted else fault)


@lean
def _hold(memory: Memory, answer: int, error: FloatArray, enable: FloatArray) -> int:
    """Store the enables of a law, or return the stored ones if it was not called in this step."""
    step, held = memory.step[0], memory.held
    if answer != HELD:
        step.answer = answer
    for i in range(enable.size):
        if answer != HELD:
            held[0, i], held[1, i] = error[i], enable[i]
        error[i], enable[i] = held[0, i], held[1, i]
    return int(step.answer)


@lean
def _is_any_on(enable: FloatArray) -> bool:
    on = False
    for i in range(enable.size):
        on |= enable[i] > 0.0
    return on


@lean
def _are_shares(error: FloatArray, enable: FloatArray) -> bool:
    good = True
    for i in range(enable.size):
        good &= 0.0 <= enable[i] <= 1.0 and math.isfinite(error[i])
    return good


@lean
def _is_slow(constants: Constants, step: Any, motion: Motion) -> bool:
    """Return whether the fastest wheel center, Eq. (38), is below the threshold."""
    limit = constants.speed_threshold
    if step.slow:
        limit += constants.speed_hysteresis
    if step.reckoned and constants.fault_detection:
        limit += _RECKONED_SHARE * step.start_speed
    step.slow = limit > fastest_wheel(
        constants.r_x, constants.r_y, motion.v_x, motion.v_y, motion.yaw_rate
    )
    return bool(step.slow)
