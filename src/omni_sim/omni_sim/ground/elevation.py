"""Height of the ground in the world: the sum of a slope, waves and bumps.

Each part is an analytic function ``z(x, y)``:

    slope   z = g (x cos a + y sin a)
    wave    z = A sin(2 pi (x cos a + y sin a) / L + p)
    bump    z = h (1 - r^2 / R^2)^3 within the radius R, else 0

A slope has the grade ``g`` and rises in the direction ``a``. A wave has the amplitude ``A``, the
length ``L`` and the phase ``p``; its crests are perpendicular to the direction ``a``. A bump has
the height ``h``, and ``r`` is the distance from its center; a bump with ``h < 0`` is a hollow.

The curvature is continuous, even at the rim of a bump. The ground is therefore smooth enough for
the local road plane of `vehicle.uneven_ground`. Without any part the ground is flat.
"""

import math

from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.ground.configuration import (  # noqa: F401 - earlier names
    SLOPE,
    WAVE,
    BumpConfiguration,
    ElevationConfiguration,
    WaveConfiguration,
)


@lean
def elevation_at(table: FloatArray, x: float, y: float) -> float:
    """Return the height of the ground ``z(x, y)`` [m].

    Args:
        table: table from `ElevationConfiguration.table`, shape (K, 5).
        x: coordinate x in the world [m].
        y: coordinate y in the world [m].
    """
    z = 0.0
    for k in range(table.shape[0]):
        kind, a, b, c, d = table[k, 0], table[k, 1], table[k, 2], table[k, 3], table[k, 4]
        if kind == SLOPE:
            z += a * x + b * y
        elif kind == WAVE:
            z += d * math.sin(a * x + b * y + c)
        else:
            inside = 1.0 - ((x - a) * (x - a) + (y - b) * (y - b)) / (c * c)
            if inside > 0.0:
                z += d * inside * inside * inside
    return z
