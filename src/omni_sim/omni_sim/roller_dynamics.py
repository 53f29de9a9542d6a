"""Planar motion of a vehicle on individual-roller wheels: the kernel of `roller_vehicle`.

Body, loads, drives and brakes are those of `dynamics`; wheels and contacts those of
`roller_wheel`. Forces act at the displaced contact points, Eqs. (10), (11), so the levers of the
platform vary with the wheel angles; the loads are those of wheels that stand under their centres.
While two rollers share a wheel, its spin is solved with the lower one and feels the other's force
of the step before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_sim import dynamics
from omni_sim.characteristic import curve_at_load
from omni_sim.dynamics import Control, Plant, move_body, velocity_ahead, write_pose
from omni_sim.friction import friction_at
from omni_sim.loads import GRAVITY, wheel_loads
from omni_sim.roller_geometry import U_X, U_Y, nearest_roller, roller_contact
from omni_sim.roller_wheel import load_share, roller_step

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Columns of the roller state: spin, deflection and force along the roller's axis (active) and
# across it (passive), whether it slides, direction of the friction, load, friction limit, slip,
# and the torque on the wheel.
SPIN, E_A, E_P, F_A, F_P, SLIDES, Q_A, Q_P, CARRIES, GRIP, SLIPS, TORQUE = range(12)
ROLLER_SIZE = 12

# An inertia so large that a wheel's speed is prescribed [kg m^2].
_PRESCRIBED = 1e30


class RollerPlant(NamedTuple):
    """What rollers add to `dynamics.Plant`.

    Attributes:
        curve_y: of the tyre's direction y, shape (10,).
        inertia: of a roller [kg m^2].
        overlap: see `roller_configuration.RollerConfiguration`.
    """

    curve_y: FloatArray
    inertia: float
    overlap: float


@njit(cache=True, nogil=True, error_model="numpy")
def _step_contact(
    plant: Plant,
    more: RollerPlant,
    i: int,
    gamma: float,
    load: float,
    wheel_load: float,
    where: tuple[float, float, float, float],
    ahead: tuple[float, float, float],
    turning: float,
    omega: float,
    inertia: float,
    brake: float,
    drive_stiffness: float,
    drive_speed: float,
    roller: FloatArray,
    push: FloatArray,
) -> tuple[float, float]:
    """Advance wheel `i` with one roller; see `roller_wheel.roller_step`.

    Args:
        plant: constants.
        more: constants of the rollers.
        i: index of the wheel.
        gamma: angle of the roller from its lowest position [rad].
        load: that the roller carries [N].
        wheel_load: that the wheel carries [N].
        where: centre of gravity in the world [m], cosine and sine of the yaw.
        ahead: as in `dynamics`.
        turning: wheel speed at the start of the step [rad/s].
        omega: likewise, moved by the torque that this roller does not make [rad/s].
        inertia: of the wheel [kg m^2].
        brake: capacity [N m].
        drive_stiffness: of the clutch [N m s/rad].
        drive_speed: commanded wheel speed [rad/s].
        roller: state of the roller, changed in place.
        push: force [N] and moment [N m] of the wheel on the body, added to, shape (3,).

    Returns:
        Wheel speed [rad/s], brake torque [N m].
    """
    dt = plant.dt
    constants = plant.wheel[i]
    u_x, u_y = plant.rollers[i, U_X], plant.rollers[i, U_Y]
    n_x, n_y, r_x, r_y, rim_active, length, depth = roller_contact(gamma, plant.rollers[i])
    p_x, p_y = n_y, -n_x
    r_x += constants[dynamics.R_X]
    r_y += constants[dynamics.R_Y]
    x, y, cos, sin = where
    friction = friction_at(
        plant.friction, plant.patches, x + cos * r_x - sin * r_y, y + sin * r_x + cos * r_y
    )
    clamped = min(load, plant.largest_load)
    radius = constants[dynamics.RADIUS] - wheel_load / plant.vertical_stiffness
    # Tipping may flatten a tyre to the roller's axis.
    spin_lever = max(radius - depth, 1e-3) * length
    lever = (radius * rim_active, radius * (u_x * p_x + u_y * p_y))
    # Speed of the rubber through the contact: wheel along u, roller along its passive direction.
    spin = spin_lever * roller[SPIN]
    rim = radius * turning
    speed = math.hypot(rim * u_x + spin * p_x, rim * u_y + spin * p_y) + plant.slip_speed
    mobility = dt * constants[dynamics.MOBILITY]
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
        more.inertia,
        spin_lever,
        (roller[E_A], roller[E_P]),
        (
            hub_x * n_x + hub_y * n_y - mobility * roller[F_A],
            hub_x * p_x + hub_y * p_y - mobility * roller[F_P],
        ),
        mobility,
        speed,
        curve_at_load(plant.curve, clamped, friction),
        curve_at_load(more.curve_y, clamped, friction),
        plant.stiffness,
        plant.damping,
        dt,
        roller[SLIDES] != 0.0,
        (roller[Q_A], roller[Q_P]),
    )
    roller[E_A], roller[E_P] = deflection
    roller[F_A], roller[F_P] = forces
    roller[SLIDES] = 1.0 if slides else 0.0
    roller[Q_A], roller[Q_P] = q
    roller[CARRIES], roller[GRIP], roller[SLIPS] = load, grip, slip
    f_x = forces[0] * n_x + forces[1] * p_x
    f_y = forces[0] * n_y + forces[1] * p_y
    push[0] += f_x
    push[1] += f_y
    push[2] += r_x * f_y - r_y * f_x
    roller[TORQUE] = -(lever[0] * forces[0] + lever[1] * forces[1])
    return new_omega, brake_torque


@njit(cache=True, nogil=True, error_model="numpy")
def _lift(rollers: FloatArray, first: int, second: int) -> None:
    """Relax all rollers of a wheel but those on the ground; they spin on."""
    for k in range(rollers.shape[0]):
        if k not in (first, second) and rollers[k, CARRIES] != 0.0:
            rollers[k, E_A:] = 0.0
            rollers[k, Q_A] = 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _step_wheel(
    plant: Plant,
    more: RollerPlant,
    control: Control,
    i: int,
    load: float,
    where: tuple[float, float, float, float],
    ahead: tuple[float, float, float],
    drive_speed: float,
    wheel: FloatArray,
    rollers: FloatArray,
    push: FloatArray,
) -> None:
    """Advance wheel `i` with the one or two rollers that carry it."""
    dt, omega = plant.dt, wheel[dynamics.SPEED]
    count, pitch = rollers.shape[0], plant.roller_pitch
    angle = wheel[dynamics.ANGLE] + 0.5 * dt * omega
    nearest = nearest_roller(angle, pitch)
    gamma = angle - pitch * nearest
    share = load_share(gamma, 0.5 * pitch, more.overlap)
    beside = nearest + (1 if gamma > 0.0 else -1)
    first, second = int(nearest % count), int(beside % count)
    _lift(rollers, first, second if share < 1.0 else first)

    shared = share < 1.0
    held = rollers[second, TORQUE] if shared else 0.0  # of the step before
    push[:] = 0.0
    new_omega, brake_torque = _step_contact(
        plant,
        more,
        i,
        gamma,
        share * load,
        load,
        where,
        ahead,
        omega,
        omega + dt * held / plant.wheel_inertia,
        plant.wheel_inertia,
        control.brake[i],
        control.drive_stiffness,
        drive_speed,
        rollers[first],
        push,
    )
    wheel[dynamics.LIMIT] = rollers[first, GRIP]
    if shared:
        _step_contact(
            plant,
            more,
            i,
            angle - pitch * beside,
            (1.0 - share) * load,
            load,
            where,
            ahead,
            omega,
            new_omega,
            _PRESCRIBED,
            0.0,
            0.0,
            0.0,
            rollers[second],
            push,
        )
        wheel[dynamics.LIMIT] += rollers[second, GRIP]
    wheel[dynamics.DEFLECTION] = rollers[first, E_A]
    wheel[dynamics.FORCE] = (
        push[0] * plant.wheel[i, dynamics.N_X] + push[1] * plant.wheel[i, dynamics.N_Y]
    )
    wheel[dynamics.SPEED] = new_omega
    wheel[dynamics.ANGLE] += 0.5 * dt * (omega + new_omega)
    wheel[dynamics.LOAD] = load
    wheel[dynamics.BRAKE] = brake_torque
    wheel[dynamics.SLIDING] = rollers[first, SLIDES]
    wheel[dynamics.SLIP] = rollers[first, SLIPS]


@njit(cache=True, nogil=True, error_model="numpy")
def _total(pushes: FloatArray) -> tuple[float, float, float]:
    """Return force [N] and moment [N m] of all wheels."""
    pull_x, pull_y, turn = 0.0, 0.0, 0.0
    for i in range(pushes.shape[0]):
        pull_x += pushes[i, 0]
        pull_y += pushes[i, 1]
        turn += pushes[i, 2]
    return pull_x, pull_y, turn


@njit(cache=True, nogil=True, error_model="numpy")
def _write_log(
    plant: Plant,
    more: RollerPlant,
    body: FloatArray,
    wheels: FloatArray,
    rollers: FloatArray,
    row: FloatArray,
    energy: FloatArray,
) -> None:
    """Write wheel states and the energies as `dynamics` does, the rollers with the wheels."""
    row[:, :] = wheels
    energy[0] = 0.5 * plant.mass * (body[dynamics.V_X] ** 2 + body[dynamics.V_Y] ** 2)
    energy[1] = 0.5 * plant.yaw_inertia * body[dynamics.YAW_RATE] ** 2
    energy[2] = 0.5 * plant.wheel_inertia * np.sum(wheels[:, dynamics.SPEED] ** 2)
    energy[2] += 0.5 * more.inertia * np.sum(rollers[:, :, SPIN] ** 2)
    energy[3] = 0.5 * plant.stiffness * np.sum(rollers[:, :, E_A : E_P + 1] ** 2)


@njit(cache=True, nogil=True, error_model="numpy")
def advance_rollers(
    plant: Plant,
    more: RollerPlant,
    control: Control,
    body: FloatArray,
    wheels: FloatArray,
    rollers: FloatArray,
    pushes: FloatArray,
    counters: IntArray,
    trajectory: FloatArray,
    wheel_log: FloatArray,
    energy_log: FloatArray,
) -> None:
    """Advance the vehicle in place by ``n`` steps, like `dynamics.advance`.

    Args:
        plant: constants.
        more: constants of the rollers.
        control: inputs, constant over the call.
        body: body state, shape (8,).
        wheels: wheel states, shape (N, 9).
        rollers: roller states, shape (N, n rollers, 12).
        pushes: force [N] and moment about the centre of gravity [N m] of each wheel in the last
            step, body frame, shape (N, 3).
        counters: counts steps with tipping and wheel-steps with overload, shape (2,).
        trajectory: receives x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of base_link
            in the world frame at the start and after each step, shape (n + 1, 6).
        wheel_log: receives the wheel states after each step, shape (n, N, 9); or (0, N, 9).
        energy_log: receives the energies [J] after each step, shape (n, 4); or (0, 4).
    """
    dt, weight = plant.dt, plant.mass * GRAVITY
    loads = np.empty(wheels.shape[0])
    start_yaw = body[dynamics.YAW]
    drive_x, drive_y = control.twist[0], control.twist[1]
    reach = -plant.height / GRAVITY
    push = _total(pushes)
    write_pose(plant, body, trajectory[0])

    for k in range(trajectory.shape[0] - 1):
        yaw = body[dynamics.YAW] + 0.5 * dt * body[dynamics.YAW_RATE]
        cos, sin = math.cos(yaw), math.sin(yaw)
        if control.hold_world:
            cos_turned, sin_turned = math.cos(yaw - start_yaw), math.sin(yaw - start_yaw)
            drive_x = cos_turned * control.twist[0] + sin_turned * control.twist[1]
            drive_y = cos_turned * control.twist[1] - sin_turned * control.twist[0]
        z_x, z_y = reach * body[dynamics.A_X], reach * body[dynamics.A_Y]
        if wheel_loads(plant.wheel, plant.plane, plant.hull, weight, z_x, z_y, loads):
            counters[dynamics.TIPPING_STEPS] += 1

        ahead = velocity_ahead(plant, control, body, (cos, sin), push)
        where = (
            body[dynamics.X] + 0.5 * dt * body[dynamics.V_X],
            body[dynamics.Y] + 0.5 * dt * body[dynamics.V_Y],
            cos,
            sin,
        )
        for i in range(wheels.shape[0]):
            if loads[i] > plant.largest_load:
                counters[dynamics.OVERLOADED_STEPS] += 1
            rolling = plant.rolling[i]
            _step_wheel(
                plant,
                more,
                control,
                i,
                loads[i],
                where,
                ahead,
                rolling[0] * drive_x + rolling[1] * drive_y + rolling[2] * control.twist[2],
                wheels[i],
                rollers[i],
                pushes[i],
            )
        push = _total(pushes)
        move_body(plant, control, body, (cos, sin), push)
        write_pose(plant, body, trajectory[k + 1])
        if wheel_log.shape[0] > 0:
            _write_log(plant, more, body, wheels, rollers, wheel_log[k], energy_log[k])
