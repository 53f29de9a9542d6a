"""Measure the cost of a physics step of the Mecanum forklift: driving, braking, releasing.

The benchmark prints the fastest of several runs in microseconds per step and as real-time factor,
for calls of 20 steps and for one call.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
import output

from omni_platform.quantities import FloatArray
from omni_sim.vehicle.vehicle import Vehicle


def brake(vehicle: Vehicle, pedal: float, enables: Sequence[FloatArray], steps: int) -> None:
    vehicle.place((0.0, 0.0, 0.0), (10.0, 0.0, 0.0))
    for enable in enables:
        vehicle.advance(steps, pedal, enable, (10.0, 0.0, 0.0))


def main() -> None:
    options = output.options(__doc__, repeats=40)
    vehicle = Vehicle(output.load("straight_line", "unassisted").vehicle)
    random = np.random.default_rng(1)
    on = [np.ones(4)] * 100
    patterns = [random.integers(0, 2, 4).astype(np.float64) for _ in on]
    vehicle.advance(1, 0.0, np.ones(4), np.zeros(3))
    metrics: output.Metrics = {}
    for name, pedal, enables in (
        ("drive", 0.0, on),
        ("brake", 1.0, on),
        ("release_and_brake", 1.0, patterns),
    ):
        for label, used, steps in (("20_steps", enables, 20), ("one_call", enables[:1], 2000)):
            stop = partial(brake, vehicle, pedal, used, steps)
            cost = output.fastest(stop, options.repeats) / (len(used) * steps)
            metrics[f"step_time.{name}_{label}"] = 1e6 * cost, "us"
            metrics[f"times_real_time.{name}_{label}"] = vehicle.physics_step / cost, "1"
    output.publish("vehicle_step", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
