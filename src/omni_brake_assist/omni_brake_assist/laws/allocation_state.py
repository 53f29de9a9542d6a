"""Constants, memory and inputs of the law `allocation`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.laws.wheel_model import NominalBrake
from omni_platform.quantities import FloatArray

WHEEL = np.dtype(
    [
        ("speed", "f8"),  # measured at the last step, in the sense of rolling [rad/s]
        ("torque", "f8"),  # of the nominal brake at this step [N m]
        ("mean_torque", "f8"),  # of the nominal brake over the last period [N m]
        ("force", "f8"),  # observed friction force [N]
        ("capacity", "f8"),  # estimated friction limit [N]
        ("demand", "f8"),  # friction force allocated at the last step [N]
    ]
)
BODY = np.dtype(
    [
        ("steps", "i8"),  # since the start of braking
        ("heading", "f8"),  # change since the start of braking [rad]
        ("v_x", "f8"),  # of the last step [m/s]
        ("v_y", "f8"),  # of the last step [m/s]
        ("yaw_rate", "f8"),  # of the last step [rad/s]
        ("a_x", "f8"),  # acceleration, with the lag of the friction observer [m/s^2]
        ("a_y", "f8"),  # acceleration, with the lag of the friction observer [m/s^2]
        ("yaw_acceleration", "f8"),  # with the lag of the friction observer [rad/s^2]
        ("deceleration", "f8"),  # magnitude of the acceleration, filtered [m/s^2]
        ("force", "f8"),  # magnitude of the sum of friction forces, filtered [N]
        ("mass", "f8"),  # estimated [kg]
        ("yaw_disturbance", "f8"),  # yaw acceleration that no friction explains [rad/s^2]
        ("lateral_disturbance", "f8"),  # acceleration across the line [m/s^2]
        ("dead_time", "f8"),  # of the brakes, at least the nominal one [s]
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
        radius: of the wheels [m], shape (N,).
        gyration: assumed square of the radius of gyration [m^2].
        inertia: nominal, of a wheel about its axis [kg m^2].
        mass: nominal, of the vehicle [kg].
        max_rotation: allowed change of heading and of the direction of motion [rad].
        brake: nominal.
        target_slip: [1].
        observer_time: [s].
        growth_time: of a capacity [s].
        slip_time: time constant of slip control [s].
        relaxation_speed: [m/s].
        return_share: [1].
        line_time: [s].
        heading_weight: [1].
        line_weight: [1].
        locked_share: [1].
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
        body: of `BODY`, shape (1,).
        wheel: of `WHEEL`, shape (N,).
        sent: torques commanded to the brakes by step, a ring, shape (QUEUE, N).
    """

    body: NDArray[np.void]
    wheel: NDArray[np.void]
    sent: FloatArray


class Wheels(NamedTuple):
    """The wheels at a step, in the sense in which each rolls, all of shape (N,).

    Attributes:
        sign: of the hub's velocity along the active direction [1].
        hub: magnitude of that velocity [m/s].
        speed: wheel speed, at least 0 [rad/s].
        slip: Eq. (20) [1].
        locked: whether the motion does not drive the wheel: its hub hardly moves along the active
            direction, so its brake is applied and its friction holds against any drift.
        known: whether its speed is measured; a wheel without is assumed to roll.
    """

    sign: FloatArray
    hub: FloatArray
    speed: FloatArray
    slip: FloatArray
    locked: NDArray[np.bool_]
    known: NDArray[np.bool_]
