"""Masses of the vehicle and the vertical loads of its wheels.

Body and load are separate rigid masses. The wheels are modeled as equal vertical springs under a
rigid chassis, so their loads are a linear function ``a + b x + c y`` of the wheel positions, the
load plane. The loads balance the weight and the moments, including the moments of inertial forces
at the height of the center of gravity. The resultant of the loads therefore acts at the zero-moment
point ``r_g - h v_dot / g``, where ``r_g`` is the position, ``h`` the height and ``v_dot`` the
acceleration of the center of gravity. Loads cannot be negative: wheels with a negative load in the
plane lift off, and the remaining wheels carry the weight. If the zero-moment point leaves the
support polygon, no such balance exists, and a real vehicle would tip over. The nearest edge of the
polygon then carries the vehicle, and `tipping` is reported, because the planar model is no longer
valid. The moment that masses at different heights exert under yaw acceleration (product of inertia)
is neglected.

Above the largest permissible load of the tire, the parabola of Eq. (3) has no physical meaning
(dissertation, section 2.3.1), so the dynamics use the force at this limit; `simulator.Overload`
reports it.
"""

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray, IntArray
from omni_sim.masses import (  # noqa: F401 - earlier names
    ForkConfiguration,
    MassConfiguration,
    MassProperties,
    support_polygon,
)
from omni_sim.vehicle.lifted_wheels import stand_on_edge, stand_on_some, stand_on_triangle


def load_plane(position: FloatArray) -> FloatArray:
    """Return the matrix that gives the wheel loads for a zero-moment point.

    While no wheel lifts off, the load of wheel i is ``F_i = m g P_i . (1, z_x, z_y)``. ``P_i`` is
    row i of the matrix, and ``(z_x, z_y)`` the zero-moment point relative to the center of gravity.

    Args:
        position: wheel contacts relative to the center of gravity [m], shape (N, 2).

    Returns:
        Matrix with the rows ``P_i`` and with columns in [1], [1/m] and [1/m], shape (N, 3).
    """
    basis = np.column_stack((np.ones(len(position)), position))
    rows = np.linalg.solve(basis.T @ basis, basis.T).T
    return np.ascontiguousarray(rows, dtype=np.float64)


@lean
def wheel_loads(
    position: FloatArray,
    plane: FloatArray,
    hull: IntArray,
    weight: float,
    z_x: float,
    z_y: float,
    loads: FloatArray,
) -> bool:
    """Write the wheel loads for a zero-moment point, even if wheels lift off.

    Args:
        position: wheel contacts relative to the center of gravity [m], shape (N, 2).
        plane: matrix from `load_plane`.
        hull: indices from `support_polygon`.
        weight: weight of the vehicle, m g [N].
        z_x: x of the zero-moment point relative to the center of gravity [m].
        z_y: y of the zero-moment point relative to the center of gravity [m].
        loads: output, the wheel loads [N], shape (N,).

    Returns:
        Whether fewer than three wheels carry load, so that the vehicle would tip over.
    """
    n = position.shape[0]
    lifted = False
    for i in range(n):
        loads[i] = weight * (plane[i, 0] + plane[i, 1] * z_x + plane[i, 2] * z_y)
        lifted = lifted or loads[i] < 0.0
    if not lifted:
        return False
    if stand_on_edge(position, hull, weight, z_x, z_y, loads):
        return True
    carrying: int = stand_on_some(position, weight, z_x, z_y, loads)
    if carrying == 0:
        stand_on_triangle(position, hull, weight, z_x, z_y, loads)
    return 0 < carrying < 3
