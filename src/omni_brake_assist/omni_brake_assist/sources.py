"""Test ratio and state of each measurement source, for diagnostics and recordings.

The test ratio is a squared normalized innovation over its gate: a source is rejected above 1. The
velocity of the twist is compared with that of the accelerometer, its yaw rate with that of the
gyro, both in the filter of all sources, and each rolling wheel with the most probable filter.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from omni_brake_assist.assist_step import Memory
from omni_brake_assist.conditions import CONDITIONS, GOOD
from omni_brake_assist.filter_bank.measurement import GATE
from omni_brake_assist.filter_bank.state import (
    FAULTY,
    NO_ESTIMATE,
    NO_FORCE,
    NO_GYRO,
    NO_IMU,
    NO_TWIST,
)

FUSED, REJECTED, ISOLATED, MISSING, BRAKED = (
    "fused",
    "rejected",
    "isolated",
    "missing",
    "braked",
)
_GATE_SIGMA = math.sqrt(GATE)  # standard deviations at a test ratio of 1 [1]


class Source(NamedTuple):
    """A measurement source at a step.

    Attributes:
        name: twist, gyro, accelerometer or a wheel.
        test_ratio: squared innovation over its gate [1], NaN without an innovation.
        state: FUSED, REJECTED, ISOLATED, MISSING or, for a wheel, BRAKED: its speed is not used.
        reason: why the source is not fused, else empty.
    """

    name: str
    test_ratio: float
    state: str
    reason: str = ""

    @property
    def words(self) -> str:
        """State and reason on one line."""
        return f"{self.state}: {self.reason}" if self.reason else self.state


def sources(memory: Memory, wheels: Sequence[str]) -> tuple[Source, ...]:
    """Return all sources after a step.

    Args:
        memory: memory of the assistant.
        wheels: names in the order of the configuration.
    """
    best, gate = int(memory.bank.record[0]["best"]), memory.gate[0]
    force, gyro = map(float, memory.bank.ratio)
    twist = max(force, gyro)
    found = [_source("twist", twist, isolated=best in (NO_TWIST, NO_ESTIMATE))]
    if gate["cause"] != GOOD:
        state = CONDITIONS[int(gate["cause"])].state.value
        found[0] = Source("twist", twist, REJECTED, state)
    for name, ratio, out, reading in (
        ("gyro", gyro, NO_GYRO, memory.workspace[0, 0]),
        ("accelerometer", force, NO_FORCE, memory.workspace[0, 1]),
    ):
        missing = not math.isfinite(reading)
        found.append(_source(name, ratio, isolated=best in (out, NO_IMU), missing=missing))
    for i, name in enumerate(wheels):
        ratio = float(memory.bank.wheel_ratio[i])
        missing = not math.isfinite(memory.speeds[i])
        wheel = _source(name, ratio, isolated=bool(memory.bank.faulty[i] > FAULTY), missing=missing)
        braked = wheel.state == FUSED and math.isnan(ratio)
        found.append(wheel._replace(state=BRAKED) if braked else wheel)
    return tuple(found)


def _source(name: str, ratio: float, *, isolated: bool, missing: bool = False) -> Source:
    if missing:
        return Source(name, math.nan, MISSING)
    if isolated:
        return Source(name, ratio, ISOLATED)
    if ratio > 1.0:
        sigma = _GATE_SIGMA * math.sqrt(ratio)
        return Source(name, ratio, REJECTED, f"innovation {sigma:.1f} sigma")
    return Source(name, ratio, FUSED)
