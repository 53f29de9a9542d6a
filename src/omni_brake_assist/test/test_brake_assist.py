"""The assistant in normal operation: pedal, line of motion, thresholds."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from made_demands import PERIOD_NS, Wheels
from reference_equations import force_directions

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState, Decision
from omni_brake_assist.configuration import MOST_VALVES, BrakeAssistConfiguration
from omni_brake_assist.laws.built_in import law_constants
from omni_core.brakes import ON_OFF, PROPORTIONAL, BrakeConfiguration
from omni_core.configuration import ConfigurationError
from omni_core.geometry import PlatformGeometry, WheelMount, cross
from omni_core.kinematics import UnusablePlatformError
from omni_core.signals import ImuSample, TwistSample


class Drive:
    """An assistant that has received three valid twists with the pedal up, and its stamps."""

    def __init__(self, wheels: Wheels, twist: tuple[float, float, float], **settings: Any) -> None:
        self.assist = BrakeAssist(BrakeAssistConfiguration(wheels=wheels, **settings))
        self.stamp_ns = -PERIOD_NS
        for _ in range(3):
            self.last = self.step(0.0, twist)

    def step(self, pedal: float, twist: tuple[float, float, float]) -> Decision:
        self.stamp_ns += PERIOD_NS
        feedback = TwistSample(self.stamp_ns, np.array(twist), 1e-6 * np.eye(3))
        return self.assist.update(BrakeDemand(self.stamp_ns, pedal, feedback))


@pytest.mark.parametrize("law", ["sliding_mode", "allocation"])
def test_the_first_braking_step_imports_nothing(mecanum: Wheels, law: str) -> None:
    # An import takes some tenths of a second, during which a vehicle would have all brakes on.
    script = f"""
import sys
import numpy as np
from omni_brake_assist.brake_assist import BrakeAssist, BrakeAssistConfiguration, BrakeDemand
from omni_core.brakes import BrakeConfiguration
from omni_core.geometry import WheelMount
from omni_core.signals import ImuSample, TwistSample, WheelSample

for kind in ("on_off", "proportional"):
    brake = BrakeConfiguration(kind=kind)
    assist = BrakeAssist(BrakeAssistConfiguration(wheels={mecanum!r}, law={law!r}, brake=brake))
    before = set(sys.modules)
    for stamp in range(0, 100_000_000, 10_000_000):
        twist = TwistSample(stamp, np.array([3.0, 0.0, 0.0]), 1e-4 * np.eye(3))
        wheels = WheelSample(stamp, np.full(4, 15.0))
        imu = ImuSample(stamp, 0.0, np.zeros(2))
        demand = BrakeDemand(stamp, float(stamp > 50_000_000), twist, wheels, imu)
        state = assist.update(demand).state
    print(state.value, *sorted(set(sys.modules) - before))
"""
    run = [sys.executable, "-c", script]
    ended = subprocess.run(run, capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines() == ["assisting"] * 2


def test_before_the_pedal_nothing_acts(mecanum: Wheels) -> None:
    drive = Drive(mecanum, (10.0, 0.5, 0.3))
    decision = drive.step(0.04, (10.0, 0.5, 0.3))
    assert decision.state is AssistState.INACTIVE
    assert decision.fault is None
    np.testing.assert_array_equal(decision.enable, 1.0)
    np.testing.assert_array_equal(decision.error, 0.0)
    assert decision.stamp_ns == drive.stamp_ns


def test_pedal_starts_assistance_with_the_brakes_of_negative_error(mecanum: Wheels) -> None:
    decision = Drive(mecanum, (10.0, 0.0, 0.3)).step(1.0, (10.0, 0.0, 0.3))
    assert decision.state is AssistState.ASSISTING
    # The vehicle turns left, and the left wheels would increase the rotation.
    np.testing.assert_array_equal(decision.enable, [0.0, 0.0, 1.0, 1.0])
    np.testing.assert_array_equal(decision.enable, (decision.error < 0.0).astype(float))


def test_all_brakes_if_no_error_is_negative(mecanum: Wheels) -> None:
    decision = Drive(mecanum, (10.0, 0.0, 0.0), weighting="zero").step(1.0, (10.0, 0.0, 0.0))
    assert decision.state is AssistState.NO_RELEASE
    np.testing.assert_array_equal(decision.enable, 1.0)
    np.testing.assert_array_equal(decision.error, 0.0)


def test_velocity_at_the_pedal_is_the_line_to_keep(mecanum: Wheels) -> None:
    # Straight ahead at first, then 0.2 m/s to the left: wheels that push left are released.
    drive = Drive(mecanum, (5.0, 0.0, 0.0), weighting="zero")
    drive.step(1.0, (5.0, 0.0, 0.0))
    decision = drive.step(1.0, (5.0, 0.2, 0.0))
    push = 0.2 * math.sqrt(0.5)
    np.testing.assert_allclose(decision.error, [-push, push, -push, push], rtol=1e-12)


def test_releasing_the_pedal_forgets_the_line(mecanum: Wheels) -> None:
    drive = Drive(mecanum, (5.0, 0.0, 0.0), weighting="zero")
    drive.step(1.0, (5.0, 0.0, 0.0))
    drive.step(0.0, (5.0, 0.2, 0.0))
    drive.step(1.0, (5.0, 0.2, 0.0))  # this is the line of motion
    np.testing.assert_allclose(drive.step(1.0, (5.0, 0.2, 0.0)).error, 0.0, atol=1e-12)


def test_line_stays_fixed_in_the_world_while_the_platform_turns(mecanum: Wheels) -> None:
    """A velocity that is constant in the world has no component across the line.

    The heading oscillates over 120 deg in closed form. The integrated heading may differ by the
    error of the trapezoidal rule, A w^2 dt^2 / 12 over a quarter period = 2e-5 rad.
    """
    amplitude, frequency = 2.0 * math.pi / 3.0, 2.0
    speed, direction = 4.0, 0.3

    def twist(time: float) -> tuple[float, float, float]:
        heading = amplitude * math.sin(frequency * time)
        return (
            speed * math.cos(direction - heading),
            speed * math.sin(direction - heading),
            amplitude * frequency * math.cos(frequency * time),
        )

    # There are no wheel speeds, and nothing slows the vehicle down.
    drive = Drive(mecanum, twist(0.0), weighting="zero", speed_noise=1.0, fault_detection=False)
    turned = 0.0
    for index in range(200):
        time = index * 0.01
        v_x, v_y, omega = twist(time)
        decision = drive.step(1.0, (v_x, v_y, omega))
        assert decision.fault is None
        forces = force_directions(drive.assist.geometry, np.array([v_x, v_y, omega]))
        angular = cross(drive.assist.geometry.position, forces) * omega
        np.testing.assert_allclose(decision.error, angular, atol=speed * 1e-4)
        turned = max(turned, abs(amplitude * math.sin(frequency * time)))
    assert turned > 2.0


def test_spin_on_the_spot_has_no_line_to_keep(mecanum: Wheels) -> None:
    drive = Drive(mecanum, (0.05, 0.0, 2.0), weighting="zero")
    drive.step(1.0, (0.05, 0.0, 2.0))
    forces = force_directions(drive.assist.geometry, np.array([0.1, 0.2, 1.9]))
    decision = drive.step(1.0, (0.1, 0.2, 1.9))
    np.testing.assert_allclose(
        decision.error, cross(drive.assist.geometry.position, forces) * 1.9, rtol=1e-12
    )


def test_below_the_threshold_all_brakes_until_clearly_above_it(mecanum: Wheels) -> None:
    drive = Drive(mecanum, (0.5, 0.0, 0.1), speed_threshold=0.3, speed_hysteresis=0.3)
    assert drive.step(1.0, (0.5, 0.0, 0.1)).state is AssistState.ASSISTING
    slow = drive.step(1.0, (0.2, 0.0, 0.1))
    assert slow.state is AssistState.BELOW_SPEED_THRESHOLD
    np.testing.assert_array_equal(slow.enable, 1.0)
    assert np.all(slow.error != 0.0)  # still computed, for analysis
    assert drive.step(1.0, (0.5, 0.0, 0.1)).state is AssistState.BELOW_SPEED_THRESHOLD
    assert drive.step(1.0, (0.65, 0.0, 0.1)).state is AssistState.ASSISTING
    assert drive.step(1.0, (0.5, 0.0, 0.1)).state is AssistState.ASSISTING


def test_releasing_the_pedal_ends_the_hysteresis(mecanum: Wheels) -> None:
    drive = Drive(mecanum, (0.2, 0.0, 0.0), speed_threshold=0.3, speed_hysteresis=0.3)
    assert drive.step(1.0, (0.2, 0.0, 0.0)).state is AssistState.BELOW_SPEED_THRESHOLD
    drive.step(0.0, (0.4, 0.0, 0.1))
    assert drive.step(1.0, (0.4, 0.0, 0.1)).state is AssistState.ASSISTING


def test_threshold_compares_the_fastest_wheel_not_the_center(mecanum: Wheels) -> None:
    # 0.1 m/s at the center, but 0.75 m * 1 rad/s at the wheels.
    drive = Drive(mecanum, (0.1, 0.0, 1.0), speed_threshold=0.5)
    assert drive.step(1.0, (0.1, 0.0, 1.0)).state is AssistState.ASSISTING


def test_disabled_keeps_all_brakes_and_still_computes_errors(mecanum: Wheels) -> None:
    disabled = Drive(mecanum, (10.0, 0.1, 0.3), enabled=False)
    enabled = Drive(mecanum, (10.0, 0.1, 0.3))
    assert disabled.last.state is AssistState.DISABLED
    for twist in ((10.0, 0.1, 0.3), (9.9, -0.1, 0.2), (9.8, 0.2, -0.1)):
        off, on = disabled.step(1.0, twist), enabled.step(1.0, twist)
        assert off.state is AssistState.DISABLED
        assert on.state is AssistState.ASSISTING
        np.testing.assert_array_equal(off.enable, 1.0)
        np.testing.assert_array_equal(off.error, on.error)


def test_the_assistant_can_be_switched_while_the_pedal_is_down(mecanum: Wheels) -> None:
    """When it is off, all brakes act; when it is on again, it keeps the same line of motion."""
    switched, assisted = Drive(mecanum, (10.0, 0.1, 0.3)), Drive(mecanum, (10.0, 0.1, 0.3))
    for enabled, twist in (
        (True, (9.9, -0.1, 0.2)),
        (False, (9.8, 0.2, -0.1)),
        (True, (9.7, 0.1, 0.2)),
    ):
        switched.assist.switch(enabled=enabled)
        decision, expected = switched.step(1.0, twist), assisted.step(1.0, twist)
        assert (decision.state is AssistState.DISABLED) == (not enabled)
        np.testing.assert_array_equal(decision.enable, expected.enable if enabled else 1.0)
        np.testing.assert_array_equal(decision.error, expected.error)


@pytest.mark.parametrize("detects", [True, False])
def test_a_reading_of_the_imu_is_new_in_one_step(mecanum: Wheels, detects: bool) -> None:
    configuration = BrakeAssistConfiguration(wheels=mecanum, fault_detection=detects)
    assist, new = BrakeAssist(configuration), []
    for step in range(6):
        stamp_ns = step * PERIOD_NS
        feedback = TwistSample(stamp_ns, np.array((1.0, 0.0, 0.0)), 1e-6 * np.eye(3))
        imu = ImuSample(step // 2 * 2 * PERIOD_NS, 0.0, np.zeros(2))
        assist.update(BrakeDemand(stamp_ns, 0.0, feedback, imu=imu))
        new.append(bool(assist._memory.step["fresh"][0]))
    assert new == [True, False] * 3


def test_kiwi_has_three_decisions(kiwi: Wheels) -> None:
    decision = Drive(kiwi, (3.0, 3.0, 0.5)).step(1.0, (3.0, 3.0, 0.5))
    assert decision.enable.shape == decision.error.shape == (3,)
    assert decision.state is AssistState.ASSISTING


def test_same_feedback_same_decisions(mecanum: Wheels) -> None:
    rng = np.random.default_rng(5)
    twists = [(8.0 - 0.02 * i, *rng.normal(0, 0.05, 2).tolist()) for i in range(100)]
    runs = []
    for _ in range(2):
        drive = Drive(mecanum, (8.0, 0.0, 0.0))
        runs.append([drive.step(1.0, twist).error.tobytes() for twist in twists])
    assert runs[0] == runs[1]


# Configuration


@pytest.mark.parametrize("k", [2, 4, 100])
def test_even_k_is_refused_by_name(mecanum: Wheels, k: int) -> None:
    with pytest.raises(ConfigurationError, match=f"^k: {k} is not an odd positive"):
        BrakeAssistConfiguration(wheels=mecanum, k=k)


def test_unknown_weighting_is_refused_by_name(mecanum: Wheels) -> None:
    with pytest.raises(ConfigurationError, match=r"^weighting: 'sine' is not one of zero"):
        BrakeAssistConfiguration(wheels=mecanum, weighting="sine")


def test_more_valves_than_a_control_period_allows_are_refused(mecanum: Wheels) -> None:
    many = {
        f"{name}_{i}": dataclasses.replace(mount, x=mount.x * (1.0 + i))
        for i in range(4)
        for name, mount in mecanum.items()
    }
    most = dict(list(many.items())[:MOST_VALVES])
    # After a brake has failed, the law sliding_mode compares patterns too.
    for law, brakes, wheels, replans in (
        ("allocation", ON_OFF, most, True),
        ("allocation", PROPORTIONAL, many, False),
        ("sliding_mode", ON_OFF, most, True),
        ("sliding_mode", ON_OFF, many, False),
    ):
        brake = BrakeConfiguration(kind=brakes)
        configuration = BrakeAssistConfiguration(wheels=wheels, law=law, brake=brake)
        constants = law_constants(configuration, PlatformGeometry.from_wheels(wheels))
        assert constants.replans == replans
    with pytest.raises(ConfigurationError, match=r"^law: .* 16 wheels, .* 14; use sliding_mode"):
        BrakeAssistConfiguration(wheels=many, law="allocation")


def test_timeout_longer_than_the_time_step_is_refused(mecanum: Wheels) -> None:
    with pytest.raises(ConfigurationError, match=r"^feedback_timeout: 0\.5 s is longer than"):
        BrakeAssistConfiguration(wheels=mecanum, feedback_timeout=0.5, maximum_time_step=0.2)


def test_platform_that_cannot_be_stopped_is_refused(mecanum: Wheels) -> None:
    pair = {name: mecanum[name] for name in ("rear_left", "front_left")}
    with pytest.raises(UnusablePlatformError, match="rank 2"):
        BrakeAssistConfiguration(wheels=pair)


def test_a_delay_of_too_many_control_periods_is_refused_by_name(mecanum: Wheels) -> None:
    with pytest.raises(ConfigurationError, match=r"feedback_delay: 0\.2 s .* control_period"):
        BrakeAssistConfiguration(
            wheels=mecanum,
            feedback_delay=0.2,
            feedback_timeout=2.0,
            maximum_time_step=2.0,
            control_period=1e-4,
        )


def test_conventional_wheels_are_refused_unless_the_assistant_only_observes(
    mecanum: Wheels,
) -> None:
    """Laws and fault detection assume rollers; with both off, all brakes act."""
    wheels = {**mecanum, "castor": WheelMount(kind="conventional", x=0.0, y=0.0)}
    off: dict[str, Any] = {"enabled": False, "fault_detection": False}
    for name, words in (
        ("enabled", "the law sliding_mode"),
        ("fault_detection", "fault_detection"),
    ):
        text = rf"wheels\.castor\.kind: .*{words}.*; set enabled and fault_detection"
        with pytest.raises(UnusablePlatformError, match=text):
            BrakeAssistConfiguration(wheels=wheels, **{**off, name: True})
    BrakeAssist(BrakeAssistConfiguration(wheels=wheels, **off))
