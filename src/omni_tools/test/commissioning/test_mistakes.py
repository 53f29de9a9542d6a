"""Errors in the description of simulated vehicles are found, and none in correct ones."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from made_drives import CONFIG, Wheels, described, drive, findings, found, swapped
from scipy.ndimage import uniform_filter1d

from omni_core.configuration import ConfigurationError
from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_runs.experiment import ExperimentLibrary
from omni_runs.recorded_run import Stream
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.commissioning import command
from omni_tools.commissioning.causes import Stated
from omni_tools.commissioning.mistakes import (
    corrected,
    find_mistakes,
    undistinguished_brakes,
)
from omni_tools.commissioning.signals import Motions, Signals, motions_of, signals_of, unchecked


@pytest.fixture(scope="module")
def forklift() -> tuple[Wheels, Signals, tuple[float, float]]:
    return drive("mecanum_forklift", "simulation.control_period=0.01")  # the period of recordings


@pytest.mark.parametrize("vehicle", ["mecanum_forklift", "six_wheel_mecanum", "three_wheel_robot"])
def test_nothing_is_found_where_nothing_is_wrong(vehicle: str) -> None:
    assert found(*drive(vehicle), described(vehicle)) == []


def test_the_report_has_the_ratio_of_each_sensor(
    forklift: tuple[Wheels, Signals, tuple[float, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, signals, (distance, angle) = forklift
    given = signals._replace(twist=signals.twist * (1.02, 1.02, 1.04))  # within the tolerances
    monkeypatch.setattr(command, "_signals", lambda *_: given)
    options = command.Options(
        recording=Path("drive"),
        vehicle="mecanum_forklift",
        distance=distance,
        angle=math.degrees(angle),
    )
    report = command.run(options, ExperimentWorkspace(CONFIG.parent))
    ratios = [row["ratio"] for row in report.document["sensors"]]
    assert ratios == pytest.approx([1.02, 1.02, 1.04, 1.0], abs=0.015)
    assert report.ok


@pytest.mark.parametrize("given", [{"forward": 1e-300}, {"turn": 0.0}, {"distance": -1e-9}])
def test_a_motion_of_no_length_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match=r"is no motion, must be at least 0\.001"):
        command.Options(recording=Path("drive"), vehicle="mecanum_forklift", **given)


FORKLIFT = ("rear_left", "front_left", "front_right", "rear_right")
Change = Callable[[Wheels, Signals], tuple[Wheels, Signals]]


def of_wheel(name: str, **factors: float) -> Change:
    def change(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
        values = {key: factor * getattr(wheels[name], key) for key, factor in factors.items()}
        return {**wheels, name: dataclasses.replace(wheels[name], **values)}, signals

    return change


def of_all(**factors: float) -> Change:
    def change(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
        for name in wheels:
            wheels, signals = of_wheel(name, **factors)(wheels, signals)
        return wheels, signals

    return change


def of_signal(field: str, change_of: Callable[[np.ndarray], np.ndarray]) -> Change:
    def change(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
        values: Any = change_of(getattr(signals, field).copy())
        return wheels, signals._replace(**{field: values})

    return change


def turned(angle: float) -> Callable[[np.ndarray], np.ndarray]:
    cos, sin = math.cos(angle), math.sin(angle)
    return lambda twist: twist @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]]).T


def scaled(*factors: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: values * np.array(factors)


def delayed_by_60_ms(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
    pedal, enable = (np.roll(values, -6, axis=0) for values in (signals.pedal, signals.enable))
    return wheels, signals._replace(pedal=pedal, enable=enable)


def turned_force(angle: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda imu: turned(angle)(imu[:, [1, 2, 0]])[:, [2, 0, 1]]


def on_its_side(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
    return wheels, signals._replace(upwards=0.0)


def mistakes() -> Iterator[tuple[str, Change]]:
    """Yield 57 errors: part of the expected name of the mistake, and the change that causes it."""
    for one, other in itertools.combinations(range(4), 2):
        words = f"wheels {FORKLIFT[one]} and {FORKLIFT[other]} are swapped"
        yield words, of_signal("wheel_speed", swapped(one, other))
    for row, name in enumerate(FORKLIFT):
        signs = [-1.0 if column == row else 1.0 for column in range(4)]
        yield f"direction of wheel {name}", of_signal("wheel_speed", scaled(*signs))
        yield f"roller of wheel {name}", of_wheel(name, roller_angle_deg=-1.0)
        yield f"x of wheel {name}", of_wheel(name, x=-1.0)
        yield f"y of wheel {name}", of_wheel(name, y=-1.0)
        yield f"radius of wheel {name}", of_wheel(name, radius=1.12)
    yield "radius of all wheels", of_signal("wheel_speed", scaled(1.1, 1.1, 1.1, 1.1))
    yield "direction of all wheels", of_signal("wheel_speed", scaled(-1, -1, -1, -1))
    for degrees in (5.0, -90.0, 180.0):
        yield f"mounted {degrees:.0f} deg off", of_signal("twist", turned(math.radians(degrees)))
    yield "twist sensor: y has the wrong sign", of_signal("twist", scaled(1, -1, 1))
    yield "twist sensor: x has the wrong sign", of_signal("twist", scaled(-1, 1, 1))
    yield "twist sensor: yaw rate has the wrong", of_signal("twist", scaled(1, 1, -1))
    yield "twist sensor: speed is 1.", of_signal("twist", scaled(1.2, 1.2, 1))
    yield (
        "twist sensor: measures at (0.",
        of_signal("twist", lambda twist: twist + np.outer(twist[:, 2], (0.1, 0.3, 0.0))),
    )
    yield "gyro: yaw rate has the wrong sign", of_signal("imu", scaled(-1, 1, 1))
    yield "gyro: yaw rate is 0.000 times", of_signal("imu", scaled(0, 1, 1))
    yield "gyro: yaw rate is 5", of_signal("imu", scaled(math.degrees(1.0), 1, 1))
    yield "accelerometer: x has", of_signal("imu", scaled(1, -1, 1))
    yield "accelerometer: y has", of_signal("imu", scaled(1, 1, -1))
    yield "accelerometer: x and y", of_signal("imu", swapped(1, 2))
    for one, other in itertools.combinations(range(4), 2):
        words = f"brakes {FORKLIFT[one]} and {FORKLIFT[other]} are swapped"
        yield words, of_signal("enable", swapped(one, other))
    yield "the enables act inversely", of_signal("enable", lambda enable: 1.0 - enable)
    yield "dead time is about", delayed_by_60_ms
    for unit, shown in ((math.degrees(1), "5"), (30 / math.pi, "9"), (652.0, "6"), (0.05, "0.05")):
        of_unit = of_signal("wheel_speed", scaled(unit, unit, unit, unit))
        yield f"speed of all wheels is {shown}", of_unit
    yield "speed of wheel rear_left is 6", of_signal("wheel_speed", scaled(64, 1, 1, 1))
    yield "speed of wheel rear_left is 0 times", of_signal("wheel_speed", scaled(0, 1, 1, 1))
    yield (
        "wheels rear_left and front_left and rear_right are swapped",
        of_signal("wheel_speed", lambda speed: speed[:, [1, 3, 2, 0]]),
    )
    yield "accelerometer: mounted 4", of_signal("imu", turned_force(math.radians(45.0)))
    yield "imu: specific force upwards 0.00", on_its_side


MISTAKES = dict(mistakes())


@pytest.mark.parametrize("words", MISTAKES)
def test_a_single_mistake_is_named(
    words: str, forklift: tuple[Wheels, Signals, tuple[float, float]]
) -> None:
    wheels, signals, known = forklift
    wheels, signals = MISTAKES[words](wheels, signals)
    names = found(wheels, signals, known)
    assert any(words in name for name in names), names
    assert len(names) == 1, names


@pytest.mark.parametrize(
    ("name", "radius"), [("rear_left", 0.95), ("front_right", 1.05), ("rear_left", 1.12)]
)
def test_a_wrong_radius_of_a_wheel_is_named_and_corrected(
    name: str, radius: float, forklift: tuple[Wheels, Signals, tuple[float, float]]
) -> None:
    wheels, signals, known = forklift
    wheels, signals = of_wheel(name, radius=radius)(wheels, signals)
    result = findings(wheels, signals, known)
    assert [one.name for one in result.mistakes] == [f"radius of wheel {name} is wrong"]
    assert found(dict(result.wheels), signals, known) == []


@pytest.mark.parametrize("axis", ["x", "y"])
def test_positions_that_are_too_small_have_the_effect_of_a_slip_and_are_not_corrected(
    axis: str, forklift: tuple[Wheels, Signals, tuple[float, float]]
) -> None:
    wheels, signals, known = forklift
    nearer, signals = of_all(**{axis: 0.9})(wheels, signals)
    result = findings(nearer, signals, known)
    assert result.mistakes == []
    assert result.uncertain
    (group,) = result.undecided
    assert [[cause.key for cause in part] for part in group] == [["slip t"], ["lever"]]
    farther, signals = of_all(**{axis: 1.1})(wheels, signals)
    result = findings(farther, signals, known)
    (mistake,) = result.mistakes
    assert mistake.name.startswith("wheelbase or track: the wheels are 0.9")
    assert result.wheels == farther
    assert result.undecided == []


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        (
            ["direction of wheel rear_left", "direction of wheel front_left"],
            ["direction of wheel rear_left is wrong", "direction of wheel front_left is wrong"],
        ),
        (
            ["roller of wheel front_right", "x of wheel rear_left"],
            ["x of wheel rear_left is wrong", "roller of wheel front_right is wrong"],
        ),
        (
            ["direction of wheel rear_left", "radius of wheel front_left"],
            ["direction of wheel rear_left is wrong", "radius of wheel front_left is wrong"],
        ),
        (
            ["roller of wheel rear_left", "radius of all wheels"],
            ["roller of wheel rear_left is wrong", "radius of all wheels is wrong"],
        ),
        (
            ["speed of all wheels is 5", "direction of all wheels"],
            ["direction of all wheels is wrong", "speed of all wheels is 5"],
        ),
    ],
)
def test_errors_of_several_wheels_are_all_named_and_corrected(
    changes: list[str],
    names: list[str],
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    for words in changes:
        wheels, signals = MISTAKES[words](wheels, signals)
    result = findings(wheels, signals, known)
    assert all(
        one.name.startswith(words) for one, words in zip(result.mistakes, names, strict=True)
    )
    if "speed" not in names[1]:  # the encoders are not in the file
        assert found(dict(result.wheels), signals, known) == []


def test_a_tilted_accelerometer_has_no_wrong_axes(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    assert found(wheels, signals._replace(imu=signals.imu + np.array([0.0, 1.7, 0.0])), known) == []


def test_gaps_of_twist_and_enables_hide_no_swap(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    twist, enable = signals.twist.copy(), swapped(0, 2)(signals.enable.copy())
    twist[::7], enable[:300] = math.nan, math.nan
    enable[np.flatnonzero(signals.pedal > 0.0)[::50]] = math.nan
    gaps = signals._replace(twist=twist, enable=enable)
    expected = [f"brakes {FORKLIFT[0]} and {FORKLIFT[2]} are swapped"]
    assert found(wheels, gaps, known) == expected


def test_a_twist_that_is_always_zero_is_no_missing_twist(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    assert "twist sensor: speed is 0.000 times the true one" in found(
        wheels, signals._replace(twist=np.zeros_like(signals.twist)), known
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rows", [slice(0, 400), slice(1050, None)])
def test_a_twist_that_misses_a_motion_or_the_stops_is_unchecked(
    rows: slice, forklift: tuple[Wheels, Signals, tuple[float, float]]
) -> None:
    wheels, signals, known = forklift
    twist = signals.twist.copy()
    twist[rows] = math.nan
    signals = signals._replace(twist=twist)
    assert found(wheels, signals, known) == []
    assert set(unchecked(signals, motions_of(signals))) == {"odometry/twist"}


def test_enables_that_do_not_name_a_wheel_are_unchecked(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    _, signals, _ = forklift
    enable = signals.enable.copy()
    enable[:, 2] = math.nan
    assert unchecked(signals, motions_of(signals)) == {}
    signals = signals._replace(enable=enable)
    assert unchecked(signals, motions_of(signals)) == {"brake/enable": "order of the brakes"}


@pytest.mark.filterwarnings("error")
def test_a_drive_whose_pedal_is_lost_while_it_brakes_has_no_mistake(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    later = (signals.pedal > 0.0) & (np.cumsum(signals.pedal) > 1.0)
    pedal = np.where(later, math.nan, signals.pedal)
    assert found(wheels, signals._replace(pedal=pedal), known) == []


def as_received(wheels: Wheels, signals: Signals, rows: np.ndarray, pedal: np.ndarray) -> Signals:
    """Return the signals of messages with the given rows of the wheel speeds, and this demand."""
    stamps = np.round(signals.time * 1e9).astype(np.int64)
    states = [
        (stamp, SimpleNamespace(name=list(wheels), velocity=speed))
        for stamp, speed in zip(stamps[rows], signals.wheel_speed[rows], strict=True)
    ]
    demands = [
        (stamp, SimpleNamespace(position=[value]))
        for stamp, value in zip(stamps, pedal, strict=True)
    ]
    streams = {"wheel_states": Stream.of(states), "brake/pedal": Stream.of(demands)}
    return signals_of(streams, list(wheels))


@pytest.mark.parametrize("full", [1.0, 0.4])
def test_an_inverted_pedal_is_named_and_hides_no_other_mistake(
    full: float, forklift: tuple[Wheels, Signals, tuple[float, float]]
) -> None:
    wheels, signals, known = forklift
    every, pedal = np.ones(len(signals.time), bool), full * signals.pedal
    assert found(wheels, as_received(wheels, signals, every, pedal), known) == []
    inverted = as_received(wheels, signals, every, 1.0 - pedal)
    np.testing.assert_allclose(inverted.pedal, pedal[:-1], atol=1e-12)
    name = "pedal: the braking demand is inverted"
    assert found(wheels, inverted, known) == [name]
    other, _ = of_wheel("rear_left", roller_angle_deg=-1.0)(wheels, signals)
    assert found(other, inverted, known) == ["roller of wheel rear_left is wrong", name]


def test_lost_wheel_speeds_change_no_result_or_are_refused(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift

    def received(gap: float) -> Signals:
        """Return the signals without the wheel speeds of each motion's first `gap` seconds."""
        lost = np.zeros(len(signals.time), bool)
        for begin in (0.7, 4.2, 7.7):
            lost |= (signals.time > begin) & (signals.time < begin + gap)
        return as_received(wheels, signals, ~lost, signals.pedal)

    assert found(wheels, received(0.25), known) == []
    with pytest.raises(ConfigurationError, match=r"no wheel speeds for 0\.\d+ s"):
        received(0.5)


def test_brakes_that_only_act_together_are_not_distinguished(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, _ = forklift
    motions = motions_of(signals)
    assert undistinguished_brakes(described(), signals, motions) == []
    for enable in (np.ones_like(signals.enable), np.full_like(signals.enable, math.nan)):
        together = signals._replace(enable=enable)
        alike = undistinguished_brakes(described(), together, motions)
        assert alike == list(itertools.combinations(wheels, 2))


def test_the_corrected_file_of_a_vehicle_has_no_mistake(
    forklift: tuple[Wheels, Signals, tuple[float, float]], tmp_path: Path
) -> None:
    wheels, signals, known = forklift
    other, _ = of_wheel("front_left", radius=1.12)(wheels, signals)
    _, late = delayed_by_60_ms(wheels, signals)
    library = ExperimentLibrary(CONFIG)
    values = library.vehicle_values("mecanum_forklift")
    for wrong, drive_of in ((other, signals), (wheels, late)):
        result = findings(wrong, drive_of, known)
        file = tmp_path / "vehicle.yaml"
        file.write_text(yaml.safe_dump(corrected(values, result), sort_keys=False))
        vehicle = library.vehicle(str(file))
        again = findings(dict(vehicle.wheels), drive_of, known, vehicle).mistakes
        assert result.mistakes
        assert again == []
        assert vehicle.body == library.vehicle("mecanum_forklift").body


def test_forty_random_vehicles_without_mistakes_are_found_correct() -> None:
    random = np.random.default_rng(11)
    for _ in range(40):
        x, y = random.uniform(0.2, 1.5), random.uniform(0.15, 0.9)
        radius = random.uniform(0.04, 0.3)
        wheels = {
            f"w{a + 1}{b + 1}": WheelMount(
                x=a * x, y=b * y, roller_angle_deg=-45 * a * b, radius=radius
            )
            for a in (-1, 1)
            for b in (-1, 1)
        }
        known = random.uniform(0.5, 3.0), random.uniform(0.5, 6.0)
        motion = np.diag([known[0], known[0], known[1]])
        angle = PlatformKinematics.of(wheels).wheel_speeds(motion)
        angle *= 1.0 + random.normal(0.0, 0.01, angle.shape)
        twist = motion + random.normal(0.0, 0.005, (3, 3))
        force = np.diag([1.0, 1.0, 0.0])[:, :2] * 0.3 + random.normal(0.0, 0.03, (3, 2))
        gyro = np.array([0.0, 0.0, known[1] * 1.01])
        motions = Motions(angle, twist, gyro, force, slice(0, 0))
        nothing = np.full((2, 4), math.nan)
        signals = Signals(np.array([0.0, 0.01]), nothing, nothing, nothing, nothing[:, 0], nothing)
        vehicle = dataclasses.replace(described(), wheels=wheels)
        stated = Stated(np.array([known[0], known[0], known[1]]))
        assert find_mistakes(vehicle, signals, motions, stated).mistakes == []


def test_a_velocity_command_of_zero_may_brake_each_motion_and_the_parked_vehicle(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    speed = np.max(np.abs(signals.wheel_speed), axis=1)
    slower = np.append(np.diff(uniform_filter1d(speed, 20)) < 0.0, True)
    slower[motions_of(signals).stop] = False
    for braked in (speed < 0.1, (speed < 0.1) | slower):
        pedal = np.maximum(signals.pedal, braked)
        assert found(wheels, signals._replace(pedal=pedal), known) == []


def test_a_drive_that_is_not_the_expected_one_is_refused(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    _, signals, _ = forklift
    short = signals._replace(
        wheel_speed=np.where(signals.time[:, None] < 4, 0, signals.wheel_speed)
    )
    with pytest.raises(ConfigurationError, match="drive forward, left, counter-clockwise"):
        motions_of(short)
