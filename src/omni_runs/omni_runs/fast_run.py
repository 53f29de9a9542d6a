"""Result of a run of the fast loop."""

import dataclasses

from omni_brake_assist.conditions import INACTIVE, SLOW
from omni_core.quantities import BoolArray, FloatArray, IntArray
from omni_runs.history import RunHistory


@dataclasses.dataclass(frozen=True, kw_only=True)
class FastRun(RunHistory):
    """Time histories of a run of the fast loop, without odometry and states of the assistant.

    Attributes:
        feedback: twist that the brake assistant received [m/s, m/s, rad/s], shape (T, 3).
        condition: state of the assistant, an index of `conditions.CONDITIONS`, shape (T,).
        energy: kinetic energy of body and wheels plus elastic energy of the tires [J], shape (T,).
        stopped: whether the vehicle came to rest within the limit on the duration of the run.
        tipping_steps: number of physics steps in which a real vehicle would have begun to tip over.
        failed: index of the wheel whose brake the assistant reports as failed at the end of the
            run; -1 for none.
    """

    feedback: FloatArray
    condition: IntArray
    energy: FloatArray
    stopped: bool
    tipping_steps: int
    failed: int

    @property
    def valid(self) -> BoolArray:
        """Whether all inputs were valid, so that brakes could be released, shape (T,)."""
        return (self.condition <= INACTIVE) | (self.condition >= SLOW)
