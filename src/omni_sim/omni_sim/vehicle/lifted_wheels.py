"""Wheel loads when a wheel lifts off the ground: the special cases of `loads`.

The arguments of all functions are: `position`, wheel contacts relative to the center of gravity
[m], shape (N, 2); `hull`, indices of the wheels of the support polygon, counter-clockwise;
`weight`, m g [N]; `z_x` and `z_y`, zero-moment point relative to the center of gravity [m]; `a`,
`b` and `c`, coefficients of the load plane ``a + b x + c y`` for a weight of 1; `loads`, output,
the wheel loads [N], shape (N,).
"""

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray, IntArray

_MAXIMUM_ITERATIONS = 100


@lean
def stand_on_edge(
    position: FloatArray, hull: IntArray, weight: float, z_x: float, z_y: float, loads: FloatArray
) -> bool:
    """Return whether the zero-moment point is outside the support polygon; if so, write the loads.

    The two wheels of the nearest edge then carry the whole weight.
    """
    outside = False
    nearest = np.inf
    first, second, share = 0, 0, 0.0
    for k in range(hull.size):
        a, b = hull[k], hull[(k + 1) % hull.size]
        edge_x, edge_y = position[b, 0] - position[a, 0], position[b, 1] - position[a, 1]
        to_x, to_y = z_x - position[a, 0], z_y - position[a, 1]
        outside = outside or edge_x * to_y - edge_y * to_x < 0.0
        along = (to_x * edge_x + to_y * edge_y) / (edge_x * edge_x + edge_y * edge_y)
        along = min(max(along, 0.0), 1.0)
        distance = (to_x - along * edge_x) ** 2 + (to_y - along * edge_y) ** 2
        if distance < nearest:
            nearest, first, second, share = distance, a, b, along
    if outside:
        loads[:] = 0.0
        loads[first] = weight * (1.0 - share)
        loads[second] = weight * share
    return outside


@lean
def stand_on_some(
    position: FloatArray, weight: float, z_x: float, z_y: float, loads: FloatArray
) -> int:
    """Write the loads if some wheels lift off, and return the number of wheels that carry load.

    If no balance is found, 0 is returned and nothing is written. In balance, `_spring_energy` is
    smallest. It is a convex function of the coefficients of the load plane, so Newton's method with
    a line search finds the minimum from any initial value. The method ends when the wheels with a
    positive load are those for which the plane was computed.
    """
    n = position.shape[0]
    a, b, c = 1.0 / n, 0.0, 0.0
    for _ in range(_MAXIMUM_ITERATIONS):
        contact = _contact_set(position, a, b, c)
        d_a, d_b, d_c, slope, exact = _newton_step(position, contact, z_x, z_y, a, b, c)
        if exact and _contact_set(position, a + d_a, b + d_b, c + d_c) == contact:
            carrying = 0
            for i in range(n):
                loads[i] = 0.0
                if contact & (1 << i):
                    plane = a + d_a + (b + d_b) * position[i, 0] + (c + d_c) * position[i, 1]
                    loads[i] = weight * plane
                    carrying += 1
            return carrying
        energy = _spring_energy(position, z_x, z_y, a, b, c)
        step = 1.0
        while step > 1e-12 and (
            _spring_energy(position, z_x, z_y, a + step * d_a, b + step * d_b, c + step * d_c)
            > energy + 0.1 * step * slope
        ):
            step *= 0.5
        a += step * d_a
        b += step * d_b
        c += step * d_c
    return 0


@lean
def _contact_set(position: FloatArray, a: float, b: float, c: float) -> int:
    """Return a mask of the wheels with a positive load in a load plane (bit i for wheel i)."""
    contact = 0
    for i in range(position.shape[0]):
        if a + b * position[i, 0] + c * position[i, 1] > 0.0:
            contact |= 1 << i
    return contact


@lean
def _newton_step(
    position: FloatArray, contact: int, z_x: float, z_y: float, a: float, b: float, c: float
) -> tuple[float, float, float, float, bool]:
    """Return the change of the load plane after which the wheels in `contact` balance the weight.

    `contact` is a mask from `_contact_set`.

    Returns:
        Changes of a, b, c; derivative of `_spring_energy` along this change; whether the balance is
        exact, which requires three contact points that are not on a line.
    """
    s, s_x, s_y, s_xx, s_xy, s_yy, size = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(position.shape[0]):
        x, y = position[i, 0], position[i, 1]
        size += (1.0 + x * x + y * y) / 3.0
        if contact & (1 << i):
            s += 1.0
            s_x += x
            s_y += y
            s_xx += x * x
            s_xy += x * y
            s_yy += y * y
    # Residual of the balance: the weight and its moments minus the wheel loads and their moments.
    r_a = 1.0 - (s * a + s_x * b + s_y * c)
    r_b = z_x - (s_x * a + s_xx * b + s_xy * c)
    r_c = z_y - (s_y * a + s_xy * b + s_yy * c)
    minor = s_xx * s_yy - s_xy * s_xy
    determinant = s * minor - s_x * (s_x * s_yy - s_xy * s_y) + s_y * (s_x * s_xy - s_xx * s_y)
    exact = determinant > 1e-9 * size * size * size
    if not exact:  # two wheels or collinear wheels: add a small stiffness
        s += 1e-8 * size
        s_xx += 1e-8 * size
        s_yy += 1e-8 * size
    # Cramer's rule on the symmetric normal equations.
    m_aa = s_xx * s_yy - s_xy * s_xy
    m_ab = s_xy * s_y - s_x * s_yy
    m_ac = s_x * s_xy - s_xx * s_y
    m_bc = s_x * s_y - s * s_xy
    scale = 1.0 / (s * m_aa + s_x * m_ab + s_y * m_ac)
    d_a = scale * (m_aa * r_a + m_ab * r_b + m_ac * r_c)
    d_b = scale * (m_ab * r_a + (s * s_yy - s_y * s_y) * r_b + m_bc * r_c)
    d_c = scale * (m_ac * r_a + m_bc * r_b + (s * s_xx - s_x * s_x) * r_c)
    return d_a, d_b, d_c, -(r_a * d_a + r_b * d_b + r_c * d_c), exact


@lean
def _spring_energy(
    position: FloatArray, z_x: float, z_y: float, a: float, b: float, c: float
) -> float:
    """Return the potential energy of wheels on springs of stiffness 1 under a weight of 1.

    It is half the sum of the squared wheel loads, minus the work of the weight, which acts at the
    zero-moment point. It is smallest in balance.
    """
    energy = -(a + b * z_x + c * z_y)
    for i in range(position.shape[0]):
        load = a + b * position[i, 0] + c * position[i, 1]
        if load > 0.0:
            energy += 0.5 * load * load
    return energy


@lean
def stand_on_triangle(
    position: FloatArray, hull: IntArray, weight: float, z_x: float, z_y: float, loads: FloatArray
) -> None:
    """Write the loads of three wheels whose triangle contains the zero-moment point.

    The three wheels are corners of the support polygon. All other wheels have no load.
    """
    loads[:] = 0.0
    o = hull[0]
    best = -np.inf
    for k in range(1, hull.size - 1):
        p, q = hull[k], hull[k + 1]
        p_x, p_y = position[p, 0] - position[o, 0], position[p, 1] - position[o, 1]
        q_x, q_y = position[q, 0] - position[o, 0], position[q, 1] - position[o, 1]
        t_x, t_y = z_x - position[o, 0], z_y - position[o, 1]
        area = p_x * q_y - p_y * q_x
        at_p = (t_x * q_y - t_y * q_x) / area
        at_q = (p_x * t_y - p_y * t_x) / area
        least = min(at_p, at_q, 1.0 - at_p - at_q)
        if least > best:
            best = least
            at_p, at_q = max(at_p, 0.0), max(at_q, 0.0)
            total = max(at_p + at_q, 1.0)
            loads[:] = 0.0
            loads[o] = weight * (1.0 - (at_p + at_q) / total)
            loads[p] = weight * at_p / total
            loads[q] = weight * at_q / total
