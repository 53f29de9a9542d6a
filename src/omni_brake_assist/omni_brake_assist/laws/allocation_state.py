"""Constants, memory and inputs of the law `allocation`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.laws.box_least_squares import Box
from omni_brake_assist.laws.wheel_model import NominalBrake
from omni_platform.quantities import FloatArray

WHEEL = np.dtype(
    [
        ("sign", "f8"),  # of the hub's velocity along the active direction [1]
        ("hub", "f8"),  # magnitude of that velocity [m/s]
        ("speed", "f8"),  # wheel speed in the sense in which the wheel rolls, at least 0 [rad/s]
        ("last_speed", "f8"),  # speed at the last step [rad/s]
        ("known", "?"),  # whether the speed is measured; a wheel without is assumed to roll
        ("slip", "f8"),  # Eq. (20) [1]
        ("locked", "?"),  # whether the motion does not drive the wheel: its hub hardly moves along
        # the active direction, so its brake is applied and its friction holds against any drift
        ("torque", "f8"),  # torque of the nominal brake at this step [N m]
        ("mean_torque", "f8"),  # mean torque of the nominal brake over the last period [N m]
        ("force", "f8"),  # observed friction force [N]
        ("capacity", "f8"),  # estimated friction limit [N]
        ("demand", "f8"),  # share of the capacity allocated at the last step [1]
    ]
)
BODY = np.dtype(
    [
        ("steps", "i8"),  # number of steps since the start of braking
        ("heading", "f8"),  # heading change since the start of braking [rad]
        ("v_x", "f8"),  # velocity of the last step, x [m/s]
        ("v_y", "f8"),  # velocity of the last step, y [m/s]
        ("yaw_rate", "f8"),  # yaw rate of the last step [rad/s]
        ("a_x", "f8"),  # acceleration, with the lag of the friction observer [m/s^2]
        ("a_y", "f8"),  # acceleration, with the lag of the friction observer [m/s^2]
        ("yaw_acceleration", "f8"),  # yaw acceleration, with the same lag [rad/s^2]
        ("deceleration", "f8"),  # magnitude of the acceleration, filtered [m/s^2]
        ("force", "f8"),  # magnitude of the sum of friction forces, filtered [N]
        ("mass", "f8"),  # estimated mass of the vehicle [kg]
        ("yaw_disturbance", "f8"),  # yaw acceleration that friction does not explain [rad/s^2]
        ("lateral_disturbance", "f8"),  # such an acceleration across the line [m/s^2]
        ("dead_time", "f8"),  # estimated dead time of the brakes, at least the nominal one [s]
        ("responded", "?"),  # whether the wheels have responded to the brakes
    ]
)


class Constants(NamedTuple):
    """Parameters of the law, vehicle and brakes.

    Attributes:
        n_x: active directions, x component [1], shape (N,).
        n_y: active directions, y component [1], shape (N,).
        lever: ``cross(r_i, n_wi)`` [m], shape (N,).
        rim: lever ``r_i |n_wi . u_i|`` of a friction force about the wheel's axis [m], shape (N,).
        sense: sign of ``n_wi . u_i`` [1], shape (N,).
        radius: radii of the wheels [m], shape (N,).
        gyration: assumed square of the vehicle's radius of gyration [m^2].
        inertia: nominal inertia of a wheel about its axis [kg m^2].
        mass: nominal mass of the vehicle [kg].
        max_rotation: allowed change of heading and of the direction of motion [rad].
        brake: nominal properties of the brakes.
        target_slip: slip at which a tire transmits its largest force [1].
        observer_time: time constant of the friction observer [s].
        growth_time: time constant of the growth of a capacity [s].
        slip_time: time constant of slip control [s].
        relaxation_speed: additional sliding speed until the tire has deflected [m/s].
        return_share: time constant of the heading over the remaining time of the stop [1].
        line_time: time constant of the return to the line of motion [s].
        heading_weight: weight of the heading in the QP [1].
        line_weight: weight of the line of motion in the QP [1].
        locked_share: share of the fastest hub below which a wheel counts as locked [1].
    """

    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    rim: FloatArray
    sense: FloatArray
    radius: FloatArray
    gyration: float
    inertia: float
    mass: float
    max_rotation: float
    brake: NominalBrake
    target_slip: float
    observer_time: float
    growth_time: float
    slip_time: float
    relaxation_speed: float
    return_share: float
    line_time: float
    heading_weight: float
    line_weight: float
    locked_share: float


class Memory(NamedTuple):
    """State of the law between steps.

    Attributes:
        body: state of the vehicle, a record of `BODY`, shape (1,).
        wheel: state of each wheel, records of `WHEEL`, shape (N,).
        sent: torques commanded to the brakes by step [N m], a ring buffer, shape (QUEUE, N).
        qp: the braking QP, with unknowns as `braking_qp` has them.
        forces: predicted shares of the capacities with a valve shut and open [1], shape (2, N).
        deep: cost of deep slides with a valve shut and open [1], shape (2, N).
    """

    body: NDArray[np.void]
    wheel: NDArray[np.void]
    sent: FloatArray
    qp: Box
    forces: FloatArray
    deep: FloatArray
