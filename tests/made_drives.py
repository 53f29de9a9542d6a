"""Commissioning drives of simulated vehicles, and the errors found in them."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np

from omni_brake_assist.brake_assist import BrakeAssist
from omni_core.brakes import BrakeConfiguration
from omni_core.geometry import WheelMount
from omni_runs.experiment import ExperimentLibrary
from omni_runs.loop import make_estimator, steps
from omni_sim.simulator import Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.commissioning.causes import Stated
from omni_tools.commissioning.mistakes import (
    Findings,
    find_mistakes,
)
from omni_tools.commissioning.signals import Signals, motions_of

CONFIG = Path(__file__).parents[1] / "config"
Wheels = dict[str, WheelMount]
DIRECT = BrakeConfiguration()


@functools.cache
def drive(vehicle: str, *changes: str) -> tuple[Wheels, Signals, tuple[float, float]]:
    """Drive a simulated vehicle; return its wheels, the signals, and distance and angle.

    The values are shared by all tests of a process: a test changes copies of them.
    """
    plain = ["feedback=velocity_sensor", "simulation.render_lines=false"]
    slower = "simulation.control_period=0.02"  # half the steps, which show check-vehicle the same
    configuration = ExperimentLibrary(CONFIG).load(
        "commissioning", "assisted", [f"vehicle={vehicle}", *plain, slower, *changes]
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
                np.array([seen.imu[-1].yaw_rate, *seen.imu[-1].acceleration]),
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


def described(
    vehicle: str = "mecanum_forklift", brake: BrakeConfiguration = DIRECT
) -> VehicleConfiguration:
    return dataclasses.replace(ExperimentLibrary(CONFIG).vehicle(vehicle), brake=brake)


def findings(
    wheels: Wheels,
    signals: Signals,
    known: tuple[float, float],
    vehicle: VehicleConfiguration | None = None,
) -> Findings:
    described_as = copy.copy(vehicle or described())
    # Unchecked: a wrong wheel may tip the vehicle.
    object.__setattr__(described_as, "wheels", wheels)
    stated = Stated(np.array([known[0], known[0], known[1]]))
    return find_mistakes(described_as, signals, motions_of(signals), stated)


def found(
    wheels: Wheels,
    signals: Signals,
    known: tuple[float, float],
    vehicle: VehicleConfiguration | None = None,
) -> list[str]:
    return [one.name for one in findings(wheels, signals, known, vehicle).mistakes]


def swapped(one: int, other: int) -> Callable[[np.ndarray], np.ndarray]:
    def change(values: np.ndarray) -> np.ndarray:
        values[:, [one, other]] = values[:, [other, one]]
        return values

    return change
