"""The built-in laws, called through one compiled function."""

from typing import NamedTuple

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws import allocation, allocation_state, sliding_mode
from omni_brake_assist.laws.law import HELD, Motion, is_new
from omni_brake_assist.sliding_manifold import Manifold
from omni_platform.geometry import PlatformGeometry
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

SLIDING_MODE, ALLOCATION = range(2)


class LawConstants(NamedTuple):
    """Constants of all built-in laws, since one kernel with a branch compiles faster than two.

    Attributes:
        kind: number of the chosen law.
        sliding_mode: constants of the law `sliding_mode`.
        allocation: constants of the law `allocation`.
    """

    kind: int
    sliding_mode: Manifold
    allocation: allocation_state.Constants


class LawMemory(NamedTuple):
    """State of the laws between steps; each law resets its own part with `Motion.first`.

    Attributes:
        allocation: state of the law `allocation`.
    """

    allocation: allocation_state.Memory


def law_memory(wheels: int) -> LawMemory:
    """Return the initial memory of all laws for N wheels."""
    return LawMemory(allocation.new_memory(wheels))


def law_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> LawConstants:
    """Return the constants of the laws in the layout of the kernel."""
    law = sliding_mode.SlidingMode(configuration, geometry)
    kind = ALLOCATION if configuration.law == "allocation" else SLIDING_MODE
    return LawConstants(
        kind, law.manifold.constants, allocation.make_constants(configuration, geometry)
    )


@lean
def step(
    laws: LawConstants, memory: LawMemory, motion: Motion, error: FloatArray, enable: FloatArray
) -> int:
    """Call the chosen law unless no time has passed; arguments as `Law.step`."""
    if not is_new(motion):
        return HELD
    if laws.kind == ALLOCATION:
        return int(allocation.step(laws.allocation, memory.allocation, motion, error, enable))
    return int(sliding_mode.step(laws.sliding_mode, motion, error, enable))
