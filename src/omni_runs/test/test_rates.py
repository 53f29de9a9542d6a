"""Rates of IMU, twist and control steps."""

from pathlib import Path

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.sources import ISOLATED
from omni_core.geometry import PlatformGeometry
from omni_core.quantities import FloatArray
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.loop import SensorEstimator, run_closed_loop, steps
from omni_sim.simulator import Simulator

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")
ALLOCATION = "brake_assist.law=allocation", "vehicle.brake.kind=proportional"
NOISY = (
    "velocity_sensor.sample_time=0.02",
    "velocity_sensor.linear_noise=0.05",
    "velocity_sensor.yaw_rate_noise=0.05",
)

LOST = "faults.lost.channel=twist", "faults.lost.kind=drop_out", "faults.lost.time=1.3"


def load(*changes: str) -> ExperimentConfiguration:
    plain = "feedback=velocity_sensor", "simulation.render_lines=false", *ALLOCATION
    return LIBRARY.load("straight_line", "assisted", [*plain, *changes])


@pytest.mark.parametrize("rate", [50, 130, 400])
def test_both_loops_read_the_same_imu_at_any_rate(rate: int) -> None:
    changes = (f"imu.rate={rate}", "simulation.duration_limit=1.5", *NOISY)
    fast, slow = run_fast_loop(load(*changes)), run_closed_loop(load(*changes))
    np.testing.assert_array_equal(fast.enable, slow.enable)
    np.testing.assert_array_equal(fast.twist, slow.twist)


@pytest.mark.parametrize("rate", [50, 130, 400, 1000])
def test_readings_have_the_rate_and_the_noise_density_of_the_imu(rate: int) -> None:
    simulator = Simulator(load(f"imu.rate={rate}", "maneuver.speed=0.1"))
    readings = [*simulator.observe().imu]
    for _ in range(300):
        simulator.advance(np.ones(4))
        readings += simulator.observe().imu
    assert len(readings) == int(3.0 * 1e9 / round(1e9 / rate)) + 1
    stamps = np.array([reading.stamp_ns for reading in readings])
    due = np.arange(len(stamps)) * 1e9 / rate
    assert np.max(np.abs(stamps - due)) <= 500_000  # a physics step
    noise = np.std([reading.yaw_rate for reading in readings])
    assert noise == pytest.approx(0.003 * (rate / 100.0) ** 0.5, rel=0.25)


@pytest.mark.parametrize("rate", [50, 400, 1000])
@pytest.mark.parametrize("changes", [(), NOISY, LOST])
def test_a_stop_does_not_depend_on_the_rate_of_the_imu(rate: int, changes: tuple[str, ...]) -> None:
    usual, other = run_fast_loop(load(*changes)), run_fast_loop(load(f"imu.rate={rate}", *changes))
    assert other.stopping_distance == pytest.approx(usual.stopping_distance, rel=0.01)
    assert other.orientation_change == pytest.approx(usual.orientation_change, abs=0.5)


@pytest.mark.parametrize("period", [0.005, 0.02, 0.025, 0.04])
def test_a_stop_hardly_depends_on_the_control_period(period: float) -> None:
    usual = run_fast_loop(load())
    other = run_fast_loop(load(f"simulation.control_period={period}"))
    lost = 10.0 * max(period - 0.01, 0.0) / 2.0  # initial speed times the longer mean delay
    assert other.stopping_distance - lost == pytest.approx(usual.stopping_distance, rel=0.03)
    assert other.orientation_change == pytest.approx(usual.orientation_change, abs=1.0)


class BrakeTheSpin:
    """The law of docs/extending.md, which switches brakes in nearly every step."""

    def __init__(self, _: object, geometry: PlatformGeometry) -> None:
        self.active, self.lever = geometry.active, geometry.lever

    def step(self, motion: Motion, error: FloatArray, enable: FloatArray) -> None:
        sliding = self.active @ (motion.v_x, motion.v_y) + self.lever * motion.yaw_rate
        error[:] = -np.sign(sliding) * self.lever * motion.yaw_rate
        enable[:] = error < 0.0


class RandomShares:
    """A law that writes shares of the brake pressure, although the valves are on-off valves."""

    def __init__(self, *_: object) -> None:
        self.generator = np.random.default_rng(1)

    def step(self, _: Motion, __: FloatArray, enable: FloatArray) -> None:
        enable[:] = self.generator.random(enable.size)


@pytest.mark.parametrize("cls", [BrakeTheSpin, RandomShares])
@pytest.mark.parametrize("experiment", ["small_stop", "straight_line", "turn_while_translate"])
def test_a_law_that_switches_brakes_in_every_step_makes_no_encoder_faulty(
    experiment: str, cls: type
) -> None:
    law = f"brake_assist.law={__name__}:{cls.__name__}"
    plain = "feedback=velocity_sensor", "simulation.render_lines=false", law
    variant = LIBRARY.variants(experiment)[-1]
    configuration = LIBRARY.load(experiment, variant, plain)
    assist, isolated = BrakeAssist(configuration.brake_assist), set()
    for moment in steps(Simulator(configuration), SensorEstimator(), assist):
        isolated |= {one.name for one in assist.sources() if one.state == ISOLATED}
        if moment.observation.stamp_ns > 4_000_000_000:
            break
    assert isolated == set()


def test_the_swing_of_a_vehicle_on_its_tires_at_the_end_of_a_stop_is_no_fault() -> None:
    changes = "vehicle=six_wheel_mecanum", "maneuver.speed=2.165", "maneuver.direction_deg=-97"
    run = run_fast_loop(load(*changes, "vehicle.tire.stiffness=100000"))
    assert run.stopped
    assert np.all(run.valid[run.brake_start :])


def test_the_assistant_has_the_control_period_of_the_simulation() -> None:
    period = "simulation.control_period=0.005"
    assert load(period).brake_assist.control_period == 0.005
    assert load(period, "brake_assist.control_period=0.01").brake_assist.control_period == 0.01
