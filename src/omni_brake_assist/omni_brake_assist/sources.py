"""Test ratio and state of each measurement source, for diagnostics and recordings.

The test ratio is the normalized innovation squared divided by `GATE`, the limit of the chi-square
gate; a source with a test ratio above 1 is rejected. The filter that uses all sources predicts
the twist from the IMU. The innovation of the twist's velocity gives the test ratio of the
accelerometer, and the innovation of its yaw rate gives that of the gyro. The sum of both is the
test ratio of the twist. The speed of each rolling wheel is compared with the prediction of the most
probable filter.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_brake_assist import conditions
from omni_brake_assist.assist_state import Memory
from omni_brake_assist.conditions import CONDITIONS, WARNING, Decision
from omni_brake_assist.filter_bank import state as bank
from omni_brake_assist.filter_bank.filters import GATE
from omni_brake_assist.filter_bank.state import FAULTY, NO_IMU
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray

FUSED, REJECTED, ISOLATED, MISSING, BRAKED = "fused", "rejected", "isolated", "missing", "braked"
LOST = "lost"  # missing, although readings are expected: see `sources`
REFUSED = "rejected for more than 1 s"
_LONG_NS = 1_000_000_000  # time for which a source is rejected before it is REFUSED [ns]
_AVERAGED = 1.0  # time constant of the low-pass of received values and their rates [s]
_REMEDIES = {
    LOST: "no plausible reading: check driver, wiring and unit",
    ISOLATED: "check unit, sign and mounting",
    REFUSED: "check unit, sign and mounting",
}
"""Remedies for the states that require a person to act."""
_NO_TWIST = (conditions.SILENCE, conditions.ABSENT, conditions.STALE)


class Source(NamedTuple):
    """Test ratio and state of a measurement source after one step.

    Attributes:
        name: twist, gyro, accelerometer or the name of a wheel.
        test_ratio: normalized innovation squared divided by `GATE` [1], NaN without an innovation.
        state: FUSED, REJECTED, REFUSED, ISOLATED, MISSING or LOST, or BRAKED for a wheel that does
            not roll.
        reason: reason why the source is not fused; empty for a fused source.
    """

    name: str
    test_ratio: float
    state: str
    reason: str = ""

    @property
    def words(self) -> str:
        """State of the source and the reason for it, on one line."""
        return f"{self.state}: {self.reason}" if self.reason else self.state


def sources(memory: Memory, kinematics: PlatformKinematics, detects: bool) -> tuple[Source, ...]:
    """Return the test ratio and state of all sources after a step.

    Args:
        memory: memory of the assistant.
        kinematics: kinematics of the wheels.
        detects: whether fault detection is on. If it is, a missing wheel speed is LOST, otherwise
            MISSING.
    """
    best, gate = int(memory.bank.record[0]["best"]), memory.gate[0]
    inertial, speeds = memory.others.values[:3], memory.others.values[3:]
    along, across, gyro = map(float, memory.bank.ratio)
    force = along + across
    twist = force + gyro
    found = [_source("twist", twist, isolated=best in (*bank.TWIST_FAULTS, bank.NO_ESTIMATE))]
    if found[0].state == ISOLATED and not memory.bank.record[0]["pressed"]:
        rolling, (x, y) = kinematics.twist(speeds), kinematics.geometry.center
        rolling[:2] += rolling[2] * np.array([-y, x])  # of the center of the wheels, as `gate`
        found[0] = found[0]._replace(reason=_disagreement(gate, rolling))
    if gate["cause"] not in conditions.INPUTS_VALID:
        state = LOST if gate["cause"] in _NO_TWIST else REJECTED
        found[0] = Source("twist", twist, state, CONDITIONS[int(gate["cause"])].state.value)
    partial = bool(np.any(np.isfinite(inertial)))
    for name, ratio, out, reading in (
        ("gyro", gyro, bank.NO_GYRO, inertial[0]),
        ("accelerometer", force, bank.NO_FORCE, inertial[1]),
    ):
        missing = not math.isfinite(reading)
        source = _source(name, ratio, isolated=best in (out, NO_IMU), missing=missing)
        if source.state == REJECTED and best in bank.TWIST_FAULTS:
            source = Source(name, ratio, FUSED)  # the innovation is that of the isolated twist
        lost = missing and (partial or bool(memory.bank.record[0]["equipped"]))
        found.append(source._replace(state=LOST) if lost else source)
    for i, name in enumerate(kinematics.geometry.names):
        ratio = float(memory.bank.wheel_ratio[i])
        missing = not math.isfinite(speeds[i])
        wheel = _source(name, ratio, isolated=memory.bank.faulty[best, i] > FAULTY, missing=missing)
        braked = wheel.state == FUSED and math.isnan(ratio)
        state = BRAKED if braked else LOST if missing and detects else wheel.state
        found.append(wheel._replace(state=state))
    return tuple(found)


class RejectionTimers:
    """Measures for how long each source has been rejected."""

    def __init__(self) -> None:
        self._since_ns: dict[str, int] = {}  # start of the present rejection of each source
        self._last_ns = 0  # stamp of the last decision

    def update(self, now_ns: int, found: Sequence[Source]) -> tuple[Source, ...]:
        """Return `found`, with the state `REFUSED` for sources that were rejected for over 1 s.

        Args:
            now_ns: stamp of the decision [ns].
            found: sources after this decision; call the method once after each decision.
        """
        # After a jump of the stamps, the time of the rejection is unknown.
        known = {} if abs(now_ns - self._last_ns) > _LONG_NS else self._since_ns
        rejected = [one.name for one in found if one.state == REJECTED]
        self._since_ns = {name: known.get(name, now_ns) for name in rejected}
        self._last_ns = now_ns
        return tuple(
            one._replace(state=REFUSED)
            if now_ns - self._since_ns.get(one.name, now_ns) > _LONG_NS
            else one
            for one in found
        )


class ReceivedRate:
    """Rate at which the samples of an input arrive, low-passed with `_AVERAGED`."""

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._rate = math.nan

    def update(self, stamp_ns: int) -> float:
        """Take the stamp of a sample [ns]; return its weight in a low-pass with `_AVERAGED` [1]."""
        elapsed = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) * 1e-9
        self._last_ns = stamp_ns
        if elapsed <= 0.0:
            return 0.0
        share = elapsed / (elapsed + _AVERAGED)
        known = self._rate if math.isfinite(self._rate) else 1.0 / elapsed
        self._rate = known + share * (1.0 / elapsed - known)
        return share

    def words(self, now_ns: int) -> str:
        """Return the rate with its unit; less than that while no samples arrive."""
        if self._last_ns is None:
            return "no sample"
        silent = (now_ns - self._last_ns) * 1e-9
        rate = min(self._rate, 1.0 / silent) if silent > 0.0 else self._rate
        return f"{rate:.3g} Hz" if math.isfinite(rate) else "one sample"


def summary(decision: Decision, found: Sequence[Source]) -> tuple[int, str]:
    """Return level and text for `/diagnostics`. If a person must act, the level is not OK."""
    level, text = decision.state.level, decision.reason
    for state, remedy in _REMEDIES.items():
        names = ", ".join(
            f"{one.name} ({one.reason})" if one.reason else one.name
            for one in found
            if one.state == state
        )
        if names:
            level, text = max(level, WARNING), f"{text}; {state}: {names}: {remedy}"
    return level, text


def _disagreement(gate: np.void, rolling: FloatArray) -> str:
    """Return a text with the last valid twist and the twist computed from the wheel speeds."""
    return "; ".join(
        f"{name} {v_x:.2f}, {v_y:.2f} m/s, {yaw_rate:.2f} rad/s"
        for name, (v_x, v_y, yaw_rate) in (
            ("twist", (gate["v_x"], gate["v_y"], gate["yaw_rate"])),
            ("wheels", rolling),
        )
        if math.isfinite(v_x + v_y + yaw_rate)
    )


def _source(name: str, ratio: float, *, isolated: bool, missing: bool = False) -> Source:
    if missing:
        return Source(name, math.nan, MISSING)
    if isolated:
        return Source(name, ratio, ISOLATED)
    if ratio > 1.0:
        return Source(name, ratio, REJECTED, f"innovation {math.sqrt(GATE * ratio):.1f} sigma")
    return Source(name, ratio, FUSED)
