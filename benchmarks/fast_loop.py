"""Cost of one run of the fast loop, from its configuration to its histories.

Run with ``./omni exec python benchmarks/fast_loop.py``.
"""

import time
from pathlib import Path

from omni_loop.compiled import run_fast_loop
from omni_loop.experiment import ExperimentLibrary

CONFIG = Path(__file__).resolve().parents[1] / "config"
REPEATS = 30
RUNS = (
    ("straight_line", "assisted"),
    ("three_wheel_diagonal", "assisted"),
    ("ice_patch_noisy", "noisy"),
    ("turn_while_translate", "unassisted"),
    ("turn_while_translate", "k1"),
)


def main() -> None:
    library = ExperimentLibrary(CONFIG)
    for experiment, variant in RUNS:
        configuration = library.load(experiment, variant, ["feedback=velocity_sensor"])
        run = run_fast_loop(configuration)
        best = float("inf")
        for _ in range(REPEATS):
            start = time.perf_counter()
            run_fast_loop(configuration)
            best = min(best, time.perf_counter() - start)
        simulated = (len(run.pedal) - 1) * run.period_ns * 1e-9
        print(
            f"{experiment:22s} {variant:12s} {1e3 * best:6.2f} ms for {simulated:.2f} s, "
            f"{simulated / best:6.0f} x real time"
        )


if __name__ == "__main__":
    main()
