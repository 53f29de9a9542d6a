"""CPU time of one run of the fast loop, from its configuration to its histories.

Run with ``./omni exec python benchmarks/fast_loop.py``; the fastest of several runs counts.
"""

import argparse
import json
import time
from pathlib import Path

from omni_loop.compiled import run_fast_loop
from omni_loop.experiment import ExperimentLibrary

CONFIG = Path(__file__).resolve().parents[1] / "config"
REPEATS = 30
ALONE = "brake_assist.fault_detection=false"
RUNS = {
    "sliding_mode": ("straight_line", "assisted", ALONE),
    "sliding_mode_with_fault_detection": ("straight_line", "assisted"),
    "allocation": ("straight_line", "allocation", ALONE),
    "allocation_with_fault_detection": ("straight_line", "allocation"),
    "turn_while_translate": ("turn_while_translate", "k1", ALONE),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one document for programs")
    options = parser.parse_args()
    library = ExperimentLibrary(CONFIG)
    metrics = {}
    for case, (experiment, variant, *changes) in RUNS.items():
        changes.append("feedback=velocity_sensor")
        configuration = library.load(experiment, variant, changes)
        run = run_fast_loop(configuration)
        best = float("inf")
        for _ in range(REPEATS):
            start = time.process_time()
            run_fast_loop(configuration)
            best = min(best, time.process_time() - start)
        simulated = (len(run.pedal) - 1) * run.period_ns * 1e-9
        metrics[f"cpu_time.{case}"] = {"value": 1e3 * best, "unit": "ms"}
        metrics[f"times_real_time.{case}"] = {"value": simulated / best, "unit": "1"}
        if not options.json:
            print(f"{case:30s} {1e3 * best:6.2f} ms, {simulated / best:6.0f} x real time")
    if options.json:
        print(json.dumps({"name": "fast_loop", "metrics": metrics}))


if __name__ == "__main__":
    main()
