"""Measure how long the brake assistant takes to answer: median, p99, p99.9 and the longest.

The demands are those of stops from 10 m/s, one after the other, with twist, wheel speeds and IMU.
CPU time is what the answer costs, wall-clock time what a vehicle waits for on a machine as busy as
this one.
"""

import argparse
import gc
import time
from pathlib import Path

import numpy as np

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_loop.compiled import run_fast_loop
from omni_loop.experiment import ExperimentLibrary
from omni_platform.signals import ImuSample, TwistSample, WheelSample

CONFIG = Path(__file__).parents[1] / "config"
BLIND = ("feedback=velocity_sensor", "simulation.render_lines=false")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=0.5, help="of answers for each law")
    minutes = parser.parse_args().minutes
    gc.collect()
    gc.freeze()
    for law in ("sliding_mode", "allocation"):
        changes = (*BLIND, f"brake_assist.law={law}")
        configuration = ExperimentLibrary(CONFIG).load("straight_line", "assisted", changes)
        run = run_fast_loop(configuration)
        force = np.diff(run.twist[:, :2], axis=0, prepend=run.twist[:1, :2]) * 1e9 / run.period_ns
        assist, covariance = BrakeAssist(configuration.brake_assist), 1e-6 * np.eye(3)
        times, costs, stamp_ns, end = [], [], 0, time.perf_counter() + 60.0 * minutes
        while time.perf_counter() < end:
            for k, pedal in enumerate(run.pedal):
                demand = BrakeDemand(
                    stamp_ns,
                    float(pedal),
                    TwistSample(stamp_ns, run.twist[k], covariance),
                    WheelSample(stamp_ns, run.record.wheel_speed[k]),
                    ImuSample(stamp_ns, float(run.twist[k, 2]), force[k]),
                )
                before, spent = time.perf_counter_ns(), time.thread_time_ns()
                assist.update(demand)
                costs.append(time.thread_time_ns() - spent)
                times.append(time.perf_counter_ns() - before)
                stamp_ns += run.period_ns
            stamp_ns += 10**9  # the next stop has nothing to do with this one
        for name, values in (("CPU", costs), ("wall clock", times)):
            p50, p99, p999 = np.percentile(values, (50.0, 99.0, 99.9)) / 1e3
            print(
                f"{law:13s} {name:10s} {len(values)} answers: median {p50:.0f} us, "
                f"p99 {p99:.0f} us, p99.9 {p999:.0f} us, longest {max(values) / 1e3:.0f} us"
            )


if __name__ == "__main__":
    main()
