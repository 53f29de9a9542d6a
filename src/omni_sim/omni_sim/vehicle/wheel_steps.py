"""Steps of single-roller wheels and of conventional wheels in the dynamics kernel.

A conventional wheel, Eqs. (1), (2), is a `wheel.roller` that cannot turn about its own axis: its
contact is connected to the rim both along the active direction of `omni_core.geometry`, which is
opposite to the rolling direction, and along the wheel's axis. Both directions share one friction
force.
"""

from omni_core.kernels import lean, lean_inline
from omni_sim.ground.friction import friction_at
from omni_sim.tire.interface.model import curve_at
from omni_sim.vehicle.state import State, Step, Treads
from omni_sim.vehicle.uneven_ground import level
from omni_sim.wheel.drivetrain import Drive, Hub, Spin, wheel_step
from omni_sim.wheel.roller import RollerHub, RollerPatch, roller_step
from omni_sim.wheel.single import Patch, TireConstants


@lean_inline
def step_omni_wheel(state: State, step: Step, i: int, brake: float, drive: Drive) -> None:
    """Advance a single-roller wheel by one step, with the equations of `wheel_step`.

    Args:
        state: state of the vehicle, changed in place; the record of this wheel contains its load.
        step: quantities common to all wheels.
        i: index of the wheel.
        brake: torque that the brake can exert [N m].
        drive: drive of the wheel.
    """
    plant, wheel, contact = state.plant, state.wheels[i], state.contacts[i]
    dt, ahead = plant.dt, step.ahead
    cos, sin = step.heading
    w_x, w_y = cos * contact.r_x - sin * contact.r_y, sin * contact.r_x + cos * contact.r_y
    if step.tilt[0] != 0.0 or step.tilt[1] != 0.0:
        w_x, w_y = level(step.tilt[0], step.tilt[1], w_x, w_y)
    friction = friction_at(plant.friction, plant.patches, step.place[0] + w_x, step.place[1] + w_y)
    friction *= plant.grip[i]
    curve = curve_at(plant.tire, min(wheel.load, plant.largest_load), friction)
    radius = plant.radius[i] - wheel.load / plant.vertical_stiffness  # r_D of Eq. (1)
    speed = radius * abs(wheel.speed) + plant.slip_speed  # denominator of Eq. (20)
    mobility = dt * plant.mobility[i]
    hub = contact.n_x * ahead[0] + contact.n_y * ahead[1] + contact.moment * ahead[2]
    after = wheel_step(
        TireConstants(plant.stiffness, plant.damping, dt),
        curve,
        Patch(wheel.deflection, speed, wheel.sliding),
        Hub(radius * contact.rim, hub - mobility * wheel.force, mobility),
        Spin(wheel.speed + wheel.gain, plant.wheel_inertia, brake),
        drive,
    )
    wheel.speed = after.speed
    wheel.deflection = after.deflection
    wheel.force = after.force
    wheel.sliding = after.sliding
    wheel.brake = after.brake
    wheel.slip = after.patch_velocity / speed
    wheel.limit = curve.peak_force


@lean
def step_treaded_wheel(
    state: State, treads: Treads, step: Step, i: int, brake: float, drive: Drive
) -> None:
    """Advance a wheel of a vehicle with conventional wheels, like `step_omni_wheel`."""
    wheel, contact, push = state.wheels[i], state.contacts[i], treads.push[i]
    if treads.conventional[i]:
        _step_conventional_wheel(state, treads, step, i, brake, drive)
    else:
        step_omni_wheel(state, step, i, brake, drive)
        push[0], push[1] = wheel.force * contact.n_x, wheel.force * contact.n_y
        push[2] = wheel.force * contact.moment


@lean
def _step_conventional_wheel(
    state: State, treads: Treads, step: Step, i: int, brake: float, drive: Drive
) -> None:
    """Advance a conventional wheel by one step; the wheel angle is not changed.

    Args:
        state: state of the vehicle, changed in place; the record of this wheel contains its load.
        treads: contacts of the wheels; state and push of this wheel are changed.
        step: quantities common to all wheels.
        i: index of the wheel.
        brake: torque that the brake can exert [N m].
        drive: drive of the wheel.
    """
    plant, wheel, contact, tread = state.plant, state.wheels[i], state.contacts[i], treads.state[i]
    cos, sin = step.heading
    r_x, r_y, n_x, n_y = contact.r_x, contact.r_y, contact.n_x, contact.n_y
    p_x, p_y = n_y, -n_x
    w_x, w_y = level(step.tilt[0], step.tilt[1], cos * r_x - sin * r_y, sin * r_x + cos * r_y)
    friction = friction_at(plant.friction, plant.patches, step.place[0] + w_x, step.place[1] + w_y)
    friction *= plant.grip[i]
    load = min(wheel.load, plant.largest_load)
    radius = plant.radius[i] - wheel.load / plant.vertical_stiffness  # r_D of Eq. (1)
    mobility = plant.dt * plant.mobility[i]
    hub_x = step.ahead[0] - step.ahead[2] * r_y
    hub_y = step.ahead[1] + step.ahead[2] * r_x
    velocity = (
        hub_x * n_x + hub_y * n_y - mobility * tread.f_a,
        hub_x * p_x + hub_y * p_y - mobility * tread.f_p,
    )
    speed = radius * abs(wheel.speed) + plant.slip_speed  # denominator of Eqs. (1), (2)
    bends, direction = (tread.e_a, tread.e_p), (tread.q_a, tread.q_p)
    after = roller_step(
        TireConstants(plant.stiffness, plant.damping, plant.dt),
        (curve_at(plant.tire, load, friction), curve_at(treads.tire_y, load, friction)),
        RollerPatch(bends, speed, tread.sliding, direction),
        RollerHub((radius * contact.rim, 0.0), velocity, mobility, 0.0, 1.0, 0.0),
        Spin(wheel.speed, plant.wheel_inertia, brake),
        drive,
    )
    tread.e_a, tread.e_p = after.deflection
    tread.f_a, tread.f_p = after.force
    tread.q_a, tread.q_p = after.direction
    tread.sliding = wheel.sliding = after.sliding
    wheel.speed, wheel.brake = after.speed, after.brake
    wheel.deflection, wheel.force = after.deflection[0], after.force[0]
    wheel.slip, wheel.limit = after.slip, after.limit
    f_x = after.force[0] * n_x + after.force[1] * p_x
    f_y = after.force[0] * n_y + after.force[1] * p_y
    push = treads.push[i]
    push[0], push[1], push[2] = f_x, f_y, r_x * f_y - r_y * f_x


@lean
def squared_bends(treads: Treads) -> float:
    """Return the sum of the squared deflections along the axes of conventional wheels [m^2]."""
    squared = 0.0
    for i in range(treads.state.shape[0]):
        squared += treads.state[i].e_p ** 2
    return squared
