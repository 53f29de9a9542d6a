"""Test ratio and state of each measurement source, for diagnostics and recordings.

The test ratio is a squared innovation over its gate: a source is rejected above 1. The
velocities of twist and accelerometer and the yaw rates of twist and gyro are compared with the
filters that exclude them, and each rolling wheel with the filter of all sources. Without an IMU the
twist is compared with the rolling wheels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from omni_brake_assist.assist_step import Memory
from omni_brake_assist.conditions import CONDITIONS, GOOD
from omni_brake_assist.observer.judgment import ALONE_GATE
from omni_brake_assist.observer.state import ALONE, NO_ESTIMATE, NO_FORCE, NO_GYRO, NO_TWIST

FUSED, REJECTED, ISOLATED, MISSING, BRAKED = (
    "fused",
    "rejected",
    "isolated",
    "missing",
    "braked",
)
_GATE_SIGMA = 3.0  # standard deviations at a test ratio of 1 [1]


class Source(NamedTuple):
    """A measurement source at a step.

    Attributes:
        name: twist, gyro, accelerometer or a wheel.
        test_ratio: squared innovation over its gate [1], NaN without an innovation.
        state: FUSED, REJECTED, ISOLATED, MISSING or, for a wheel, BRAKED: its speed is not used.
        reason: why it is not fused, else empty.
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
    isolation, trust = memory.observer.isolation[0], memory.trust[0]
    out, known = int(isolation["out"]), isolation["inertial"] != 0.0
    velocity, rate = float(isolation["apart_velocity"]) ** 2, float(isolation["apart_rate"]) ** 2
    twist = max(velocity, rate) if known else float(memory.observer.score[ALONE]) / ALONE_GATE
    found = [_source("twist", twist, isolated=out in (NO_TWIST, NO_ESTIMATE))]
    if trust["cause"] != GOOD:
        state = CONDITIONS[int(trust["cause"])].state.value
        found[0] = Source("twist", twist, REJECTED, state)
    gyro, force = memory.workspace[0, 0], memory.workspace[0, 1]
    found.append(_source("gyro", rate, isolated=out == NO_GYRO, missing=not math.isfinite(gyro)))
    found.append(
        _source(
            "accelerometer", velocity, isolated=out == NO_FORCE, missing=not math.isfinite(force)
        )
    )
    for i, name in enumerate(wheels):
        ratio = float(memory.observer.wheel_ratio[i])
        missing = not math.isfinite(memory.speeds[i])
        wheel = _source(name, ratio, isolated=bool(memory.watch[i]["rejected"]), missing=missing)
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
