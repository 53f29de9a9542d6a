"""Contact point and active direction of a roller for kernels, Eqs. (10)-(17)."""

import math
from typing import Any

from omni_core.kernels import lean


@lean
def nearest_roller(angle: float, pitch: float) -> float:
    """Return the number of the lowest roller, which increases by n in each turn of the wheel [1].

    Roller 0 therefore has the number 0 in the first turn and n in the second.

    Args:
        angle: angle of the wheel, 0 with roller 0 lowest [rad].
        pitch: angle between two rollers, ``2 pi / n`` [rad].
    """
    return math.floor(angle / pitch + 0.5)


@lean
def roller_contact(gamma: float, roller: Any) -> tuple[float, ...]:
    """Return contact point and active direction of a roller.

    Args:
        gamma: wheel angle from the lowest position of the roller [rad].
        roller: one record of `AXIS`.

    Returns:
        Seven numbers: x and y of the active direction ``n_w`` in the body frame [1], with the sign
        of `omni_core.geometry`; x and y of the contact point relative to the point under the
        wheel center [m]; ``n_w . u`` with the rolling direction ``u`` of the wheel [1]; length of
        the horizontal part of the unit vector along the roller's axis [1]; height of the wheel's
        axis above the roller's axis at the contact [m].
    """
    u_x, u_y = roller.u_x, roller.u_y
    cosine = math.cos(gamma)
    b_u, b_n = roller.cos * cosine, roller.sin
    length = math.sqrt(b_u * b_u + b_n * b_n)  # Eq. (9) without b_z
    b_u, b_n = b_u / length, b_n / length
    # The wheel axis is k x u = (-u_y, u_x).
    along = roller.distance * math.tan(gamma) * roller.sin / roller.cos + roller.shift  # Eq. (10)
    n_x, n_y = b_n * u_y - b_u * u_x, -b_u * u_y - b_n * u_x
    return n_x, n_y, -along * u_y, along * u_x, -b_u, length, roller.distance / cosine
