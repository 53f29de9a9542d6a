"""One step of the brake assistant as a compiled kernel: fail-safe, line of motion, law, valves.

`BrakeAssist` calls the kernel with the values of received messages. The compiled simulation
(`omni_runs.compiled`) calls it with simulated sensor readings. Node and simulation therefore use
the same fail-safe reactions and give bit-identical results. A user's own law is called between the
two halves of a step, `receive` and `act`.
"""

import math
from typing import Any

from omni_brake_assist import braking_line, conditions, fail_safe, valves
from omni_brake_assist.assist_state import Constants, Inputs, LawCall, Memory
from omni_brake_assist.fail_safe import since
from omni_brake_assist.filter_bank import state as bank_state
from omni_brake_assist.filter_bank.bank import estimate
from omni_brake_assist.laws import brake_observer, built_in, law
from omni_brake_assist.monitors import brake_monitor, effect_monitor
from omni_core.kernels import inlined, kernel, lean, lean_inline, linked
from omni_core.quantities import FloatArray, Pair, Triple
from omni_core.signals import MISSING, UNMEASURED_VARIANCE, VALID, TwistSample


@linked
@lean
def assist_step(
    constants: Constants, memory: Memory, inputs: Inputs, error: FloatArray, enable: FloatArray
) -> int:
    """Compute the brake enables of one step.

    Args:
        constants: from `assist_state.make_constants`.
        memory: from `assist_state.new_memory`, changed in place.
        inputs: inputs of this step.
        error: output, error of each wheel, as defined by the control law [m/s], shape (N,); zero
            while the pedal is up or no valid estimate of the motion exists.
        enable: output, share of the brake pressure that passes, 0 to 1, shape (N,).

    Returns:
        Index of the row in `conditions.CONDITIONS` that describes the state of the assistant.
    """
    error[:] = 0.0
    ready, motion = _receive(constants, memory, inputs)
    answer = law.NO_HELP
    if ready:
        answer = built_in.step(constants.laws, memory.laws, motion, error, enable)
        if answer == law.ASSIST and not law.is_valid(error, enable):
            answer = law.FAILED
    return int(act(constants, memory, inputs, LawCall(ready, motion, answer), error, enable))


@kernel
def receive(constants: Constants, memory: Memory, inputs: Inputs) -> tuple[bool, law.Motion]:
    """Check the inputs, estimate the motion, and update the line of motion.

    Args:
        constants: from `assist_state.make_constants`.
        memory: changed in place.
        inputs: inputs of this step.

    Returns:
        Whether the law is to be called, and the motion that is its input.
    """
    ready, motion = _receive(constants, memory, inputs)
    return ready, motion


@inlined
def _receive(constants: Constants, memory: Memory, inputs: Inputs) -> tuple[bool, law.Motion]:
    """Compute the result of `receive`; kernels of this module can inline this function."""
    step, imu_ns = memory.step[0], inputs.imu.stamp_ns
    step.fresh, step.imu_ns = imu_ns != step.imu_ns, imu_ns
    ready, first, dt, twist, across, failed = _check_and_estimate(constants, memory, inputs)
    (v_x, v_y, yaw_rate), (p_x, p_y) = twist, across
    isolated = memory.bank.record[0].best in (bank_state.NO_FORCE, bank_state.NO_IMU)
    values, pedal, speeds = memory.others.values, inputs.pedal, memory.law_speeds
    f_x, f_y = (math.nan, math.nan) if isolated else (values[1], values[2])
    motion = (first, dt, v_x, v_y, yaw_rate, p_x, p_y, pedal, speeds, failed, f_x, f_y, step.fresh)
    return ready, law.Motion(*motion)


@linked
@lean
def _check_and_estimate(
    constants: Constants, memory: Memory, inputs: Inputs
) -> tuple[bool, bool, float, Triple, Pair, int]:
    """Do the work of `receive`.

    Returns:
        Whether the law is to be called; and values of `law.Motion`: `first`, `dt`, velocity and yaw
        rate, direction perpendicular to the line of motion, and `failed_brake`.
    """
    step, gate, others = memory.step[0], memory.gate[0], memory.others
    now_ns, limits = inputs.now_ns, constants.limits
    braking = inputs.pedal >= limits.pedal_threshold
    pedal = inputs.pedal if braking else 0.0
    if not braking:
        step.slow, step.dead = False, 0
        others.changed_ns[:] = now_ns  # while the pedal is up, constant readings are plausible

    feedback = _twist_of_center(constants, memory, inputs.feedback)
    complete, step.stuck = fail_safe.check_others(
        limits, constants.bank.roll, others, gate, now_ns, inputs.wheels, inputs.imu
    )
    weighed = complete and constants.fault_detection
    elapsed = min(max(since(now_ns, gate.now_ns) * 1e-9, 0.0), limits.maximum_time_step)
    received = fail_safe.check_twist(limits, gate, now_ns, feedback, braking, weighed)
    good, gate_open, stamp_ns, twist = _estimate(
        constants, memory, inputs, feedback, received, pedal, elapsed
    )
    ready = braking and good and gate_open
    if constants.fault_detection and (ready or not braking):
        _watch(constants, memory, pedal, elapsed, twist)
    within = limits.minimum_reference_speed, limits.maximum_time_step
    dt, begun, across = braking_line.keep_line(
        memory.line[0], stamp_ns, twist, within, braking, good, ready
    )
    first = begun or not step.assisting
    step.assisting = ready or (step.assisting and not begun and braking)
    return ready, first, dt, twist, across, step.dead - 1


@inlined
def _twist_of_center(constants: Constants, memory: Memory, received: TwistSample) -> TwistSample:
    """Return the twist of the center of the wheels for a twist of base_link."""
    _store_twist(constants, memory, received)
    twist, covariance = memory.twist, memory.twist_covariance
    return TwistSample(received.stamp_ns, twist, covariance, received.validity)


@lean
def _store_twist(constants: Constants, memory: Memory, received: TwistSample) -> None:
    """Store a twist of base_link as the twist of the center of the wheels, Eq. (23)."""
    x, y, twist = constants.center[0], constants.center[1], memory.twist
    covariance = memory.twist_covariance
    for i in range(3):
        twist[i] = received.value[i]
        for j in range(3):
            covariance[i, j] = received.covariance[i, j]
    if x != 0.0 or y != 0.0:
        twist[0] -= y * twist[2]
        twist[1] += x * twist[2]
        for j in range(3):
            covariance[0, j] -= y * covariance[2, j]
            covariance[1, j] += x * covariance[2, j]
        for j in range(3):
            covariance[j, 0] -= y * covariance[j, 2]
            covariance[j, 1] += x * covariance[j, 2]
    if constants.shared_gyro:
        for j in range(3):
            covariance[2, j] = covariance[j, 2] = 0.0
        covariance[2, 2] = UNMEASURED_VARIANCE


@lean
def _estimate(
    constants: Constants,
    memory: Memory,
    inputs: Inputs,
    feedback: TwistSample,
    good: bool,
    pedal: float,
    elapsed: float,
) -> tuple[bool, bool, int, Triple]:
    """Choose the twist that the law uses, and the wheel speeds without those of isolated sensors.

    A twist of which no component is measured counts as no twist.

    Args:
        constants: constants of the assistant.
        memory: memory of the assistant, changed in place.
        inputs: inputs of this step.
        feedback: latest twist, of the center of the wheels.
        good: whether the latest twist is valid.
        pedal: the driver's brake demand, 0 while the pedal is up [1].
        elapsed: time since the previous step [s].

    Returns:
        Whether there is an estimate; whether the input gate is open; stamp of the estimate [ns] and
        twist [m/s, m/s, rad/s].
    """
    step, record, cause = memory.step[0], memory.bank.record[0], memory.gate[0].cause
    inertial, speeds = memory.others.values[:3], memory.others.values[3:]
    gate_open, stamp_ns, twist = cause == conditions.GOOD, feedback.stamp_ns, feedback.value
    if constants.fault_detection:
        enables, variance = memory.commanded, feedback.covariance
        released = enables[enables.argmin()] < 1.0
        step.no_effect = effect_monitor.watch_effect(
            constants.effect, memory.effect, elapsed, pedal, released, speeds, inertial
        )
        received = good and cause in conditions.INPUTS_VALID
        least = min(variance[0, 0], variance[1, 1], variance[2, 2])
        validity = VALID if received and least < UNMEASURED_VARIANCE else MISSING
        body, brake = memory.laws.body[0], constants.laws.allocation.brake
        lag = body.dead_time - brake.dead_time if body.responded else bank_state.UNKNOWN_LAG
        age = max(since(inputs.now_ns, inputs.imu.stamp_ns) * 1e-9, 0.0)
        chosen = estimate(
            constants.bank,
            memory.bank,
            inputs.now_ns,
            bank_state.Readings(pedal, enables, inertial, speeds, step.fresh, age, lag, step.stuck),
            TwistSample(stamp_ns, twist, variance, validity),
            memory.answer,
        )
        step.contradicted = chosen == bank_state.NO_ESTIMATE
        step.reckoned = chosen in bank_state.DEAD_RECKONING or not received
        if record.equipped:
            good = gate_open = not step.contradicted
            stamp_ns, twist = inputs.now_ns, memory.answer
        good = good and not step.contradicted
    for i in range(speeds.size):
        isolated = memory.bank.faulty[record.best, i] > bank_state.FAULTY
        memory.law_speeds[i] = math.nan if isolated else speeds[i]
    return good, gate_open, stamp_ns, (twist[0], twist[1], twist[2])


@lean
def _watch(constants: Constants, memory: Memory, pedal: float, dt: float, twist: Triple) -> None:
    """Update the brake monitor, and store the number of a wheel whose brake has failed.

    The arguments `pedal`, `dt` and `twist` are those of `brake_monitor.watch_brakes`.
    """
    step, best = memory.step[0], min(memory.bank.record[0].best, bank_state.NO_IMU)
    scale = memory.bank.state[best, bank_state.SCALE]
    wheels = brake_monitor.BrakedWheels(memory.commanded, memory.law_speeds, scale)
    if step.dead == 0:
        dead = brake_monitor.watch_brakes(constants.brakes, memory.brakes, dt, pedal, wheels, twist)
        if dead == law.NO_WHEEL:
            dead = brake_observer.failed_brake(memory.laws, pedal)
        step.dead = dead + 1
        if dead != law.NO_WHEEL:
            step.assisting = False  # the memory of the law assumes a working brake


@lean_inline
def act(
    constants: Constants,
    memory: Memory,
    inputs: Inputs,
    call: LawCall,
    error: FloatArray,
    enable: FloatArray,
) -> int:
    """Determine the brake enables from the result of the law, and apply the dwell times.

    If the law may not act, all brakes are on.

    Args:
        constants: from `assist_state.make_constants`.
        memory: changed in place.
        inputs: inputs of this step.
        call: input and result of the law.
        error: error of each wheel, which the law has written [m/s], shape (N,).
        enable: enable of each brake, which the law has written [1], shape (N,). This function
            overwrites it with enables that respect the dwell times.

    Returns:
        Index of the row in `conditions.CONDITIONS` that describes the state of the assistant.
    """
    outcome = _outcome(constants, memory, inputs, call, error, enable)
    step = memory.step[0]
    elapsed = float(max(since(inputs.now_ns, step.switched_ns), 0))
    step.switched_ns = inputs.now_ns
    if outcome >= conditions.REPLANNED:
        valves.switch_valves(memory.valves, constants.dwell, elapsed, enable)
    else:
        enable[:] = 1.0
        valves.open_valves(memory.valves, constants.dwell, elapsed)
    for i in range(enable.size):
        memory.commanded[i] = enable[i]
    return int(outcome)


@lean
def _outcome(
    constants: Constants,
    memory: Memory,
    inputs: Inputs,
    call: LawCall,
    error: FloatArray,
    enable: FloatArray,
) -> int:
    ready, motion, answer = call
    if ready:
        answer = _hold(memory, answer, error, enable)
    slow = ready and _is_slow(constants, memory.step[0], motion)
    helps = ready and answer == law.ASSIST
    if answer == law.FAILED:
        fail_safe.close_gate(memory.gate[0], conditions.INTERNAL_ERROR, 0.0, 0.0, 0.0)
        error[:] = 0.0
    if helps:
        helps = _is_any_on(enable, motion.failed_brake)  # so that the vehicle never rolls unbraked
    step = memory.step[0]
    step.fault = _first_fault(step, memory.gate[0].cause, inputs.outside, constants.laws.replans)
    if not inputs.enabled:
        return conditions.DISABLED
    if inputs.pedal < constants.limits.pedal_threshold:
        return conditions.INACTIVE
    # The filter bank can replace a rejected twist. The rows above DEMAND_BACK in the table are
    # faults of other inputs, which nothing can replace.
    if step.fault < conditions.DEMAND_BACK or not ready:
        return int(min(step.fault, conditions.CONTRADICTED))
    if slow:
        return conditions.SLOW
    if step.dead != 0:
        planned = helps and constants.laws.replans
        return conditions.REPLANNED if planned else conditions.FAILED_BRAKE
    assisting = conditions.DEAD_RECKONING if step.reckoned else conditions.ASSISTING
    return assisting if helps else conditions.NO_RELEASE


@lean
def _first_fault(step: Any, cause: int, outside: int, replans: bool) -> int:
    """Return the row of `conditions.CONDITIONS` with the first fault that is present, or GOOD.

    Args:
        step: flags of this step, the record `Memory.step`.
        cause: condition that closed the input gate; GOOD while this gate is open.
        outside: condition that was detected before the kernel is called; see `Inputs.outside`.
        replans: whether `allocation` controls the rest of a stop after a brake has failed. If so, a
            failed brake gives the condition REPLANNED, otherwise FAILED_BRAKE.
    """
    fault = min(outside, cause)
    if step.no_effect:
        fault = min(fault, conditions.NO_EFFECT)
    if step.dead != 0:
        fault = min(fault, conditions.REPLANNED if replans else conditions.FAILED_BRAKE)
    return int(min(fault, conditions.CONTRADICTED) if step.contradicted else fault)


@lean
def _hold(memory: Memory, answer: int, error: FloatArray, enable: FloatArray) -> int:
    """Store the output of the law in `memory`.

    If the law was not called (`answer` is HELD), write its last output to `error` and `enable`.

    Returns:
        Result of the law in its last call, such as ASSIST.
    """
    step, held = memory.step[0], memory.held
    if answer != law.HELD:
        step.answer = answer
    for i in range(enable.size):
        if answer != law.HELD:
            held[0, i], held[1, i] = error[i], enable[i]
        error[i], enable[i] = held[0, i], held[1, i]
    return int(step.answer)


@lean
def _is_any_on(enable: FloatArray, failed: int) -> bool:
    """Return whether any brake other than that of wheel `failed` is on."""
    on = False
    for i in range(enable.size):
        on |= enable[i] > 0.0 and i != failed
    return on


@lean
def _is_slow(constants: Constants, step: Any, motion: law.Motion) -> bool:
    """Return whether the fastest wheel center, Eq. (38), is slower than the speed threshold.

    If it was already slower in the last step, the hysteresis is added to the threshold.
    """
    limits = constants.limits
    limit = limits.speed_threshold + step.slow * limits.speed_hysteresis
    step.slow = limit > fastest_wheel(
        constants.r_x, constants.r_y, motion.v_x, motion.v_y, motion.yaw_rate
    )
    return bool(step.slow)


@lean
def fastest_wheel(r_x: FloatArray, r_y: FloatArray, v_x: float, v_y: float, omega: float) -> float:
    """Return the speed of the fastest wheel center [m/s], Eq. (38).

    Args:
        r_x: wheel positions, x [m], shape (N,).
        r_y: wheel positions, y [m], shape (N,).
        v_x: velocity of the center of the wheels, x [m/s].
        v_y: velocity of the center of the wheels, y [m/s].
        omega: yaw rate [rad/s].
    """
    largest = 0.0
    for i in range(r_x.size):
        w_x, w_y = v_x - omega * r_y[i], v_y + omega * r_x[i]
        largest = max(largest, w_x * w_x + w_y * w_y)
    return math.sqrt(largest)
