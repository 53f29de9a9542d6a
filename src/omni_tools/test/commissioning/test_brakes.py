"""Exchanged brakes, brakes that do not act, and wrong dead times are found in simulated drives."""

from __future__ import annotations

import dataclasses
import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_drives import CONFIG, described, drive, found, swapped

from omni_core.brakes import (
    ON_OFF,
    PROPORTIONAL,
    SPRING,
    TORQUE,
    TYPICAL,
    VELOCITY,
    BrakeConfiguration,
    typical_changes,
)
from omni_core.kinematics import PlatformKinematics
from omni_runs.experiment import ExperimentLibrary
from omni_tools.commissioning.brakes import Response, late_brake
from omni_tools.commissioning.mistakes import (
    undistinguished_brakes,
)
from omni_tools.commissioning.signals import motions_of
from omni_tools.vehicles.estimates import Measured, write_vehicle

DELAYS = ("dead_time", "release_time")


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
        ({**CART, "brakes": VELOCITY}, 3.0),
        ({**CART, "brakes": VELOCITY, "kind": "omni", "wheels": 6}, 1.0),
    ],
)
def test_weak_drives_and_heavy_wheels_are_no_mistake_but_their_idle_brakes_are(
    measured: dict[str, Any], inertia: float, tmp_path: Path
) -> None:
    file, *_ = write_vehicle("robot", Measured(**measured), tmp_path / "robot")
    vehicle = ExperimentLibrary(CONFIG).vehicle(str(file))
    vehicle = dataclasses.replace(vehicle, wheel_inertia=inertia * vehicle.wheel_inertia)
    changes = f"vehicle.wheel_inertia={vehicle.wheel_inertia}", "brake_assist.law=allocation"
    assert vehicle.brake.max_power == measured.get("drive_power", 0.0)
    wheels, signals, known = drive(str(file), *changes)
    assert found(wheels, signals, known, vehicle) == []
    name = list(wheels)[1]
    idle = drive(str(file), *changes, f"vehicle.conditions.{name}={{brake: 0.0}}")
    assert found(*idle, vehicle) == [f"brake {name} does not act"]


def test_swapped_brakes_of_velocity_drives_are_found(tmp_path: Path) -> None:
    measured = Measured(length=1.3, width=1.16, mass=84.0, wheel_radius=0.178, brakes=VELOCITY)
    file, *_ = write_vehicle("robot", measured, tmp_path / "robot")
    vehicle = ExperimentLibrary(CONFIG).vehicle(str(file))
    wheels, signals, known = drive(str(file))
    names = list(wheels)
    enable = swapped(1, 2)(signals.enable.copy())
    expected = [f"brakes {names[1]} and {names[2]} are swapped"]
    assert found(wheels, signals._replace(enable=enable), known, vehicle) == expected


def test_slow_brakes_that_are_fast_have_a_wrong_dead_time(tmp_path: Path) -> None:
    file, *_ = write_vehicle("robot", Measured(**ROBOT), tmp_path / "robot")
    wheels, signals, known = drive(str(file))
    fast = ExperimentLibrary(CONFIG).vehicle(str(file))
    slow = dataclasses.replace(fast, brake=dataclasses.replace(fast.brake, **TYPICAL[SPRING]))
    for scale in (0.96, 1.0, 1.04):
        scaled = signals._replace(twist=scale * signals.twist)
        assert found(wheels, scaled, known, fast) == []
        assert found(wheels, scaled, known, slow) == ["brakes: dead time is about 0 ms"]


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


@pytest.mark.parametrize("row", [0, 3])
def test_one_brake_that_acts_later_than_the_others_is_named(row: int) -> None:
    vehicle = "mecanum_forklift"
    name = list(ExperimentLibrary(CONFIG).vehicle(vehicle).wheels)[row]
    wheels, signals, known = drive(vehicle, "brake_assist.enabled=false")
    motions = motions_of(signals)
    rows = round(0.16 / signals.period)
    speed = signals.wheel_speed.copy()
    rolling = PlatformKinematics.of(wheels).wheel_speeds(signals.twist)[:, row]
    slip = rolling - speed[:, row]
    slip[motions.stop] = np.roll(slip, rows)[motions.stop]
    speed[:, row] = rolling - slip
    late = signals._replace(wheel_speed=speed)
    assert found(wheels, signals, known, described(vehicle)) == []
    (only,) = found(wheels, late, known, described(vehicle))
    milliseconds = re.fullmatch(rf"brake {name} acts (\d+) ms later than the others", only)
    assert milliseconds, only
    assert abs(int(milliseconds[1]) - 160) <= 40


def test_noise_of_the_torques_is_no_late_brake() -> None:
    brake, period, rows = BrakeConfiguration(), 0.01, np.arange(100)
    for seed in range(20):
        random = np.random.default_rng(seed)
        demand = np.tile(rows[:, np.newaxis] >= 50, 4).astype(np.float64)
        torque = brake.max_torque * demand
        torque[:, 2] = brake.max_torque * (rows >= 65)
        every, nothing = np.ones((100, 4), np.bool_), np.zeros((100, 4))
        sizes = np.ones(4), np.ones(4)
        response = Response(nothing, torque, demand, nothing + 1.0, every, every[:, :1],
                            every[:, 0], period, *sizes, brake)  # fmt: skip
        found_late = late_brake(response)
        assert found_late is not None
        np.testing.assert_allclose(found_late, (2, 0.15))
        noise = random.normal(0.0, 3.0 * brake.max_torque, torque.shape)
        assert late_brake(response._replace(torque=brake.max_torque * demand + noise)) is None


@pytest.mark.parametrize(("wheels_late", "twist_late"), [(6, 0), (0, 6)])
def test_late_wheel_speeds_or_twists_are_no_brakes_without_effect(
    wheels_late: int, twist_late: int
) -> None:
    vehicle = "mecanum_forklift"
    wheels, signals, known = drive(vehicle, "brake_assist.enabled=false")
    later = signals._replace(
        wheel_speed=np.roll(signals.wheel_speed, wheels_late, axis=0),
        twist=np.roll(signals.twist, twist_late, axis=0),
    )
    assert found(wheels, later, known, described(vehicle)) == []


@pytest.mark.parametrize(
    ("brakes", "power", "law", "fewest"),
    [
        (PROPORTIONAL, 0.0, "sliding_mode", 13),
        (SPRING, 0.0, "sliding_mode", 13),
        (TORQUE, 3000.0, "allocation", 5),  # five of the six wheels get similar demands
    ],
)
def test_a_swap_of_brakes_is_found_or_its_brakes_are_named_as_alike(
    brakes: str, power: float, law: str, fewest: int
) -> None:
    limit, vehicle = f"vehicle.brake.max_power={power}", "six_wheel_mecanum"
    changes = *typical_changes(brakes), limit, f"brake_assist.law={law}"
    wheels, signals, known = drive(vehicle, *changes)
    brake = ExperimentLibrary(CONFIG).vehicle(vehicle).brake
    known_vehicle = described(
        vehicle, dataclasses.replace(brake, **TYPICAL[brakes], max_power=power)
    )
    alike = undistinguished_brakes(known_vehicle, signals, motions_of(signals))
    pairs = itertools.combinations(enumerate(wheels), 2)
    shown = [pair for pair in pairs if tuple(name for _, name in pair) not in alike]
    assert len(shown) >= fewest
    for (one, first), (other, second) in shown:
        enable = swapped(one, other)(signals.enable.copy())
        names = found(wheels, signals._replace(enable=enable), known, known_vehicle)
        assert names == [f"brakes {first} and {second} are swapped"]
