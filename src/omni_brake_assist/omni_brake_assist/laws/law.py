"""Interface of a control law: its input `Motion` and its output, the brake enables.

While the pedal is down and the motion is known, a law is called once for each new stamp of the
motion. Its result is reused for further demands with the same stamp. For each wheel the law writes
the share of the brake pressure that should pass. The fail-safe reactions are in `assist_step`, so a
law needs no such reactions.
"""

import math
import sys
import traceback
from typing import NamedTuple, Protocol

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray

# Results of a law. ASSIST: apply the enables. NO_HELP: put all brakes on, because releasing some of
# them would not help, or too few wheel speeds are known. FAILED: the law raised an error. HELD: the
# law was not called, because the motion has the same stamp as in the last call.
ASSIST, NO_HELP, FAILED, HELD = range(4)

NO_WHEEL = -1


class Motion(NamedTuple):
    """Input of a law at a control step.

    Attributes:
        first: whether this is the first step of a stop or of a new line of motion.
        dt: time since the motion of the previous step [s]; a law receives 0 only in the first step.
        v_x: velocity of the center of the wheels along x in the body frame [m/s].
        v_y: velocity of the center of the wheels along y in the body frame [m/s].
        yaw_rate: yaw rate [rad/s].
        across_x: x component of the unit vector across the line of motion in the present body
            frame, ``p`` of Eq. (51) of the dissertation [1]; 0 if there is no line to keep.
        across_y: y component of this vector [1].
        pedal: the driver's brake demand, 0 to 1.
        wheel_speed: wheel speeds about the axes [rad/s], NaN where unknown, shape (N,).
        failed_brake: index of the wheel whose brake has failed, NO_WHEEL if all brakes work.
        force_x: specific force along x in the body frame [m/s^2], NaN where unknown.
        force_y: specific force along y [m/s^2], NaN where unknown.
        new_force: whether the specific force contains a reading that no earlier step contains.
    """

    first: bool
    dt: float
    v_x: float
    v_y: float
    yaw_rate: float
    across_x: float
    across_y: float
    pedal: float
    wheel_speed: FloatArray
    failed_brake: int = NO_WHEEL
    force_x: float = math.nan
    force_y: float = math.nan
    new_force: bool = True


class Law(Protocol):
    """A control law, created from a `BrakeAssistConfiguration` and a `PlatformGeometry`.

    The positions of the geometry are relative to the center of the wheels.
    """

    def step(self, motion: Motion, error: FloatArray, enable: FloatArray) -> int | None:
        """Compute the brake enables of one step.

        Args:
            motion: motion of the vehicle and its wheels.
            error: output, error of each wheel as the law defines it [m/s], finite, shape (N,);
                only recorded.
            enable: output, share of the brake pressure that passes, 0 to 1, shape (N,); rounded to
                the resolution of the brakes. If all are then 0, the assistant puts all brakes on.

        Returns:
            ASSIST or None to apply the enables, NO_HELP to put all brakes on.
        """


_shown: set[tuple[type, str]] = set()  # laws and those of their events that have been printed


@lean
def is_valid(error: FloatArray, enable: FloatArray) -> bool:
    """Return whether every error that a law has written is finite and every enable in [0, 1]."""
    valid = True
    for i in range(enable.size):
        valid &= 0.0 <= enable[i] <= 1.0 and math.isfinite(error[i])
    return bool(valid)


def call_law(
    law: Law,
    motion: Motion,
    error: FloatArray,
    enable: FloatArray,
    pressure_step: float,
    *,
    enabled: bool = True,
) -> tuple[int, str]:
    """Call a user's law, and return its result and an error message.

    The enables are rounded to the resolution of the brakes (`pressure_step`, 1 for on-off valves),
    as the valves do, so that the assistant monitors the brakes that are on.

    The result is a constant of this module, such as ASSIST. The message is empty unless the result
    is FAILED. If the law may release brakes (`enabled`), this function also prints the first error
    to standard error, with the lines of the law's file at which the error occurred. It also prints
    a sentence when the law releases every wheel for the first time.
    """
    if not (motion.first or motion.dt > 0.0):
        return HELD, ""
    try:
        answer = law.step(motion, error, enable)
        if not is_valid(error, enable):
            raise ValueError(
                f"the law wrote the enables {enable.tolist()}, must be within [0, 1], and the "
                f"errors {error.tolist()}, must be finite"
            )
        if answer is not None and (type(answer) is not int or answer not in (ASSIST, NO_HELP)):
            raise ValueError(
                f"step returned {answer!r}, must be None, ASSIST or NO_HELP; step writes the "
                "shares of the brake pressure into enable"
            )
        if pressure_step > 0.0:
            enable[:] = np.minimum(np.floor(enable / pressure_step + 0.5) * pressure_step, 1.0)
    except (Exception, SystemExit) as problem:  # no error of a law may release a brake
        if enabled:
            frames = traceback.extract_tb(problem.__traceback__)[1:]  # without this function
            lines = traceback.format_list(frames) + traceback.format_exception_only(problem)
            _show(law, "failed", "\n" + "".join(lines).rstrip())
        return FAILED, f"{type(problem).__name__}: {problem}"
    if enabled and answer != NO_HELP and not enable.any():
        twist = f"({motion.v_x:.3g} m/s, {motion.v_y:.3g} m/s, {motion.yaw_rate:.3g} rad/s)"
        _show(law, "released every wheel", f" the twist is {twist}")
    return ASSIST if answer is None else answer, ""


def _show(law: Law, event: str, details: str) -> None:
    """Print once for a law what it has done, and that all brakes are on for this reason."""
    if (type(law), event) not in _shown:
        _shown.add((type(law), event))
        name = f"{type(law).__module__}:{type(law).__qualname__}"
        sentence = f"control law {name} {event}, so all brakes are on (shown once):"
        print(sentence + details, file=sys.stderr, flush=True)
