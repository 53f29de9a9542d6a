"""The line of motion that the vehicle should keep, fixed in the world: ``p`` of Eq. (51).

The velocity at the start of braking is stored as a direction in the world frame. Only rotation
since then matters, so the body axes of that moment serve as world axes; the heading since then is
the yaw rate of the feedback, integrated by the trapezoidal rule over its stamps.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.fail_safe import TwistSample

FloatArray = NDArray[np.float64]


class BrakingLine:
    """Keeps the direction across the line of motion and turns it into the body frame.

    Args:
        minimum_speed: speed below which a velocity has no usable direction [m/s].
        maximum_gap: longest time between two samples that the heading may be carried across [s].

    Attributes:
        stored: whether the start of braking has been seen.
        heading: yaw angle turned since then [rad].
    """

    def __init__(self, minimum_speed: float, maximum_gap: float) -> None:
        self._minimum_speed = minimum_speed
        self._maximum_gap = maximum_gap
        self.forget()

    def forget(self) -> None:
        """Drop the line, as when the pedal is released."""
        self.stored = False
        self.heading = 0.0
        self._across: tuple[float, float] | None = None
        self._last: TwistSample | None = None

    def store(self, sample: TwistSample) -> None:
        """Take the velocity of a sample as ``v_c0``; too slow a one has no direction to keep."""
        self.forget()
        self.stored = True
        self._last = sample
        speed = math.hypot(sample.v_x, sample.v_y)
        if speed >= self._minimum_speed:
            self._across = (-sample.v_y / speed, sample.v_x / speed)  # Eq. (51)

    def advance(self, sample: TwistSample) -> None:
        """Carry the heading on to a sample; the line is lost where that cannot be done."""
        if not self.stored or self._last is None:
            return
        dt = (sample.stamp_ns - self._last.stamp_ns) * 1e-9
        if not 0.0 <= dt <= self._maximum_gap:
            self.forget()
            return
        self.heading += (self._last.yaw_rate + sample.yaw_rate) / 2 * dt
        self._last = sample

    def perpendicular(self) -> FloatArray | None:
        """Return ``p`` in the body frame of the last sample [1], shape (2,), or None."""
        if self._across is None:
            return None
        c, s = math.cos(self.heading), math.sin(self.heading)
        p_x, p_y = self._across
        return np.array([c * p_x + s * p_y, c * p_y - s * p_x])
