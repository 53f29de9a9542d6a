"""Types of samples; each type contains the values of one signal, as the signal's message does.

In one process, simulator, odometry and brake assistant exchange samples directly. In a ROS graph,
the `messages.py` of each package converts standard messages to samples.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_core.quantities import GRAVITY, FloatArray

VALID, MISSING, INVALID = range(3)
"""Validity of a sample: MISSING if none has been received, INVALID if its content is malformed."""

UNMEASURED_VARIANCE = 1e6
"""A component with at least this variance counts as not measured [square of its unit]."""

_UPWARDS_TOLERANCE = 2.0  # allows for slopes and a scale error, but not for another unit [m/s^2]


class PedalSample(NamedTuple):
    """Position of the brake pedal.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        position: driver's brake demand [1], 0 to 1.
    """

    stamp_ns: int
    position: float


class TwistSample(NamedTuple):
    """A measured twist of `base_link` in its own axes.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        value: ``(v_cx, v_cy, Omega)`` [m/s, m/s, rad/s], shape (3,).
        covariance: covariance of `value`, shape (3, 3), in the squares of its units.
        validity: VALID, MISSING or INVALID.
    """

    stamp_ns: int
    value: FloatArray
    covariance: FloatArray
    validity: int = VALID


@dataclasses.dataclass(frozen=True, eq=False)
class Flow:
    """A measurement of an optical-flow sensor.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        velocity: velocity of the sensor, along its axis and to the left of it [m/s], shape (2,).
        covariance: covariance of `velocity` [m^2/s^2], shape (2, 2); all zero if unknown.
    """

    stamp_ns: int
    velocity: FloatArray
    covariance: FloatArray


class WheelSample(NamedTuple):
    """Speeds measured by the wheel encoders.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        speed: rotational speed of each wheel [rad/s], in the order of the configuration, shape
            (N,).
        validity: VALID, MISSING or INVALID.
    """

    stamp_ns: int
    speed: FloatArray
    validity: int = VALID


class ImuSample(NamedTuple):
    """A reading of the inertial sensor.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        yaw_rate: angular velocity about the z axis of `base_link` [rad/s].
        acceleration: specific force at the mounting along x and y of `base_link` [m/s^2], shape
            (2,).
        validity: VALID, MISSING or INVALID.
    """

    stamp_ns: int
    yaw_rate: float
    acceleration: FloatArray
    validity: int = VALID


Lines = NDArray[np.uint8] | NDArray[np.uint16]
"""Gray levels of consecutive lines, oldest first, shape (m, pixels)."""


class LineBatchError(ValueError):
    """A batch of lines is invalid; the message states the reason."""


@dataclasses.dataclass(frozen=True)
class LineBatch:
    """Consecutive lines of one sensor.

    Attributes:
        stamp_ns: exposure of the newest line [ns].
        lines: gray levels, uint8 or uint16, oldest line first, shape (m, pixels).
        fault: reason why the lines cannot be used, such as an unknown format; empty for usable
            lines.

    Raises:
        LineBatchError: the lines have another type or shape.
    """

    stamp_ns: int
    lines: Lines
    fault: str = ""

    @classmethod
    def unusable(cls, stamp_ns: int, fault: str) -> LineBatch:
        """Create a batch without lines; `fault` is the reason for this."""
        return cls(stamp_ns, np.empty((0, 0), np.uint8), fault)

    def __post_init__(self) -> None:
        if self.lines.ndim != 2 or self.lines.dtype not in (np.uint8, np.uint16):
            raise LineBatchError(
                "lines must be an array of uint8 or uint16 with one row per line, "
                f"not of {self.lines.dtype} with shape {self.lines.shape}"
            )


def upwards_problem(upwards: float) -> tuple[str, str] | None:
    """Return problem and remedy if a specific force upwards [m/s^2] is not near 1 g, else None."""
    if abs(upwards - GRAVITY) <= _UPWARDS_TOLERANCE:
        return None
    problem = f"imu: specific force upwards {upwards:.2f}, must be {GRAVITY:g} m/s^2 (REP 145)"
    return problem, "check unit and axes"
