"""The laws that come with the assistant, behind one compiled door."""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws import sliding_mode
from omni_brake_assist.laws.law import FloatArray, Motion
from omni_brake_assist.sliding_manifold import Manifold
from omni_platform.geometry import PlatformGeometry

SLIDING_MODE = 0


class LawConstants(NamedTuple):
    """Constants of every built-in law; a branch is cheaper to compile than a kernel for each.

    Attributes:
        kind: which one is asked.
        sliding_mode: constants of that law.
    """

    kind: int
    sliding_mode: Manifold


def law_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> LawConstants:
    """Lay out the constants of the laws for the kernel."""
    law = sliding_mode.SlidingMode(configuration, geometry)
    return LawConstants(SLIDING_MODE, law.manifold.constants)


@njit(cache=True, nogil=True, error_model="numpy")
def step(laws: LawConstants, motion: Motion, error: FloatArray, enable: FloatArray) -> int:
    """Ask the chosen law; arguments as `Law.step`."""
    return int(sliding_mode.step(laws.sliding_mode, motion, error, enable))
