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

from omni_brake_assist.brake_assist import BrakeAssist
from omni_loop.experiment import ExperimentLibrary
from omni_loop.loop import make_estimator, steps
from omni_loop.recorded_run import Stream
from omni_platform.brakes import (
    ON_OFF,
    PROPORTIONAL,
    SPRING,
    TORQUE,
    TYPICAL,
    VELOCITY,
    BrakeConfiguration,
    typical_changes,
)
from omni_platform.configuration import ConfigurationError
from omni_platform.geometry import WheelMount
from omni_platform.kinematics import PlatformKinematics
from omni_sim.simulator import Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.commissioning.mistakes import (
    Mistake,
    corrected,
    find_mistakes,
    undistinguished_brakes,
)
from omni_tools.commissioning.signals import Motions, Signals, motions_of, signals_of, unchecked
from omni_tools.vehicles.estimates import Measured, write_vehicle

CONFIG = Path(__file__).parents[4] / "config"
Wheels = dict[str, WheelMount]
DIRECT = BrakeConfiguration()
DELAYS = ("dead_time", "release_time")


def drive(vehicle: str, *changes: str) -> tuple[Wheels, Signals, tuple[float, float]]:
    """Drive a simulated vehicle; return its wheels, the signals, and distance and angle."""
    plain = ["feedback=velocity_sensor", "simulation.render_lines=false"]
    configuration = ExperimentLibrary(CONFIG).load(
        "commissioning", "assisted", [f"vehicle={vehicle}", *plain, *changes]
    )
    rows = []
    assist = BrakeAssist(configuration.brake_assist)
    for moment in steps(Simulator(configuration), make_estimator(configuration), assist):
        seen = moment.observation
        rows.append(
            (
                np.array([seen.stamp_ns * 1e-9]),
                seen.encoder_speed,
                moment.feedback.value,
                seen.imu,
                np.array([seen.pedal]),
                moment.decision.enable,
                seen.pose,
            )
        )
        if seen.stamp_ns >= 20_000_000_000:
            break
    time, speed, twist, imu, pedal, enable, pose = map(np.array, zip(*rows, strict=True))
    signals = Signals(time[:, 0], speed, twist, imu, pedal[:, 0], enable)
    before, between, after = (int(np.argmax(time[:, 0] > at)) for at in (0.4, 3.7, 10.7))
    distance = float(np.hypot(*(pose[between, :2] - pose[before, :2])))
    turned = float(pose[after, 2] - pose[between, 2])
    return dict(configuration.vehicle.wheels), signals, (distance, turned)


@pytest.fixture(scope="module")
def forklift() -> tuple[Wheels, Signals, tuple[float, float]]:
    return drive("mecanum_forklift")


def described(
    vehicle: str = "mecanum_forklift", brake: BrakeConfiguration = DIRECT
) -> VehicleConfiguration:
    return dataclasses.replace(ExperimentLibrary(CONFIG).vehicle(vehicle), brake=brake)


def mistakes_in(
    wheels: Wheels,
    signals: Signals,
    known: tuple[float, float],
    vehicle: VehicleConfiguration,
) -> list[Mistake]:
    at, (distance, angle) = motions_of(signals), known
    return find_mistakes(wheels, signals, at, distance=distance, angle=angle, vehicle=vehicle)


def found(
    wheels: Wheels,
    signals: Signals,
    known: tuple[float, float],
    vehicle: VehicleConfiguration | None = None,
) -> list[str]:
    return [mistake.name for mistake in mistakes_in(wheels, signals, known, vehicle or described())]


@pytest.mark.parametrize("vehicle", ["mecanum_forklift", "six_wheel_mecanum", "three_wheel_robot"])
def test_nothing_is_found_where_nothing_is_wrong(vehicle: str) -> None:
    assert found(*drive(vehicle), described(vehicle)) == []


def test_brakes_that_release_slowly_have_no_wrong_dead_time() -> None:
    brake = BrakeConfiguration(dead_time=0.06, release_time=0.1)
    changes = typical_changes(SPRING)
    assert found(*drive("mecanum_forklift", *changes), described(brake=brake)) == []


ROBOT: Any = {"length": 0.58, "width": 0.38, "mass": 30.0, "wheel_radius": 0.05, "load": 8.0}
CART = {"length": 0.7, "width": 0.5, "mass": 20.0, "wheel_radius": 0.06, "load": 4.0}
TRUCK = {"length": 2.0, "width": 2.0, "mass": 320.0, "wheel_radius": 0.17, "load": 60.0}


@pytest.mark.parametrize(
    ("measured", "inertia"),
    [
        ({**ROBOT, "brakes": TORQUE, "drive_power": 20.0}, 1.0),
        ({**ROBOT, "brakes": TORQUE, "drive_power": 100.0}, 1.0),
        ({**CART, "brakes": PROPORTIONAL}, 5.0),
        ({**TRUCK, "brakes": PROPORTIONAL, "kind": "omni"}, 1.0),
    ],
)
def test_weak_drives_and_heavy_wheels_are_no_mistake(
    measured: dict[str, Any], inertia: float, tmp_path: Path
) -> None:
    file, *_ = write_vehicle("robot", Measured(**measured), tmp_path / "robot")
    vehicle = ExperimentLibrary(CONFIG).vehicle(str(file))
    vehicle = dataclasses.replace(vehicle, wheel_inertia=inertia * vehicle.wheel_inertia)
    changes = f"vehicle.wheel_inertia={vehicle.wheel_inertia}", "brake_assist.law=allocation"
    assert vehicle.brake.max_power == measured.get("drive_power", 0.0)
    assert found(*drive(str(file), *changes), vehicle) == []


@pytest.mark.parametrize("scale", [0.96, 1.0, 1.04])
def test_slow_brakes_that_are_fast_have_a_wrong_dead_time(scale: float, tmp_path: Path) -> None:
    file, *_ = write_vehicle("robot", Measured(**ROBOT), tmp_path / "robot")
    wheels, signals, known = drive(str(file))
    fast = ExperimentLibrary(CONFIG).vehicle(str(file))
    slow = dataclasses.replace(fast, brake=dataclasses.replace(fast.brake, **TYPICAL[SPRING]))
    signals = signals._replace(twist=scale * signals.twist)
    assert found(wheels, signals, known, fast) == []
    assert found(wheels, signals, known, slow) == ["brakes: dead time is about 0 ms"]


FORKLIFT = ("rear_left", "front_left", "front_right", "rear_right")
Change = Callable[[Wheels, Signals], tuple[Wheels, Signals]]


def of_wheel(name: str, **factors: float) -> Change:
    def change(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
        values = {key: factor * getattr(wheels[name], key) for key, factor in factors.items()}
        return {**wheels, name: dataclasses.replace(wheels[name], **values)}, signals

    return change


def of_signal(field: str, change_of: Callable[[np.ndarray], np.ndarray]) -> Change:
    def change(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
        values = change_of(getattr(signals, field).copy())
        return wheels, signals._replace(**{field: values})

    return change


def exchanged(one: int, other: int) -> Callable[[np.ndarray], np.ndarray]:
    def change(values: np.ndarray) -> np.ndarray:
        values[:, [one, other]] = values[:, [other, one]]
        return values

    return change


def turned(angle: float) -> Callable[[np.ndarray], np.ndarray]:
    cos, sin = math.cos(angle), math.sin(angle)
    return lambda twist: twist @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]]).T


def scaled(*factors: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: values * np.array(factors)


def delayed_by_60_ms(wheels: Wheels, signals: Signals) -> tuple[Wheels, Signals]:
    pedal, enable = (np.roll(values, -6, axis=0) for values in (signals.pedal, signals.enable))
    return wheels, signals._replace(pedal=pedal, enable=enable)


def mistakes() -> Iterator[tuple[str, Change]]:
    """Yield 47 errors: a word in the expected name of the result, and the change that makes it."""
    for one, other in itertools.combinations(range(4), 2):
        words = f"wheels {FORKLIFT[one]} and {FORKLIFT[other]} are exchanged"
        yield words, of_signal("wheel_speed", exchanged(one, other))
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
    yield "accelerometer: x and y", of_signal("imu", exchanged(1, 2))
    for one, other in itertools.combinations(range(4), 2):
        words = f"brakes {FORKLIFT[one]} and {FORKLIFT[other]} are exchanged"
        yield words, of_signal("enable", exchanged(one, other))
    yield "dead time is about", delayed_by_60_ms


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
    ("vehicle", "brakes", "law"),
    [
        ("mecanum_forklift", ON_OFF, "sliding_mode"),
        ("three_wheel_robot", SPRING, "sliding_mode"),
        ("mecanum_forklift", TORQUE, "allocation"),
        ("mecanum_forklift", VELOCITY, "sliding_mode"),
        ("three_wheel_robot", VELOCITY, "allocation"),
    ],
)
def test_a_brake_that_does_not_act_is_named(vehicle: str, brakes: str, law: str) -> None:
    name = list(ExperimentLibrary(CONFIG).vehicle(vehicle).wheels)[1]
    changes = [*typical_changes(brakes), f"brake_assist.law={law}"]
    brake = BrakeConfiguration(**TYPICAL[brakes])
    for enabled in ("true", "false"):
        faulty = f"vehicle.conditions.{name}={{brake: 0.0}}", f"brake_assist.enabled={enabled}"
        names = found(*drive(vehicle, *changes, *faulty), described(vehicle, brake))
        assert names == [f"brake {name} does not act"]


@pytest.mark.parametrize(
    ("brakes", "law"),
    [(SPRING, "sliding_mode"), (TORQUE, "allocation"), (VELOCITY, "allocation")],
)
@pytest.mark.parametrize("wrong", [0.0, 0.15])
def test_a_wrong_dead_time_is_named(brakes: str, law: str, wrong: float) -> None:
    typical, true = BrakeConfiguration(**TYPICAL[brakes]), 0.08
    later = [f"vehicle.brake.{key}={getattr(typical, key) + true:.3f}" for key in DELAYS]
    changes = [*typical_changes(brakes), *later, f"brake_assist.law={law}"]
    brake = dataclasses.replace(typical, **{key: getattr(typical, key) + wrong for key in DELAYS})
    names = found(*drive("mecanum_forklift", *changes), described(brake=brake))
    assert len(names) == 1
    milliseconds = int(names[0].removeprefix("brakes: dead time is about ").removesuffix(" ms"))
    assert abs(milliseconds - 1e3 * (typical.dead_time + true)) <= 20


@pytest.mark.parametrize(
    ("brakes", "power", "law"),
    [
        (PROPORTIONAL, 0.0, "sliding_mode"),
        (SPRING, 0.0, "sliding_mode"),
        (TORQUE, 3000.0, "allocation"),
    ],
)
def test_an_exchange_of_brakes_is_found_or_its_brakes_are_named_as_alike(
    brakes: str, power: float, law: str
) -> None:
    limit, vehicle = f"vehicle.brake.max_power={power}", "six_wheel_mecanum"
    changes = *typical_changes(brakes), limit, f"brake_assist.law={law}"
    wheels, signals, known = drive(vehicle, *changes)
    brake = ExperimentLibrary(CONFIG).vehicle(vehicle).brake
    known_vehicle = described(
        vehicle, dataclasses.replace(brake, **TYPICAL[brakes], max_power=power)
    )
    alike = undistinguished_brakes(wheels, signals, motions_of(signals), vehicle=known_vehicle)
    pairs = itertools.combinations(enumerate(wheels), 2)
    shown = [pair for pair in pairs if tuple(name for _, name in pair) not in alike]
    assert len(shown) > 6
    for (one, first), (other, second) in shown:
        enable = exchanged(one, other)(signals.enable.copy())
        names = found(wheels, signals._replace(enable=enable), known, known_vehicle)
        assert names == [f"brakes {first} and {second} are exchanged"]


def test_gaps_of_twist_and_enables_hide_no_exchange(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    twist, enable = signals.twist.copy(), exchanged(0, 2)(signals.enable.copy())
    twist[::7], enable[:300] = math.nan, math.nan
    enable[np.flatnonzero(signals.pedal > 0.0)[::50]] = math.nan
    gaps = signals._replace(twist=twist, enable=enable)
    expected = [f"brakes {FORKLIFT[0]} and {FORKLIFT[2]} are exchanged"]
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
    assert "odometry/twist" in unchecked(signals, motions_of(signals))


@pytest.mark.filterwarnings("error")
def test_a_drive_whose_pedal_is_lost_while_it_brakes_has_no_mistake(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    later = (signals.pedal > 0.0) & (np.cumsum(signals.pedal) > 1.0)
    pedal = np.where(later, math.nan, signals.pedal)
    assert found(wheels, signals._replace(pedal=pedal), known) == []


def test_lost_wheel_speeds_change_no_result_or_are_refused(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, known = forklift
    stamps = np.round(signals.time * 1e9).astype(np.int64)

    def received(gap: float) -> Signals:
        """Return the signals without the wheel speeds of each motion's first `gap` seconds."""
        lost = np.zeros(len(stamps), bool)
        for begin in (0.7, 4.2, 7.7):
            lost |= (signals.time > begin) & (signals.time < begin + gap)
        states = [
            (stamp, SimpleNamespace(name=list(wheels), velocity=speed))
            for stamp, speed in zip(stamps[~lost], signals.wheel_speed[~lost], strict=True)
        ]
        pedal = [
            (stamp, SimpleNamespace(position=[value]))
            for stamp, value in zip(stamps, signals.pedal, strict=True)
        ]
        streams = {"wheel_states": Stream.of(states), "brake/pedal": Stream.of(pedal)}
        return signals_of(streams, list(wheels))

    assert found(wheels, received(0.25), known) == []
    with pytest.raises(ConfigurationError, match=r"no wheel speeds for 0\.\d+ s"):
        received(0.5)


def test_brakes_that_only_act_together_are_not_distinguished(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    wheels, signals, _ = forklift
    motions = motions_of(signals)
    assert undistinguished_brakes(wheels, signals, motions, vehicle=described()) == []
    for enable in (np.ones_like(signals.enable), np.full_like(signals.enable, math.nan)):
        together = signals._replace(enable=enable)
        alike = undistinguished_brakes(wheels, together, motions, vehicle=described())
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
        mistakes = mistakes_in(wrong, drive_of, known, described())
        file = tmp_path / "vehicle.yaml"
        file.write_text(yaml.safe_dump(corrected(values, mistakes), sort_keys=False))
        vehicle = library.vehicle(str(file))
        again = mistakes_in(dict(vehicle.wheels), drive_of, known, vehicle)
        assert mistakes
        assert again == []
        assert vehicle.body == library.vehicle("mecanum_forklift").body


def test_forty_random_vehicles_without_mistakes_are_found_correct() -> None:
    random = np.random.default_rng(11)
    for _ in range(40):
        x, y = random.uniform(0.2, 1.5), random.uniform(0.15, 0.9)
        radius = random.uniform(0.04, 0.3)
        wheels = {
            f"{a}{b}": WheelMount(x=a * x, y=b * y, roller_angle_deg=-45 * a * b, radius=radius)
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
        found = find_mistakes(
            wheels, signals, motions, distance=known[0], angle=known[1], vehicle=described()
        )
        assert found == []


def test_a_drive_that_is_not_the_expected_one_is_refused(
    forklift: tuple[Wheels, Signals, tuple[float, float]],
) -> None:
    _, signals, _ = forklift
    short = signals._replace(pedal=np.zeros_like(signals.pedal))
    with pytest.raises(ConfigurationError, match="drive forward, left, counter-clockwise"):
        motions_of(short)
