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
from omni_sim.dynamics import Control, Plant, _write_pose
from omni_sim.friction import friction_at
from omni_sim.loads import GRAVITY, wheel_loads
from omni_sim.roller_geometry import roller_contact
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
        cosine: of the roller angle of each wheel [1], shape (N,).
        sine: likewise, shape (N,).
        axis: rolling direction ``u`` of each wheel in the body frame, shape (N, 2).
        mobility: by how much all forces together change a contact's velocity at most
            [m/s per N and s], shape (N,).
        distance: ``d`` of each wheel [m], shape (N,).
        curve_y: of the tyre's direction y, shape (10,).
        inertia: of a roller [kg m^2].
        overlap: see `roller_wheel.RollerConfiguration`.
    """

    cosine: FloatArray
    sine: FloatArray
    axis: FloatArray
    mobility: FloatArray
    distance: FloatArray
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
    wrench: FloatArray,
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
        wrench: force [N] and moment [N m] on the body, added to, shape (3,).

    Returns:
        Wheel speed [rad/s], brake torque [N m].
    """
    dt = plant.dt
    constants = plant.wheel[i]
    u_x, u_y = more.axis[i, 0], more.axis[i, 1]
    b_u, b_n, length, along, depth = roller_contact(gamma, more.cosine[i], more.sine[i])
    along *= more.distance[i]
    # The wheel axis is (-u_y, u_x); active against the roller axis as in `geometry`.
    n_x, n_y = -(b_u * u_x - b_n * u_y), -(b_u * u_y + b_n * u_x)
    p_x, p_y = n_y, -n_x
    r_x, r_y = constants[dynamics.R_X] - along * u_y, constants[dynamics.R_Y] + along * u_x
    x, y, cos, sin = where
    friction = friction_at(
        plant.friction, plant.patches, x + cos * r_x - sin * r_y, y + sin * r_x + cos * r_y
    )
    clamped = min(load, plant.largest_load)
    radius = constants[dynamics.RADIUS] - wheel_load / plant.vertical_stiffness
    spin_lever = max(radius - depth * more.distance[i], 1e-3) * length
    lever = (radius * (u_x * n_x + u_y * n_y), radius * (u_x * p_x + u_y * p_y))
    # Speed of the rubber through the contact: wheel along u, roller along its passive direction.
    spin = spin_lever * roller[SPIN]
    rim = radius * turning
    speed = math.hypot(rim * u_x + spin * p_x, rim * u_y + spin * p_y) + plant.slip_speed
    mobility = dt * more.mobility[i]
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
    wrench[0] += f_x
    wrench[1] += f_y
    wrench[2] += r_x * f_y - r_y * f_x
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
    wrench: FloatArray,
) -> None:
    """Advance wheel `i` with the one or two rollers that carry it."""
    dt, omega = plant.dt, wheel[dynamics.SPEED]
    count = rollers.shape[0]
    pitch = 2.0 * math.pi / count
    angle = wheel[dynamics.ANGLE] + 0.5 * dt * omega
    nearest = math.floor(angle / pitch + 0.5)
    gamma = angle - pitch * nearest
    share = load_share(gamma, 0.5 * pitch, more.overlap)
    beside = nearest + (1 if gamma > 0.0 else -1)
    first, second = int(nearest % count), int(beside % count)
    _lift(rollers, first, second if share < 1.0 else first)

    shared = share < 1.0
    held = rollers[second, TORQUE] if shared else 0.0  # of the step before
    push_x, push_y = wrench[0], wrench[1]
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
        wrench,
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
            wrench,
        )
        wheel[dynamics.LIMIT] += rollers[second, GRIP]
    push_x, push_y = wrench[0] - push_x, wrench[1] - push_y
    wheel[dynamics.FORCE] = (
        push_x * plant.wheel[i, dynamics.N_X] + push_y * plant.wheel[i, dynamics.N_Y]
    )
    wheel[dynamics.SPEED] = new_omega
    wheel[dynamics.ANGLE] += 0.5 * dt * (omega + new_omega)
    wheel[dynamics.LOAD] = load
    wheel[dynamics.BRAKE] = brake_torque
    wheel[dynamics.SLIDING] = rollers[first, SLIDES]
    wheel[dynamics.SLIP] = rollers[first, SLIPS]


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
    wrench: FloatArray,
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
        wrench: force [N] and moment [N m] of all contacts in the last step, body frame, (3,).
        counters: counts steps with tipping and wheel-steps with overload, shape (2,).
        trajectory: receives x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of base_link
            in the world frame at the start and after each step, shape (n + 1, 6).
        wheel_log: receives the wheel states after each step, shape (n, N, 9); or (0, N, 9).
        energy_log: receives the energies [J] after each step, shape (n, 4); or (0, 4).
    """
    dt, mass = plant.dt, plant.mass
    loads = np.empty(wheels.shape[0])
    start_yaw = body[dynamics.YAW]
    drive_x, drive_y = control.twist[0], control.twist[1]
    reach = -plant.height / GRAVITY
    _write_pose(plant, body, trajectory[0])

    for k in range(trajectory.shape[0] - 1):
        yaw = body[dynamics.YAW] + 0.5 * dt * body[dynamics.YAW_RATE]
        cos, sin = math.cos(yaw), math.sin(yaw)
        if control.hold_world:
            cos_turned, sin_turned = math.cos(yaw - start_yaw), math.sin(yaw - start_yaw)
            drive_x = cos_turned * control.twist[0] + sin_turned * control.twist[1]
            drive_y = cos_turned * control.twist[1] - sin_turned * control.twist[0]
        z_x, z_y = reach * body[dynamics.A_X], reach * body[dynamics.A_Y]
        if wheel_loads(plant.wheel, plant.plane, plant.hull, mass * GRAVITY, z_x, z_y, loads):
            counters[dynamics.TIPPING_STEPS] += 1

        ahead_x = body[dynamics.V_X] + dt * control.force_x / mass
        ahead_y = body[dynamics.V_Y] + dt * control.force_y / mass
        ahead = (
            cos * ahead_x + sin * ahead_y + dt * wrench[0] / mass,
            cos * ahead_y - sin * ahead_x + dt * wrench[1] / mass,
            body[dynamics.YAW_RATE] + dt * wrench[2] / plant.yaw_inertia,
        )
        where = (
            body[dynamics.X] + 0.5 * dt * body[dynamics.V_X],
            body[dynamics.Y] + 0.5 * dt * body[dynamics.V_Y],
            cos,
            sin,
        )
        wrench[:] = 0.0
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
                wrench,
            )
        body[dynamics.A_X] += plant.filter_share * (wrench[0] / mass - body[dynamics.A_X])
        body[dynamics.A_Y] += plant.filter_share * (wrench[1] / mass - body[dynamics.A_Y])

        # Eqs. (39), (40); positions by the trapezoidal rule.
        gain_x = dt * (cos * wrench[0] - sin * wrench[1] + control.force_x) / mass
        gain_y = dt * (sin * wrench[0] + cos * wrench[1] + control.force_y) / mass
        gain_turn = dt * wrench[2] / plant.yaw_inertia
        body[dynamics.X] += dt * (body[dynamics.V_X] + 0.5 * gain_x)
        body[dynamics.Y] += dt * (body[dynamics.V_Y] + 0.5 * gain_y)
        body[dynamics.YAW] += dt * (body[dynamics.YAW_RATE] + 0.5 * gain_turn)
        body[dynamics.V_X] += gain_x
        body[dynamics.V_Y] += gain_y
        body[dynamics.YAW_RATE] += gain_turn

        _write_pose(plant, body, trajectory[k + 1])
        if wheel_log.shape[0] > 0:
            _write_log(plant, more, body, wheels, rollers, wheel_log[k], energy_log[k])
