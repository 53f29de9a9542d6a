"""A user's law has the same fail-safe as the built-in laws."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState, Decision
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.sources import FUSED
from omni_core.brakes import BrakeConfiguration
from omni_core.configuration import ConfigurationError
from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.signals import ImuSample, TwistSample, WheelSample

Wheels = dict[str, WheelMount]

PROPORTIONAL = BrakeConfiguration(kind="proportional")

LAWS = """
import numpy as np

class Constant:
    answer, value = None, 1.0

    def __init__(self, configuration, geometry):
        self.wheels = len(geometry.names)

    def step(self, motion, error, enable):
        enable[:] = self.value
        return self.answer

class Half(Constant):
    value = 0.5

class Most(Constant):
    value = 0.7

class Few(Constant):
    value = 0.4

class Nothing(Constant):
    value = 0.0

class NotANumber(Constant):
    value = np.nan

class TooMuch(Constant):
    value = 1.5

class NoError(Constant):
    def step(self, motion, error, enable):
        error[:], enable[:] = np.nan, 0.5

class NothingToo(Nothing):
    pass

class NoErrorToo(NoError):
    pass

class Broken(Constant):
    def step(self, motion, error, enable):
        enable[:] = 0.0
        raise RuntimeError("lost count")

class BrokenToo(Broken):
    def step(self, motion, error, enable):
        raise RuntimeError("lost count")

class Ends(Constant):
    def step(self, motion, error, enable):
        raise SystemExit(0)

class Yes(Constant):
    answer = True

class Words(Constant):
    answer = "brake"

class KnownWheels(Constant):
    def step(self, motion, error, enable):
        enable[:] = np.where(np.isfinite(motion.wheel_speed), 0.5, 1.0)

class NoLaw:
    pass

class Unmakeable(Constant):
    def __init__(self, configuration, geometry):
        raise KeyError("mass")

class EndsAtOnce(Constant):
    def __init__(self, configuration, geometry):
        raise SystemExit(0)
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "laws_of_a_test.py").write_text(LAWS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return "laws_of_a_test"


def drive(wheels: Wheels, law: str, **changes: Any) -> list[Decision]:
    """Brake from 8 m/s in a turn, with a gap in the feedback."""
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=wheels, law=law, **changes))
    decisions = []
    for step in range(60):
        stamp_ns = step * 10_000_000
        heading = 0.3 * math.sin(0.1 * step)
        value = np.array([8.0 - 0.05 * step, 0.4 * heading, heading])
        feedback = TwistSample(stamp_ns, value, 1e-5 * np.eye(3))
        given = None if 20 <= step < 24 else feedback
        decisions.append(assist.update(BrakeDemand(stamp_ns, float(step > 5), given)))
    return decisions


def test_a_built_in_law_as_a_class_from_outside_decides_the_same(mecanum: Wheels) -> None:
    inside = drive(mecanum, "sliding_mode", minimum_dwell_time=0.03)
    outside = drive(
        mecanum, "omni_brake_assist.laws.sliding_mode:SlidingMode", minimum_dwell_time=0.03
    )
    assert {d.state for d in inside} >= {AssistState.ASSISTING, AssistState.NO_FEEDBACK}
    for a, b in zip(inside, outside, strict=True):
        assert (a.state, a.reason, a.fault) == (b.state, b.reason, b.fault)
        assert a.enable.tobytes() == b.enable.tobytes()
        assert a.error.tobytes() == b.error.tobytes()


def test_brakes_may_be_partly_on(mecanum: Wheels, module: str) -> None:
    last = drive(mecanum, f"{module}:Half", brake=PROPORTIONAL)[-1]
    assert last.state is AssistState.ASSISTING
    np.testing.assert_array_equal(last.enable, 0.5)


@pytest.mark.parametrize(
    ("law", "resolution", "enable"), [("Most", 0.0, 1.0), ("Most", 0.25, 0.75), ("Few", 0.25, 0.5)]
)
def test_enables_have_the_resolution_of_the_brakes(
    mecanum: Wheels, module: str, law: str, resolution: float, enable: float
) -> None:
    kind = "proportional" if resolution else "on_off"
    brake = BrakeConfiguration(kind=kind, resolution=resolution)
    last = drive(mecanum, f"{module}:{law}", brake=brake)[-1]
    assert last.state is AssistState.ASSISTING
    np.testing.assert_array_equal(last.enable, enable)


@pytest.mark.parametrize("detects", [True, False])
def test_a_law_does_not_receive_old_wheel_speeds(
    mecanum: Wheels, module: str, detects: bool
) -> None:
    configuration = BrakeAssistConfiguration(
        wheels=mecanum,
        law=f"{module}:KnownWheels",
        fault_detection=detects,
        brake=PROPORTIONAL,
    )
    assist = BrakeAssist(configuration)
    rolling = np.array([8.0 / mount.radius for mount in mecanum.values()])
    decisions = []
    for stamp_ns in range(0, 200_000_000, 10_000_000):
        feedback = TwistSample(stamp_ns, np.array([8.0, 0.0, 0.0]), 1e-5 * np.eye(3))
        taken_ns = min(stamp_ns, 100_000_000)  # the timeout is 50 ms
        speeds = WheelSample(taken_ns, rolling - 1e-9 * taken_ns)
        pedal = float(stamp_ns > 50_000_000)
        decisions.append(assist.update(BrakeDemand(stamp_ns, pedal, feedback, speeds)))
    enables = {d.stamp_ns: d.enable for d in decisions if d.state is AssistState.ASSISTING}
    assert np.all(enables[150_000_000] == 0.5)
    assert np.all(enables[160_000_000] == 1.0)


@pytest.mark.safety(
    "brakes released when they should act",
    "a law that releases every brake, raises an exception, or returns an invalid value",
    "all brakes are on",
    within="the same step",
)
@pytest.mark.parametrize(
    ("law", "state", "reason"),
    [
        ("Nothing", AssistState.NO_RELEASE, ""),
        ("Few", AssistState.NO_RELEASE, ""),  # on-off valves would shut
        ("NotANumber", AssistState.INTERNAL_ERROR, "[nan, nan, nan, nan], must be within [0, 1]"),
        ("TooMuch", AssistState.INTERNAL_ERROR, "1.5], must be within [0, 1]"),
        ("NoError", AssistState.INTERNAL_ERROR, "errors [nan, nan, nan, nan], must be finite"),
        ("Broken", AssistState.INTERNAL_ERROR, "RuntimeError: lost count"),
        ("Ends", AssistState.INTERNAL_ERROR, "SystemExit: 0"),
        ("Yes", AssistState.INTERNAL_ERROR, "True, must be None, ASSIST or NO_HELP"),
        ("Words", AssistState.INTERNAL_ERROR, "'brake', must be None, ASSIST or NO_HELP"),
    ],
)
def test_a_law_that_fails_has_all_brakes_on(
    mecanum: Wheels, module: str, law: str, state: AssistState, reason: str
) -> None:
    decisions = drive(mecanum, f"{module}:{law}")
    first = next(d for d in decisions[6:] if d.state is state)
    assert reason in first.reason
    for decision in decisions:
        np.testing.assert_array_equal(decision.enable, 1.0)


@pytest.mark.parametrize("imu", [True, False])
def test_the_twist_stays_fused_while_a_law_fails(mecanum: Wheels, module: str, imu: bool) -> None:
    configuration = BrakeAssistConfiguration(wheels=mecanum, law=f"{module}:Broken")
    assist, kinematics = BrakeAssist(configuration), PlatformKinematics(mecanum)
    for step in range(60):
        stamp_ns, braked = step * 10_000_000, max(step - 30, 0)
        twist = np.array([5.0 - 0.01 * braked, 0.0, 0.0])
        decision = assist.update(
            BrakeDemand(
                stamp_ns,
                1.0 if braked else 0.0,
                TwistSample(stamp_ns, twist, 1e-6 * np.eye(3)),
                WheelSample(stamp_ns, kinematics.wheel_speeds(twist)),
                ImuSample(stamp_ns, 0.0, np.array([-float(braked > 0), 0.0])) if imu else None,
            )
        )
    assert decision.state is AssistState.INTERNAL_ERROR
    assert {source.state for source in assist.sources() if source.name == "twist"} == {FUSED}


@pytest.mark.parametrize(
    ("law", "sentence"),
    [("NothingToo", "(shown once): the twist is (7.7"), ("NoErrorToo", "must be finite")],
)
def test_the_reason_for_full_braking_is_shown_once(
    mecanum: Wheels, module: str, law: str, sentence: str, capfd: pytest.CaptureFixture[str]
) -> None:
    drive(mecanum, f"{module}:{law}", enabled=False)
    assert capfd.readouterr().err == ""
    drive(mecanum, f"{module}:{law}")
    shown = capfd.readouterr().err
    assert shown.count(f"control law {module}:{law} ") == shown.count("(shown once)") == 1
    assert sentence in shown


def test_the_first_fault_is_shown_once_with_its_place_in_the_law_s_file(
    mecanum: Wheels, module: str, capfd: pytest.CaptureFixture[str]
) -> None:
    drive(mecanum, f"{module}:BrokenToo")
    shown = capfd.readouterr().err
    assert shown.count("RuntimeError: lost count") == 1
    assert f"{module}.py" in shown
    assert "law.py" not in shown
    drive(mecanum, f"{module}:BrokenToo")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("law", "problem"),
    [
        ("sliding_mod", "did you mean 'sliding_mode'"),
        ("no_such_module:Law", "working directory or on PYTHONPATH"),
        ("laws_of_a_test:Missing", "it has Constant, Half"),
        ("laws_of_a_test:NoLaw", "has no method 'step'"),
        ("laws_of_a_test:Unmakeable", "cannot be made (KeyError: 'mass')"),
        ("laws_of_a_test:EndsAtOnce", "cannot be made (SystemExit: 0)"),
    ],
)
@pytest.mark.usefixtures("module")
def test_what_is_no_law_is_refused_by_name(mecanum: Wheels, law: str, problem: str) -> None:
    with pytest.raises(ConfigurationError, match="law") as refused:
        BrakeAssist(BrakeAssistConfiguration(wheels=mecanum, law=law))
    assert problem in str(refused.value)
