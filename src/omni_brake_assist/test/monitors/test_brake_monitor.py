"""The brake monitor, for vehicles in which one wheel rolls although its brake should act."""

import dataclasses

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState
from omni_brake_assist.configuration import LAWS, BrakeAssistConfiguration
from omni_brake_assist.laws.law import NO_WHEEL, Motion
from omni_brake_assist.monitors.brake_monitor import (
    BrakeConstants,
    BrakedWheels,
    brake_constants,
    brake_memory,
    watch_brakes,
)
from omni_core.brakes import BrakeConfiguration
from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.quantities import FloatArray
from omni_core.signals import ImuSample, TwistSample, WheelSample

DT = 0.01
TWIST = (5.0, 0.5, 0.2)
LAG = BrakeConfiguration(dead_time=0.02, time_constant=0.02)


@pytest.fixture
def configuration(mecanum: dict[str, WheelMount]) -> BrakeAssistConfiguration:
    return BrakeAssistConfiguration(wheels=mecanum)


def constants_of(configuration: BrakeAssistConfiguration) -> BrakeConstants:
    return brake_constants(configuration, PlatformGeometry.from_wheels(configuration.wheels))


def rolling(constants: BrakeConstants, twist: tuple[float, float, float]) -> FloatArray:
    """Return the speeds of wheels that roll free [rad/s]."""
    hubs = constants.n_x * twist[0] + constants.n_y * twist[1] + constants.lever * twist[2]
    speeds: FloatArray = hubs / constants.roll
    return speeds


def found(
    constants: BrakeConstants,
    slips: FloatArray,
    enables: FloatArray,
    *,
    pedal: float = 1.0,
    duration: float = 1.0,
    twist: tuple[float, float, float] = TWIST,
) -> tuple[int, float]:
    """Return which brake is reported as failed, and when, if the rims slip by these shares."""
    memory = brake_memory(len(enables))
    wheels = BrakedWheels(enables, (1.0 - slips) * rolling(constants, twist), 0.0)
    for step in range(1, round(duration / DT)):
        wheel = watch_brakes(constants, memory, DT, pedal, wheels, twist)
        if wheel != NO_WHEEL:
            return int(wheel), step * DT
    return NO_WHEEL, np.inf


@pytest.mark.safety(
    "a brake does not follow its command",
    "a brake without torque",
    "brake monitor: the wheel rolls while others slide; `allocation` controls the other on-off "
    "valves, or all proportional brakes are on; an error is reported",
    within=0.2,
)
@pytest.mark.parametrize("brake", [BrakeConfiguration(), LAG])
@pytest.mark.parametrize("dead", range(4))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_brake_whose_wheel_keeps_rolling_has_failed(
    configuration: BrakeAssistConfiguration,
    brake: BrakeConfiguration,
    dead: int,
    sign: float,
    within: float,
) -> None:
    constants = constants_of(dataclasses.replace(configuration, brake=brake))
    slips, twist = np.where(np.arange(4) == dead, 0.01, 0.3), tuple(sign * np.array(TWIST))
    wheel, time = found(constants, slips, np.ones(4), twist=twist)
    assert wheel == dead
    assert time <= within


def test_a_brake_that_gets_all_and_rolls_while_others_slide_by_less_has_failed(
    configuration: BrakeAssistConfiguration,
) -> None:
    """A law demands more and more from the failed, proportional brake and releases the others."""
    slips, enables = np.array([0.01, 0.3, 0.0, 0.0]), np.array([1.0, 0.2, 0.0, 0.0])
    wheel, time = found(constants_of(configuration), slips, enables)
    assert wheel == 0
    assert time <= 0.2


@pytest.mark.parametrize("max_torque", [0.0, 10.0])
def test_a_full_demand_shows_a_failed_brake_whatever_mass_is_configured(
    configuration: BrakeAssistConfiguration, max_torque: float
) -> None:
    brake = dataclasses.replace(configuration.brake, max_torque=max_torque)
    light = dataclasses.replace(configuration, brake=brake, nominal_mass=1000.0)
    wheel, time = found(constants_of(light), np.array([0.0, 0.3, 0.3, 0.3]), np.ones(4))
    assert wheel == 0
    assert time <= 0.2


def test_a_gentle_demand_makes_the_detection_slower(
    configuration: BrakeAssistConfiguration,
) -> None:
    """The less torque a brake should exert, the less its wheel differs from a rolling one."""
    constants, slips = constants_of(configuration), np.array([0.005, 0.3, 0.3, 0.3])
    times = [found(constants, slips, np.ones(4), pedal=pedal)[1] for pedal in (1.0, 0.3, 0.2, 0.15)]
    assert times[0] == times[1] < times[2] < times[3] <= 1.0


@pytest.mark.parametrize(
    ("slips", "enables", "pedal"),
    [
        ([0.01, 0.01, 0.01, 0.01], [1.0, 1.0, 1.0, 1.0], 1.0),  # weak braking: no wheel slides
        ([0.05, 0.3, 0.3, 0.3], [1.0, 1.0, 1.0, 1.0], 1.0),  # one wheel slides less than the others
        ([0.04, 0.3, 0.3, 0.3], [1.0, 1.0, 1.0, 1.0], 1.0),  # a heavily loaded wheel
        ([0.03, 0.3, 0.0, 0.0], [1.0, 0.8, 0.0, 0.0], 0.2),  # the same with a gentle demand
        ([0.0, 0.3, 0.3, 0.3], [0.0, 1.0, 1.0, 1.0], 1.0),  # let go
        ([0.0, 0.3, 0.3, 0.3], [0.5, 1.0, 1.0, 1.0], 1.0),  # a law demands less from it
        ([0.0, 0.3, 0.3, 0.3], [1.0, 1.0, 1.0, 1.0], 0.1),  # small demand of the pedal
        ([0.01, 0.3, 0.3, 0.3], [1.0, 0.2, 0.2, 0.2], 0.3),  # loads and ice may differ so much
        ([np.nan, 0.3, 0.3, 0.3], [1.0, 1.0, 1.0, 1.0], 1.0),  # an encoder without readings
    ],
)
def test_a_brake_that_may_well_act_is_not_reported_as_failed(
    configuration: BrakeAssistConfiguration, slips: list[float], enables: list[float], pedal: float
) -> None:
    constants = constants_of(configuration)
    wheel, _ = found(constants, np.array(slips), np.array(enables), pedal=pedal)
    assert wheel == NO_WHEEL


def test_short_commands_to_a_brake_are_no_failure(
    configuration: BrakeAssistConfiguration,
) -> None:
    """Between the commands, the pressure of a slow brake falls before its wheel slides."""
    constants, memory = constants_of(configuration), brake_memory(4)
    speeds = (1.0 - np.array([0.0, 0.3, 0.3, 0.3])) * rolling(constants, TWIST)
    for step in range(100):
        enables = np.array([float(step % 3 == 0), 1.0, 1.0, 1.0])
        wheels = BrakedWheels(enables, speeds, 0.0)
        assert watch_brakes(constants, memory, DT, 1.0, wheels, TWIST) == NO_WHEEL


class LeftWheels:
    """A user's law that brakes on the left."""

    def __init__(self, *_parts: object) -> None:
        pass

    def step(self, _motion: Motion, _error: FloatArray, enable: FloatArray) -> None:
        enable[2:] = 0.0


@pytest.mark.parametrize(
    ("law", "dwell"), [("sliding_mode", 0.0), ("allocation", 0.0), (f"{__name__}:LeftWheels", 0.5)]
)
def test_the_other_brakes_act_until_the_pedal_is_released(
    configuration: BrakeAssistConfiguration, law: str, dwell: float
) -> None:
    """All brakes act at once: no valve waits for its dwell time."""
    assist = BrakeAssist(dataclasses.replace(configuration, law=law, minimum_dwell_time=dwell))
    constants = constants_of(configuration)
    slips = np.array([0.5, 0.0, 0.5, 0.5])  # the second brake has failed, unless released
    states, stamp_ns, v_x, enable = [], 0, 5.0, np.ones(4)
    reasons: set[str] = set()
    for pedal in [0.0] * 30 + [1.0] * 60 + [0.0] * 5 + [1.0]:
        stamp_ns += round(DT * 1e9)
        v_x -= 4.0 * DT * pedal
        twist = np.array([v_x, 0.0, 0.0])
        grip = slips if stamp_ns < 0.8e9 else 0.0  # then no wheel slides: the law releases none
        speeds = (1.0 - grip * pedal * enable) * rolling(constants, (v_x, 0.0, 0.0))
        decision = assist.update(
            BrakeDemand(
                stamp_ns,
                pedal,
                TwistSample(stamp_ns, twist, 1e-6 * np.eye(3)),
                WheelSample(stamp_ns, speeds),
                ImuSample(stamp_ns, 0.0, np.array([-4.0 * pedal, 0.0])),
            )
        )
        enable = decision.enable
        states.append(decision.state)
        if decision.state == AssistState.FAILED_BRAKE:
            assert np.any(np.delete(decision.enable, 1) > 0.0)
            assert law in LAWS or np.all(decision.enable == 1.0)
            reasons.add(decision.reason)
    dead = [state == AssistState.FAILED_BRAKE for state in states]
    first = dead.index(True)
    assert 30 < first < 30 + 25
    assert all(dead[first:90])
    assert not any(dead[90:])
    (reason,) = reasons  # also in steps in which the law releases no brake
    assert "front_left" in reason


def test_a_wheel_that_rolls_at_the_speed_of_its_drive_has_a_working_brake(
    configuration: BrakeAssistConfiguration,
) -> None:
    drives = dataclasses.replace(configuration, brake=BrakeConfiguration(kind="velocity"))
    slips = np.array([0.0, 0.3, 0.3, 0.3])
    assert found(constants_of(configuration), slips, np.ones(4))[0] == 0
    assert found(constants_of(drives), slips, np.ones(4))[0] == NO_WHEEL


def test_the_smallest_nominal_mass_gives_finite_constants(
    configuration: BrakeAssistConfiguration,
) -> None:
    light = dataclasses.replace(configuration, nominal_mass=5e-324)
    with np.errstate(all="raise"):
        assert all(np.all(np.isfinite(constant)) for constant in constants_of(light))
