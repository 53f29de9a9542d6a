"""Planar motion of a vehicle on wheels: a compiled kernel that advances many steps.

`move` advances the body in the plane, and the rest of the module computes the forces. The equations
of motion are Eqs. (39), (40) of the dissertation for the center of gravity ``r_g``:

    m v_dot = sum f_i,    J Omega_dot = sum cross(r_i - r_g, f_i)

``f_i`` are the forces of the wheels (`drivetrain`) at the positions ``r_i``. On uneven ground the
motion is in the path plane of `uneven_ground`, and gravity is an additional force.

Quantities are evaluated at the middle of the step, but velocities are implicit: the force of each
wheel is computed for the velocity that its hub will have at the end of the step. This velocity is
predicted from all forces of the previous step and corrected by ``W (F - F_before)``. Here, ``F``
and ``F_before`` are the forces of the wheel in this step and in the previous step, and ``W`` is the
sum of the absolute mobilities that couple the wheel to all wheels. A single pass over the wheels is
therefore stable for any tire stiffness, without iteration. The coupling between wheels lags by one
step. In tests of the energy balance, this second-order error is visible only with very stiff tires.

Kernels with one caller are inlined, because passing their many arguments would take much of the
computing time. Kernels with several callers are not inlined, so that the compilation takes less
time.
"""

import math

from omni_core.kernels import lean, lean_inline, linked
from omni_core.quantities import GRAVITY, FloatArray, Pair, Triple
from omni_sim.vehicle import state as layout
from omni_sim.vehicle.loads import wheel_loads
from omni_sim.vehicle.roller_dynamics import (
    contact_shift,
    displace_contacts,
    roller_energies,
    step_roller_wheel,
)
from omni_sim.vehicle.state import Energies, Step
from omni_sim.vehicle.suspension import sprung_loads
from omni_sim.vehicle.uneven_ground import follow_ground, level, standing
from omni_sim.vehicle.wheel_steps import squared_bends, step_omni_wheel, step_treaded_wheel
from omni_sim.wheel.brake_pressure import press, set_demand
from omni_sim.wheel.drivetrain import clutch_torque, motor_drive
from omni_sim.wheel.passive_losses import passive_force
from omni_sim.wheel.steering import driven_speed, steer

# Lower limit on the normal force per mass in the load transfer, for ground that falls away [m/s^2].
_LEAST_PRESSING = 0.1


@lean_inline
def move(
    plant: layout.Plant, body: layout.Record, heading: Pair, pull: Triple, other: Pair
) -> None:
    """Advance the motion of the body in the plane by one step.

        x_dot = v,    m v_dot = R(psi) f + f_other,    psi_dot = Omega,    J Omega_dot = M

    Eqs. (39), (40), with positions by the trapezoidal rule.

    Args:
        plant: constants.
        body: `state.BODY`, changed in place.
        heading: ``R(psi)``, cosine and sine of the yaw at the middle of the step.
        pull: force ``f`` of the wheels in the body frame [N], and the sum ``M`` of all moments
            about the center of gravity [N m].
        other: further forces on the center of gravity in the world frame, ``f_other`` [N].
    """
    dt = plant.dt
    push = dt / plant.mass
    cos, sin = heading
    dv_x = push * (cos * pull[0] - sin * pull[1] + other[0])
    dv_y = push * (sin * pull[0] + cos * pull[1] + other[1])
    d_rate = dt / plant.yaw_inertia * pull[2]
    dx, dy = dt * (body.v_x + 0.5 * dv_x), dt * (body.v_y + 0.5 * dv_y)
    if body.tilt_x != 0.0 or body.tilt_y != 0.0:
        dx, dy = level(body.tilt_x, body.tilt_y, dx, dy)
    body.x += dx
    body.y += dy
    body.yaw += dt * (body.yaw_rate + 0.5 * d_rate)
    body.v_x += dv_x
    body.v_y += dv_y
    body.yaw_rate += d_rate


@linked
@lean
def advance(
    state: layout.State, control: layout.Control, steps: int, trajectory: FloatArray
) -> None:
    """Advance the state of the vehicle by `steps` physics steps.

    Args:
        state: state of the vehicle, changed in place.
        control: inputs, constant over the call.
        steps: number of steps.
        trajectory: output; pose and velocity of base_link in the world frame at the start and after
            each step, shape (steps + 1, 6); not written if its shape is (0, 6).
    """
    plant, body = state.plant, state.body[0]
    # One division for all steps.
    mobility = (plant.dt / plant.mass, plant.dt / plant.yaw_inertia)
    filter_share = plant.filter_share / plant.mass
    start_yaw, traced = body.yaw, trajectory.shape[0] > 0
    set_demand(state.pressure, control.brake, control.enable)
    pull = _resultant(state, state.rollers, state.treads)
    if traced:
        _write_pose(plant, body, trajectory[0])

    for k in range(steps):
        step, other, lean = _meet_ground(state, body, control, pull, mobility, start_yaw)
        pull = _turn_wheels(state, body, step)
        body.a_x += filter_share * pull[0] - plant.filter_share * body.a_x
        body.a_y += filter_share * pull[1] - plant.filter_share * body.a_y
        move(plant, body, step.heading, (pull[0], pull[1], pull[2] + lean), other)
        if traced:
            _write_pose(plant, body, trajectory[k + 1])


@lean_inline
def _meet_ground(
    state: layout.State,
    body: layout.Record,
    control: layout.Control,
    pull: Triple,
    mobility: Pair,
    start_yaw: float,
) -> tuple[Step, Pair, float]:
    """Compute what all wheels meet in a step: ground, loads, and motion of body and drives.

    Args:
        state: state of the vehicle; the wheel loads and the steered wheels are changed.
        body: `state.BODY`, changed on uneven ground.
        control: inputs of the step.
        pull: force [N] and moment [N m] of the wheels in the last step, in the body frame.
        mobility: velocity per force [m/s per N] and yaw rate per moment [rad/s per N m] of a step.
        start_yaw: yaw for which the drive command is given [rad].

    Returns:
        Quantities common to all wheels; further forces in the world frame [N] and further moment
        [N m] on the body.
    """
    push, turn = mobility
    dt = state.plant.dt
    pressing, gravity, lean = GRAVITY, (0.0, 0.0), 0.0
    if state.terrain.parts.shape[0] > 0:
        pressing, gravity, lean = follow_ground(state, body)
        state.counters[0].tipping_steps += pressing <= 0.0  # the vehicle would take off
    other = (control.force_x + gravity[0], control.force_y + gravity[1])
    lean += control.moment
    yaw = body.yaw + 0.5 * dt * body.yaw_rate
    cos, sin = math.cos(yaw), math.sin(yaw)
    state.counters[0].tipping_steps += _carry(state, body, pressing, pull, control.height)
    ahead_x, ahead_y = body.v_x + push * other[0], body.v_y + push * other[1]
    ahead = (
        cos * ahead_x + sin * ahead_y + push * pull[0],
        cos * ahead_y - sin * ahead_x + push * pull[1],
        body.yaw_rate + turn * (pull[2] + lean),
    )
    drive_x, drive_y = control.twist[0], control.twist[1]
    if control.in_world:
        drive_x, drive_y = in_turned_frame(drive_x, drive_y, yaw - start_yaw)
    place = (body.x + 0.5 * dt * body.v_x, body.y + 0.5 * dt * body.v_y)
    tilt, command = (body.tilt_x, body.tilt_y), (drive_x, drive_y, control.twist[2])
    drive = _steered(state, state.treads, command, control.drive_stiffness > 0.0)
    return Step(place, (cos, sin), tilt, ahead, drive, control.drive_stiffness), other, lean


@lean_inline
def _turn_wheels(state: layout.State, body: layout.Record, step: Step) -> Triple:
    """Advance brakes and wheels by one step; return force [N] and moment [N m] of the wheels."""
    loads = state.loads
    press(state.pressure)
    if state.losses.wheel.shape[0] > 0:
        _resist(state, body, step, loads)
    if state.plant.roller_pitch > 0.0 and state.rollers is None:
        displace_contacts(state.plant, state.wheels, state.contacts)
    _step_wheels(state, state.rollers, state.treads, step, state.pressure.acting, loads)
    return _resultant(state, state.rollers, state.treads)


@lean_inline
def _steered(
    state: layout.State, treads: layout.Treads | None, command: Triple, follows: bool
) -> Triple:
    """Turn the steered wheels, if there are any, by one step; return the twist of the drives.

    Args:
        state: state of the vehicle, changed in place.
        treads: treads of the state, or None; the kernel is compiled for both cases.
        command: commanded twist in the body frame [m/s, m/s, rad/s].
        follows: whether the drives are engaged, so that the wheels follow the command.
    """
    if treads is None:
        return command
    return steer(treads.steering, treads.lateral, state.contacts, command, follows, state.plant.dt)


@lean_inline
def _carry(
    state: layout.State, body: layout.Record, pressing: float, pull: Triple, height: float
) -> bool:
    """Write the wheel loads to `state`; return whether fewer than three wheels carry load.

    Args:
        state: state of the vehicle.
        body: `state.BODY`.
        pressing: normal force of the vehicle on the ground, divided by its mass [m/s^2].
        pull: force [N] and moment of the wheels in the body frame.
        height: height of the center of gravity [m].
    """
    plant, shift = state.plant, contact_shift(state, state.rollers)
    weight = plant.mass * max(pressing, 0.0)
    if state.suspension.stiffness > 0.0:
        tilting = (height * pull[0] + shift[0], height * pull[1] + shift[1])
        return sprung_loads(plant, state.suspension, state.wheels, weight, tilting, state.loads)
    reach = -height / max(pressing, _LEAST_PRESSING)
    z_x, z_y = reach * body.a_x, reach * body.a_y
    if weight > 0.0:
        z_x, z_y = z_x - shift[0] / weight, z_y - shift[1] / weight
    return wheel_loads(plant.position, plant.plane, plant.hull, weight, z_x, z_y, state.loads)


@lean
def in_turned_frame(v_x: float, v_y: float, turned: float) -> tuple[float, float]:
    """Return the components of a velocity [m/s] in axes that are rotated by an angle [rad]."""
    cos, sin = math.cos(turned), math.sin(turned)
    return cos * v_x + sin * v_y, cos * v_y - sin * v_x


@lean
def base_motion(body: layout.Record, center: Pair, motion: FloatArray) -> None:
    """Write pose and twist of `base_link` from the motion of the center of gravity, Eq. (23).

    Args:
        body: `state.BODY`.
        center: center of gravity in the body frame [m].
        motion: output, x, y [m], yaw [rad, not wrapped] in the world frame, then the velocity in
            the body frame [m/s, m/s, rad/s], shape (6,).
    """
    cos, sin = math.cos(body.yaw), math.sin(body.yaw)
    rate = body.yaw_rate
    d_x, d_y = cos * center[0] - sin * center[1], sin * center[0] + cos * center[1]
    if body.tilt_x != 0.0 or body.tilt_y != 0.0:
        d_x, d_y = level(body.tilt_x, body.tilt_y, d_x, d_y)
    motion[0] = body.x - d_x
    motion[1] = body.y - d_y
    motion[2] = body.yaw
    motion[3] = cos * body.v_x + sin * body.v_y + rate * center[1]
    motion[4] = cos * body.v_y - sin * body.v_x - rate * center[0]
    motion[5] = rate


@lean
def _write_pose(plant: layout.Plant, body: layout.Record, row: FloatArray) -> None:
    """Write pose and velocity of base_link in the world frame to `row`.

    The row contains x, y, yaw [m, m, rad] and their time derivatives, shape (6,).
    """
    cos, sin = math.cos(body.yaw), math.sin(body.yaw)
    c_x, c_y = plant.center
    g_x, g_y = cos * c_x - sin * c_y, sin * c_x + cos * c_y
    v_x, v_y = body.v_x + body.yaw_rate * g_y, body.v_y - body.yaw_rate * g_x
    if body.tilt_x != 0.0 or body.tilt_y != 0.0:
        g_x, g_y = level(body.tilt_x, body.tilt_y, g_x, g_y)
        v_x, v_y = level(body.tilt_x, body.tilt_y, v_x, v_y)
    row[0] = body.x - g_x
    row[1] = body.y - g_y
    row[2] = body.yaw
    row[3] = v_x
    row[4] = v_y
    row[5] = body.yaw_rate


@lean_inline
def energies(state: layout.State) -> Energies:
    """Return the kinetic, elastic and potential energies of the vehicle in a state [J]."""
    plant, body = state.plant, state.body[0]
    spin, elastic = _wheel_energies(state, state.rollers, state.treads)
    height = 0.0
    if state.terrain.parts.shape[0] > 0:
        height = plant.mass * GRAVITY * standing(state, 0.0)[0]
    moving = 0.5 * plant.mass * (body.v_x**2 + body.v_y**2)
    return Energies(moving, 0.5 * plant.yaw_inertia * body.yaw_rate**2, spin, elastic, height)


@lean
def _wheel_energies(
    state: layout.State, rollers: layout.Rollers | None, treads: layout.Treads | None
) -> Pair:
    """Return the spin energy of all wheels and the energy of their tires' deflection [J]."""
    squared_speed, squared_deflection = 0.0, 0.0
    for i in range(state.wheels.shape[0]):
        squared_speed += state.wheels[i].speed ** 2
        squared_deflection += state.wheels[i].deflection ** 2
    spin = 0.5 * state.plant.wheel_inertia * squared_speed
    if rollers is None:
        if treads is not None:
            squared_deflection += squared_bends(treads)
        return spin, 0.5 * state.plant.stiffness * squared_deflection
    roller_spin, elastic = roller_energies(rollers)
    return spin + roller_spin, elastic


@lean_inline
def _resultant(
    state: layout.State, rollers: layout.Rollers | None, treads: layout.Treads | None
) -> Triple:
    """Return the total force and moment of the wheels.

    The force is along x and y of the body frame [N], the moment about the center of gravity [N m].
    """
    wheels, losses = state.wheels, state.losses
    pull_x, pull_y, turn = 0.0, 0.0, 0.0
    for i in range(wheels.shape[0]):
        if rollers is None:
            if treads is None:
                pull_x += wheels[i].force * state.contacts[i].n_x
                pull_y += wheels[i].force * state.contacts[i].n_y
                turn += wheels[i].force * state.contacts[i].moment
            else:
                pull_x += treads.push[i, 0]
                pull_y += treads.push[i, 1]
                turn += treads.push[i, 2]
        else:
            pull_x += rollers.push[i, 0]
            pull_y += rollers.push[i, 1]
            turn += rollers.push[i, 2]
    for i in range(losses.wheel.shape[0]):
        pull_x += wheels[i].passive * losses.wheel[i].u_x
        pull_y += wheels[i].passive * losses.wheel[i].u_y
        turn += wheels[i].passive * losses.wheel[i].moment
    return pull_x, pull_y, turn


@lean
def _resist(state: layout.State, body: layout.Record, step: Step, loads: FloatArray) -> None:
    """Write the passive losses of all wheels in a step; `loads` are the wheel loads [N]."""
    plant, losses = state.plant, state.losses
    dt = plant.dt
    cos, sin = step.heading
    v_x = cos * body.v_x + sin * body.v_y
    v_y = cos * body.v_y - sin * body.v_x
    rate = body.yaw_rate
    for i in range(losses.wheel.shape[0]):
        wheel, loss = state.wheels[i], losses.wheel[i]
        lever = (plant.radius[i] - loads[i] / plant.vertical_stiffness) * loss.rim
        speed = wheel.speed
        spin = speed + (speed - wheel.last_speed)
        wheel.last_speed = speed
        # The passive directions rotate with the body during the step.
        turned = dt * rate * (loss.u_x * v_y - loss.u_y * v_x)
        coming = loss.u_x * step.ahead[0] + loss.u_y * step.ahead[1] + loss.moment * step.ahead[2]
        now = loss.u_x * v_x + loss.u_y * v_y + loss.moment * rate
        coming, now = coming - lever * spin, now - lever * speed - turned
        share = losses.constant + losses.growing * loads[i] + losses.quadratic * now * now
        most = share * loads[i]
        mobility = dt * loss.mobility
        force = passive_force(coming, now, wheel.passive, mobility, most, losses.inertia, dt)
        wheel.passive = force
        wheel.gain = -dt * lever * force / plant.wheel_inertia


@lean_inline
def _step_wheels(
    state: layout.State,
    rollers: layout.Rollers | None,
    treads: layout.Treads | None,
    step: Step,
    brake: FloatArray,
    loads: FloatArray,
) -> None:
    """Advance all wheels by one step.

    Args:
        state: state of the vehicle, changed in place.
        rollers: rollers of the state, or None; the kernel is compiled for both cases.
        treads: treads of the state, or None; the kernel is compiled for both cases.
        step: quantities common to all wheels.
        brake: torque that each brake can exert in this step [N m], shape (N,).
        loads: wheel loads [N], shape (N,).
    """
    plant = state.plant
    for i in range(state.wheels.shape[0]):
        wheel = state.wheels[i]
        if loads[i] > plant.largest_load:
            state.counters[0].overloaded_steps += 1
        omega = wheel.speed
        wheel.load = loads[i]
        speed = (
            plant.rolling[i, 0] * step.drive[0]
            + plant.rolling[i, 1] * step.drive[1]
            + plant.rolling[i, 2] * step.drive[2]
        )
        if treads is not None:
            speed = driven_speed(treads.steering, i, speed)
        stiffness, power = step.drive_stiffness, plant.drive_power
        torque = plant.brake_share[i] * brake[i]
        ramped = plant.ramp[i] > 0.0 and stiffness <= 0.0
        if ramped:
            reduced = max(abs(wheel.command) - plant.dt * plant.ramp[i] * torque, 0.0)
            wheel.command = math.copysign(reduced, wheel.command) if torque > 0.0 else omega
            stiffness = plant.drive_stiffness if torque > 0.0 else 0.0
            speed, power = wheel.command, plant.brake_power
        drive = motor_drive(plant.motor, stiffness, speed, omega, wheel.motor, power)
        torque = 0.0 if plant.ramp[i] > 0.0 else _limited(torque, omega, plant.brake_power)
        if rollers is None:
            if treads is None:
                step_omni_wheel(state, step, i, torque, drive)
            else:
                step_treaded_wheel(state, treads, step, i, torque, drive)
        else:
            step_roller_wheel(plant, rollers, wheel, step, i, torque, drive)
        wheel.motor = clutch_torque(drive, wheel.speed)
        if ramped:
            wheel.brake = wheel.motor
        else:
            wheel.command = wheel.speed
        wheel.angle += 0.5 * plant.dt * (omega + wheel.speed)


@lean_inline
def _limited(torque: float, speed: float, power: float) -> float:
    """Return a torque [N m], reduced if its power at a speed [rad/s] exceeds `power` [W].

    The torque must not be negative.
    """
    return power / abs(speed) if torque * abs(speed) > power else torque
