"""Friction of the ground as a function of the position in the world: a base value and patches."""

import math
from collections.abc import Mapping

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.ground.configuration import FrictionPatch


class FrictionMap:
    """Friction factor ``mu/mu_0`` of the ground; where patches overlap, the last one applies.

    Attributes:
        base: friction factor outside all patches [1].
        table: one row per patch: center x, y [m], cosine and sine of the heading, half length, half
            width [m], friction factor [1], and 1 for an ellipse or 0 for a rectangle; shape (P, 8).
    """

    def __init__(
        self, base: float = 1.0, patches: Mapping[str, FrictionPatch] | None = None
    ) -> None:
        """Create the friction map of a ground.

        Args:
            base: friction factor outside all patches [1], at least 0.
            patches: patches, keyed by name.
        """
        if not (math.isfinite(base) and base >= 0.0):
            raise ValueError(f"friction factor {base} must be at least 0")
        self.base = base
        rows = []
        for patch in (patches or {}).values():
            angle = math.radians(patch.heading_deg)
            frame = patch.x, patch.y, math.cos(angle), math.sin(angle)
            size = patch.length / 2.0, patch.width / 2.0
            rows.append((*frame, *size, patch.friction, float(patch.shape == "ellipse")))
        self.table: FloatArray = np.array(rows, dtype=np.float64).reshape(len(rows), 8)

    def at(self, x: float, y: float) -> float:
        """Return the friction factor [1] at a point of the ground [m]."""
        return float(friction_at(self.base, self.table, x, y))


@lean
def friction_at(base: float, table: FloatArray, x: float, y: float) -> float:
    """Return the friction factor [1] at a point of the ground.

    Args:
        base: friction factor outside all patches [1].
        table: table of the patches from `FrictionMap`, shape (P, 8).
        x: coordinate x in the world [m].
        y: coordinate y in the world [m].
    """
    for row in range(table.shape[0] - 1, -1, -1):
        dx = x - table[row, 0]
        dy = y - table[row, 1]
        along = dx * table[row, 2] + dy * table[row, 3]
        across = dy * table[row, 2] - dx * table[row, 3]
        if abs(along) <= table[row, 4] and abs(across) <= table[row, 5]:
            u, v = along / table[row, 4], across / table[row, 5]
            if table[row, 7] == 0.0 or u * u + v * v <= 1.0:
                return float(table[row, 6])
    return base
