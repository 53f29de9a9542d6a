"""Planar motion of a vehicle on omni-wheels: one compiled kernel that advances many steps.

The rigid body moves about its centre of gravity, Eqs. (39), (40) read as
``m v_dot = sum f_i`` and ``J Omega_dot = sum cross(r_i - r_g, f_i)``, with the wheels of
`drivetrain`. Everything is taken at the middle of the step but velocities, which are implicit:
each wheel's force is solved at the velocity that its hub will have at the end of the step. That
velocity is predicted from all forces of the step before, and corrected by ``W (F - F_before)``
with the sum of absolute mobilities that couple the wheel to any other as ``W``, which makes the
pass over the wheels stable for any tire stiffness without iteration. The coupling between wheels
lags by one step, an error of second order that energy tests find only with very hard tires.
On uneven ground all this takes place in the path plane of `uneven_ground`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_sim.driver.scripted import in_turned_frame
from omni_sim.ground.friction import friction_at
from omni_sim.tire.model import curve_at
from omni_sim.vehicle.loads import GRAVITY, wheel_loads
from omni_sim.vehicle.roller_dynamics import (
    E_A,
    SLIDES,
    SLIPS,
    Rollers,
    roller_energies,
    step_roller_wheel,
)
from omni_sim.vehicle.uneven_ground import frame_turn, level, stand
from omni_sim.wheel.drivetrain import wheel_step
from omni_sim.wheel.passive_losses import passive_force
from omni_sim.wheel.roller_geometry import nearest_roller, roller_contact

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Entries of the body state: position of the centre of gravity and its velocity in the world
# frame, the low-passed acceleration by the tires in the body frame, and the level components of
# the path plane's normal, in whose frame yaw and velocity are.
X, Y, YAW, V_X, V_Y, YAW_RATE, A_X, A_Y, TILT_X, TILT_Y = range(10)
BODY_SIZE = 10

ENERGIES = 5

# Columns of the wheel state; those from LOAD on are results of the last step.
SPEED, ANGLE, DEFLECTION, FORCE, SLIDING, LOAD, BRAKE, SLIP, LIMIT = range(9)
# With passive losses: their force, the speed that they add to the wheel in a step, and the wheel
# speed before the last step.
PASSIVE, GAIN, LAST_SPEED = range(9, 12)
WHEEL_SIZE = 12

# Columns of the wheel constants: contact relative to the centre of gravity, active direction,
# cross(r_i - r_g, n_w), n_w . u, radius, mobility W. The contacts have those up to RIM.
R_X, R_Y, N_X, N_Y, MOMENT, RIM, RADIUS, MOBILITY = range(8)
CONTACT_SIZE = 6

# Columns of the constants of passive losses: passive direction, cross(r_i - r_g, u_w), u_w . u,
# sum of the absolute mobilities that couple the roller to any force.
U_X, U_Y, U_MOMENT, U_RIM, U_MOBILITY = range(5)

# Load per mass that load transfer is computed with at least, when the ground falls away [m/s^2].
_LEAST_PRESSING = 0.1

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
        tire: constants of the tire model; their type chooses it.
        largest_load: at which the tire's load is clamped [N].
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


class Terrain(NamedTuple):
    """Height of the ground.

    Attributes:
        elevation: from `ground_elevation.ElevationConfiguration`, shape (K, 5), flat with K = 0.
        sampling: distance of the four points that span a road plane, Eq. (5) [m].
    """

    elevation: FloatArray
    sampling: float


class Losses(NamedTuple):
    """Losses along the passive directions.

    Attributes:
        wheel: constants of the wheels by column, shape (N, 5); none, (0, 5), without losses.
        constant: friction per load [1].
        growing: friction per load and load, Eq. (19) [1/N].
        inertia: of a roller against its surface speed [kg].
    """

    wheel: FloatArray
    constant: float
    growing: float
    inertia: float


class Control(NamedTuple):
    """What acts on the vehicle during a call.

    Attributes:
        brake: torque that each brake can exert in each step [N m], shape (n, N), or (1, N) in all
            steps.
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _write_pose(plant: Plant, body: FloatArray, row: FloatArray) -> None:
    """Write pose and velocity of base_link in the world frame, shape (6,)."""
    cos, sin = math.cos(body[YAW]), math.sin(body[YAW])
    g_x = cos * plant.centre_x - sin * plant.centre_y
    g_y = sin * plant.centre_x + cos * plant.centre_y
    v_x = body[V_X] + body[YAW_RATE] * g_y
    v_y = body[V_Y] - body[YAW_RATE] * g_x
    if body[TILT_X] != 0.0 or body[TILT_Y] != 0.0:
        g_x, g_y = level(body[TILT_X], body[TILT_Y], g_x, g_y)
        v_x, v_y = level(body[TILT_X], body[TILT_Y], v_x, v_y)
    row[0] = body[X] - g_x
    row[1] = body[Y] - g_y
    row[2] = body[YAW]
    row[3] = v_x
    row[4] = v_y
    row[5] = body[YAW_RATE]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _write_log(
    plant: Plant,
    terrain: Terrain,
    body: FloatArray,
    rollers: Rollers | None,
    wheels: FloatArray,
    row: FloatArray,
    energy: FloatArray,
) -> None:
    """Write wheel states and energies: translation, rotation, wheel spin, elastic, height [J]."""
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
    energy[4] = plant.mass * GRAVITY * _stand(plant, terrain, body, 0.0)[0]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _stand(
    plant: Plant, terrain: Terrain, body: FloatArray, ahead: float
) -> tuple[float, float, float, float, float, float]:
    """Return how the vehicle will stand after a time [s], as `uneven_ground.stand`."""
    v_x, v_y = level(body[TILT_X], body[TILT_Y], body[V_X], body[V_Y])
    yaw = body[YAW] + ahead * body[YAW_RATE]
    standing: tuple[float, float, float, float, float, float] = stand(
        terrain.elevation,
        terrain.sampling,
        plant.wheel,
        plant.plane,
        body[X] + ahead * v_x,
        body[Y] + ahead * v_y,
        math.cos(yaw),
        math.sin(yaw),
    )
    return standing


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _follow_ground(
    plant: Plant, terrain: Terrain, body: FloatArray
) -> tuple[float, float, float, float]:
    """Turn yaw and velocity into the path plane at the middle of the step.

    Returns:
        Gravity's force in that plane [N], its moment about the normal [N m], and the load per mass
        on the ground [m/s^2], negative if the vehicle would take off.
    """
    old_x, old_y = body[TILT_X], body[TILT_Y]
    v_x, v_y = level(old_x, old_y, body[V_X], body[V_Y])
    _, _, _, new_x, new_y, turn = _stand(plant, terrain, body, 0.5 * plant.dt)
    normal = math.sqrt(1.0 - new_x * new_x - new_y * new_y)
    change = normal - math.sqrt(1.0 - old_x * old_x - old_y * old_y)
    climb = -(old_x * body[V_X] + old_y * body[V_Y])
    bend = ((new_x - old_x) * v_x + (new_y - old_y) * v_y + change * climb) / plant.dt
    angle = frame_turn(old_x, old_y, new_x, new_y)
    cos, sin = math.cos(angle), math.sin(angle)
    v_x, v_y = body[V_X], body[V_Y]
    body[V_X], body[V_Y] = cos * v_x - sin * v_y, sin * v_x + cos * v_y
    body[YAW] += angle
    body[TILT_X], body[TILT_Y] = new_x, new_y
    weight = plant.mass * GRAVITY
    return weight * new_x, weight * new_y, -weight * turn, GRAVITY * normal - bend


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _with_losses(
    losses: Losses, wheels: FloatArray, forces: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return the resultant with the forces of the passive losses."""
    pull_x, pull_y, turn = forces
    for i in range(losses.wheel.shape[0]):
        pull_x += wheels[i, PASSIVE] * losses.wheel[i, U_X]
        pull_y += wheels[i, PASSIVE] * losses.wheel[i, U_Y]
        turn += wheels[i, PASSIVE] * losses.wheel[i, U_MOMENT]
    return pull_x, pull_y, turn


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _resist(
    plant: Plant,
    losses: Losses,
    body: FloatArray,
    heading: tuple[float, float],
    ahead: tuple[float, float, float],
    loads: FloatArray,
    wheels: FloatArray,
) -> None:
    """Compute the losses of all wheels for the step to come; arguments as in `_step_wheels`."""
    dt = plant.dt
    cos, sin = heading
    v_x = cos * body[V_X] + sin * body[V_Y]
    v_y = cos * body[V_Y] - sin * body[V_X]
    rate = body[YAW_RATE]
    for i in range(losses.wheel.shape[0]):
        wheel = wheels[i]
        u_x, u_y, moment = losses.wheel[i, U_X], losses.wheel[i, U_Y], losses.wheel[i, U_MOMENT]
        radius = plant.wheel[i, RADIUS] - loads[i] / plant.vertical_stiffness
        lever = radius * losses.wheel[i, U_RIM]
        speed = wheel[SPEED]
        spin = speed + (speed - wheel[LAST_SPEED])
        wheel[LAST_SPEED] = speed
        # The directions turn with the body during the step.
        turned = dt * rate * (u_x * v_y - u_y * v_x)
        force = passive_force(
            u_x * ahead[0] + u_y * ahead[1] + moment * ahead[2] - lever * spin,
            u_x * v_x + u_y * v_y + moment * rate - lever * speed - turned,
            wheel[PASSIVE],
            dt * losses.wheel[i, U_MOBILITY],
            (losses.constant + losses.growing * loads[i]) * loads[i],
            losses.inertia,
            dt,
        )
        wheel[PASSIVE] = force
        wheel[GAIN] = -dt * lever * force / plant.wheel_inertia


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def displace_contacts(plant: Plant, wheels: FloatArray, contacts: FloatArray) -> None:
    """Move the contacts to where the rollers touch the ground, Eqs. (9), (10).

    Args:
        plant: constants, with a roller pitch.
        wheels: wheel states, shape (N, 12).
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _step_wheels(
    plant: Plant,
    control: Control,
    brake: FloatArray,
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
        brake: torque that each brake can exert in this step [N m].
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
        n_x, n_y, moment = contacts[i, N_X], contacts[i, N_Y], contacts[i, MOMENT]
        r_x, r_y = contacts[i, R_X], contacts[i, R_Y]
        w_x, w_y = cos * r_x - sin * r_y, sin * r_x + cos * r_y
        if body[TILT_X] != 0.0 or body[TILT_Y] != 0.0:
            w_x, w_y = level(body[TILT_X], body[TILT_Y], w_x, w_y)
        friction = friction_at(plant.friction, plant.patches, middle_x + w_x, middle_y + w_y)
        load = loads[i]
        if load > plant.largest_load:
            counters[OVERLOADED_STEPS] += 1
        curve = curve_at(plant.tire, min(load, plant.largest_load), friction)
        radius = plant.wheel[i, RADIUS] - load / plant.vertical_stiffness  # r_D of Eq. (1)
        omega = wheels[i, SPEED]
        speed = radius * abs(omega) + plant.slip_speed  # denominator of Eq. (20)
        mobility = dt * plant.wheel[i, MOBILITY]
        hub = n_x * ahead[0] + n_y * ahead[1] + moment * ahead[2] - mobility * wheels[i, FORCE]
        force, deflection, new_omega, brake_torque, patch, sliding = wheel_step(
            omega + wheels[i, GAIN],
            plant.wheel_inertia,
            brake[i],
            control.drive_stiffness,
            plant.rolling[i, 0] * drive[0]
            + plant.rolling[i, 1] * drive[1]
            + plant.rolling[i, 2] * drive[2],
            plant.drive_limit,
            radius * contacts[i, RIM],
            wheels[i, DEFLECTION],
            hub,
            mobility,
            speed,
            curve,
            plant.stiffness,
            plant.damping,
            dt,
            wheels[i, SLIDING] != 0.0,
        )
        wheels[i, SPEED] = new_omega
        wheels[i, ANGLE] += 0.5 * dt * (omega + new_omega)
        wheels[i, DEFLECTION] = deflection
        wheels[i, FORCE] = force
        wheels[i, SLIDING] = 1.0 if sliding else 0.0
        wheels[i, LOAD] = load
        wheels[i, BRAKE] = brake_torque
        wheels[i, SLIP] = patch / speed
        wheels[i, LIMIT] = curve.peak_force


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _step_roller_wheels(
    plant: Plant,
    control: Control,
    brake: FloatArray,
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
            brake[i],
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _move(
    plant: Plant,
    body: FloatArray,
    heading: tuple[float, float],
    pull: tuple[float, float, float],
    force_x: float,
    force_y: float,
) -> None:
    """Advance the body by one step, Eqs. (39), (40); positions by the trapezoidal rule.

    Args:
        plant: constants.
        body: body state, changed in place.
        heading: cosine and sine of the yaw at the middle of the step.
        pull: forces in the body frame [N], and all moments about the centre of gravity [N m].
        force_x: other force on the centre of gravity along x of the world frame [N].
        force_y: the same along y [N].
    """
    dt, mass = plant.dt, plant.mass
    cos, sin = heading
    gain_x = dt * (cos * pull[0] - sin * pull[1] + force_x) / mass
    gain_y = dt * (sin * pull[0] + cos * pull[1] + force_y) / mass
    gain_turn = dt * pull[2] / plant.yaw_inertia
    step_x, step_y = dt * (body[V_X] + 0.5 * gain_x), dt * (body[V_Y] + 0.5 * gain_y)
    if body[TILT_X] != 0.0 or body[TILT_Y] != 0.0:
        step_x, step_y = level(body[TILT_X], body[TILT_Y], step_x, step_y)
    body[X] += step_x
    body[Y] += step_y
    body[YAW] += dt * (body[YAW_RATE] + 0.5 * gain_turn)
    body[V_X] += gain_x
    body[V_Y] += gain_y
    body[YAW_RATE] += gain_turn


# The parts above are inlined by force: passing their many arguments from call to call would cost
# more than a third of the time.
@njit(cache=True, nogil=True, error_model="numpy")
def advance(
    plant: Plant,
    terrain: Terrain,
    losses: Losses,
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
        terrain: height of the ground.
        losses: along the passive directions.
        control: inputs, constant over the call.
        body: body state, shape (10,).
        contacts: of the last step, with the columns of the wheel constants, shape (N, 6); change
            only if there is a roller pitch; individual rollers leave them alone.
        rollers: individual rollers of the wheels, if there are any; the kernel is compiled for
            either case.
        wheels: wheel states, shape (N, 12).
        counters: counts steps with tipping and wheel-steps with overload, shape (2,).
        trajectory: receives x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of base_link
            in the world frame at the start and after each step, shape (n + 1, 6).
        wheel_log: receives the wheel states after each step, shape (n, N, 12); or (0, N, 12).
        energy_log: receives the energies [J] after each step, shape (n, 5); or (0, 5).
    """
    dt, mass, yaw_inertia = plant.dt, plant.mass, plant.yaw_inertia
    loads = np.empty(wheels.shape[0])
    start_yaw = body[YAW]
    pull_x, pull_y, turn = _resultant(rollers, contacts, wheels)
    uneven, lossy = terrain.elevation.shape[0] > 0, losses.wheel.shape[0] > 0
    if lossy:
        pull_x, pull_y, turn = _with_losses(losses, wheels, (pull_x, pull_y, turn))
    drive_x, drive_y = control.twist[0], control.twist[1]
    reach = -plant.height / GRAVITY
    weight, force_x, force_y, lean = mass * GRAVITY, control.force_x, control.force_y, 0.0
    _write_pose(plant, body, trajectory[0])

    for k in range(trajectory.shape[0] - 1):
        if uneven:
            down_x, down_y, lean, pressing = _follow_ground(plant, terrain, body)
            force_x, force_y = control.force_x + down_x, control.force_y + down_y
            counters[TIPPING_STEPS] += pressing <= 0.0  # the vehicle would take off
            weight, reach = (
                mass * max(pressing, 0.0),
                -plant.height / max(pressing, _LEAST_PRESSING),
            )
        yaw = body[YAW] + 0.5 * dt * body[YAW_RATE]
        cos, sin = math.cos(yaw), math.sin(yaw)
        if control.hold_world:
            drive_x, drive_y = in_turned_frame(control.twist[0], control.twist[1], yaw - start_yaw)

        z_x, z_y = reach * body[A_X], reach * body[A_Y]
        if wheel_loads(plant.wheel, plant.plane, plant.hull, weight, z_x, z_y, loads):
            counters[TIPPING_STEPS] += 1

        ahead_x = body[V_X] + dt * force_x / mass
        ahead_y = body[V_Y] + dt * force_y / mass
        ahead = (
            cos * ahead_x + sin * ahead_y + dt * pull_x / mass,
            cos * ahead_y - sin * ahead_x + dt * pull_y / mass,
            body[YAW_RATE] + dt * (turn + lean) / yaw_inertia,
        )
        if lossy:
            _resist(plant, losses, body, (cos, sin), ahead, loads, wheels)
        drive = (drive_x, drive_y, control.twist[2])
        brake = control.brake[min(k, control.brake.shape[0] - 1)]
        if rollers is None:
            if plant.roller_pitch > 0.0:
                displace_contacts(plant, wheels, contacts)
            _step_wheels(
                plant,
                control,
                brake,
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
                brake,
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
        if lossy:
            pull_x, pull_y, turn = _with_losses(losses, wheels, (pull_x, pull_y, turn))
        body[A_X] += plant.filter_share * (pull_x / mass - body[A_X])
        body[A_Y] += plant.filter_share * (pull_y / mass - body[A_Y])

        _move(plant, body, (cos, sin), (pull_x, pull_y, turn + lean), force_x, force_y)
        _write_pose(plant, body, trajectory[k + 1])
        if wheel_log.shape[0] > 0:
            _write_log(plant, terrain, body, rollers, wheels, wheel_log[k], energy_log[k])
