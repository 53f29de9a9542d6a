"""Real-time factors of the forklift's wheel models compared with MuJoCo's, by processor time.

All brake from 10 m/s straight ahead with a physics step of 0.5 ms, in turns; the fastest of several
runs counts. With ``--json`` one document for programs. MuJoCo is optional, see CONTRIBUTING.md.
"""

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path

import numpy as np

from omni_loop.experiment import ExperimentLibrary
from omni_sim.vehicle.mujoco_vehicle import build_vehicle, load_mujoco

CONFIG = Path(__file__).resolve().parents[1] / "config"
DURATION, REPEATS = 1.0, 5  # [s] simulated, while the vehicle still moves; [1]
ENGINES = ("single", "rollers", "mujoco")
LIMITS = {"single": 300.0, "rollers": 10.0}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one document for programs")
    arguments = parser.parse_args()
    # This file has the name of the package that it measures.
    sys.path[:] = [entry for entry in sys.path if Path(entry) != CONFIG.parent / "benchmarks"]
    load_mujoco()
    vehicle = ExperimentLibrary(CONFIG).load("straight_line", "unassisted").vehicle
    best = dict.fromkeys(ENGINES, float("inf"))
    for _ in range(REPEATS):
        for name in ENGINES:
            configuration = dataclasses.replace(vehicle, wheel_model=name)
            machine = build_vehicle(configuration, twist=(10.0, 0.0, 0.0))
            machine.advance(1, 1.0, np.ones(4), np.zeros(3), traced=False)  # loads the kernel
            steps = round(DURATION / machine.physics_step)
            begin = time.process_time()
            machine.advance(steps, 1.0, np.ones(4), np.zeros(3), traced=False)
            best[name] = min(best[name], time.process_time() - begin)
    factors = {name: DURATION / spent for name, spent in best.items()}
    metrics = {
        f"real_time_factor.{name}": {"value": factor, "unit": "1"}
        for name, factor in factors.items()
    }
    for name, limit in LIMITS.items():
        ratio = factors[name] / factors["mujoco"]
        metrics[f"times_mujoco.{name}"] = {"value": ratio, "unit": "1", "limit": limit}
    if arguments.json:
        print(json.dumps({"name": "mujoco", "metrics": metrics}))
        return
    for name, factor in factors.items():
        ratio = factor / factors["mujoco"]
        print(f"{name:8s} {factor:7.1f} x real time, {ratio:6.1f} x MuJoCo")


if __name__ == "__main__":
    main()
