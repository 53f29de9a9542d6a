"""Wheels with individual rollers in the dynamics kernel: which rollers carry, and their contacts.

Wheels and contacts are those of `roller_wheel`. Forces act at the displaced contact points, Eqs.
(10), (11), so the levers of the platform vary with the wheel angles; the loads are those of wheels
that stand under their centres. While two rollers share a wheel, its spin is solved with the lower
one and feels the other's force of the step before.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_sim.ground.friction import friction_at
from omni_sim.tire.model import curve_at
from omni_sim.wheel.roller import load_share, roller_step
from omni_sim.wheel.roller_geometry import U_X, U_Y, nearest_roller, roller_contact

if TYPE_CHECKING:
    from omni_sim.vehicle.dynamics import Plant

FloatArray = NDArray[np.float64]

# Columns of the roller state: spin, deflection and force along the roller's axis (active) and
# across it (passive), whether it slides, direction of the friction, load, friction limit, slip,
# and the torque on the wheel.
SPIN, E_A, E_P, F_A, F_P, SLIDES, Q_A, Q_P, CARRIES, GRIP, SLIPS, TORQUE = range(12)
ROLLER_SIZE = 12

# An inertia so large that a wheel's speed is prescribed [kg m^2].
_PRESCRIBED = 1e30
# Tipping may flatten a tire down to the roller's axis; its lever stays above this [m].
_LEAST_LEVER = 1e-3


class Rollers(NamedTuple):
    """The individual rollers of all wheels: what they add to `dynamics.Plant`, and their state.

    Attributes:
        tire_y: constants of the tire model in the direction y.
        inertia: of a roller [kg m^2].
        stiffness: of a roller's tread [N/m].
        damping: of a roller's tread [N s/m].
        overlap: see `roller_configuration.RollerConfiguration`.
        state: of the rollers by column, shape (N, n, 12).
        push: forces [N] and moment about the centre of gravity [N m] of each wheel in the last
            step, body frame, shape (N, 3).
    """

    tire_y: Any
    inertia: float
    stiffness: float
    damping: float
    overlap: float
    state: FloatArray
    push: FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def _step_contact(
    plant: Plant,
    rollers: Rollers,
    i: int,
    k: int,
    gamma: float,
    load: float,
    turning: float,
    omega: float,
    inertia: float,
    brake: float,
    drive_stiffness: float,
    drive_speed: float,
    position: tuple[float, float],
    radius: float,
    mobility: float,
    where: tuple[float, float, float, float],
    ahead: tuple[float, float, float],
) -> tuple[float, float]:
    """Advance wheel `i` with its roller `k`; see `roller_wheel.roller_step`.

    Args:
        plant: constants.
        rollers: state of the roller is changed and its force added to the wheel's in place.
        i: index of the wheel.
        k: index of the roller.
        gamma: angle of the roller from its lowest position [rad].
        load: that the roller carries [N].
        turning: wheel speed at the start of the step [rad/s].
        omega: likewise, moved by the torque that this roller does not make [rad/s].
        inertia: of the wheel [kg m^2].
        brake: capacity [N m].
        drive_stiffness: of the clutch [N m s/rad].
        drive_speed: commanded wheel speed [rad/s].
        position: as in `step_roller_wheel`.
        radius: likewise [m].
        mobility: likewise [m/s per N].
        where: likewise.
        ahead: likewise.

    Returns:
        Wheel speed [rad/s], brake torque [N m].
    """
    roller, push = rollers.state[i, k], rollers.push[i]
    u_x, u_y = plant.rollers[i, U_X], plant.rollers[i, U_Y]
    n_x, n_y, r_x, r_y, rim_active, length, depth = roller_contact(gamma, plant.rollers[i])
    p_x, p_y = n_y, -n_x
    r_x += position[0]
    r_y += position[1]
    x, y, cos, sin = where
    friction = friction_at(
        plant.friction, plant.patches, x + cos * r_x - sin * r_y, y + sin * r_x + cos * r_y
    )
    clamped = min(load, plant.largest_load)
    spin_lever = max(radius - depth, _LEAST_LEVER) * length
    lever = (radius * rim_active, radius * (u_x * p_x + u_y * p_y))
    # Speed of the rubber through the contact: wheel along u, roller along its passive direction.
    spin = spin_lever * roller[SPIN]
    rim = radius * turning
    speed = math.hypot(rim * u_x + spin * p_x, rim * u_y + spin * p_y) + plant.slip_speed
    hub_x = ahead[0] - ahead[2] * r_y  # Eq. (11)
    hub_y = ahead[1] + ahead[2] * r_x
    forces, deflection, roller[SPIN], new_omega, brake_torque, slides, q, slip, grip = roller_step(
        omega,
        inertia,
        brake,
        drive_stiffness,
        drive_speed,
        plant.drive_limit,
        lever,
        roller[SPIN],
        rollers.inertia,
        spin_lever,
        (roller[E_A], roller[E_P]),
        (
            hub_x * n_x + hub_y * n_y - mobility * roller[F_A],
            hub_x * p_x + hub_y * p_y - mobility * roller[F_P],
        ),
        mobility,
        speed,
        curve_at(plant.tire, clamped, friction),
        curve_at(rollers.tire_y, clamped, friction),
        rollers.stiffness,
        rollers.damping,
        plant.dt,
        roller[SLIDES] != 0.0,
        (roller[Q_A], roller[Q_P]),
    )
    roller[E_A], roller[E_P] = deflection
    roller[F_A], roller[F_P] = forces
    roller[SLIDES] = 1.0 if slides else 0.0
    roller[Q_A], roller[Q_P] = q
    roller[CARRIES], roller[GRIP], roller[SLIPS] = load, grip, slip
    roller[TORQUE] = -(lever[0] * forces[0] + lever[1] * forces[1])
    f_x = forces[0] * n_x + forces[1] * p_x
    f_y = forces[0] * n_y + forces[1] * p_y
    push[0] += f_x
    push[1] += f_y
    push[2] += r_x * f_y - r_y * f_x
    return new_omega, brake_torque


@njit(cache=True, nogil=True, error_model="numpy")
def _lift(rollers: FloatArray, first: int, second: int) -> None:
    """Relax all rollers of a wheel but those on the ground; they spin on."""
    for k in range(rollers.shape[0]):
        if k not in (first, second) and rollers[k, CARRIES] != 0.0:
            rollers[k, E_A:] = 0.0
            rollers[k, Q_A] = 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def step_roller_wheel(
    plant: Plant,
    rollers: Rollers,
    i: int,
    omega: float,
    angle: float,
    brake: float,
    drive_stiffness: float,
    drive_speed: float,
    load: float,
    position: tuple[float, float],
    radius: float,
    mobility: float,
    where: tuple[float, float, float, float],
    ahead: tuple[float, float, float],
) -> tuple[float, float, int, float]:
    """Advance a wheel by one step with the one or two rollers that carry it.

    Args:
        plant: constants.
        rollers: of all wheels; state and force of wheel `i` are changed in place.
        i: index of the wheel.
        omega: its speed [rad/s].
        angle: its angle at the middle of the step [rad].
        brake: torque that its brake can exert [N m].
        drive_stiffness: of the clutch [N m s/rad], 0 when disengaged.
        drive_speed: commanded wheel speed [rad/s].
        load: that the wheel carries [N].
        position: of the wheel centre from the centre of gravity, body frame [m].
        radius: ``r_D`` of the wheel [m].
        mobility: by how much all forces together change a contact's velocity at most in the step
            [m/s per N].
        where: centre of gravity in the world at the middle of the step [m], cosine and sine of
            the yaw.
        ahead: velocity of the centre of gravity [m/s] and yaw rate [rad/s] at the end of the step
            if the forces did not change, in the body frame.

    Returns:
        Wheel speed [rad/s], brake torque [N m], index of the lower roller, sum of the friction
        limits [N].
    """
    count, pitch = rollers.state.shape[1], plant.roller_pitch
    nearest = nearest_roller(angle, pitch)
    gamma = angle - pitch * nearest
    share = load_share(gamma, 0.5 * pitch, rollers.overlap)
    beside = nearest + (1.0 if gamma > 0.0 else -1.0)
    first, second = int(nearest % count), int(beside % count)
    shared = share < 1.0
    _lift(rollers.state[i], first, second if shared else first)
    rollers.push[i, :] = 0.0
    held = rollers.state[i, second, TORQUE] if shared else 0.0  # of the step before
    new_omega, brake_torque = _step_contact(
        plant,
        rollers,
        i,
        first,
        gamma,
        share * load,
        omega,
        omega + plant.dt * held / plant.wheel_inertia,
        plant.wheel_inertia,
        brake,
        drive_stiffness,
        drive_speed,
        position,
        radius,
        mobility,
        where,
        ahead,
    )
    limit = rollers.state[i, first, GRIP]
    if shared:
        _step_contact(
            plant,
            rollers,
            i,
            second,
            angle - pitch * beside,
            (1.0 - share) * load,
            omega,
            new_omega,
            _PRESCRIBED,
            0.0,
            0.0,
            0.0,
            position,
            radius,
            mobility,
            where,
            ahead,
        )
        limit += rollers.state[i, second, GRIP]
    return new_omega, brake_torque, first, limit


@njit(cache=True, nogil=True, error_model="numpy")
def roller_energies(rollers: Rollers) -> tuple[float, float]:
    """Return the energy of all rollers' spin and that of their deflection [J]."""
    spin, elastic = 0.0, 0.0
    for i in range(rollers.state.shape[0]):
        for k in range(rollers.state.shape[1]):
            roller = rollers.state[i, k]
            spin += 0.5 * rollers.inertia * roller[SPIN] ** 2
            elastic += 0.5 * rollers.stiffness * (roller[E_A] ** 2 + roller[E_P] ** 2)
    return spin, elastic
