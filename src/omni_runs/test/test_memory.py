"""Long campaigns do not use more memory: kernels free every array, and runs leave no cycles."""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from linescan_odometry.port import OdometryPort
from omni_brake_assist.configuration import LAWS
from omni_core import background
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.loop import LineEstimator
from omni_sim.simulator import Simulator

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")
SENSOR = ("feedback=velocity_sensor", "simulation.render_lines=false")


def _kept(work: Callable[[], object], times: int) -> int:
    """Do some work `times` times; return the number of kernel arrays that are not freed."""
    work()  # arrays that are created once are no leak
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for _ in range(times):
            work()
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    made, freed = after.mi_alloc - before.mi_alloc, after.mi_free - before.mi_free
    return int(made - freed)


@pytest.mark.parametrize("brakes", ["proportional", "on_off"])
@pytest.mark.parametrize("law", LAWS)
def test_stops_keep_no_memory(law: str, brakes: str) -> None:
    changes = (*SENSOR, f"brake_assist.law={law}", f"vehicle.brake.kind={brakes}")
    configuration = LIBRARY.load("small_stop", "assisted", changes)
    assert _kept(lambda: run_fast_loop(configuration), 25) <= 0  # 50 of every law


def test_steps_of_simulator_and_odometry_keep_no_memory() -> None:
    configuration = LIBRARY.load("small_stop", "assisted")
    simulator = Simulator(configuration)
    odometry = LineEstimator(OdometryPort("", configuration.odometry))
    enable = np.ones(len(configuration.vehicle.wheels))

    def step() -> None:
        odometry.estimate(simulator.observe())
        simulator.advance(enable)

    for _ in range(30):  # buffers fill up
        step()
    assert _kept(step, 250) <= 2  # the results of the last step may hold other arrays


@pytest.mark.parametrize("alone", ["1", ""], ids=["one thread", "two threads"])
def test_a_run_with_lines_is_freed_without_a_garbage_collection(
    alone: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(background.ALONE, alone)
    background._thread.cache_clear()
    configuration = LIBRARY.load("small_stop", "assisted")
    enable = np.ones(len(configuration.vehicle.wheels))

    def run() -> None:
        simulator = Simulator(configuration)
        odometry = LineEstimator(OdometryPort("", configuration.odometry))
        for _ in range(3):
            odometry.estimate(simulator.observe())
            simulator.advance(enable)

    run()
    gc.collect()
    gc.set_debug(gc.DEBUG_SAVEALL)
    try:
        run()
        gc.collect()
        modules = {type(one).__module__.split(".")[0] for one in gc.garbage}
    finally:
        gc.set_debug(0)
        gc.garbage.clear()
        background._thread.cache_clear()
    assert not modules & {"omni_sim", "linescan_odometry", "omni_runs"}
