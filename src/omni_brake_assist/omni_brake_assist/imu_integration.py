"""IMU readings integrated over control steps, whatever the rate and the jitter of the readings.

A reading of the accelerometer is the mean since the previous reading. Its integral is therefore
known up to the newest reading; from there to the end of a step, the newest reading is held. The
next step corrects the integral by the difference between the held and the received readings, so
that none is lost or counted twice. In this way, autopilots reduce the rate of an IMU to that of
their filter. The mean over the step is the difference of the integrals divided by its length.

The gyro measures the yaw rate at a stamp. In a step, the yaw rate is modeled as a line over the
readings. Its value at the newest of n readings ``y_1 ... y_n`` is the least-squares estimate

    (6 S - 2 (n + 1) sum y_j) / (n (n + 1))  with  S = sum j y_j

A single reading is returned unchanged, and ten readings have a third of the variance of one.
"""

import math

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import lean
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.signals import ImuSample

_STATE = np.dtype(
    [
        ("begun", "?"),  # whether a reading has been received
        ("stamp_ns", "i8"),  # stamp of the newest reading [ns]
        ("step_ns", "i8"),  # end of the last step [ns]
        ("count", "i8"),  # number of gyro readings since the last step
        ("sum", "f8"),  # their sum [rad/s]
        ("weighted", "f8"),  # their sum, weighted by their numbers from 1 [rad/s]
        ("yaw_rate", "f8"),  # yaw rate at the newest reading [rad/s]
        ("force", "f8", 2),  # newest specific force [m/s^2]
        # Integral of the specific force up to the newest reading that no step contains yet; NaN if
        # it is unknown [m/s].
        ("open", "f8", 2),
    ]
)


def new_integral() -> NDArray[np.void]:
    """Return the state before the first reading, shape (1,)."""
    return np.zeros(1, _STATE)


@lean
def add_reading(
    memory: NDArray[np.void], longest_ns: int, stamp_ns: int, yaw_rate: float, force: FloatArray
) -> None:
    """Add a reading; a reading that is not newer than the last one is ignored.

    Args:
        memory: from `new_integral`, changed in place.
        longest_ns: gap between two readings over which the specific force is not integrated [ns].
        stamp_ns: stamp of the reading [ns].
        yaw_rate: yaw rate [rad/s], NaN if unknown.
        force: specific force [m/s^2], NaN if unknown, shape (2,).
    """
    state = memory[0]
    elapsed = stamp_ns - state.stamp_ns
    if state.begun and -longest_ns < elapsed <= 0:
        return
    joined = state.begun and 0 < elapsed <= longest_ns
    for j in range(2):
        state.force[j] = force[j]
        state.open[j] += elapsed * 1e-9 * force[j] if joined else math.nan
    if not math.isfinite(state.sum + yaw_rate):  # a gap ends or begins
        state.count, state.sum, state.weighted = 0, 0.0, 0.0
    state.begun, state.stamp_ns = True, stamp_ns
    state.count += 1
    state.sum += yaw_rate
    state.weighted += state.count * yaw_rate


@lean
def end_step(memory: NDArray[np.void], now_ns: int, force: FloatArray) -> float:
    """End a step: write its mean specific force to `force`, and return the yaw rate.

    Args:
        memory: from `new_integral`, changed in place.
        now_ns: end of the step [ns].
        force: output, specific force [m/s^2], NaN if unknown, shape (2,).

    Returns:
        Yaw rate at the newest reading [rad/s], NaN if unknown.
    """
    state = memory[0]
    step = (now_ns - state.step_ns) * 1e-9
    for j in range(2):
        held = state.force[j] * (now_ns - state.stamp_ns) * 1e-9
        force[j] = (state.open[j] + held) / step if step > 0.0 else math.nan
        if not math.isfinite(force[j]):
            force[j] = state.force[j]
        if step != 0.0:
            state.open[j] = -held
    n = state.count
    if n > 0:
        state.yaw_rate = (6.0 * state.weighted - 2.0 * (n + 1) * state.sum) / (n * (n + 1))
    state.step_ns, state.count, state.sum, state.weighted = now_ns, 0, 0.0, 0.0
    return float(state.yaw_rate)


class ImuIntegrator:
    """Integrates the received IMU readings over control steps.

    Args:
        timeout: gap between two readings over which the specific force is not integrated [s].
    """

    def __init__(self, timeout: float) -> None:
        self._memory = new_integral()
        self._longest_ns = round(timeout * SECOND_NS)

    def add(self, sample: ImuSample) -> None:
        """Add a reading."""
        stamp_ns, yaw_rate, force, _ = sample
        add_reading(self._memory, self._longest_ns, stamp_ns, yaw_rate, force)

    def end_step(self, now_ns: int) -> ImuSample | None:
        """Return the readings since the last step as one sample; None before the first reading.

        The stamp is that of the newest reading. Without a new reading, the last one is held.

        Args:
            now_ns: end of the step [ns].
        """
        state, force = self._memory[0], np.empty(2)
        if not state["begun"]:
            return None
        yaw_rate = end_step(self._memory, now_ns, force)
        return ImuSample(int(state["stamp_ns"]), yaw_rate, force)
