"""Wheels with individual rollers in the dynamics kernel: rollers on the ground and their forces.

Wheels and contacts are modeled in `wheel.roller`. Forces act at the displaced contact points, Eqs.
(10), (11), so their levers about the center of gravity vary with the wheel angles. The loads act
there, too: `dynamics` computes them with the displacements of the last step. While two rollers of a
wheel touch the ground, the equations of the wheel and the lower roller are solved together. For the
other roller, they contain its force in the last step.
"""

import math
from typing import NamedTuple

from omni_core.kernels import lean, lean_inline
from omni_core.quantities import Pair
from omni_sim.ground.friction import friction_at
from omni_sim.tire.interface.model import curve_at
from omni_sim.vehicle.state import Plant, Record, Rollers, State, Step, Structured
from omni_sim.wheel.drivetrain import Drive, Spin
from omni_sim.wheel.roller import RollerHub, RollerPatch, RollerStep, load_share, roller_step
from omni_sim.wheel.roller_contact import nearest_roller, roller_contact
from omni_sim.wheel.single import TireConstants

# Inertia that is so large that the speed of the wheel is practically constant [kg m^2].
_PRESCRIBED = 1e30
# Lower limit on the lever, because tipping may compress a tire down to the roller's axis [m].
_LEAST_LEVER = 1e-3


class _Touch(NamedTuple):
    """A roller that touches the ground.

    Attributes:
        wheel: index of the wheel.
        roller: index of the roller on the wheel.
        gamma: wheel angle from the lowest position of the roller [rad].
        load: load of the roller [N].
        wheel_load: load of the wheel [N].
        turning: wheel speed at the start of the step [rad/s].
    """

    wheel: int
    roller: int
    gamma: float
    load: float
    wheel_load: float
    turning: float


@lean
def displace_contacts(plant: Plant, wheels: Structured, contacts: Structured) -> None:
    """Write the contact of each wheel's lowest roller at the middle of the step, Eqs. (9), (10).

    Args:
        plant: constants; the roller pitch must not be 0.
        wheels: `state.WHEEL`, shape (N,).
        contacts: `state.CONTACT`, written in place, shape (N,).
    """
    for i in range(wheels.shape[0]):
        angle = wheels[i].angle + 0.5 * plant.dt * wheels[i].speed
        nearest = nearest_roller(angle, plant.roller_pitch)
        gamma = angle - plant.roller_pitch * nearest
        n_x, n_y, x, y, rim, _, _ = roller_contact(gamma, plant.rollers[i, int(nearest) % 2])
        contact = contacts[i]
        contact.r_x, contact.r_y = plant.contact[i].r_x + x, plant.contact[i].r_y + y
        contact.n_x, contact.n_y = n_x, n_y
        contact.moment = contact.r_x * n_y - contact.r_y * n_x
        contact.rim = rim


@lean
def contact_shift(state: State, rollers: Rollers | None) -> Pair:
    """Return the sum of wheel load times displacement of the contact in the last step [N m].

    The displacement is that of the rollers on the ground from the point under the wheel's center.
    The wheel loads act at the displaced contacts, so they move by its mean in the other direction.
    """
    x, y = 0.0, 0.0
    if state.plant.roller_pitch > 0.0:
        for i in range(state.wheels.shape[0]):
            if rollers is None:
                contact, nominal = state.contacts[i], state.plant.contact[i]
                x += state.loads[i] * (contact.r_x - nominal.r_x)
                y += state.loads[i] * (contact.r_y - nominal.r_y)
            else:
                x += rollers.push[i, 3]
                y += rollers.push[i, 4]
    return x, y


@lean
def step_roller_wheel(
    plant: Plant, rollers: Rollers, wheel: Record, step: Step, i: int, brake: float, drive: Drive
) -> None:
    """Advance a wheel on one or two rollers by one step; the wheel angle is not changed.

    Args:
        plant: constants.
        rollers: rollers of all wheels; state and force of the rollers of wheel `i` are changed in
            place.
        wheel: `state.WHEEL`, with the load of this step; changed in place.
        step: quantities common to all wheels.
        i: index of the wheel.
        brake: torque that the brake can exert [N m].
        drive: drive of the wheel.
    """
    count, pitch = rollers.state.shape[1], plant.roller_pitch
    omega, load = wheel.speed, wheel.load
    angle = wheel.angle + 0.5 * plant.dt * omega
    nearest = nearest_roller(angle, pitch)
    gamma = angle - pitch * nearest
    share = load_share(gamma, 0.5 * pitch, rollers.overlap)
    beside = nearest + (1.0 if gamma > 0.0 else -1.0)
    first, second = int(nearest % count), int(beside % count)
    shared = share < 1.0
    _lift(rollers.state[i], first, second if shared else first)
    for j in range(5):
        rollers.push[i, j] = 0.0
    held = rollers.state[i, second].torque if shared else 0.0  # of the previous step
    spin = Spin(omega + plant.dt * held / plant.wheel_inertia, plant.wheel_inertia, brake)
    lower = _Touch(i, first, gamma, share * load, load, omega)
    wheel.speed, wheel.brake = _step_contact(plant, rollers, step, lower, spin, drive)
    limit = rollers.state[i, first].limit
    if shared:
        other = _Touch(i, second, angle - pitch * beside, (1.0 - share) * load, load, omega)
        prescribed = Spin(wheel.speed, _PRESCRIBED, 0.0)
        _step_contact(plant, rollers, step, other, prescribed, Drive(0.0, 0.0, 0.0, 0.0))
        limit += rollers.state[i, second].limit
    contact, roller = plant.contact[i], rollers.state[i, first]
    wheel.deflection, wheel.sliding, wheel.slip = roller.e_a, roller.sliding, roller.slip
    wheel.force = rollers.push[i, 0] * contact.n_x + rollers.push[i, 1] * contact.n_y
    wheel.limit = limit


@lean
def _lift(rollers: Structured, first: int, second: int) -> None:
    """Set deflection and force of the rollers that have left the ground to zero.

    Args:
        rollers: `state.ROLLER` of one wheel, shape (n,).
        first: index of the lowest roller.
        second: index of the other roller on the ground; equal to `first` if there is none.
    """
    for k in range(rollers.shape[0]):
        roller = rollers[k]
        if k not in (first, second) and roller.load != 0.0:
            roller.e_a = roller.e_p = roller.f_a = roller.f_p = 0.0
            roller.q_a, roller.q_p = 1.0, 0.0
            roller.load = roller.limit = roller.slip = roller.torque = 0.0
            roller.sliding = False


@lean
def _step_contact(
    plant: Plant, rollers: Rollers, step: Step, touch: _Touch, spin: Spin, drive: Drive
) -> Pair:
    """Advance a wheel and one roller; return the wheel speed [rad/s] and brake torque [N m].

    Args:
        plant: constants.
        rollers: all rollers; the state of this roller and `push` of this wheel are changed.
        step: quantities common to all wheels.
        touch: wheel, roller, load and angle of the contact.
        spin: spin of the wheel, to which the torque of the other roller has been applied.
        drive: drive of the wheel.
    """
    i, parity = touch.wheel, touch.roller % 2
    roller, push, axis = rollers.state[i, touch.roller], rollers.push[i], plant.rollers[i, parity]
    inertia = rollers.inertia[parity]
    radius = plant.radius[i] - touch.wheel_load / plant.vertical_stiffness  # r_D of Eq. (1)
    # Largest change of the contact's velocity per force, if all forces act together.
    mobility = plant.dt * plant.mobility[i]
    n_x, n_y, r_x, r_y, rim_active, length, depth = roller_contact(touch.gamma, axis)
    push[3], push[4] = push[3] + touch.load * r_x, push[4] + touch.load * r_y
    p_x, p_y = n_y, -n_x
    r_x, r_y = r_x + plant.contact[i].r_x, r_y + plant.contact[i].r_y
    (x, y), (cos, sin) = step.place, step.heading
    friction = friction_at(
        plant.friction, plant.patches, x + cos * r_x - sin * r_y, y + sin * r_x + cos * r_y
    )
    friction *= plant.grip[i]
    clamped = min(touch.load, plant.largest_load)
    spin_lever = max(radius - depth, _LEAST_LEVER) * length
    lever = (radius * rim_active, radius * (axis.u_x * p_x + axis.u_y * p_y))
    # Speed of the rubber through the contact: the wheel contributes along u, and the roller across
    # its axis.
    surface = spin_lever * roller.spin
    rim = radius * touch.turning
    speed = math.hypot(rim * axis.u_x + surface * p_x, rim * axis.u_y + surface * p_y)
    hub_x = step.ahead[0] - step.ahead[2] * r_y  # Eq. (11)
    hub_y = step.ahead[1] + step.ahead[2] * r_x
    velocity = (
        hub_x * n_x + hub_y * n_y - mobility * roller.f_a,
        hub_x * p_x + hub_y * p_y - mobility * roller.f_p,
    )
    turned = _slowed(rollers, roller, touch.load, spin_lever, plant.dt * spin_lever / inertia)
    deflection, direction = (roller.e_a, roller.e_p), (roller.q_a, roller.q_p)
    after = roller_step(
        TireConstants(rollers.stiffness, rollers.damping, plant.dt),
        (curve_at(plant.tire, clamped, friction), curve_at(rollers.tire_y, clamped, friction)),
        RollerPatch(deflection, speed + plant.slip_speed, roller.sliding, direction),
        RollerHub(lever, velocity, mobility, turned, inertia, spin_lever),
        spin,
        drive,
    )
    _store(roller, touch.load, lever, after)
    f_x = after.force[0] * n_x + after.force[1] * p_x
    f_y = after.force[0] * n_y + after.force[1] * p_y
    push[0] += f_x
    push[1] += f_y
    push[2] += r_x * f_y - r_y * f_x
    return after.speed, after.brake


@lean_inline
def _slowed(rollers: Rollers, roller: Record, load: float, spin_lever: float, turn: float) -> float:
    """Return a roller's spin after a step of dry friction, which can bring it to rest [rad/s].

    Args:
        rollers: constants of the friction.
        roller: state of the roller.
        load: load of the roller [N].
        spin_lever: ratio of the speed of the roller's surface to its spin [m].
        turn: change of the spin in the step per force [rad/s per N].
    """
    spin: float = roller.spin
    free: float = spin - turn * roller.f_p
    surface = spin_lever * spin
    share = rollers.constant + rollers.growing * load + rollers.quadratic * surface * surface
    slowed = turn * share * load
    return spin - min(max(free, -slowed), slowed)


@lean
def _store(roller: Record, load: float, lever: Pair, after: RollerStep) -> None:
    """Store the load [N] and the state of a roller after a step; `lever` is `RollerHub.lever`."""
    roller.spin = after.spin
    roller.e_a, roller.e_p = after.deflection
    roller.f_a, roller.f_p = after.force
    roller.q_a, roller.q_p = after.direction
    roller.load, roller.limit, roller.slip = load, after.limit, after.slip
    roller.torque = -(lever[0] * after.force[0] + lever[1] * after.force[1])
    roller.sliding = after.sliding


@lean
def roller_energies(rollers: Rollers) -> Pair:
    """Return the spin energy of all rollers and the energy of their treads' deflection [J]."""
    spin, elastic = 0.0, 0.0
    for i in range(rollers.state.shape[0]):
        for k in range(rollers.state.shape[1]):
            roller = rollers.state[i, k]
            spin += 0.5 * rollers.inertia[k % 2] * roller.spin**2
            elastic += 0.5 * rollers.stiffness * (roller.e_a**2 + roller.e_p**2)
    return spin, elastic
