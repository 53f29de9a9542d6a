"""Metrics compared with closed forms."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from omni_runs.history import RunHistory
from omni_runs.metrics import (
    REST_SPEED,
    Metric,
    rest_stamp,
    results_document,
    results_entry,
    run_metrics,
    still_rolls,
)

MakeHistory = Callable[..., RunHistory]
PERIOD = 0.01
# At 5 m/s^2 the speed falls below the criterion's this long before the end.
EARLY = REST_SPEED / 5.0


def test_straight_stop(make_history: MakeHistory) -> None:
    metrics = run_metrics(make_history(speed=10.0, deceleration=5.0, heading=0.4))
    assert metrics["stopping_distance"].value == pytest.approx(10.0**2 / (2 * 5.0), abs=1e-9)
    assert metrics["path_length"].value == pytest.approx(10.0, abs=1e-9)
    assert metrics["stopping_time"].value == pytest.approx(10.0 / 5.0 - EARLY, abs=PERIOD)
    assert metrics["orientation_change"].value == pytest.approx(0.0, abs=1e-9)
    assert metrics["lateral_deviation"].value == pytest.approx(0.0, abs=1e-9)
    assert metrics["peak_yaw_rate"].value == 0.0
    assert metrics["brake_switchings"].value == 0.0


@pytest.mark.parametrize("sign", [1, -1])
def test_orientation_counts_full_turns_without_sign(make_history: MakeHistory, sign: int) -> None:
    metrics = run_metrics(make_history(turn=sign * math.radians(500.0)))
    assert metrics["orientation_change"].value == pytest.approx(500.0, abs=1e-6)
    assert metrics["peak_yaw_rate"].value == pytest.approx(math.radians(500.0) / 2.0)


def quarter_circle(make_history: MakeHistory, radius: float, direction: int) -> RunHistory:
    """Return a vehicle that brakes along a quarter of a circle and faces along its path."""
    straight = make_history(brakes_at=0.0)
    traveled = straight.pose[:, 0]
    angle = direction * math.pi / 2.0 * traveled / traveled[-1]
    radius *= direction
    pose = np.column_stack((radius * np.sin(angle), radius * (1.0 - np.cos(angle)), angle))
    speed = abs(radius) * np.gradient(np.abs(angle), PERIOD)
    twist = np.column_stack((speed, 0 * speed, speed / radius))
    return make_history(brakes_at=0.0, pose=pose, twist=twist)


@pytest.mark.parametrize("direction", [1, -1])
def test_circular_arc(make_history: MakeHistory, direction: int) -> None:
    metrics = run_metrics(quarter_circle(make_history, 6.0, direction))
    assert metrics["stopping_distance"].value == pytest.approx(6.0 * math.sqrt(2.0), rel=1e-9)
    assert metrics["path_length"].value == pytest.approx(6.0 * math.pi / 2.0, rel=1e-3)
    assert metrics["lateral_deviation"].value == pytest.approx(6.0, rel=1e-9)
    assert metrics["orientation_change"].value == pytest.approx(90.0, abs=1e-9)


def test_metrics_do_not_depend_on_where_the_run_happens(make_history: MakeHistory) -> None:
    run = quarter_circle(make_history, 6.0, 1)
    cos, sin = math.cos(2.0), math.sin(2.0)
    turned = run.pose[:, :2] @ np.array([(cos, sin), (-sin, cos)]) + (5.0, -7.0)
    pose = np.column_stack((turned, run.pose[:, 2] + 2.0))
    moved = run_metrics(make_history(brakes_at=0.0, pose=pose, twist=run.twist))
    for name, metric in run_metrics(run).items():
        assert moved[name].value == pytest.approx(metric.value, rel=1e-9, nan_ok=True), name


def test_lateral_deviation_is_the_largest_not_the_last(make_history: MakeHistory) -> None:
    run = make_history()
    pose = run.pose.copy()
    pose[:, 1] -= 0.3 * np.sin(np.clip((run.time - 0.5) / 2.0, 0.0, 1.0) * math.pi)
    metrics = run_metrics(make_history(pose=pose))
    assert metrics["lateral_deviation"].value == pytest.approx(0.3, rel=1e-3)


def test_rocking_on_the_tires_does_not_delay_the_stop(make_history: MakeHistory) -> None:
    run = make_history(rest=1.0)
    after = np.maximum(run.time - 2.5, 0.0)
    twist = run.twist.copy()
    twist[:, 0] += 0.35 * np.sin(25.0 * after) * np.exp(-3.0 * after)
    metrics = run_metrics(make_history(rest=1.0, twist=twist))
    assert metrics["stopping_time"].value == pytest.approx(2.0 - EARLY, abs=PERIOD)


def test_a_vehicle_that_moves_on_has_not_stopped() -> None:
    twist = np.zeros((30, 3))
    twist[:10, 0] = 2.0
    assert rest_stamp(twist) == 10
    twist[20, 1] = -1.0
    assert rest_stamp(twist) == 21
    twist[29, 2] = 1.0
    assert rest_stamp(twist) is None


def test_turning_on_the_spot_is_no_rest() -> None:
    twist = np.zeros((30, 3))
    twist[:20, 2] = 0.5
    assert rest_stamp(twist) == 20


def test_a_history_that_ends_before_the_stop_gives_no_distance(make_history: MakeHistory) -> None:
    metrics = run_metrics(make_history(rest=-0.5))
    for name in ("stopping_distance", "path_length", "orientation_change", "stopping_time"):
        assert math.isnan(metrics[name].value)
        assert "rest" in metrics[name].note
    assert math.isfinite(metrics["twist_rmse"].value)


def test_the_order_of_the_metrics_does_not_depend_on_the_rest(make_history: MakeHistory) -> None:
    """A table lists the wheels below the total of their switchings, whatever run is the first."""
    stopped, moving = run_metrics(make_history()), run_metrics(make_history(rest=-0.5))
    assert list(moving) == list(stopped)


def test_a_stop_that_does_not_come_to_rest_with_the_pedal_down_is_reported(
    make_history: MakeHistory,
) -> None:
    stopped, moving = make_history(), make_history(rest=-0.5)
    released = dataclasses.replace(moving, pedal=np.append(moving.pedal[:-1], 0.0))
    never = dataclasses.replace(moving, pedal=np.zeros_like(moving.pedal))
    assert [still_rolls(run) for run in (stopped, moving, released, never)] == [
        False,
        True,
        False,
        False,
    ]


def test_without_the_pedal_there_is_no_braking(make_history: MakeHistory) -> None:
    metrics = run_metrics(make_history(pedal=np.zeros(301)))
    assert math.isnan(metrics["stopping_distance"].value)
    assert "pedal" in metrics["stopping_distance"].note


def test_braking_at_a_standstill_has_no_line(make_history: MakeHistory) -> None:
    still = run_metrics(make_history(twist=np.zeros((301, 3)), pose=np.zeros((301, 3))))
    assert still["stopping_distance"].value == 0.0
    assert math.isnan(still["lateral_deviation"].value)
    assert "standstill" in still["lateral_deviation"].note


def test_switchings_are_counted_per_wheel_while_stopping(make_history: MakeHistory) -> None:
    enable = np.ones((301, 4))
    enable[50:60, 0] = 0.0  # with the pedal at 0.5 s: off and on
    enable[100:200:2, 1] = 0.0  # fifty times off and on
    enable[10:20, 2] = 0.0  # before the pedal
    enable[280:290, 3] = 0.0  # after the stop at 2.5 s
    metrics = run_metrics(make_history(enable=enable))
    counts = [metrics[f"brake_switchings.{name}"].value for name in make_history().wheel_names]
    assert counts == [2.0, 100.0, 0.0, 0.0]
    assert metrics["brake_switchings"].value == 102.0


def test_missing_enables_are_no_switchings(make_history: MakeHistory) -> None:
    enable = np.ones((301, 4))
    enable[100:110] = np.nan
    assert run_metrics(make_history(enable=enable))["brake_switchings"].value == 0.0
    none = run_metrics(make_history(enable=np.full((301, 4), np.nan)))
    assert math.isnan(none["brake_switchings"].value)


def test_odometry_error_is_that_of_the_velocity_vector(make_history: MakeHistory) -> None:
    run = make_history(turn=1.0)
    metrics = run_metrics(make_history(turn=1.0, estimate=run.twist + np.array([0.3, -0.4, 0.02])))
    assert metrics["twist_rmse"].value == pytest.approx(0.5, rel=1e-9)
    assert metrics["yaw_rate_rmse"].value == pytest.approx(0.02, rel=1e-9)


def test_odometry_error_of_white_noise(make_history: MakeHistory) -> None:
    run = make_history(rest=30.0)
    noise = np.random.default_rng(5).normal(0.0, (0.1, 0.1, 0.05), run.twist.shape)
    metrics = run_metrics(make_history(rest=30.0, estimate=run.twist + noise))
    # The relative standard error of an rms over n values is 1 / sqrt(2 n).
    assert metrics["twist_rmse"].value == pytest.approx(0.1 * math.sqrt(2.0), rel=0.06)
    assert metrics["yaw_rate_rmse"].value == pytest.approx(0.05, rel=0.06)


def test_only_measured_stamps_count_for_the_odometry(make_history: MakeHistory) -> None:
    run = make_history()
    estimate, variance = run.twist + 0.0, run.estimate_variance.copy()
    estimate[:100] = 99.0
    variance[:100] = 1e6
    metrics = run_metrics(make_history(estimate=estimate, estimate_variance=variance))
    assert metrics["twist_rmse"].value == 0.0
    blind = run_metrics(make_history(estimate=np.full((301, 3), np.nan)))
    assert math.isnan(blind["twist_rmse"].value)
    assert blind["twist_rmse"].note


def test_document_names_cases_and_is_strict_json() -> None:
    document = results_document(
        "table2",
        {
            "k7": {
                "orientation_change": Metric(26.1, "deg", reference=26.3, at_most=30.0),
                "brake_switchings.rear_left": Metric(3.0, "1"),
                "stopping_time": Metric(math.nan, "s", note="why"),
                "path_length": Metric(math.inf, "m"),
            }
        },
    )
    assert json.loads(json.dumps(document, allow_nan=False)) == {
        "name": "table2",
        "metrics": {
            "orientation_change.k7": {
                "value": 26.1,
                "unit": "deg",
                "reference": 26.3,
                "at_most": 30.0,
                "status": "met",
            },
            "brake_switchings.k7_rear_left": {
                "value": 3.0,
                "unit": "1",
                "variant": "k7",
                "wheel": "rear_left",
            },
            "stopping_time.k7": {"value": None, "unit": "s", "note": "why"},
            "path_length.k7": {"value": None, "unit": "m"},
        },
    }


@pytest.mark.parametrize(
    ("value", "limits", "status"),
    [
        (1.0, {}, ""),
        (1.0, {"at_most": 1.0}, "met"),
        (1.1, {"at_most": 1.0}, "missed"),
        (1.0, {"at_least": 1.0}, "met"),
        (0.9, {"at_least": 1.0}, "missed"),
        (0.5, {"at_least": 0.4, "at_most": 0.6}, "met"),
        (math.nan, {"at_most": 1.0}, "missed"),
        (math.nan, {"at_least": 1.0}, "missed"),
    ],
)
def test_a_limit_is_met_or_missed(value: float, limits: dict[str, Any], status: str) -> None:
    metric = Metric(value, "1", **limits)
    assert metric.status == status
    assert results_entry(metric).get("status", "") == status


def test_fail_safe_counts_the_faults_between_pedal_and_rest(make_history: MakeHistory) -> None:
    run = make_history(speed=10.0, deceleration=5.0)
    start = run.brake_start
    rest = rest_stamp(run.twist, start or 0)
    assert start
    assert rest
    states = ["low_confidence"] * start + ["assisting"] * (len(run.stamp_ns) - start)
    states[start + 2 : start + 12] = ["time_jump"] * 3 + ["low_confidence"] * 7
    states[rest + 1 :] = ["stale_feedback"] * (len(states) - rest - 1)
    metric = run_metrics(dataclasses.replace(run, assist_state=tuple(states)))["fail_safe_share"]
    assert metric.value == pytest.approx(10 / (rest + 1 - start))
    assert "low confidence" in metric.note
    assert math.isnan(run_metrics(run)["fail_safe_share"].value)
