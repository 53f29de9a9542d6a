"""Planar motion of a vehicle on omni-wheels: one compiled kernel that advances many steps.

The rigid body moves about its centre of gravity, Eqs. (39), (40) read as
``m v_dot = sum f_i`` and ``J Omega_dot = sum cross(r_i - r_g, f_i)``, with the wheels of
`drivetrain`. Everything is taken at the middle of the step but velocities, which are implicit:
each wheel's force is solved at the velocity that its hub will have at the end of the step. That
velocity is predicted from all forces of the step before, and corrected by ``W (F - F_before)``
with the sum of absolute mobilities that couple the wheel to any other as ``W``, which makes the
pass over the wheels stable for any tyre stiffness without iteration. The coupling between wheels
lags by one step, an error of second order that energy tests find only with very hard tyres.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_sim.drivetrain import wheel_step
from omni_sim.friction import friction_at
from omni_sim.loads import GRAVITY, wheel_loads
from omni_sim.roller_dynamics import (
    E_A,
    SLIDES,
    SLIPS,
    Rollers,
    roller_energies,
    step_roller_wheel,
)
from omni_sim.roller_geometry import nearest_roller, roller_contact
from omni_sim.tire_model import curve_at

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Entries of the body state: position of the centre of gravity and its velocity in the world
# frame, and the low-passed acceleration by the tyres in the body frame.
X, Y, YAW, V_X, V_Y, YAW_RATE, A_X, A_Y = range(8)
BODY_SIZE = 8

# Columns of the wheel state; those from LOAD on are results of the last step.
SPEED, ANGLE, DEFLECTION, FORCE, SLIDING, LOAD, BRAKE, SLIP, LIMIT = range(9)
WHEEL_SIZE = 9

# Columns of the wheel constants: contact relative to the centre of gravity, active direction,
# cross(r_i - r_g, n_w), n_w . u, radius, mobility W. The contacts have those up to RIM.
R_X, R_Y, N_X, N_Y, MOMENT, RIM, RADIUS, MOBILITY = range(8)
CONTACT_SIZE = 6

# Entries of the counters.
TIPPING_STEPS, OVERLOADED_STEPS = range(2)


class Plant(NamedTuple):
    """What never changes during a run.

    Attributes:
        dt: physics step [s].
        mass: m [kg].
        yaw_inertia: J about the centre of gravity [kg m^2].
        centre_x: centre of gravity in the body frame [m].
        centre_y: likewise in y [m].
        height: of the centre of gravity [m].
        filter_share: weight of the newest acceleration in the low-pass [1].
        wheel: constants of the wheels by column, shape (N, 8).
        rolling: wheel speeds per unit of body twist, Eq. (32), shape (N, 3).
        plane: from `loads.load_plane`.
        hull: from `loads.support_polygon`.
        wheel_inertia: I of a wheel about its axis [kg m^2].
        drive_limit: largest torque of a clutch [N m].
        tire: constants of the tyre model; their type chooses it.
        largest_load: at which the tyre's load is clamped [N].
        stiffness: c_x [N/m].
        damping: d_x [N s/m].
        vertical_stiffness: c_z [N/m].
        slip_speed: v_num [m/s].
        friction: factor of the ground outside the patches [1].
        patches: from `friction.FrictionMap`, shape (P, 7).
        rollers: geometry of the rollers, rows for `roller_geometry.roller_contact`, (N, 5).
        roller_pitch: angle between two rollers [rad]; 0 where contacts stay under the wheels.
    """

    dt: float
    mass: float
    yaw_inertia: float
    centre_x: float
    centre_y: float
    height: float
    filter_share: float
    wheel: FloatArray
    rolling: FloatArray
    plane: FloatArray
    hull: IntArray
    wheel_inertia: float
    drive_limit: float
    tire: Any
    largest_load: float
    stiffness: float
    damping: float
    vertical_stiffness: float
    slip_speed: float
    friction: float
    patches: FloatArray
    rollers: FloatArray
    roller_pitch: float


class Control(NamedTuple):
    """What acts on the vehicle during a call.

    Attributes:
        brake: torque that each brake can exert [N m], shape (N,).
        drive_stiffness: of the clutches [N m s/rad], 0 when disengaged.
        twist: commanded body twist at the start of the call [m/s, m/s, rad/s], shape (3,).
        hold_world: whether its linear part keeps its direction in the world while the body turns.
        force_x: constant force at the centre of gravity, world frame [N].
        force_y: likewise in y [N].
    """

    brake: FloatArray
    drive_stiffness: float
    twist: FloatArray
    hold_world: bool
    force_x: float
    force_y: float


@njit(cache=True, nogil=True, error_model="numpy")
def _write_pose(plant: Plant, body: FloatArray, row: FloatArray) -> None:
    """Write pose and velocity of base_link in the world frame, shape (6,)."""
    cos, sin = math.cos(body[YAW]), math.sin(body[YAW])
    g_x = cos * plant.centre_x - sin * plant.centre_y
    g_y = sin * plant.centre_x + cos * plant.centre_y
    row[0] = body[X] - g_x
    row[1] = body[Y] - g_y
    row[2] = body[YAW]
    row[3] = body[V_X] + body[YAW_RATE] * g_y
    row[4] = body[V_Y] - body[YAW_RATE] * g_x
    row[5] = body[YAW_RATE]


@njit(cache=True, nogil=True, error_model="numpy")
def _write_log(
    plant: Plant,
    body: FloatArray,
    rollers: Rollers | None,
    wheels: FloatArray,
    row: FloatArray,
    energy: FloatArray,
) -> None:
    """Write wheel states and the energies: translation, rotation, wheel spin, elastic [J]."""
    row[:, :] = wheels
    energy[0] = 0.5 * plant.mass * (body[V_X] ** 2 + body[V_Y] ** 2)
    energy[1] = 0.5 * plant.yaw_inertia * body[YAW_RATE] ** 2
    energy[2] = 0.5 * plant.wheel_inertia * np.sum(wheels[:, SPEED] ** 2)
    if rollers is None:
        energy[3] = 0.5 * plant.stiffness * np.sum(wheels[:, DEFLECTION] ** 2)
    else:
        spin, elastic = roller_energies(rollers)
        energy[2] += spin
        energy[3] = elastic


@njit(cache=True, nogil=True, error_model="numpy")
def _resultant(
    rollers: Rollers | None, contacts: FloatArray, wheels: FloatArray
) -> tuple[float, float, float]:
    """Return the wheels' force in the body frame [N] and moment about the centre [N m]."""
    pull_x, pull_y, turn = 0.0, 0.0, 0.0
    for i in range(wheels.shape[0]):
        if rollers is None:
            pull_x += wheels[i, FORCE] * contacts[i, N_X]
            pull_y += wheels[i, FORCE] * contacts[i, N_Y]
            turn += wheels[i, FORCE] * contacts[i, MOMENT]
        else:
            pull_x += rollers.push[i, 0]
            pull_y += rollers.push[i, 1]
            turn += rollers.push[i, 2]
    return pull_x, pull_y, turn


@njit(cache=True, nogil=True, error_model="numpy")
def displace_contacts(plant: Plant, wheels: FloatArray, contacts: FloatArray) -> None:
    """Move the contacts to where the rollers touch the ground, Eqs. (9), (10).

    Args:
        plant: constants, with a roller pitch.
        wheels: wheel states, shape (N, 9).
        contacts: written in place, shape (N, 6).
    """
    for i in range(wheels.shape[0]):
        angle = wheels[i, ANGLE] + 0.5 * plant.dt * wheels[i, SPEED]
        nearest = nearest_roller(angle, plant.roller_pitch)
        gamma = angle - plant.roller_pitch * nearest
        n_x, n_y, x, y, rim, _, _ = roller_contact(gamma, plant.rollers[i])
        r_x, r_y = plant.wheel[i, R_X] + x, plant.wheel[i, R_Y] + y
        contacts[i, R_X], contacts[i, R_Y] = r_x, r_y
        contacts[i, N_X], contacts[i, N_Y] = n_x, n_y
        contacts[i, MOMENT] = r_x * n_y - r_y * n_x
        contacts[i, RIM] = rim


@njit(cache=True, nogil=True, error_model="numpy")
def _step_wheels(
    plant: Plant,
    control: Control,
    body: FloatArray,
    heading: tuple[float, float],
    ahead: tuple[float, float, float],
    drive: tuple[float, float, float],
    loads: FloatArray,
    contacts: FloatArray,
    wheels: FloatArray,
    counters: IntArray,
) -> None:
    """Advance all wheels by one step.

    Args:
        plant: constants.
        control: inputs.
        body: body state at the start of the step.
        heading: cosine and sine of the yaw at the middle of the step.
        ahead: velocity of the centre of gravity and yaw rate at the end of the step if the
            forces did not change, in the body frame.
        drive: commanded twist in the body frame.
        loads: wheel loads [N].
        contacts: where and in which directions the wheels touch the ground.
        wheels: wheel states, changed in place.
        counters: counts overloaded wheels.
    """
    dt = plant.dt
    cos, sin = heading
    middle_x = body[X] + 0.5 * dt * body[V_X]
    middle_y = body[Y] + 0.5 * dt * body[V_Y]
    for i in range(wheels.shape[0]):
        constants = plant.wheel[i]
        wheel = wheels[i]
        n_x, n_y, moment = contacts[i, N_X], contacts[i, N_Y], contacts[i, MOMENT]
        r_x, r_y = contacts[i, R_X], contacts[i, R_Y]
        friction = friction_at(
            plant.friction,
            plant.patches,
            middle_x + cos * r_x - sin * r_y,
            middle_y + sin * r_x + cos * r_y,
        )
        load = loads[i]
        if load > plant.largest_load:
            counters[OVERLOADED_STEPS] += 1
        curve = curve_at(plant.tire, min(load, plant.largest_load), friction)
        radius = constants[RADIUS] - load / plant.vertical_stiffness  # r_D of Eq. (1)
        omega = wheel[SPEED]
        speed = radius * abs(omega) + plant.slip_speed  # denominator of Eq. (20)
        mobility = dt * constants[MOBILITY]
        hub = n_x * ahead[0] + n_y * ahead[1] + moment * ahead[2] - mobility * wheel[FORCE]
        rolling = plant.rolling[i]
        force, deflection, new_omega, brake_torque, patch, sliding = wheel_step(
            omega,
            plant.wheel_inertia,
            control.brake[i],
            control.drive_stiffness,
            rolling[0] * drive[0] + rolling[1] * drive[1] + rolling[2] * drive[2],
            plant.drive_limit,
            radius * contacts[i, RIM],
            wheel[DEFLECTION],
            hub,
            mobility,
            speed,
            curve,
            plant.stiffness,
            plant.damping,
            dt,
            wheel[SLIDING] != 0.0,
        )
        wheel[SPEED] = new_omega
        wheel[ANGLE] += 0.5 * dt * (omega + new_omega)
        wheel[DEFLECTION] = deflection
        wheel[FORCE] = force
        wheel[SLIDING] = 1.0 if sliding else 0.0
        wheel[LOAD] = load
        wheel[BRAKE] = brake_torque
        wheel[SLIP] = patch / speed
        wheel[LIMIT] = curve.peak_force


@njit(cache=True, nogil=True, error_model="numpy")
def _step_roller_wheels(
    plant: Plant,
    control: Control,
    body: FloatArray,
    heading: tuple[float, float],
    ahead: tuple[float, float, float],
    drive: tuple[float, float, float],
    loads: FloatArray,
    rollers: Rollers,
    wheels: FloatArray,
    counters: IntArray,
) -> None:
    """Advance all wheels with individual rollers by one step; arguments as in `_step_wheels`."""
    dt = plant.dt
    where = (body[X] + 0.5 * dt * body[V_X], body[Y] + 0.5 * dt * body[V_Y], *heading)
    for i in range(wheels.shape[0]):
        constants = plant.wheel[i]
        wheel = wheels[i]
        if loads[i] > plant.largest_load:
            counters[OVERLOADED_STEPS] += 1
        rolling = plant.rolling[i]
        omega = wheel[SPEED]
        new_omega, brake_torque, first, limit = step_roller_wheel(
            plant,
            rollers,
            i,
            omega,
            wheel[ANGLE] + 0.5 * dt * omega,
            control.brake[i],
            control.drive_stiffness,
            rolling[0] * drive[0] + rolling[1] * drive[1] + rolling[2] * drive[2],
            loads[i],
            (constants[R_X], constants[R_Y]),
            constants[RADIUS] - loads[i] / plant.vertical_stiffness,  # r_D of Eq. (1)
            dt * constants[MOBILITY],
            where,
            ahead,
        )
        wheel[SPEED] = new_omega
        wheel[ANGLE] += 0.5 * dt * (omega + new_omega)
        wheel[DEFLECTION] = rollers.state[i, first, E_A]
        wheel[FORCE] = rollers.push[i, 0] * constants[N_X] + rollers.push[i, 1] * constants[N_Y]
        wheel[SLIDING] = rollers.state[i, first, SLIDES]
        wheel[LOAD] = loads[i]
        wheel[BRAKE] = brake_torque
        wheel[SLIP] = rollers.state[i, first, SLIPS]
        wheel[LIMIT] = limit


@njit(cache=True, nogil=True, error_model="numpy")
def advance(
    plant: Plant,
    control: Control,
    body: FloatArray,
    contacts: FloatArray,
    rollers: Rollers | None,
    wheels: FloatArray,
    counters: IntArray,
    trajectory: FloatArray,
    wheel_log: FloatArray,
    energy_log: FloatArray,
) -> None:
    """Advance the vehicle in place by ``n`` steps.

    Args:
        plant: constants.
        control: inputs, constant over the call.
        body: body state, shape (8,).
        contacts: of the last step, with the columns of the wheel constants, shape (N, 6); change
            only if there is a roller pitch; individual rollers leave them alone.
        rollers: individual rollers of the wheels, if there are any; the kernel is compiled for
            either case.
        wheels: wheel states, shape (N, 9).
        counters: counts steps with tipping and wheel-steps with overload, shape (2,).
        trajectory: receives x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of base_link
            in the world frame at the start and after each step, shape (n + 1, 6).
        wheel_log: receives the wheel states after each step, shape (n, N, 9); or (0, N, 9).
        energy_log: receives the energies [J] after each step, shape (n, 4); or (0, 4).
    """
    dt, mass, yaw_inertia = plant.dt, plant.mass, plant.yaw_inertia
    loads = np.empty(wheels.shape[0])
    start_yaw = body[YAW]
    pull_x, pull_y, turn = _resultant(rollers, contacts, wheels)
    drive_x, drive_y = control.twist[0], control.twist[1]
    reach = -plant.height / GRAVITY
    _write_pose(plant, body, trajectory[0])

    for k in range(trajectory.shape[0] - 1):
        yaw = body[YAW] + 0.5 * dt * body[YAW_RATE]
        cos, sin = math.cos(yaw), math.sin(yaw)
        if control.hold_world:
            cos_turned, sin_turned = math.cos(yaw - start_yaw), math.sin(yaw - start_yaw)
            drive_x = cos_turned * control.twist[0] + sin_turned * control.twist[1]
            drive_y = cos_turned * control.twist[1] - sin_turned * control.twist[0]

        z_x, z_y = reach * body[A_X], reach * body[A_Y]
        if wheel_loads(plant.wheel, plant.plane, plant.hull, mass * GRAVITY, z_x, z_y, loads):
            counters[TIPPING_STEPS] += 1

        ahead_x = body[V_X] + dt * control.force_x / mass
        ahead_y = body[V_Y] + dt * control.force_y / mass
        ahead = (
            cos * ahead_x + sin * ahead_y + dt * pull_x / mass,
            cos * ahead_y - sin * ahead_x + dt * pull_y / mass,
            body[YAW_RATE] + dt * turn / yaw_inertia,
        )
        drive = (drive_x, drive_y, control.twist[2])
        if rollers is None:
            if plant.roller_pitch > 0.0:
                displace_contacts(plant, wheels, contacts)
            _step_wheels(
                plant,
                control,
                body,
                (cos, sin),
                ahead,
                drive,
                loads,
                contacts,
                wheels,
                counters,
            )
        else:
            _step_roller_wheels(
                plant,
                control,
                body,
                (cos, sin),
                ahead,
                drive,
                loads,
                rollers,
                wheels,
                counters,
            )
        pull_x, pull_y, turn = _resultant(rollers, contacts, wheels)
        body[A_X] += plant.filter_share * (pull_x / mass - body[A_X])
        body[A_Y] += plant.filter_share * (pull_y / mass - body[A_Y])

        # Eqs. (39), (40); positions by the trapezoidal rule.
        gain_x = dt * (cos * pull_x - sin * pull_y + control.force_x) / mass
        gain_y = dt * (sin * pull_x + cos * pull_y + control.force_y) / mass
        gain_turn = dt * turn / yaw_inertia
        body[X] += dt * (body[V_X] + 0.5 * gain_x)
        body[Y] += dt * (body[V_Y] + 0.5 * gain_y)
        body[YAW] += dt * (body[YAW_RATE] + 0.5 * gain_turn)
        body[V_X] += gain_x
        body[V_Y] += gain_y
        body[YAW_RATE] += gain_turn

        _write_pose(plant, body, trajectory[k + 1])
        if wheel_log.shape[0] > 0:
            _write_log(plant, body, rollers, wheels, wheel_log[k], energy_log[k])
