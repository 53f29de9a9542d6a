"""Measure the duration of a step of the brake assistant: median, p99, p99.9 and maximum.

The demands are those of stops from 10 m/s, one after the other, with twist, wheel speeds and IMU.
The CPU time is the cost of a step. The wall-clock time is the delay of a step on a machine with the
same load.
"""

import gc
import time

import numpy as np
import output

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_core.quantities import SECOND_NS
from omni_core.signals import ImuSample, TwistSample, WheelSample
from omni_runs.compiled import run_fast_loop


def main() -> None:
    options = output.options(__doc__, minutes=0.5)
    metrics: output.Metrics = {}
    gc.collect()
    gc.freeze()
    for law in ("sliding_mode", "allocation"):
        configuration = output.load(
            "straight_line", "assisted", *output.BLIND, f"brake_assist.law={law}"
        )
        run = run_fast_loop(configuration)
        change = np.diff(run.twist[:, :2], axis=0, prepend=run.twist[:1, :2])
        period_ns = int(run.stamp_ns[1])
        force = change * SECOND_NS / period_ns
        assist, covariance = BrakeAssist(configuration.brake_assist), 1e-6 * np.eye(3)
        times, costs, stamp_ns = [], [], 0
        end = time.perf_counter() + 60.0 * options.minutes
        while time.perf_counter() < end:
            for k, pedal in enumerate(run.pedal):
                demand = BrakeDemand(
                    stamp_ns,
                    float(pedal),
                    TwistSample(stamp_ns, run.twist[k], covariance),
                    WheelSample(stamp_ns, run.wheel_speed[k]),
                    ImuSample(stamp_ns, float(run.twist[k, 2]), force[k]),
                )
                before, spent = time.perf_counter_ns(), time.thread_time_ns()
                assist.update(demand)
                costs.append(time.thread_time_ns() - spent)
                times.append(time.perf_counter_ns() - before)
                stamp_ns += period_ns
            stamp_ns += SECOND_NS  # separates the next stop from this one
        for kind, values in (("cpu_time", costs), ("wall_time", times)):
            for name, share in (("p50", 50.0), ("p99", 99.0), ("p99_9", 99.9), ("longest", 100.0)):
                metrics[f"{kind}_{name}.{law}"] = 1e-3 * float(np.percentile(values, share)), "us"
        metrics[f"answers.{law}"] = len(times), "1"
    output.publish("assistant_step", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
