"""Initial state of a vehicle on the ground: rolling without slip, with undeflected tires."""

import math

import numpy as np

from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.masses import MassProperties
from omni_sim.vehicle import roller_dynamics, suspension, uneven_ground
from omni_sim.vehicle.plant import static_loads
from omni_sim.vehicle.state import ROLLER, State
from omni_sim.wheel import brake_pressure, roller_contact, steering

_PLACEMENTS = 8  # iterations for the plane under the wheels, whose positions depend on the plane


def place(
    state: State, masses: MassProperties, pose: FloatArray, twist: FloatArray, angle: FloatArray
) -> None:
    """Place a vehicle with wheels and rollers that roll without slip at the given twist.

    Steered wheels have the steering angles of this twist, whose lateral velocity is replaced as in
    `wheel.steering`.

    Args:
        state: state of the vehicle, changed in place.
        masses: masses of the vehicle.
        pose: x, y [m], yaw [rad] of base_link in the world frame, shape (3,).
        twist: twist of base_link in the body frame [m/s, m/s, rad/s], shape (3,).
        angle: angle of the wheels [rad], shape (N,).
    """
    x, y, yaw = pose
    g, treads = masses.center, state.treads
    state.contacts[:] = state.plant.contact
    if treads is not None:
        for name in ("angle", "target"):
            treads.steering[name] = 0.0
        command = float(twist[0]), float(twist[1]), float(twist[2])
        twist = np.array(
            steering.steer(treads.steering, treads.lateral, state.contacts, command, True, math.inf)
        )
    v = twist[:2] + twist[2] * np.array([-g[1], g[0]])
    cos, sin = math.cos(yaw), math.sin(yaw)
    plant, body, wheels = state.plant, state.body[0], state.wheels
    for array in (state.body, wheels, state.counters):
        array.fill(0)
    body["x"] = x + cos * g[0] - sin * g[1]
    body["y"] = y + sin * g[0] + cos * g[1]
    body["yaw"] = yaw
    _lean_on_ground(state, x, y)
    body["v_x"] = cos * v[0] - sin * v[1]
    body["v_y"] = sin * v[0] + cos * v[1]
    body["yaw_rate"] = twist[2]
    brake_pressure.release(state.pressure)
    wheels["speed"] = plant.rolling @ twist
    if treads is not None:
        steered = treads.steering["limit"] > 0.0
        wheels["speed"][steered] = treads.steering["speed"][steered]
    pressing = math.sqrt(1.0 - (body["tilt_x"] ** 2 + body["tilt_y"] ** 2))
    wheels["load"] = pressing * static_loads(plant)
    wheels["angle"] = angle
    if state.suspension.stiffness > 0.0:
        uneven_ground.standing(state, 0.0)
        weight = pressing * plant.mass * GRAVITY
        wheels["load"] = suspension.settle(plant, state.suspension, wheels["angle"], weight)
    if plant.roller_pitch > 0.0:
        wheels["speed"] = _rolling_speed(state, v, twist[2])
    wheels["last_speed"] = wheels["command"] = wheels["speed"]
    state.loads[:] = wheels["load"]
    if treads is not None:
        treads.push[:] = 0.0
        treads.state[:] = np.zeros((), ROLLER)
        treads.state["q_a"] = 1.0
    _place_rollers(state)


def rolling_radius(state: State) -> FloatArray:
    """Return the rolling radius ``r_D`` of Eq. (1) under the wheel loads [m], shape (N,)."""
    return np.asarray(state.plant.radius - state.wheels["load"] / state.plant.vertical_stiffness)


def along_active(state: State, twist: FloatArray) -> FloatArray:
    """Return the velocities of the contacts along their active directions [m/s], shape (N,).

    Args:
        state: state of the vehicle.
        twist: velocity of the center of gravity and yaw rate in the body frame [m/s, m/s, rad/s],
            shape (3,).
    """
    contacts = state.contacts
    columns = np.column_stack((contacts["n_x"], contacts["n_y"], contacts["moment"]))
    return np.asarray(columns @ twist, dtype=np.float64)


def _rolling_speed(state: State, velocity: FloatArray, yaw_rate: float) -> FloatArray:
    """Move the contacts to the rollers on the ground; return the wheel speeds without slip.

    Args:
        state: state of the vehicle, changed in place.
        velocity: velocity of the center of gravity in the body frame [m/s], shape (2,).
        yaw_rate: yaw rate [rad/s].

    Returns:
        Wheel speeds, Eq. (16) [rad/s], shape (N,).
    """
    state.wheels["speed"] = 0.0
    roller_dynamics.displace_contacts(state.plant, state.wheels, state.contacts)
    hub = along_active(state, np.array([*velocity, yaw_rate]))
    return np.asarray(hub / (rolling_radius(state) * state.contacts["rim"]))


def _place_rollers(state: State) -> None:
    """Set the spin of each roller so that it rolls on the ground without slip, Eq. (13)."""
    rollers, plant, body = state.rollers, state.plant, state.body[0]
    if rollers is None:
        return
    rollers.push[:] = 0.0
    rollers.state[:] = np.zeros((), ROLLER)
    rollers.state["q_a"] = 1.0
    state.contacts[:] = plant.contact
    cos, sin = math.cos(body["yaw"]), math.sin(body["yaw"])
    v_x, v_y = body["v_x"], body["v_y"]
    rate, pitch = body["yaw_rate"], plant.roller_pitch
    for i, radius in enumerate(rolling_radius(state)):
        wheel, contact = state.wheels[i], plant.contact[i]
        angle = wheel["angle"]
        nearest = roller_contact.nearest_roller(angle, pitch)
        gamma, axis = angle - pitch * nearest, plant.rollers[i, int(nearest) % 2]
        n_x, n_y, x, y, _, length, depth = roller_contact.roller_contact(gamma, axis)
        r_x, r_y = contact["r_x"] + x, contact["r_y"] + y
        rim = radius * wheel["speed"]
        slip_x = cos * v_x + sin * v_y - rate * r_y - rim * axis["u_x"]
        slip_y = cos * v_y - sin * v_x + rate * r_x - rim * axis["u_y"]
        surface = (slip_x * n_y - slip_y * n_x) / length
        depths = depth / axis["distance"] * plant.rollers[i]["distance"]  # of even and odd rollers
        rollers.state["spin"][i] = np.resize(surface / (radius - depths), rollers.state.shape[1])


def _lean_on_ground(state: State, x: float, y: float) -> None:
    """Write tilt and center of gravity of a vehicle whose base_link is at x, y [m] on the ground.

    The positions of the wheels depend on the tilt, and the tilt depends on these positions. Both
    are therefore computed by iteration.
    """
    body = state.body[0]
    g_x, g_y = body["x"] - x, body["y"] - y
    for _ in range(_PLACEMENTS if len(state.terrain.parts) else 0):
        body["tilt_x"], body["tilt_y"] = uneven_ground.standing(state, 0.0)[3:5]
        d_x, d_y = uneven_ground.level(body["tilt_x"], body["tilt_y"], g_x, g_y)
        body["x"], body["y"] = x + d_x, y + d_y
