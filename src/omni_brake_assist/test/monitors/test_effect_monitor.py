"""The effect monitor with stops of known loss of speed."""

import numpy as np
import pytest

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.monitors.effect_monitor import (
    EffectConstants,
    effect_constants,
    effect_memory,
    watch_effect,
)
from omni_core.brakes import BrakeConfiguration
from omni_core.geometry import PlatformGeometry, WheelMount

RELEASED = "brakes released when they should act"
DT = 0.01
WHEELS = 4
START = 5.0
"""Speed of the rims when the pedal goes down [m/s]."""
UNKNOWN = np.full(3, np.nan)
DIRECTION = {False: np.nan, True: 0.0}  # of the motion, without and with an IMU [rad]


@pytest.fixture
def constants(mecanum: dict[str, WheelMount]) -> EffectConstants:
    return lagging(mecanum, 0.0)


def lagging(wheels: dict[str, WheelMount], dead_time: float) -> EffectConstants:
    """Return the constants for brakes with a known dead time [s]."""
    brake = BrakeConfiguration(dead_time=dead_time)
    configuration = BrakeAssistConfiguration(wheels=wheels, brake=brake)
    return effect_constants(configuration, PlatformGeometry.from_wheels(wheels))


def trip_time(
    constants: EffectConstants,
    first: float,
    later: float,
    *,
    pedal: tuple[float, float] = (1.0, 1.0),
    direction: float = 0.0,
    released: bool = True,
    rolls: int = WHEELS,
) -> float:
    """Return when the monitor puts all brakes on in a stop of two phases; inf for never.

    Args:
        constants: constants of the vehicle.
        first: loss of speed during the first half second [m/s^2].
        later: loss of speed from then on [m/s^2].
        pedal: position of the pedal in both phases [1].
        direction: direction of motion that the IMU measures [rad]; NaN without an IMU.
        released: whether a brake is released.
        rolls: number of wheels that roll; the others are locked.
    """
    ledger, speed = effect_memory(), START
    motion = np.nan_to_num(direction)
    rim = constants.active @ np.array([np.cos(motion), np.sin(motion), 0.0])
    rolling = rim / np.max(np.abs(rim)) / constants.roll
    roll = np.where(np.arange(constants.roll.size) < rolls, rolling, 0.0)
    watch_effect(constants, ledger, DT, 0.0, False, speed * rolling, UNKNOWN)
    for step in range(1, 3000):
        late = step * DT > 0.5
        loss = later if late else first
        speed -= loss * DT
        if speed <= 0.0:
            break
        force = np.array([0.0, -loss * np.cos(direction), -loss * np.sin(direction)])
        if watch_effect(constants, ledger, DT, pedal[late], released, speed * roll, force):
            return step * DT
    return np.inf


@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize("loss", [1.5, 3.0, 7.0])
def test_a_steady_stop_is_left_alone_whatever_its_brakes_do(
    constants: EffectConstants, imu: bool, loss: float
) -> None:
    assert trip_time(constants, loss, loss, direction=DIRECTION[imu]) == np.inf


@pytest.mark.parametrize("direction", [1.6, 2.5, -1.0])
def test_the_effect_is_the_same_in_every_direction(
    constants: EffectConstants, direction: float
) -> None:
    for first, later in ((0.0, 0.0), (6.0, 0.5), (6.0, 6.0)):
        ahead = trip_time(constants, first, later)
        assert trip_time(constants, first, later, direction=direction) == ahead


def test_one_braked_wheel_of_three_has_enough_effect(kiwi: dict[str, WheelMount]) -> None:
    assert trip_time(lagging(kiwi, 0.0), 1.0, 1.0, direction=np.nan) == np.inf


@pytest.mark.safety(
    RELEASED,
    "the vehicle rolls unbraked from 5 m/s, because several sensors or the law are faulty",
    "effect monitor",
    within=0.2,
)
@pytest.mark.parametrize("imu", [True, False])
def test_a_vehicle_that_rolls_unbraked_is_braked(
    constants: EffectConstants, imu: bool, within: float
) -> None:
    allowed = (constants.creep + constants.allowance * START) / START
    found = trip_time(constants, 0.0, 0.0, direction=DIRECTION[imu])
    assert found == pytest.approx(allowed, abs=2 * DT)
    assert found <= within


@pytest.mark.parametrize("speed", [0.0, START])
def test_a_position_beside_the_axis_of_a_spin_hides_no_missing_effect(
    mecanum: dict[str, WheelMount], speed: float
) -> None:
    found, rate = [], 2.0
    for x, y in ((0.0, 0.0), (0.6, 0.4)):
        configuration = BrakeAssistConfiguration(wheels=mecanum, imu_x=x, imu_y=y)
        constants = effect_constants(configuration, PlatformGeometry.from_wheels(mecanum))
        speeds = constants.active @ np.array([speed, 0.0, rate]) / constants.roll
        felt, ledger = np.array([rate, -(rate**2) * x, -(rate**2) * y]), effect_memory()
        watch_effect(constants, ledger, DT, 0.0, False, speeds, felt)
        steps = range(1, 3000)
        trips = (watch_effect(constants, ledger, DT, 1.0, True, speeds, felt) for _ in steps)
        found.append(next((step for step, trip in zip(steps, trips, strict=False) if trip), None))
    assert found[0] is not None
    assert found[1] == found[0]


@pytest.mark.parametrize("imu", [True, False])
def test_a_known_dead_time_of_the_brakes_is_no_missing_effect(
    mecanum: dict[str, WheelMount], constants: EffectConstants, imu: bool
) -> None:
    later = trip_time(lagging(mecanum, 0.2), 0.0, 0.0, direction=DIRECTION[imu])
    assert later == pytest.approx(
        trip_time(constants, 0.0, 0.0, direction=DIRECTION[imu]) + 0.2, abs=2 * DT
    )


@pytest.mark.parametrize(
    "imu",
    [
        pytest.param(
            True,
            marks=pytest.mark.safety(
                RELEASED,
                "the vehicle rolls unbraked from the middle of a stop on",
                "effect monitor",
                within=1.2,
            ),
        ),
        pytest.param(
            False,
            marks=pytest.mark.safety(
                RELEASED,
                "the vehicle rolls unbraked from the middle of a stop on, without an IMU",
                "effect monitor, from the wheel speeds",
                within=2.5,
            ),
        ),
    ],
)
def test_a_vehicle_that_stops_losing_speed_is_braked(
    constants: EffectConstants, imu: bool, within: float
) -> None:
    assert trip_time(constants, 4.0, 0.3, direction=DIRECTION[imu]) - 0.5 <= within


def test_one_wheel_that_rolls_is_enough_to_detect_it(constants: EffectConstants) -> None:
    assert trip_time(constants, 4.0, 0.3, direction=np.nan, rolls=1) < 3.0
    assert trip_time(constants, 4.0, 0.1, rolls=1) < 3.0


@pytest.mark.safety(
    "the stop is longer or rotates more",
    "ice under one side of the vehicle, whose braked wheels slide",
    "effect monitor: assistance is not ended",
    within="the whole stop",
)
@pytest.mark.parametrize("rolls", [2, 3])
def test_ice_on_which_half_of_the_wheels_slide_does_not_end_the_assistance(
    constants: EffectConstants, rolls: int
) -> None:
    later = 0.3  # much less than the least deceleration on slippery ground
    found = trip_time(constants, 4.0, later, rolls=rolls)
    assert found == np.inf if rolls == 2 else found < 5.0


@pytest.mark.parametrize("direction", [0.4, 2.0])
def test_a_false_specific_force_extends_no_stop_in_which_the_rims_stay_fast(
    constants: EffectConstants, direction: float
) -> None:
    """Its integral falsifies the direction of motion, in which the wheels then seem to slide."""
    ledger, ends = effect_memory(), START / constants.least + constants.grace
    rolling = constants.active @ (np.cos(direction), np.sin(direction), 0.0) / constants.roll
    watch_effect(constants, ledger, DT, 0.0, False, START * rolling, UNKNOWN)
    bias = np.array([0.0, 1.0, 0.0])
    for step in range(1, 3000):
        speeds = (START - 0.05 * step * DT) * rolling
        if watch_effect(constants, ledger, DT, 1.0, True, speeds, bias):
            break
    assert step * DT < 1.5 * ends


def test_locked_wheels_across_the_motion_are_no_sign_of_ice(
    constants: EffectConstants,
) -> None:
    """Two wheels cannot brake the diagonal motion; the other two roll."""
    ledger, motion = effect_memory(), np.array([START, START, 0.0]) / np.sqrt(2.0)
    rim = constants.active @ motion
    speeds = np.where(np.abs(rim) > 0.1, rim, 0.0) / constants.roll
    watch_effect(constants, ledger, DT, 0.0, False, rim / constants.roll, np.zeros(3))
    force = np.array([0.0, -0.1, -0.1])
    found = [watch_effect(constants, ledger, DT, 1.0, True, speeds, force) for _ in range(100)]
    assert found.index(True) <= 40


@pytest.mark.parametrize(
    "imu",
    [
        pytest.param(
            True,
            marks=pytest.mark.safety(
                RELEASED,
                "the vehicle rolls unbraked at the end of a stop, at a tenth of the initial speed",
                "effect monitor",
                within=1.1,
            ),
        ),
        pytest.param(
            False,
            marks=pytest.mark.safety(
                RELEASED,
                "the vehicle rolls unbraked at the end of a stop, without an IMU",
                "effect monitor, from the duration of the stop",
                within=5.6,
            ),
        ),
    ],
)
def test_a_vehicle_that_keeps_rolling_at_the_end_of_a_stop_is_braked(
    constants: EffectConstants, imu: bool, within: float
) -> None:
    # It loses speed from 5 to 0.5 m/s within half a second, and rolls on from there.
    assert trip_time(constants, 9.0, 0.05, direction=DIRECTION[imu]) - 0.5 <= within


def test_brakes_that_act_never_trip_the_monitor(constants: EffectConstants) -> None:
    assert trip_time(constants, 4.0, 0.05, released=False) == np.inf


def test_less_pedal_may_have_less_effect(constants: EffectConstants) -> None:
    assert trip_time(constants, 4.0, 0.4, pedal=(1.0, 0.25)) == np.inf
    assert trip_time(constants, 4.0, 0.4) < np.inf


@pytest.mark.parametrize("imu", [True, False])
def test_ice_that_takes_most_of_the_deceleration_does_not_end_the_assistance(
    constants: EffectConstants, imu: bool
) -> None:
    later = 1.1 * constants.least_loss
    assert trip_time(constants, 7.0, later, direction=DIRECTION[imu]) == np.inf


def test_missed_braking_counts_in_proportion_to_the_pedal(constants: EffectConstants) -> None:
    allowed = (constants.creep + constants.allowance * START) / START
    assert trip_time(constants, 0.0, 0.0, pedal=(0.5, 0.5)) == pytest.approx(2.0 * allowed, abs=DT)


def test_brakes_that_only_stop_the_rotation_have_an_effect(constants: EffectConstants) -> None:
    ledger, speed, turn = effect_memory(), START, 3.0 / constants.reach
    roll, force = 1.0 / constants.roll, -0.3
    rim = speed + constants.reach * turn
    watch_effect(constants, ledger, DT, 0.0, False, rim * roll, np.array([turn, 0.0, 0.0]))
    for _ in range(100):
        speed, turn = speed + force * DT, turn - 3.0 / constants.reach * DT
        rim, inertial = speed + constants.reach * turn, np.array([turn, force, 0.0])
        assert not watch_effect(constants, ledger, DT, 1.0, True, rim * roll, inertial)


def test_brakes_are_not_released_for_longer_than_a_modest_stop_lasts(
    constants: EffectConstants,
) -> None:
    # So slow that the missed distance does not exceed the bound.
    due = constants.grace + START / constants.least
    assert trip_time(constants, 0.9, 0.1) <= due + DT


def test_once_exceeded_it_holds_until_the_pedal_is_released(constants: EffectConstants) -> None:
    ledger, speeds = effect_memory(), START / constants.roll
    still, rest = np.zeros(3), 0.0 * speeds
    watch_effect(constants, ledger, DT, 0.0, False, speeds, still)
    detected = [watch_effect(constants, ledger, DT, 1.0, True, speeds, still) for _ in range(200)]
    assert detected[-1]
    assert watch_effect(constants, ledger, DT, 1.0, False, rest, still)
    assert not watch_effect(constants, ledger, DT, 0.0, False, rest, still)
    assert not watch_effect(constants, ledger, DT, 1.0, True, rest, still)


def test_sensors_without_a_number_cannot_hide_a_vehicle_that_rolls(
    constants: EffectConstants,
) -> None:
    ledger, none = effect_memory(), np.full(WHEELS, np.nan)
    watch_effect(constants, ledger, DT, 0.0, False, START / constants.roll, UNKNOWN)
    detected = [watch_effect(constants, ledger, DT, 1.0, True, none, UNKNOWN) for _ in range(100)]
    assert any(detected)


def test_one_encoder_that_reads_nonsense_does_not_end_an_assisted_stop(
    constants: EffectConstants,
) -> None:
    ledger, speed = effect_memory(), START
    watch_effect(constants, ledger, DT, 0.0, False, speed / constants.roll, UNKNOWN)
    for value in (np.nan, np.inf, 1e9) * 30:
        speed -= 4.0 * DT
        speeds = speed / constants.roll
        speeds[2] = value
        force = np.array([0.0, -4.0, 0.0])
        assert not watch_effect(constants, ledger, DT, 1.0, True, speeds, force)


@pytest.mark.safety(
    RELEASED,
    "a scale error that the twist and all encoders share, from the start of braking",
    "effect monitor: it uses the speed from the integrated specific force",
    within=1.2,
)
@pytest.mark.parametrize("scale", [0.0, 0.5, 0.7])
def test_a_scale_error_of_all_encoders_does_not_hide_an_unbraked_vehicle(
    constants: EffectConstants, scale: float, within: float
) -> None:
    ledger, speed, time = effect_memory(), START, 0.0
    watch_effect(constants, ledger, DT, 0.0, False, START / constants.roll, np.zeros(3))
    while not watch_effect(
        constants, ledger, DT, 1.0, True, scale * speed / constants.roll, np.array([0.0, -0.5, 0.0])
    ):
        speed, time = speed - 0.5 * DT, time + DT
        assert time <= within
