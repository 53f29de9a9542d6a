"""Inputs, constants and memory of the compiled step of the brake assistant."""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist import braking_line, conditions, fail_safe
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.filter_bank import state as bank_state
from omni_brake_assist.laws import allocation, allocation_state, built_in
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.monitors import brake_monitor, effect_monitor
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import by_reference
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.signals import ImuSample, TwistSample, WheelSample

_STEP = np.dtype(
    [
        ("imu_ns", "i8"),  # stamp of the newest IMU reading [ns]
        ("fresh", "?"),  # whether this reading is new in this step
        ("switched_ns", "i8"),  # stamp of the last valve update [ns]
        ("slow", "?"),  # whether the speed has fallen below the threshold
        ("reckoned", "?"),  # whether the motion is estimated without using the twist
        ("contradicted", "?"),  # whether there is no valid estimate
        ("no_effect", "?"),
        ("stuck", "?"),  # whether a reading has just not changed for `frozen_time`
        ("fault", "i8"),  # first fault present, a row of `conditions.CONDITIONS`
        ("assisting", "?"),  # False if the next step of the law is a first step, see `Motion.first`
        ("answer", "i8"),  # last return value of the law, such as ASSIST
        ("dead", "i8"),  # number of the wheel whose brake failed, counted from 1; 0 for none
    ]
)

_VALVE = np.dtype(
    [
        ("shut", "?"),  # whether the valve is shut, which lets its wheel roll freely
        ("held", "f8"),  # remaining time until the valve may switch [ns]
    ]
)


@by_reference
class Constants(NamedTuple):
    """Constants of the compiled step of the brake assistant.

    All positions and levers are relative to the center of the wheels, so that the decisions do not
    depend on the position of base_link.

    Attributes:
        limits: limits within which inputs are valid, and thresholds.
        laws: constants of the control laws.
        fault_detection: whether the filter bank and the monitors are used.
        bank: constants of the filter bank, which detects sensor faults.
        effect: constants of the effect monitor, which detects braking with too little effect.
        brakes: constants of the brake monitor, which detects failed brakes.
        shared_gyro: whether the yaw rate of the twist is not used, because it is that of the IMU.
        center: center of the wheels in the body frame [m], shape (2,).
        r_x: wheel positions, x [m], shape (N,).
        r_y: wheel positions, y [m], shape (N,).
        dwell: minimum time between two switching operations of a valve [ns].
    """

    limits: fail_safe.Limits
    laws: built_in.LawConstants
    fault_detection: bool
    bank: bank_state.BankConstants
    effect: effect_monitor.EffectConstants
    brakes: brake_monitor.BrakeConstants
    shared_gyro: bool
    center: FloatArray
    r_x: FloatArray
    r_y: FloatArray
    dwell: float


@by_reference
class Memory(NamedTuple):
    """State of the brake assistant between two steps; `new_memory` creates it.

    Attributes:
        gate: state of the gate, which checks the twist; a record of `fail_safe.GATE_STATE`, shape
            (1,).
        step: stamps and flags of the last step, shape (1,).
        line: line of motion to keep, see `braking_line`, shape (1,).
        valves: state of the valves, shape (N,).
        laws: state of the law `allocation`; the other built-in law has no state.
        bank: state of the filter bank, see `filter_bank`.
        effect: state of the effect monitor, see `effect_monitor`, shape (1,).
        brakes: state of the brake monitor, see `brake_monitor.brake_memory`, shape (2 N + 1,).
        law_speeds: wheel speeds given to the law [rad/s], NaN where faulty or unknown, shape (N,).
        commanded: brake enables of the last step [1], shape (N,).
        twist: latest received twist, of the center of the wheels [m/s, m/s, rad/s], shape (3,).
        twist_covariance: covariance of `twist` in the squares of its units, shape (3, 3).
        answer: twist that the filter bank estimates for the present time [m/s, m/s, rad/s],
            shape (3,).
        others: received yaw rate, specific force and wheel speeds.
        held: errors [m/s] and brake enables [1] of the wheels from the last call of the law, shape
            (2, N).
    """

    gate: NDArray[np.void]
    step: NDArray[np.void]
    line: NDArray[np.void]
    valves: NDArray[np.void]
    laws: allocation_state.Memory
    bank: bank_state.BankMemory
    effect: NDArray[np.void]
    brakes: FloatArray
    law_speeds: FloatArray
    commanded: FloatArray
    twist: FloatArray
    twist_covariance: FloatArray
    answer: FloatArray
    others: fail_safe.Others
    held: FloatArray


class Inputs(NamedTuple):
    """Inputs of one step of the brake assistant.

    Attributes:
        now_ns: stamp of the driver's demand [ns].
        pedal: the driver's brake demand, 0 to 1; 1 if the received value is invalid.
        enabled: whether the assistant may release brakes.
        outside: condition that was detected before the kernel is called: INVALID_DEMAND,
            UNKNOWN_WHEEL or WRONG_FRAME; GOOD if no such condition was detected.
        feedback: latest received twist.
        wheels: latest received wheel speeds.
        imu: IMU readings of the step, integrated over it.
    """

    now_ns: int
    pedal: float
    enabled: bool
    outside: int
    feedback: TwistSample
    wheels: WheelSample
    imu: ImuSample


class LawCall(NamedTuple):
    """Input and result of the control law in one step.

    Attributes:
        ready: whether a law may act in this step.
        motion: input of the law.
        answer: result of the law: ASSIST (apply the enables), NO_HELP (all brakes on), FAILED (the
            law raised an error) or HELD (repeat the last result, because the law was not called).
    """

    ready: bool
    motion: Motion
    answer: int


def make_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> Constants:
    """Return the constants of the compiled step for a configuration and wheel geometry."""
    center, geometry = geometry.center, geometry.seen_from(geometry.center)
    if np.any(center):
        x, y = configuration.imu_x - center[0], configuration.imu_y - center[1]
        configuration = dataclasses.replace(configuration, imu_x=float(x), imu_y=float(y))
    r_x, r_y = np.ascontiguousarray(geometry.position.T)
    return Constants(
        fail_safe.make_limits(configuration, float(np.max(np.hypot(r_x, r_y)))),
        built_in.law_constants(configuration, geometry),
        configuration.fault_detection,
        bank_state.bank_constants(configuration, geometry),
        effect_monitor.effect_constants(configuration, geometry),
        brake_monitor.brake_constants(configuration, geometry),
        configuration.shared_gyro,
        center,
        r_x,
        r_y,
        float(round(configuration.minimum_dwell_time * SECOND_NS)),
    )


def new_memory(constants: Constants) -> Memory:
    """Return the state of an assistant that has received no message yet."""
    wheels, step, gate = constants.r_x.size, np.zeros(1, _STEP), np.zeros(1, fail_safe.GATE_STATE)
    gate["cause"] = conditions.NOTHING_YET
    step["imu_ns"], n = -1, 3 + wheels
    return Memory(
        gate,
        step,
        np.zeros(1, braking_line.LINE),
        np.zeros(wheels, _VALVE),
        allocation.new_memory(constants.laws.allocation),
        bank_state.bank_memory(constants.bank),
        effect_monitor.effect_memory(),
        brake_monitor.brake_memory(wheels),
        np.zeros(wheels),
        np.ones(wheels),
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros(3),
        fail_safe.Others(np.zeros(n), np.zeros(n), np.zeros(n, np.int64)),
        np.zeros((2, wheels)),
    )
