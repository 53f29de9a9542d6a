"""What one part tells another: the values that the topics carry, so that nobody converts.

Simulator, odometry and brake assistant pass these between each other in one process; over topics
`messages.py` of each package makes them from the standard messages.
"""

from __future__ import annotations

import dataclasses

from omni_platform.quantities import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Twist:
    """A measured twist of `base_link` in its own axes.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        value: ``(v_cx, v_cy, Omega)`` [m/s, m/s, rad/s], shape (3,).
        covariance: of `value`, shape (3, 3), in the squares of its units.
    """

    stamp_ns: int
    value: FloatArray
    covariance: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Flow:
    """What an optical-flow sensor says.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        velocity: of its place, along its axis and to the left of it [m/s], shape (2,).
        covariance: of `velocity` [m^2/s^2], shape (2, 2); all zero where it states none.
    """

    stamp_ns: int
    velocity: FloatArray
    covariance: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class WheelSpeeds:
    """What the encoders of the wheels say.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        speed: of each wheel about its axis, in the order of the configuration [rad/s], shape (N,).
    """

    stamp_ns: int
    speed: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class ImuReading:
    """What an inertial sensor says.

    Attributes:
        stamp_ns: time of validity [ns from the start of the run].
        yaw_rate: about the z axis of `base_link` [rad/s].
        acceleration: specific force along x and y of `base_link` at the mounting [m/s^2], (2,).
    """

    stamp_ns: int
    yaw_rate: float
    acceleration: FloatArray
