"""Stops that lose a brake or come onto ice, beside the bound for stops that keep the heading."""

import dataclasses
import functools
import math
from pathlib import Path

import numpy as np
import pytest

from omni_brake_assist.laws.law import NO_WHEEL
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentLibrary
from omni_sim.vehicle.configuration import WheelCondition
from omni_studies.campaign.brake_detection import detection
from omni_studies.campaign.drawn_faults import SensorFault
from omni_studies.campaign.lost_brakes import THREE_WHEELS, metrics
from omni_studies.campaign.sensor_faults import LAWS, FaultyStops, Setting, StopWithFault

LIBRARY = ExperimentLibrary(Path(__file__).parents[4] / "config")
_SETTING = Setting("sliding_mode", True, "six_wheels")


def _lost(onset: float) -> SensorFault:
    return SensorFault("brake", "brake", 0, onset, 0.0, 0.1)


@pytest.fixture(scope="module")
def stops() -> FaultyStops:
    return FaultyStops(LIBRARY)


def test_a_lost_brake_has_a_bound_that_a_later_loss_lowers(stops: FaultyStops) -> None:
    early, late = (stops.run(_SETTING, _lost(onset)) for onset in (-9.0, 0.5))
    # With the loss from the start, all brakes on is the reference of the stop and of its bound.
    assert early.bound <= 1.0
    assert late.bound / late.all_on_distance <= 1.02
    found = metrics([early, late])
    assert found["runs.sliding_mode_imu_brake_lost_before"].value == 1
    ratio = found["over_bound_worst.sliding_mode_imu_brake_lost_during"]
    assert ratio.value == pytest.approx(late.distance / late.bound)


def test_only_a_lost_brake_of_a_vehicle_that_does_not_rotate_has_a_bound(
    stops: FaultyStops,
) -> None:
    stuck = stops.run(_SETTING, SensorFault("brake", "stuck_brake", 0, 0.5, 0.5, 0.1))
    rotating = stops.run(Setting("sliding_mode", True, "turn_while_translate"), _lost(0.5))
    assert stuck.bound == rotating.bound == 0.0
    assert "bounded.sliding_mode_imu_brake_lost_during" not in metrics([stuck])


def test_ice_lengthens_the_shortest_stop_that_keeps_the_heading(stops: FaultyStops) -> None:
    slippery, little = (
        stops.run(_SETTING, SensorFault("ground", "ice", 0, 0.3, friction, 0.1))
        for friction in (0.1, 0.9)
    )
    assert slippery.bound > 1.5  # no controller can keep the heading within the limit
    assert little.bound < 1.0
    found = metrics([slippery, little])
    assert found["impossible.sliding_mode_imu_event_ice"].value == 1
    ratio = found["over_bound_impossible.sliding_mode_imu_event_ice"]
    assert ratio.value == pytest.approx(slippery.distance / slippery.bound)


@pytest.mark.safety(
    "the stop is longer or rotates more",
    "ice under one side of the vehicle from the middle of the stop on, with the law `allocation`",
    "the law keeps the heading: the stop is at most 1.15 times as long as the shortest one that "
    "keeps heading and line, and rotates by at most 10 deg more than with all brakes on",
    within="the whole stop",
)
@pytest.mark.parametrize(("onset", "friction"), [(0.3, 0.2), (0.6, 0.3), (0.9, 0.15)])
def test_a_stop_on_ice_is_nearly_the_shortest_that_keeps_the_heading(
    stops: FaultyStops, onset: float, friction: float
) -> None:
    ice = SensorFault("ground", "ice", 0, onset, friction, 0.1)
    stop = stops.run(Setting("allocation", True, "straight_line"), ice)
    assert stop.rotation <= 10.0
    assert stop.distance <= 1.15 * stop.bound


@functools.cache
def _longest_delay(law: str, case: str, *, imu: bool) -> float:
    """Return the longest delay with which the loss of any brake at 0.3 s is reported [s]."""
    base = FaultyStops(LIBRARY)._bases[Setting(law, imu, case), True]
    time, delays = base.maneuver.brake_time + 0.3, []
    for k, name in enumerate(base.vehicle.wheels):
        lost = {name: WheelCondition(brake=0.0, onset=time)}
        vehicle = dataclasses.replace(base.vehicle, conditions=lost)
        run = run_fast_loop(dataclasses.replace(base, vehicle=vehicle))
        found = detection(run, base, k, time)
        delays.append(found.found - found.observable)
    return max(math.inf if math.isnan(delay) else delay for delay in delays)


@pytest.mark.safety(
    "a brake does not follow its command",
    "any brake of a vehicle on four or six wheels loses its torque during the stop, in the closed "
    "loop without an IMU",
    "brake monitor, as in the row above",
    within=0.45,
)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("case", ["straight_line", "diagonal", "slippery", "six_wheels"])
def test_without_an_imu_a_lost_brake_is_found(law: str, case: str, within: float) -> None:
    assert _longest_delay(law, case, imu=False) <= within


@pytest.mark.parametrize("case", ["straight_line", "diagonal", "six_wheels"])
def test_an_imu_shortens_the_detection(case: str) -> None:
    longest = _longest_delay("allocation", case, imu=True)
    assert longest <= min(0.2, _longest_delay("allocation", case, imu=False))


@pytest.mark.parametrize(
    ("pedal", "settings"),
    [
        (0.2, ["vehicle.brake.kind=proportional"]),
        (0.06, ["vehicle.brake.dead_time=0.05", "maneuver.speed=9.1"]),
    ],
)
def test_working_brakes_are_not_reported_in_a_gentle_stop(
    pedal: float, settings: list[str]
) -> None:
    changes = ["encoders.resolution=4096", "brake_assist.law=allocation", f"maneuver.pedal={pedal}"]
    base = LIBRARY.load("straight_line", "assisted", [*WITHOUT_CAMERAS, *changes, *settings])
    run = run_fast_loop(base)
    assert run.stopped
    assert run.failed == NO_WHEEL


def test_a_loss_is_observable_when_the_brake_is_commanded() -> None:
    base = FaultyStops(LIBRARY)._bases[Setting("allocation", True, "straight_line"), True]
    run = run_fast_loop(base)
    released = run.enable.copy()
    released[:, 1] = 0.0
    released[run.stamp_ns >= 0.8e9, 1] = 0.01  # 15 N m change 1250 kg by less than the noise
    idle = dataclasses.replace(run, enable=released)
    assert detection(run, base, 1, 0.5).observable == pytest.approx(0.0)
    assert math.isnan(detection(run, base, 1, 0.5).found)
    assert math.isnan(detection(idle, base, 1, 0.5).observable)
    commanded = np.where(run.stamp_ns[:, np.newaxis] >= 0.8e9, 0.5, released)
    again = dataclasses.replace(run, enable=commanded)
    assert detection(again, base, 1, 0.5).observable == pytest.approx(0.3)
    assert math.isnan(detection(again, base, 1, 30.0).observable)  # at rest


def test_brakes_are_counted_by_what_can_be_observed(stops: FaultyStops) -> None:
    stop = stops.run(_SETTING, _lost(0.3))
    assert np.isfinite(stop.observable + stop.found)
    assert not stop.false_brake
    rows = [
        stop._replace(observable=0.1, found=0.2),
        stop._replace(observable=0.1, found=0.4),
        stop._replace(observable=0.1, found=math.nan),
        stop._replace(observable=math.nan, found=math.nan),
    ]
    group = "sliding_mode_imu_brake_lost_during"
    found = {name: metric.value for name, metric in metrics(rows).items()}
    assert found[f"never_observable.{group}"] == 1
    assert found[f"found.{group}"] == pytest.approx(200.0 / 3.0)
    assert found[f"delay_median.{group}"] == pytest.approx(0.2)
    assert found[f"delay_worst.{group}"] == pytest.approx(0.3)


def test_three_wheels_are_counted_with_and_without_the_assistant(stops: FaultyStops) -> None:
    stop = stops.run(Setting("sliding_mode", True, THREE_WHEELS), _lost(0.3))
    assert not stop.rest  # the vehicle circles
    assert not stop.counted
    rows: list[StopWithFault] = [
        stop,
        stop._replace(rest=1),
        stop._replace(counted=1),
        stop._replace(counted=1, rest=1),
    ]
    found = {name: metric.value for name, metric in metrics(rows).items()}
    assert found["runs.sliding_mode_three_wheels"] == 4
    assert found["not_at_rest.sliding_mode_three_wheels"] == 2
    assert found["not_at_rest_all_on.sliding_mode_three_wheels"] == 2
    assert found["not_at_rest_assisted_alone.sliding_mode_three_wheels"] == 1
