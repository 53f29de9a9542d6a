"""Measure the CPU time of one run of the fast loop, from its configuration to its histories.

Run with ``./omni exec python benchmarks/fast_loop.py``; the fastest of several runs counts.
"""

from functools import partial

import output

from omni_runs.compiled import run_fast_loop

ALONE = "brake_assist.fault_detection=false"
RUNS = {
    "sliding_mode": ("straight_line", "assisted", ALONE),
    "sliding_mode_with_fault_detection": ("straight_line", "assisted"),
    "allocation": ("straight_line", "allocation", ALONE),
    "allocation_with_fault_detection": ("straight_line", "allocation"),
    "turn_while_translate": ("turn_while_translate", "k1", ALONE),
}


def main() -> None:
    options = output.options(__doc__, repeats=30)
    metrics: output.Metrics = {}
    for case, (experiment, variant, *changes) in RUNS.items():
        configuration = output.load(experiment, variant, *changes, "feedback=velocity_sensor")
        run = run_fast_loop(configuration)
        best = output.fastest(partial(run_fast_loop, configuration), options.repeats)
        simulated = run.time[-1]
        metrics[f"cpu_time.{case}"] = 1e3 * best, "ms"
        metrics[f"times_real_time.{case}"] = simulated / best, "1"
    output.publish("fast_loop", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
