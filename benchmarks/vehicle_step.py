"""Measure the cost of a physics step of the Mecanum forklift: driving, braking, releasing.

Prints the fastest of several runs, in microseconds per step and as real-time factor.
"""

import time
from pathlib import Path

import numpy as np
import yaml

from omni_platform.configuration import from_mapping
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

CONFIG = Path(__file__).parents[1] / "config"
STEPS = 20
PERIODS = 100
REPEATS = 40


def forklift() -> VehicleConfiguration:
    mapping = yaml.safe_load((CONFIG / "vehicles" / "mecanum_forklift.yaml").read_text())
    mapping["tire"] = yaml.safe_load((CONFIG / "tires" / f"{mapping['tire']}.yaml").read_text())
    return from_mapping(VehicleConfiguration, mapping)


def seconds(vehicle: Vehicle, pedal: float, enables: list[np.ndarray], steps: int) -> float:
    best = float("inf")
    for _ in range(REPEATS):
        vehicle.place((0.0, 0.0, 0.0), (10.0, 0.0, 0.0))
        start = time.process_time()
        for enable in enables:
            vehicle.advance(steps, pedal, enable, (10.0, 0.0, 0.0))
        best = min(best, time.process_time() - start)
    return best


def main() -> None:
    vehicle = Vehicle(forklift())
    random = np.random.default_rng(1)
    on = [np.ones(4)] * PERIODS
    patterns = [random.integers(0, 2, 4).astype(np.float64) for _ in range(PERIODS)]
    cases = {
        "drive": (0.0, on),
        "brake": (1.0, on),
        "release and brake": (1.0, patterns),
    }
    vehicle.advance(1, 0.0, np.ones(4), np.zeros(3))
    for name, (pedal, enables) in cases.items():
        for label, used, steps in (
            (f"{STEPS} steps a call", enables, STEPS),
            ("one call", enables[:1], STEPS * PERIODS),
        ):
            cost = seconds(vehicle, pedal, used, steps) / (len(used) * steps)
            factor = vehicle.physics_step / cost
            print(f"{name:18s} {label:16s} {1e6 * cost:6.3f} us/step, {factor:6.0f} x real time")


if __name__ == "__main__":
    main()
