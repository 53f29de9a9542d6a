"""Call of the selected built-in law through one compiled function."""

from typing import NamedTuple

from omni_brake_assist.configuration import LAWS, MOST_VALVES, BrakeAssistConfiguration
from omni_brake_assist.laws import allocation, allocation_state, sliding_mode
from omni_brake_assist.laws.law import HELD, NO_HELP, NO_WHEEL, Motion
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import by_reference, lean
from omni_core.quantities import FloatArray

SLIDING_MODE, ALLOCATION = range(2)


@by_reference
class LawConstants(NamedTuple):
    """Constants of all built-in laws. One compiled kernel contains all of these laws.

    Attributes:
        kind: number of the chosen law.
        replans: whether `allocation` controls the rest of a stop after a brake has failed. This
            requires a built-in law and at most `MOST_VALVES` brakes, all with on-off valves. With
            proportional brakes, some vehicles would rotate more under `allocation` than with all
            brakes on, so all brakes act after a failure.
        sliding_mode: constants of the law `sliding_mode`.
        allocation: constants of the law `allocation`.
    """

    kind: int
    replans: bool
    sliding_mode: sliding_mode.Manifold
    allocation: allocation_state.Constants


def law_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> LawConstants:
    """Return the constants of the laws for a configuration and wheel geometry."""
    law = sliding_mode.SlidingMode(configuration, geometry)
    kind = ALLOCATION if configuration.law == "allocation" else SLIDING_MODE
    made = allocation.make_constants(configuration, geometry)
    few_valves = made.brake.pressure_step >= 1.0 and len(made.rim) <= MOST_VALVES
    replans = configuration.law in LAWS and few_valves
    return LawConstants(kind, replans, law.manifold.constants, made)


@lean
def step(
    laws: LawConstants,
    memory: allocation_state.Memory,
    motion: Motion,
    error: FloatArray,
    enable: FloatArray,
) -> int:
    """Call the chosen law and return its result; HELD if the stamp of the motion is not new.

    The arguments `motion`, `error` and `enable` are those of `Law.step`. After a brake has failed,
    `allocation` controls the rest of the stop with the working brakes if `LawConstants.replans` is
    true; otherwise the result is NO_HELP.
    """
    if not (motion.first or motion.dt > 0.0):
        return HELD
    failed = motion.failed_brake != NO_WHEEL
    if failed and not laws.replans:
        return NO_HELP
    if laws.kind == ALLOCATION or failed:
        return int(allocation.step(laws.allocation, memory, motion, error, enable))
    return int(sliding_mode.step(laws.sliding_mode, motion, error, enable))
