"""Constants and memory of the law `allocation`.

Each wheel is modeled as a mass at its rim. The lever of the friction force about the axle converts
the wheel speed to the speed of the rim along the active direction, the wheel's inertia to the mass,
and the brake torque to a force.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.laws.box_least_squares import Box
from omni_brake_assist.laws.wheel_model import NominalBrake
from omni_core.kernels import by_reference
from omni_core.quantities import FloatArray

CASCADE = 2.0
"""Ratio of the time constant of a loop to that of the next inner loop [1]."""

WHEEL = np.dtype(
    [
        # Sign of the hub's velocity along the active direction [1]; if the locked wheel holds its
        # hub, the sign of the velocity of the wheels' center along this direction.
        ("sign", "f8"),
        ("hub", "f8"),  # speed of the hub along the active direction [m/s]
        ("speed", "f8"),  # speed of the rim in the sense of rolling, at least 0 [m/s]
        ("last_speed", "f8"),  # speed of the rim in the last step [m/s]
        # Whether the wheel speed is measured and plausible; if not, rolling is assumed.
        ("known", "?"),
        ("idle", "f8"),  # time for which friction should have turned a wheel that reads 0 [s]
        # Whether the enable stays 1, because the brake has failed or the motion hardly drives the
        # wheel. The friction of a wheel that the motion hardly drives only opposes a drift.
        ("fixed", "?"),
        ("brake", "f8"),  # nominal brake force in this step [N]
        ("measured", "f8"),  # friction force over the last period [N]
        ("force", "f8"),  # low-passed friction force [N]
        ("capacity", "f8"),  # estimated friction capacity [N]
        # Largest friction force with the present pedal: the capacity, or the whole brake force [N].
        ("usable", "f8"),
        ("late_brake", "f8"),  # nominal brake force with an additional lag [N]
        ("impulse", "f8"),  # integral of `measured` since the last reading of the IMU [N s]
        ("spun", "f8"),  # part of this integral that has changed the speed of the rim [N s]
        ("lost", "f8"),  # log-likelihood ratio of a brake without torque to a working brake [1]
    ]
)
BODY = np.dtype(
    [
        ("dt", "f8"),  # length of the last period [s]
        ("steps", "i8"),  # number of steps since the start of braking
        ("heading", "f8"),  # heading change since the start of braking [rad]
        ("twist", "f8", 3),  # velocity and yaw rate in the last step [m/s, m/s, rad/s]
        ("mass", "f8"),  # estimated mass of the vehicle [kg]
        # Remaining time of the stop if all wheels used the largest possible friction forces, and
        # these opposed the motion [s].
        ("left", "f8"),
        ("yaw_disturbance", "f8"),  # yaw acceleration that friction does not explain [rad/s^2]
        ("lateral_disturbance", "f8"),  # unexplained acceleration across the line [m/s^2]
        ("dead_time", "f8"),  # estimated dead time of the brakes, at least the nominal one [s]
        # Estimated reciprocal of the mass [1/kg], and its variance [1/kg^2] (`brake_observer`).
        ("inverse_mass", "f8"),
        ("inverse_variance", "f8"),
        # Recent change of the velocity that the specific force does not explain, x, y [m/s].
        ("contradiction", "f8", 2),
        ("span", "f8"),  # time since the last reading of the IMU [s]
        ("felt", "f8", 2),  # integral of the specific force since this reading, x, y [m/s]
        ("pushed", "f8"),  # evidence of an external force, as `lost` of a wheel [nats]
        ("responded", "?"),  # whether the wheels have responded to the brakes
    ]
)


@by_reference
class Constants(NamedTuple):
    """Constants of the law `allocation`: parameters of the law, the vehicle and the brakes.

    Attributes:
        active: active direction ``n_wi`` [1] of each wheel, and its lever about the center
            of the wheels, ``cross(r_i, n_wi)`` with the wheel's position ``r_i`` [m], shape (N, 3).
        rim: ratio of the rim's speed along the active direction to the wheel speed,
            ``R_i n_wi . u_i`` with the wheel's radius ``R_i`` and rolling direction ``u_i`` [m],
            shape (N,).
        wheel_mass: inertia of a wheel as a mass at its rim [kg], shape (N,).
        most: brake force with the pedal fully down [N], shape (N,).
        gyration: assumed radius of gyration of the vehicle about the vertical axis [m].
        mass: nominal mass of the vehicle [kg].
        max_rotation: allowed change of heading and of the direction of motion [rad].
        period: control period, assumed at the first step [s].
        commands: number of stored commands, enough for the longest dead time.
        brake: nominal lag of the brakes.
        follows: whether the brakes are drives that follow a speed with unknown torques.
        imu_x: position of the IMU relative to the center of the wheels, x [m].
        imu_y: position of the IMU, y [m].
        target_slip: ratio of the sliding speed to the speed of the rim along the active direction
            at which the tire transmits its largest force [1], shape (N,).
        observer_time: time constant of the friction observer [s].
        relaxation_speed: sliding speed that is added to the set-point until the tire has deflected
            [m/s].
        return_share: time constant of the heading correction as a share of the remaining time of
            the stop [1].
        deviation_weight: weight of heading and line of motion in the QP [1].
        locked_share: share that defines two limits [1]. A wheel is locked if its rim is slower than
            this share of the rolling speed. The motion does not turn a wheel if, along its active
            direction, hub and vehicle are slower than this share of the vehicle's speed.
    """

    active: FloatArray
    rim: FloatArray
    wheel_mass: FloatArray
    most: FloatArray
    gyration: float
    mass: float
    max_rotation: float
    period: float
    commands: int
    brake: NominalBrake
    follows: bool
    imu_x: float
    imu_y: float
    target_slip: FloatArray
    observer_time: float
    relaxation_speed: float
    return_share: float
    deviation_weight: float
    locked_share: float


@by_reference
class Memory(NamedTuple):
    """State of the law `allocation` between two steps.

    Attributes:
        body: state of the vehicle, a record of `BODY`, shape (1,).
        wheel: state of each wheel, records of `WHEEL`, shape (N,).
        sent: commands of past steps as shares of the force with the pedal fully down [1], a ring
            buffer, shape (Q, N); Q is `Constants.commands`.
        qp: the braking QP with the unknowns listed in `braking_qp`. Its solution begins with the
            demanded shares of the wheels' capacities.
        forces: predicted low-passed friction force of each wheel with the valve shut and with the
            valve open, as a share of the usable force [1], shape (2, N).
    """

    body: NDArray[np.void]
    wheel: NDArray[np.void]
    sent: FloatArray
    qp: Box
    forces: FloatArray
