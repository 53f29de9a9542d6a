"""Road plane under a wheel on uneven ground, Eq. (5).

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 2.3.2, after the contact model of TMeasy (Figure 8). The ground ``z(x, y)`` is replaced
under each wheel by the plane of four points before, behind, left and right of its projection.
"""

import math

from omni_platform.kernels import lean
from omni_sim.ground.elevation import Terrain, elevation_at


@lean
def plane_of_points(
    front: float, back: float, left: float, right: float, distance: float
) -> tuple[float, float, float, float]:
    """Return the plane through four points at ``distance`` around a projection, Eq. (5).

    With ``r_21`` from back to front and ``r_43`` from right to left, both of horizontal length
    ``2 distance``, ``e_n = r_21 x r_43 / |r_21 x r_43|``.

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
