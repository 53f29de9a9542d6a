"""One control step of the brake assistant on trusted feedback, as a compiled kernel.

`brake_assist` calls it behind its fail-safe, and a simulation of many runs calls it without the
detour through messages and checks: both brake with the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_brake_assist.braking_line import (
    LINE_SIZE,
    STORED,
    advance_line,
    forget_line,
    perpendicular,
    store_line,
)
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.sliding_manifold import Manifold, fastest_wheel, wheel_error
from omni_brake_assist.valve_dwell import open_valves, switch_valves

FloatArray = NDArray[np.float64]

# What a step comes to. In all but ASSIST every brake is on.
RELEASED, UNTRUSTED, SLOW, NO_HELP, ASSIST = range(5)

# The memory holds the braking line, then whether the speed fell below the threshold.
_SLOW = LINE_SIZE
MEMORY_SIZE = LINE_SIZE + 1


class ControlLaw(NamedTuple):
    """The constants of the control law.

    Attributes:
        manifold: of the error functions.
        enabled: whether brakes may be released.
        pedal_threshold: from which the driver brakes [1].
        minimum_reference_speed: below which there is no line to keep [m/s].
        speed_threshold: of the fastest wheel centre, below which all brakes are on [m/s].
        speed_hysteresis: above it, to resume assisting [m/s].
        dwell: shortest time between two switchings of a valve [ns].
    """

    manifold: Manifold
    enabled: bool
    pedal_threshold: float
    minimum_reference_speed: float
    speed_threshold: float
    speed_hysteresis: float
    dwell: float


def control_law(configuration: BrakeAssistConfiguration, manifold: Manifold) -> ControlLaw:
    """Lay out the constants of the law for the kernel."""
    return ControlLaw(
        manifold,
        configuration.enabled,
        configuration.pedal_threshold,
        configuration.minimum_reference_speed,
        configuration.speed_threshold,
        configuration.speed_hysteresis,
        float(round(configuration.minimum_dwell_time * 1e9)),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _is_slow(law: ControlLaw, memory: FloatArray, speed: float) -> bool:
    limit = law.speed_threshold
    if memory[_SLOW] != 0.0:
        limit += law.speed_hysteresis
    slow = speed < limit
    memory[_SLOW] = 1.0 if slow else 0.0
    return slow


@njit(cache=True, nogil=True, error_model="numpy")
def _judge(
    law: ControlLaw,
    memory: FloatArray,
    braking: bool,
    good: bool,
    trusted: bool,
    dt: float,
    v_x: float,
    v_y: float,
    omega: float,
    error: FloatArray,
) -> int:
    """Follow the braking line and compute the errors; arguments as for `control_step`."""
    error[:] = 0.0
    line = memory[:LINE_SIZE]
    if not braking:
        forget_line(line)
        memory[_SLOW] = 0.0
        return RELEASED
    if good:
        if line[STORED] != 0.0:
            advance_line(line, dt, omega)
        elif trusted:
            store_line(line, law.minimum_reference_speed, v_x, v_y, omega)
    if not (good and trusted):
        return UNTRUSTED
    p_x, p_y = perpendicular(line)
    helpful = 0
    for i in range(error.size):
        s_perp, s_omega, s_par = wheel_error(law.manifold, i, v_x, v_y, omega, p_x, p_y)
        error[i] = s_perp + s_omega + s_par  # Eq. (44)
        helpful += error[i] < 0.0
    if _is_slow(law, memory, fastest_wheel(law.manifold, v_x, v_y, omega)):
        return SLOW
    if helpful == 0:
        return NO_HELP
    return ASSIST


@njit(cache=True, nogil=True, error_model="numpy")
def control_step(
    law: ControlLaw,
    memory: FloatArray,
    valves: FloatArray,
    elapsed: float,
    braking: bool,
    good: bool,
    trusted: bool,
    dt: float,
    v_x: float,
    v_y: float,
    omega: float,
    error: FloatArray,
    enable: FloatArray,
) -> int:
    """Follow the braking line and decide which brakes help, Eqs. (44)-(46), section 3.3.

    Args:
        law: constants.
        memory: from step to step, zeros at the start, shape (7,).
        valves: likewise, see `valve_dwell`, shape (N, 2).
        elapsed: time since the last step [ns].
        braking: whether the driver brakes.
        good: whether the feedback passed every check; otherwise its numbers are not used.
        trusted: whether good feedback may release brakes.
        dt: time since the last good feedback [s].
        v_x: ``v_cx`` of the feedback [m/s].
        v_y: ``v_cy`` [m/s].
        omega: ``Omega`` [rad/s].
        error: receives ``s_i`` [m/s], shape (N,); zeros without braking or trust.
        enable: receives 1 where brake pressure passes, else 0, shape (N,).

    Returns:
        One of RELEASED, UNTRUSTED, SLOW, NO_HELP and ASSIST.
    """
    outcome = _judge(law, memory, braking, good, trusted, dt, v_x, v_y, omega, error)
    if outcome == ASSIST and law.enabled:
        for i in range(error.size):
            enable[i] = 1.0 if error[i] < 0.0 else 0.0  # Eqs. (45), (46)
        switch_valves(valves, law.dwell, elapsed, enable)
    else:
        enable[:] = 1.0
        open_valves(valves, law.dwell, elapsed)
    return int(outcome)
