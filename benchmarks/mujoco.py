"""Compare the real-time factors of the forklift's wheel models and MuJoCo, by CPU time.

Each model brakes from 10 m/s straight ahead for one second, which is too short to stop, with a
physics step of 0.5 ms. The models run in turns, and the fastest of several runs counts. MuJoCo is
optional, see CONTRIBUTING.md.
"""

import dataclasses
import sys
from functools import partial
from pathlib import Path

import numpy as np
import output

from omni_sim.mujoco_import import load_mujoco
from omni_sim.vehicle.mujoco_vehicle import build_vehicle

LIMITS = {"single": 300.0, "rollers": 10.0}  # minimum ratio to MuJoCo's real-time factor


def main() -> None:
    options = output.options(__doc__, repeats=5)
    # This file has the same name as the package that it imports.
    sys.path[:] = [entry for entry in sys.path if Path(entry) != Path(__file__).resolve().parent]
    load_mujoco()
    vehicle = output.load("straight_line", "unassisted").vehicle
    best = dict.fromkeys((*LIMITS, "mujoco"), float("inf"))
    for _ in range(options.repeats):
        for name in best:
            configuration = dataclasses.replace(vehicle, wheel_model=name)
            machine = build_vehicle(configuration, twist=(10.0, 0.0, 0.0))
            run = partial(machine.advance, pedal=1.0, enable=np.ones(4), command_twist=np.zeros(3))
            run(1, traced=False)  # loads the kernels
            steps = round(1.0 / machine.physics_step)
            best[name] = min(best[name], output.fastest(partial(run, steps, traced=False), 1))
    metrics: output.Metrics = {
        f"real_time_factor.{name}": (1.0 / spent, "1") for name, spent in best.items()
    }
    for name, limit in LIMITS.items():
        metrics[f"times_mujoco.{name}"] = best["mujoco"] / best[name], "1", limit
    output.publish("mujoco", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
