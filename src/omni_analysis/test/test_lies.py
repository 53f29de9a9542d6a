"""Stops with a lying sensor against the limits that hold for any single lie."""

from pathlib import Path

import pytest

from omni_analysis.campaign.lies import (
    DISTANCE_LIMITS,
    ROTATION_LIMIT,
    Lie,
    LyingSensors,
    loss_of_twist,
)
from omni_analysis.loop.compiled import run_fast_loop
from omni_analysis.loop.experiment import ExperimentLibrary

LIBRARY = ExperimentLibrary(Path(__file__).parents[3] / "config")


@pytest.fixture(scope="module")
def stops() -> LyingSensors:
    return LyingSensors(LIBRARY)


@pytest.mark.safety(
    "the stop is longer or turns more",
    "twist or an encoder off, stuck, whispering, drifting or gone",
    "all layers, in the closed loop: the limits of the study hold",
    within="the whole stop",
)
@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize(
    ("channel", "kind", "axis", "amplitude"),
    [
        ("twist", "offset", 1, 0.5),  # never came to rest once
        ("twist", "offset", 2, -3.0),
        ("twist", "whisper", -1, 0.0),
        ("twist", "zero", 1, 0.0),
        ("twist", "ramp", 1, 2.0),
        ("twist", "drop_out", -1, 0.0),
        ("encoder", "zero", 0, 0.0),
        ("encoder", "drift", 1, 10.0),
    ],
)
def test_a_lie_makes_no_stop_worse(
    stops: LyingSensors, imu: bool, channel: str, kind: str, axis: int, amplitude: float
) -> None:
    stop = stops.run(0, "straight_line", Lie(channel, kind, axis, 0.3, amplitude, 0.3), imu=imu)
    assert stop.rest
    assert stop.distance <= DISTANCE_LIMITS[imu]
    if imu:
        assert stop.rotation <= ROTATION_LIMIT


@pytest.mark.parametrize(
    ("case", "kind", "axis", "onset", "amplitude", "period"),
    [
        ("table_2", "ramp", 2, 0.43, 0.675, 0.17),  # cost the gyro its word, and 41 deg
        ("six_wheels", "ramp", 2, -0.11, 0.582, 0.57),
        ("slippery", "drift", -1, 0.06, 0.189, 0.15),
        ("turn_while_translate", "stuck", 0, -0.14, 0.0, 0.1),
        ("straight_line", "offset", 2, 0.84, -0.508, 0.1),
    ],
)
def test_a_twist_that_turns_otherwise_does_not_convict_the_gyro(
    stops: LyingSensors,
    case: str,
    kind: str,
    axis: int,
    onset: float,
    amplitude: float,
    period: float,
) -> None:
    stop = stops.run(0, case, Lie("twist", kind, axis, onset, amplitude, period), imu=True)
    assert stop.rest
    assert stop.distance <= DISTANCE_LIMITS[True]
    assert stop.rotation <= ROTATION_LIMIT


@pytest.mark.safety(
    "the stop is longer or turns more",
    "gyro or accelerometer off, stuck, reversed, swapped or gone",
    "likewise",
    within="the whole stop",
)
@pytest.mark.parametrize(
    ("channel", "kind", "amplitude"),
    [
        ("gyro", "zero", 0.0),
        ("gyro", "sign", 0.0),
        ("gyro", "offset", -3.0),
        ("gyro", "drift", 0.3),
        ("accelerometer", "swap", 0.0),
        ("accelerometer", "sign", 0.0),
        ("accelerometer", "offset", 3.0),
        ("accelerometer", "stuck", 0.0),
    ],
)
def test_an_imu_that_lies_makes_no_stop_worse(
    stops: LyingSensors, channel: str, kind: str, amplitude: float
) -> None:
    for onset in (0.05, 0.4):
        axis = 0 if channel == "gyro" else -1
        lie = Lie(channel, kind, axis, onset, amplitude, 0.3)
        stop = stops.run(0, "straight_line", lie, imu=True)
        assert stop.rest
        assert stop.distance <= DISTANCE_LIMITS[True]
        assert stop.rotation <= ROTATION_LIMIT


def test_a_gyro_that_lies_just_before_the_pedal_is_no_offset_of_the_twist(
    stops: LyingSensors,
) -> None:
    lie = Lie("gyro", "offset", 0, -0.03, 1.05, 0.17)
    stop = stops.run(0, "turn_while_translate", lie, imu=True)
    assert stop.rest
    assert stop.distance <= 1.05
    assert stop.rotation <= ROTATION_LIMIT


@pytest.mark.safety(
    "the stop is longer or turns more",
    "a lie too small to be found, also while the line of motion is stored",
    "it costs little; the line is stored again once a dispute is settled",
    within="the whole stop",
)
@pytest.mark.parametrize(
    ("case", "lie"),
    [
        ("slippery", Lie("accelerometer", "sign", 1, -0.19, 0.0, 0.1)),
        ("table_2", Lie("accelerometer", "sine", -1, -0.07, 6.6, 0.2)),
        ("turn_while_translate", Lie("encoder", "stuck", 1, -0.06, 0.0, 0.1)),
        ("slippery", Lie("encoder", "drift", 0, 0.08, 3.6, 0.1)),
        ("diagonal", Lie("twist", "scale", 1, -0.18, -1.327, 0.1)),  # as the line is stored
        ("six_wheels", Lie("twist", "swap", 0, -0.2, 0.0, 0.1)),
    ],
)
def test_a_lie_too_small_for_a_dispute_costs_little(
    stops: LyingSensors, case: str, lie: Lie
) -> None:
    stop = stops.run(0, case, lie, imu=True)
    assert stop.rest
    assert stop.distance <= DISTANCE_LIMITS[True]
    assert stop.rotation <= ROTATION_LIMIT


@pytest.mark.parametrize(
    ("case", "lie"),
    [
        ("turn_while_translate", Lie("twist", "ramp", 0, -0.14, -3.212, 0.1)),
        ("table_2", Lie("twist", "whisper", -1, 0.92, 0.0, 0.1)),
    ],
)
def test_without_an_imu_a_twist_that_loses_no_speed_is_found(
    stops: LyingSensors, case: str, lie: Lie
) -> None:
    stop = stops.run(0, case, lie, imu=False)
    assert stop.rest
    assert stop.distance <= DISTANCE_LIMITS[False]


@pytest.mark.parametrize(
    ("case", "onset"), [("six_wheels", -0.32), ("turn_while_translate", -0.45)]
)
def test_a_leap_across_which_nothing_was_heard_is_still_one(
    stops: LyingSensors, case: str, onset: float
) -> None:
    """The gate refuses a twist that leaps, until too long has passed to say anything."""
    stop = stops.run(0, case, Lie("twist", "swap", -1, onset, 0.0, 0.3), imu=True)
    assert stop.rest
    assert stop.distance <= DISTANCE_LIMITS[True]  # 1.41 with the biases that it taught
    assert stop.rotation <= ROTATION_LIMIT  # 19 deg


def test_disputes_that_come_and_go_are_settled() -> None:
    setting = ("maneuver.speed=2.34", "maneuver.direction_deg=174.1", "maneuver.yaw_rate_deg=24.3")
    stops = LyingSensors(LIBRARY, (*setting, "ground.friction=0.48"))
    lie = Lie("twist", "sine", 1, 0.1, -0.389, 0.5)
    assert stops.run(0, "straight_line", lie, imu=True).distance <= DISTANCE_LIMITS[True]


@pytest.mark.safety(
    "the stop is longer or turns more",
    "twist lost for good 0.3 s after the pedal",
    "dead reckoning, then all brakes: at most 8 deg",
    within="the whole stop",
)
def test_a_stop_goes_on_without_the_twist(stops: LyingSensors) -> None:
    assert loss_of_twist(stops, 0.3) <= 8.0


@pytest.mark.parametrize(
    ("kind", "onset", "amplitude", "wheel"),
    [
        ("zero", -0.03, 0.0, 2),  # took 2.5 times the distance of all brakes on
        ("zero", 0.3, 0.0, 0),
        ("sign", 0.22, 0.0, 1),
        ("offset", 0.3, -20.0, 3),
        ("drop_out", 0.3, 0.0, 0),
        ("drop_out", -0.2, 0.0, 1),
    ],
)
def test_allocation_is_not_led_astray_by_an_encoder(
    kind: str, onset: float, amplitude: float, wheel: int
) -> None:
    base = ["feedback=velocity_sensor", "encoders.resolution=4096", "simulation.render_lines=false"]
    time = LIBRARY.load("straight_line", "assisted").maneuver.brake_time + onset
    lie = f"channel: encoder, kind: {kind}, axis: {wheel}, time: {time}, amplitude: {amplitude}"
    unassisted = run_fast_loop(LIBRARY.load("straight_line", "unassisted", base))
    stop = run_fast_loop(
        LIBRARY.load("straight_line", "allocation", [*base, f"faults.lie={{{lie}}}"])
    )
    assert stop.stopping_distance <= DISTANCE_LIMITS[True] * unassisted.stopping_distance
    assert stop.orientation_change <= unassisted.orientation_change + ROTATION_LIMIT


FAST_TURN = (
    *("maneuver.speed=8", "maneuver.direction_deg=80", "maneuver.yaw_rate_deg=-90"),
    "maneuver.brake_time=0.5",
)


@pytest.mark.safety(
    "brakes act late",
    "twist 20 to 200 ms late, as `feedback_delay` says",
    "all are judged by what they said of the same moment: the stop is that of a prompt one",
    within="the whole stop",
)
@pytest.mark.parametrize("law", ["sliding_mode", "allocation"])
@pytest.mark.parametrize("delay", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize(
    ("experiment", "variant", "changes"),
    [
        ("straight_line", "assisted", ()),
        ("ice_patch_noisy", "noisy", ("maneuver.brake_time=2",)),
        ("turn_while_translate", "k7", ("maneuver.brake_time=0.5",)),
        ("straight_line", "assisted", FAST_TURN),
    ],
)
def test_a_delay_that_is_told_costs_little(
    experiment: str, variant: str, changes: tuple[str, ...], delay: float, law: str
) -> None:
    ideal = ["feedback=velocity_sensor", f"brake_assist.law={law}", *changes]
    ideal += ["brake_assist.second_opinion=true"]
    if law == "allocation":
        ideal += ["vehicle.brake.kind=proportional"]
    late = f"faults.late={{channel: twist, kind: delay, time: 0.0, period: {delay}}}"
    told = f"brake_assist.feedback_delay={delay}"
    prompt, behind = (
        run_fast_loop(LIBRARY.load(experiment, variant, [*ideal, *changes]))
        for changes in ([], [late, told])
    )
    assert behind.stopping_distance <= 1.03 * prompt.stopping_distance
    assert behind.orientation_change <= prompt.orientation_change + 1.0


def test_a_seed_is_always_the_same_stop(stops: LyingSensors) -> None:
    assert stops(3) == stops(3) == LyingSensors(LIBRARY)(3)
