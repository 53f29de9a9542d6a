"""Motion on uneven ground: heave, roll, pitch, tilt of the path, and gravity along the path.

The vehicle does not leave the ground. Under each wheel is a road plane (`plane_of_points`) with the
height ``z_i`` and the gradient ``s_i``. The wheels share the weight like equal springs (`loads`),
with the shares ``w_i`` at rest. Heave, roll and pitch therefore follow a plane that is fitted to
the heights ``z_i``, the *vehicle's plane*. The ground under the center of gravity has the height
``Z = sum w_i z_i``. The center of gravity moves in the plane with the gradient ``sum w_i s_i``,
which is called the *path plane* and has the unit normal ``n``.

The planar dynamics are computed in a frame of the path plane, which results from the world frame by
the smallest rotation that aligns the vertical with ``n``. On an even slope this frame is constant,
and the motion is exactly that on flat ground with an additional acceleration ``g (n_x, n_y)`` due
to gravity and with the normal force ``m g n_z``. On curved ground the frame moves without rotation
about ``n``. The normal force is then ``m (g n_z - n_dot . v)``, and the moment of gravity is ``-m g
dZ/dyaw``. The sum of kinetic energy and potential energy ``m g Z`` is conserved. Yaw is the angle
about ``n`` in this frame, whereas positions are in the horizontal plane of the world. If the
vehicle would take off, the normal force is zero and the vehicle counts as tipping.

The model neglects:

- the shorter projection of a tilted vehicle in the computation of the ground under its wheels,
- the kinetic energy of roll and pitch,
- the height of the center of gravity in the computation of its path; the height affects only the
  load transfer,
- the difference between the road plane of a wheel and the path plane in the direction of the
  wheel's force, which is of second order in the angle between the planes,
- the change of the loads due to twisted ground, as if the chassis were flexible, unless the vehicle
  has a `suspension`.

Source of the road plane, Eq. (5): V. Kalman, "On modeling and control of omnidirectional wheels",
BME Budapest 2013, section 2.3.2, after the contact model of TMeasy (Figure 8). The ground ``z(x,
y)`` is replaced under each wheel by the plane of four points before, behind, left and right of its
projection.
"""

import math

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import GRAVITY, FloatArray, Pair
from omni_sim.ground.configuration import Terrain
from omni_sim.ground.elevation import elevation_at
from omni_sim.vehicle.state import Record, State


@lean
def level(tilt_x: float, tilt_y: float, x: float, y: float) -> tuple[float, float]:
    """Return the horizontal components of a vector in the path plane.

    Args:
        tilt_x: component ``n_x`` of the path plane's unit normal [1].
        tilt_y: component ``n_y`` of the path plane's unit normal [1].
        x: component x of the vector in the frame of the path plane [any unit].
        y: component y of the vector in the frame of the path plane [same unit as x].
    """
    normal = math.sqrt(1.0 - tilt_x * tilt_x - tilt_y * tilt_y)
    along = (tilt_x * x + tilt_y * y) / (1.0 + normal)
    return x - tilt_x * along, y - tilt_y * along


@lean
def stand(
    terrain: Terrain,
    position: FloatArray,
    plane: FloatArray,
    place: tuple[float, float],
    heading: tuple[float, float],
    heights: FloatArray,
) -> tuple[float, float, float, float, float, float]:
    """Return height and gradients of the vehicle's plane and path plane on the ground.

    Args:
        terrain: height of the ground.
        position: wheel contacts relative to the center of gravity in the body frame [m], (N, 2).
        plane: matrix from `loads.load_plane`.
        place: center of gravity in the world [m].
        heading: cosine and sine of the yaw.
        heights: output, the ground's height under the wheels above the vehicle's plane [m], (N,).

    Returns:
        Height ``Z`` of the ground under the center of gravity [m]; gradient of the vehicle's plane
        forward and to the left [1]; components ``n_x``, ``n_y`` of the path plane's unit normal
        [1]; derivative ``dZ/dyaw`` of the height [m].
    """
    height, forward, left, slope_x, slope_y, turn = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y = place
    cos, sin = heading
    for i in range(position.shape[0]):
        r_x = cos * position[i, 0] - sin * position[i, 1]
        r_y = sin * position[i, 0] + cos * position[i, 1]
        z, n_x, n_y, n_z = road_plane_at(terrain, x + r_x, y + r_y, cos, sin)
        heights[i] = z
        height += plane[i, 0] * z
        forward += plane[i, 1] * z
        left += plane[i, 2] * z
        slope_x -= plane[i, 0] * n_x / n_z
        slope_y -= plane[i, 0] * n_y / n_z
        turn -= plane[i, 0] * (n_y * r_x - n_x * r_y) / n_z
    for i in range(position.shape[0]):
        heights[i] -= height + forward * position[i, 0] + left * position[i, 1]
    up = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return height, forward, left, -slope_x * up, -slope_y * up, turn


@lean
def standing(state: State, ahead: float) -> tuple[float, float, float, float, float, float]:
    """Return height and gradients of the ground at the vehicle's position after a given time.

    The velocity is assumed to be constant. The result is that of `stand`.

    Args:
        state: state of the vehicle; the heights of the ground in `state.suspension` are written.
        ahead: time until the vehicle reaches this position [s].
    """
    body, plant = state.body[0], state.plant
    v_x, v_y = level(body.tilt_x, body.tilt_y, body.v_x, body.v_y)
    yaw = body.yaw + ahead * body.yaw_rate
    place, heading = (body.x + ahead * v_x, body.y + ahead * v_y), (math.cos(yaw), math.sin(yaw))
    springs = state.suspension.ground
    return stand(state.terrain, plant.position, plant.plane, place, heading, springs)


@lean
def follow_ground(state: State, body: Record) -> tuple[float, Pair, float]:
    """Rotate yaw and velocity into the path plane at the middle of the step.

    Returns:
        Normal force on the ground divided by the mass [m/s^2], negative if the vehicle would take
        off; force of gravity in the path plane [N]; moment of gravity about the normal [N m].
    """
    plant = state.plant
    old_x, old_y = body.tilt_x, body.tilt_y
    v_x, v_y = level(old_x, old_y, body.v_x, body.v_y)
    _, _, _, new_x, new_y, turn = standing(state, 0.5 * plant.dt)
    normal = math.sqrt(1.0 - new_x * new_x - new_y * new_y)
    change = normal - math.sqrt(1.0 - old_x * old_x - old_y * old_y)
    climb = -(old_x * body.v_x + old_y * body.v_y)
    bend = ((new_x - old_x) * v_x + (new_y - old_y) * v_y + change * climb) / plant.dt
    angle = frame_turn(old_x, old_y, new_x, new_y)
    cos, sin = math.cos(angle), math.sin(angle)
    v_x, v_y = body.v_x, body.v_y
    body.v_x, body.v_y = cos * v_x - sin * v_y, sin * v_x + cos * v_y
    body.yaw += angle
    body.tilt_x, body.tilt_y = new_x, new_y
    weight = plant.mass * GRAVITY
    return GRAVITY * normal - bend, (weight * new_x, weight * new_y), -weight * turn


@lean
def frame_turn(tilt_x: float, tilt_y: float, new_x: float, new_y: float) -> float:
    """Return the rotation of a fixed direction relative to the frame of the path plane [rad].

    If the normal ``n`` changes by ``dn``, the frame rotates about ``n`` by ``-(n_x dn_y - n_y dn_x)
    / (1 + n_z)``. A fixed direction therefore rotates relative to the frame by the opposite angle.

    Args:
        tilt_x: component ``n_x`` of the path plane's unit normal before the change [1].
        tilt_y: component ``n_y`` before the change [1].
        new_x: component ``n_x`` after the change [1].
        new_y: component ``n_y`` after the change [1].
    """
    normal = math.sqrt(1.0 - new_x * new_x - new_y * new_y)
    return (tilt_x * new_y - tilt_y * new_x) / (1.0 + normal)


def orientation(yaw: float, forward: float, left: float) -> FloatArray:
    """Return the rotation from the body to the world, shape (3, 3).

    Args:
        yaw: yaw in the frame of the vehicle's plane [rad].
        forward: gradient of the vehicle's plane forward [1].
        left: gradient of the vehicle's plane to the left [1].
    """
    cos, sin = math.cos(yaw), math.sin(yaw)
    c = 1.0 / math.sqrt(1.0 + forward * forward + left * left)
    a, b = -c * (forward * cos - left * sin), -c * (forward * sin + left * cos)
    share = 1.0 / (1.0 + c)
    tilt = np.array(
        [
            [1.0 - a * a * share, -a * b * share, a],
            [-a * b * share, 1.0 - b * b * share, b],
            [-a, -b, c],
        ]
    )
    return np.asarray(tilt @ [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@lean
def plane_of_points(
    front: float, back: float, left: float, right: float, distance: float
) -> tuple[float, float, float, float]:
    """Return the road plane of four points around the projection of a wheel center, Eq. (5).

    The unit normal of the plane is ``e_n = r_21 x r_43 / |r_21 x r_43|``. The vector ``r_21`` is
    from the point behind to the point in front, and ``r_43`` from the right to the left point.

    Args:
        front: height of the point before the projection [m].
        back: height of the point behind the projection [m].
        left: height of the point on the left of the projection [m].
        right: height of the point on the right of the projection [m].
        distance: distance of the points from the projection [m].

    Returns:
        Height of the plane at the projection [m], then ``e_n`` along forward, left and up [1].
    """
    along = (front - back) / (2.0 * distance)
    across = (left - right) / (2.0 * distance)
    up = 1.0 / math.sqrt(1.0 + along * along + across * across)
    return 0.25 * (front + back + left + right), -along * up, -across * up, up


@lean
def road_plane_at(
    terrain: Terrain, x: float, y: float, cos: float, sin: float
) -> tuple[float, float, float, float]:
    """Return the local road plane of an analytic ground, Eq. (5), for the kernels.

    Args:
        terrain: height of the ground.
        x: x of the wheel center in the world [m].
        y: y of the wheel center in the world [m].
        cos: cosine of the direction that counts as forward [1].
        sin: sine of the direction that counts as forward [1].

    Returns:
        Height of the plane [m] and the three components of ``e_n`` in the world frame [1].
    """
    parts, distance = terrain.parts, terrain.sampling
    d_x, d_y = distance * cos, distance * sin
    z, forward, left, up = plane_of_points(
        elevation_at(parts, x + d_x, y + d_y),
        elevation_at(parts, x - d_x, y - d_y),
        elevation_at(parts, x - d_y, y + d_x),
        elevation_at(parts, x + d_y, y - d_x),
        distance,
    )
    return z, cos * forward - sin * left, sin * forward + cos * left, up
