"""The spin of a wheel between its tire, its clutch and its brake (Appendix A, figure C).

One implicit step solves the wheel's equation of motion together with the tire's force:

    I (omega' - omega) / dt = -g F + tau_drive(omega') + tau_brake(omega')

with ``g = r_D (n_w . u)``, the lever by which the tire turns the wheel. The drive follows its
command through a stiff clutch of limited torque, ``tau = k (omega_cmd - omega')``; a disengaged
clutch has ``k = 0``. The brake is Coulomb friction: it opposes rotation with its full capacity,
and holds the wheel at exactly zero speed where less suffices. It never reverses a wheel.
"""

from __future__ import annotations

from numba import njit

from omni_sim.wheel.single import Curve, tire_force

# force [N], deflection [m], wheel speed [rad/s], brake torque [N m], patch velocity [m/s], sliding
WheelStep = tuple[float, float, float, float, float, bool]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _rolling(
    momentum: float,
    inertia: float,
    lever: float,
    deflection: float,
    hub_velocity: float,
    mobility: float,
    speed: float,
    curve: Curve,
    stiffness: float,
    damping: float,
    dt: float,
    sliding: bool,
) -> tuple[float, float, float, float, bool]:
    """Step a wheel that is free to spin; return force, deflection, omega', v_p, sliding."""
    free_speed = momentum / inertia
    force, new_deflection, patch, now_sliding = tire_force(
        deflection,
        hub_velocity - lever * free_speed,
        mobility + dt * lever * lever / inertia,
        speed,
        curve,
        stiffness,
        damping,
        dt,
        sliding,
    )
    return force, new_deflection, free_speed - dt * lever * force / inertia, patch, now_sliding


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _braked(
    omega: float,
    brake: float,
    momentum: float,
    inertia: float,
    lever: float,
    deflection: float,
    hub_velocity: float,
    mobility: float,
    speed: float,
    curve: Curve,
    stiffness: float,
    damping: float,
    dt: float,
    sliding: bool,
) -> WheelStep:
    """Step a wheel under a brake of capacity `brake` [N m], turning or held."""
    wheel = (lever, deflection, hub_velocity, mobility, speed, curve)
    tire = (stiffness, damping, dt, sliding)
    if brake <= 0.0:
        force, e, spin, patch, now = _rolling(momentum, inertia, *wheel, *tire)
        return force, e, spin, 0.0, patch, now
    if omega != 0.0:
        torque = -brake if omega > 0.0 else brake
        force, e, spin, patch, now = _rolling(momentum + dt * torque, inertia, *wheel, *tire)
        if spin * omega > 0.0:
            return force, e, spin, torque, patch, now
    # The wheel stands, or comes to a stand within this step.
    force, e, patch, now = tire_force(
        deflection, hub_velocity, mobility, speed, curve, stiffness, damping, dt, sliding
    )
    holding = lever * force - momentum / dt
    if abs(holding) <= brake:
        return force, e, 0.0, holding, patch, now
    torque = brake if holding > 0.0 else -brake
    broken = _rolling(momentum + dt * torque, inertia, *wheel, *tire)
    if broken[2] * torque < 0.0:
        return broken[0], broken[1], broken[2], torque, broken[3], broken[4]
    return force, e, 0.0, torque, patch, now


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def wheel_step(
    omega: float,
    inertia: float,
    brake: float,
    drive_stiffness: float,
    drive_speed: float,
    drive_limit: float,
    lever: float,
    deflection: float,
    hub_velocity: float,
    mobility: float,
    speed: float,
    curve: Curve,
    stiffness: float,
    damping: float,
    dt: float,
    sliding: bool,
) -> WheelStep:
    """Advance one wheel and its tire by one step.

    Args:
        omega: wheel speed [rad/s].
        inertia: of the wheel about its axis [kg m^2].
        brake: torque that the brake can exert [N m], >= 0.
        drive_stiffness: ``k`` of the clutch [N m s/rad], 0 when disengaged.
        drive_speed: commanded wheel speed [rad/s].
        drive_limit: largest torque of the clutch [N m].
        lever: ``g = r_D (n_w . u)`` [m].
        deflection: ``e`` [m].
        hub_velocity: of the wheel centre along the active direction at the end of the step if
            this tire made no force [m/s].
        mobility: by how much the force changes that velocity [m/s per N].
        speed: ``V = r_D |omega| + v_num`` [m/s].
        curve: of any tire model, from `tire_model.curve_at`.
        stiffness: ``c`` of the tire [N/m].
        damping: ``d`` of the tire [N s/m].
        dt: step [s].
        sliding: whether the patch slid in the step before.

    Returns:
        Force on the vehicle along the active direction [N], deflection [m], wheel speed [rad/s],
        brake torque on the wheel [N m], sliding velocity of the patch [m/s], sliding.
    """
    wheel = (lever, deflection, hub_velocity, mobility, speed, curve)
    tire = (stiffness, damping, dt, sliding)
    if drive_stiffness <= 0.0:
        step: WheelStep = _braked(omega, brake, inertia * omega, inertia, *wheel, *tire)
        return step
    coupled = inertia + dt * drive_stiffness
    momentum = inertia * omega + dt * drive_stiffness * drive_speed
    step = _braked(omega, brake, momentum, coupled, *wheel, *tire)
    torque = drive_stiffness * (drive_speed - step[2])
    if abs(torque) > drive_limit:
        limited = drive_limit if torque > 0.0 else -drive_limit
        momentum = inertia * omega + dt * limited
        step = _braked(omega, brake, momentum, inertia, *wheel, *tire)
    return step
