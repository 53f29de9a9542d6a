"""Spin of a wheel under the torques of its tire, clutch and brake (dissertation, Appendix A).

One implicit step solves the equation of motion of the wheel together with the force of the tire:

    I (omega' - omega) / dt = -g F + tau_drive(omega') + tau_brake(omega')

``omega`` and ``omega'`` are the wheel speeds before and after the step. ``F`` is the force of the
tire on the vehicle. It turns the wheel with the lever ``g = r_D (n_w . u)``, where ``r_D`` is the
rolling radius, ``n_w`` the active direction and ``u`` the rolling direction. The drive follows its
speed command through a stiff clutch of limited torque, ``tau = k (omega_cmd - omega')``; for a
disengaged clutch, ``k = 0``. `motor_drive` adds the limits of a motor. The brake is Coulomb
friction: it opposes rotation with its full torque, and holds the wheel at exactly zero speed if a
smaller torque suffices. It never reverses a wheel.

If a velocity drive without friction brake slows the vehicle down, it reduces ``omega_cmd`` to zero
along a ramp. Like any speed controller, it also accelerates a wheel that is slower than the
command, so it does not lock the wheel.
"""

from typing import NamedTuple

from omni_core.kernels import lean, lean_inline
from omni_sim.tire.interface.model import Curve
from omni_sim.wheel.configuration import Motor
from omni_sim.wheel.single import Patch, TireConstants, tire_force


class Hub(NamedTuple):
    """Constants that relate the tire force to the motion of wheel and vehicle in a step.

    Attributes:
        lever: lever ``g`` by which the tire turns the wheel [m].
        velocity: velocity along the active direction that the wheel center would have at the end of
            the step without the force of this tire [m/s].
        mobility: change of this velocity per force of the tire [m/s per N].
    """

    lever: float
    velocity: float
    mobility: float


class Spin(NamedTuple):
    """Rotation of a wheel about its axis.

    Attributes:
        speed: speed of the wheel [rad/s].
        inertia: moment of inertia of the wheel [kg m^2].
        brake: torque that the brake can exert [N m], >= 0.
    """

    speed: float
    inertia: float
    brake: float


class Drive(NamedTuple):
    """Drive of a wheel, which follows a speed through a clutch.

    Attributes:
        stiffness: torque of the clutch per difference between commanded and actual wheel speed,
            ``k`` [N m s/rad]; 0 when disengaged.
        speed: commanded wheel speed [rad/s].
        least: lower limit on the torque of the clutch [N m].
        most: upper limit on this torque [N m].
    """

    stiffness: float
    speed: float
    least: float
    most: float


class WheelStep(NamedTuple):
    """State of a wheel and its tire after a step.

    Attributes:
        force: force on the vehicle along the active direction [N].
        deflection: deflection of the tire [m].
        speed: speed of the wheel [rad/s].
        brake: torque of the brake on the wheel [N m].
        patch_velocity: sliding velocity of the contact patch [m/s].
        sliding: whether the contact patch slides.
    """

    force: float
    deflection: float
    speed: float
    brake: float
    patch_velocity: float
    sliding: bool


@lean
def motor_drive(
    motor: Motor, stiffness: float, speed: float, omega: float, torque: float, power: float
) -> Drive:
    """Return the drive of a wheel in a step, within the limits of its motor.

    The back EMF reduces the torque of the largest voltage ``+-U`` to ``tau_0 (+-1 - omega /
    omega_0)``, which is a drive with another stiffness. The current loop is a first-order lag of
    the torque.

    Args:
        motor: limits and lag of the motor.
        stiffness: torque of the speed controller per difference of the speeds [N m s/rad].
        speed: commanded wheel speed [rad/s].
        omega: wheel speed at the start of the step [rad/s].
        torque: torque of the motor in the last step [N m].
        power: limit on the mechanical power [W].
    """
    if stiffness <= 0.0:
        return Drive(0.0, 0.0, 0.0, 0.0)
    limit = power / abs(omega) if motor.limit * abs(omega) > power else motor.limit
    wanted = stiffness * (speed - omega)
    if wanted > motor.slope * (motor.idling - omega):
        stiffness, speed = motor.slope, motor.idling
    elif wanted < motor.slope * (-motor.idling - omega):
        stiffness, speed = motor.slope, -motor.idling
    share = motor.response
    kept = (1.0 - share) * torque
    return Drive(
        share * stiffness,
        speed + kept / (share * stiffness),
        kept - share * limit,
        kept + share * limit,
    )


@lean
def clutch_torque(drive: Drive, speed: float) -> float:
    """Return the torque of a drive on a wheel with a speed [rad/s] at the end of a step [N m]."""
    return min(max(drive.stiffness * (drive.speed - speed), drive.least), drive.most)


@lean_inline
def wheel_step(
    tire: TireConstants, curve: Curve, patch: Patch, hub: Hub, spin: Spin, drive: Drive
) -> WheelStep:
    """Advance one wheel and its tire by one step.

    Args:
        tire: constants.
        curve: curve of any tire model, from `tire.interface.model.curve_at`.
        patch: contact patch of the tire at the start of the step.
        hub: relation of force and motion.
        spin: spin of the wheel at the start of the step.
        drive: drive of the wheel.
    """
    if drive.stiffness <= 0.0:
        return _braked(tire, curve, patch, hub, spin, 0.0)
    coupled = Spin(spin.speed, spin.inertia + tire.dt * drive.stiffness, spin.brake)
    driven = tire.dt * drive.stiffness * (drive.speed - spin.speed)
    step = _braked(tire, curve, patch, hub, coupled, driven)
    torque = drive.stiffness * (drive.speed - step.speed)
    limited = min(max(torque, drive.least), drive.most)
    if limited != torque:
        step = _braked(tire, curve, patch, hub, spin, tire.dt * limited)
    return step


@lean_inline
def _braked(
    tire: TireConstants, curve: Curve, patch: Patch, hub: Hub, spin: Spin, impulse: float
) -> WheelStep:
    """Advance a wheel by one step, in which the brake may lock it.

    The arguments are those of `_rolling`, except that the brake of `spin` acts; its torque is not
    included in `impulse`.
    """
    if spin.brake <= 0.0 or spin.speed != 0.0:
        torque = 0.0 - spin.brake if spin.speed > 0.0 else spin.brake  # not -0.0
        s = _rolling(tire, curve, patch, hub, spin, impulse + tire.dt * torque)
        if spin.brake <= 0.0 or s.speed * spin.speed > 0.0:
            return WheelStep(s.force, s.deflection, s.speed, torque, s.patch_velocity, s.sliding)
    # The wheel is at rest, or stops within this step.
    force, deflection, velocity, sliding = tire_force(
        tire, curve, patch, hub.velocity, hub.mobility
    )
    holding = hub.lever * force - 1.0 / tire.dt * (spin.inertia * spin.speed + impulse)
    if abs(holding) <= spin.brake:
        return WheelStep(force, deflection, 0.0, holding, velocity, sliding)
    torque = spin.brake if holding > 0.0 else -spin.brake
    s = _rolling(tire, curve, patch, hub, spin, impulse + tire.dt * torque)
    if s.speed * torque < 0.0:
        return WheelStep(s.force, s.deflection, s.speed, torque, s.patch_velocity, s.sliding)
    return WheelStep(force, deflection, 0.0, torque, velocity, sliding)


@lean_inline
def _rolling(
    tire: TireConstants, curve: Curve, patch: Patch, hub: Hub, spin: Spin, impulse: float
) -> WheelStep:
    """Advance a wheel without brake by one step.

    Args:
        tire: constants.
        curve: force-slip curve of the tire.
        patch: contact patch of the tire at the start of the step.
        hub: relation of force and motion.
        spin: spin of the wheel at the start of the step; its brake is ignored.
        impulse: angular impulse of all torques on the wheel except that of the tire [N m s].
    """
    free_speed = spin.speed + 1.0 / spin.inertia * impulse
    turn = tire.dt / spin.inertia * hub.lever
    force, deflection, velocity, sliding = tire_force(
        tire, curve, patch, hub.velocity - hub.lever * free_speed, hub.mobility + turn * hub.lever
    )
    return WheelStep(force, deflection, free_speed - turn * force, 0.0, velocity, sliding)
