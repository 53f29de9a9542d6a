"""Sprung chassis with the dynamics of heave, pitch and roll.

Without a suspension, the wheels share the weight like equal springs without dynamics (`loads`).
With a suspension, each wheel including its tire has a spring and a damper, and the chassis moves
according to

    m z'' = sum F_i - m g,    I_p p'' = sum F_i x_i + h f_x,    I_r r'' = sum F_i y_i + h f_y,
    F_i = max(0, c e_i + d e_i'),    e_i = s_i - (z + p x_i + r y_i)

Chassis: ``z`` is the heave of the center of gravity, and ``p`` and ``r`` are the small gradients of
the chassis forward and to the left. ``h`` is the constant height of the center of gravity above the
ground, and ``f`` is the force of the wheels along the ground.

Wheel i: ``F_i`` is its load, ``e_i`` the compression of its spring, and ``(x_i, y_i)`` its
position. ``c`` and ``d`` are stiffness and damping of every wheel. ``s_i`` is the height of the
road under the wheel above the vehicle's plane (`uneven_ground`), minus the mounting height of the
wheel, and minus the depth by which it sinks into a gap between two rollers.

The wheel loads therefore depend on the mounting heights and on twisted ground, for which the loads
of a rigid vehicle are indeterminate. Rollers with gaps excite vibrations.

The model neglects the separate mass of the wheels, gyroscopic moments, the displacement of the
center of gravity due to a tilt of the chassis, and the velocity of the contact points due to pitch
and roll.
"""

import math

import numpy as np

from omni_core.geometry import turned
from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.vehicle.configuration import SuspensionConfiguration  # noqa: F401 - earlier names
from omni_sim.vehicle.state import Plant, Structured, Suspension
from omni_sim.wheel.roller_contact import nearest_roller

_BALANCES = 100  # limit on the number of iterations for a chassis at rest


def fastest_motion(plant: Plant, suspension: Suspension) -> float:
    """Return the largest natural angular frequency of a chassis on its springs [rad/s]."""
    inertia = np.sqrt([plant.mass, suspension.pitch_inertia, suspension.roll_inertia])
    scaled = _lever_arms(plant) / inertia
    return math.sqrt(suspension.stiffness * float(np.linalg.eigvalsh(scaled.T @ scaled)[-1]))


def settle(plant: Plant, suspension: Suspension, angle: FloatArray, weight: float) -> FloatArray:
    """Place a chassis at rest on its springs; return the wheel loads [N], shape (N,).

    If fewer than three wheels carry load, the vehicle is not balanced and starts to move.

    Args:
        plant: constants.
        suspension: springs and ground under the wheels; the state of the chassis is written.
        angle: angle of the wheels [rad], shape (N,).
        weight: weight on the ground [N].
    """
    basis = _lever_arms(plant)
    for i in range(len(angle)):
        suspension.sunk[i] = gap_depth(plant, suspension.half_gap, i, angle[i])
    height = suspension.ground - suspension.mounted - suspension.sunk
    carrying = np.ones(len(height), bool)
    for _ in range(_BALANCES):
        rows = basis[carrying]
        balance = rows.T @ height[carrying] - np.array([weight / suspension.stiffness, 0.0, 0.0])
        plane = np.linalg.lstsq(rows.T @ rows, balance, rcond=None)[0]
        squeeze = height - basis @ plane
        if np.array_equal(squeeze > 0.0, carrying):
            break
        carrying = squeeze > 0.0
    suspension.chassis[0] = (*plane, 0.0, 0.0, 0.0)
    return np.asarray(suspension.stiffness * np.maximum(squeeze, 0.0), dtype=np.float64)


def _lever_arms(plant: Plant) -> FloatArray:
    return np.column_stack((np.ones(len(plant.position)), plant.position))


@lean
def gap_depth(plant: Plant, half_gap: float, wheel: int, angle: float) -> float:
    """Return the depth by which a wheel sinks into the gap between two rollers [m].

    In the gap, the wheel rests on the end of a roller. This end is on the circle of the envelope.

    Args:
        plant: constants.
        half_gap: distance along the rim from the end of a roller to the middle of the gap [m].
        wheel: index of the wheel.
        angle: angle of the wheel [rad].
    """
    if half_gap <= 0.0:
        return 0.0
    pitch = plant.roller_pitch
    gamma = abs(angle - pitch * nearest_roller(angle, pitch))
    radius = plant.radius[wheel]
    beyond = max(gamma - 0.5 * pitch + half_gap / radius, 0.0)
    depth: float = radius * (1.0 - math.cos(beyond))
    return depth


@lean
def sprung_loads(
    plant: Plant,
    suspension: Suspension,
    wheels: Structured,
    weight: float,
    tilting: tuple[float, float],
    loads: FloatArray,
) -> bool:
    """Advance the chassis on its springs by one step, and write the wheel loads.

    Args:
        plant: constants.
        suspension: springs and state of the chassis, changed in place.
        wheels: `state.WHEEL`, shape (N,).
        weight: weight on the ground [N].
        tilting: force of the wheels along the ground in the body frame, times the height of the
            center of gravity [N m].
        loads: output, the wheel loads [N], shape (N,).

    Returns:
        Whether fewer than three wheels carry load.
    """
    chassis, dt = suspension.chassis[0], plant.dt
    lift, nose, side = -weight, tilting[0], tilting[1]
    carrying = 0
    for i in range(wheels.shape[0]):
        x, y = plant.position[i, 0], plant.position[i, 1]
        sunk = gap_depth(plant, suspension.half_gap, i, wheels[i].angle)
        stand = suspension.ground[i] - suspension.mounted[i] - sunk
        squeeze = stand - (chassis.heave + chassis.forward * x + chassis.left * y)
        rate = (suspension.sunk[i] - sunk) / dt
        rate -= chassis.heave_rate + chassis.forward_rate * x + chassis.left_rate * y
        suspension.sunk[i] = sunk
        loads[i] = 0.0
        if squeeze > 0.0:
            loads[i] = max(suspension.stiffness * squeeze + suspension.damping * rate, 0.0)
            carrying += 1
        lift += loads[i]
        nose += loads[i] * x
        side += loads[i] * y
    chassis.heave_rate += dt * lift / plant.mass
    chassis.forward_rate += dt * nose / suspension.pitch_inertia
    chassis.left_rate += dt * side / suspension.roll_inertia
    chassis.heave += dt * chassis.heave_rate
    chassis.forward += dt * chassis.forward_rate
    chassis.left += dt * chassis.left_rate
    return carrying < 3


def swaying(
    trajectory: FloatArray, before: FloatArray, after: FloatArray, height: float, period: float
) -> FloatArray:
    """Return the trajectory of the sensors' fields of view on a sprung chassis.

    A sprung chassis tilts about its center of gravity, which is at the height h. Let p and r be the
    gradients of the chassis in the forward direction and to the left. A line of sight perpendicular
    to the chassis meets the ground at a point that is shifted by ``h (p, r)`` forward and to the
    left. This shift does not depend on the mounting position. All fields of view therefore move
    over the ground with the velocity ``h (p', r')``, the time derivative of the shift. A ground
    sensor cannot distinguish this velocity from a motion of the vehicle. Between two control
    stamps, p and r are cubics with the given values and derivatives at both stamps. Heave changes
    only the magnification. The slant of the view and the cosine of the tilt are second-order
    effects and are neglected.

    Args:
        trajectory: x, y [m] and yaw [rad] of the vehicle, and their time derivatives in the world
            frame, at uniform steps, shape (n + 1, 6).
        before: `Vehicle.ride` at the start: heave [m], gradients [1], and the time derivatives of
            all three [m/s, 1/s, 1/s], shape (6,).
        after: `Vehicle.ride` at the end, shape (6,).
        height: height of the center of gravity [m].
        period: time from start to end [s].
    """
    t = np.linspace(0.0, 1.0, len(trajectory))[:, None]
    start, end = before[1:3], after[1:3]
    slope, last = period * before[4:], period * after[4:]
    bend = 3.0 * (end - start) - 2.0 * slope - last
    twist = slope + last - 2.0 * (end - start)
    tilt = start + t * (slope + t * (bend + t * twist))
    rate = (slope + t * (2.0 * bend + t * 3.0 * twist)) / period
    swayed = trajectory.copy()
    for first, body in ((0, height * tilt), (3, height * rate)):
        swayed[:, first : first + 2] += turned(body, trajectory[:, 2])
    return swayed
