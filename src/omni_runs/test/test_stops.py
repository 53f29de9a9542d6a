"""A drive is divided into its stops, and the drift of the odometry is the integral of its error."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from omni_runs.drift import absolute_error, drift_metrics, odometry_path, relative_error
from omni_runs.history import RunHistory
from omni_runs.metrics import run_metrics
from omni_runs.stops import drive_metrics, named_stops, stops_of

PERIOD = 0.01  # [s]


def drive(*parts: tuple[float, float, float, float], scale: float = 1.0) -> RunHistory:
    """Return a straight drive; a part is (duration, speed before, speed after, pedal)."""
    speed = np.concatenate([np.linspace(a, b, round(t / PERIOD)) for t, a, b, _ in parts])
    pedal = np.concatenate([np.full(round(t / PERIOD), p) for t, _, _, p in parts])
    stamps = len(speed)
    twist = np.column_stack((speed, np.zeros((stamps, 2))))
    pose = np.zeros((stamps, 3))
    pose[1:, 0] = np.cumsum(speed[1:]) * PERIOD
    return RunHistory.from_samples(
        wheel_names=("left", "right"),
        stamp_ns=np.arange(stamps) * round(PERIOD * 1e9),
        pose=pose,
        twist=twist,
        wheel_angle=np.zeros((stamps, 2)),
        wheel_speed=np.zeros((stamps, 2)),
        brake_torque=np.zeros((stamps, 2)),
        enable=np.ones((stamps, 2)),
        error=np.zeros((stamps, 2)),
        pedal=pedal,
        estimate=twist * scale,
        estimate_variance=np.ones((stamps, 3)),
        assist_state=["inactive"] * stamps,
    )


PARKED = (20.0, 0.0, 0.0, 1.0)
AWAY = (2.0, 0.0, 4.0, 0.0)
STOP = (1.0, 4.0, 0.0, 1.0)
STILL = (2.0, 0.0, 0.0, 1.0)
TAP = (0.5, 4.0, 3.0, 0.4)
ON = (2.0, 3.0, 3.0, 0.0)
SLOW_STOP = (1.0, 3.0, 0.0, 1.0)


def test_a_drive_is_split_and_parking_and_taps_are_no_stops() -> None:
    stops = stops_of(drive(PARKED, AWAY, STOP, STILL, PARKED, AWAY, TAP, ON, SLOW_STOP, PARKED))
    assert len(stops) == 2
    for stop, speed in zip(stops, (4.0, 3.0), strict=True):
        start = stop.brake_start
        assert start is not None
        assert stop.time[start] - stop.time[0] == pytest.approx(1.0, abs=2 * PERIOD)
        assert stop.time[-1] - stop.time[0] < 2.7  # without the time at rest
        assert stop.twist[start, 0] == pytest.approx(speed, abs=0.01)
        distance = run_metrics(stop)["stopping_distance"].value
        assert distance == pytest.approx(speed / 2.0, abs=0.04)


def test_only_several_stops_are_numbered() -> None:
    one, two = drive(PARKED, AWAY, STOP, STILL), drive(AWAY, STOP, STILL, AWAY, STOP, STILL)
    assert list(named_stops(one, "a")) == ["a"]
    (stop,) = named_stops(one, "a").values()
    assert run_metrics(stop)["stopping_distance"].value == pytest.approx(2.0, abs=0.04)
    assert list(named_stops(two, "a")) == ["a/stop_1", "a/stop_2"]
    # 4 m during each acceleration and 2 m in each stop
    whole = {name: metric.value for name, metric in drive_metrics(two, 2).items()}
    assert whole == {"stops": 2.0, "path_length": pytest.approx(12.0, abs=0.1)}


def test_a_scripted_run_stays_whole() -> None:
    whole = drive((1.0, 4.0, 4.0, 0.0), STOP, STILL)
    assert stops_of(whole) == (whole,)


@pytest.mark.parametrize("parts", [(PARKED,), (PARKED, AWAY), (AWAY, TAP, ON)])
def test_without_a_stop_there_is_nothing_to_split(
    parts: tuple[tuple[float, float, float, float], ...],
) -> None:
    whole = drive(*parts)
    assert stops_of(whole) == (whole,)


def test_a_stop_that_begins_right_after_another_does_not_show_it() -> None:
    stops = stops_of(drive(PARKED, AWAY, STOP, STILL, (0.4, 0.0, 2.0, 0.0), (0.5, 2.0, 0.0, 1.0)))
    first, second = stops
    assert first.stamp_ns[-1] < second.stamp_ns[0]
    assert second.brake_start is not None
    assert second.pedal[0] == 0.0


def test_an_odometry_without_error_does_not_drift() -> None:
    history = drive(AWAY, STOP, STILL)
    metrics = drift_metrics(history)
    assert metrics["odometry_ate"].value == pytest.approx(0.0, abs=1e-9)
    assert metrics["odometry_rpe"].value == pytest.approx(0.0, abs=1e-9)


def test_an_odometry_one_percent_too_long_drifts_by_one_percent() -> None:
    history = drive((10.0, 2.0, 2.0, 0.0), scale=1.01)
    metrics = drift_metrics(history)
    # 20 m in a line: the error grows from 0 to 0.2 m, its root mean square is that over sqrt(3).
    assert metrics["odometry_ate"].value == pytest.approx(0.2 / math.sqrt(3.0), rel=0.01)
    assert metrics["odometry_rpe"].value == pytest.approx(0.01, rel=0.03)
    short = drift_metrics(drive((0.2, 2.0, 2.0, 0.0)))["odometry_rpe"]
    assert math.isnan(short.value)
    assert "shorter than 1 m" in short.note


def test_the_errors_do_not_depend_on_where_the_drive_was() -> None:
    random = np.random.default_rng(3)
    truth = np.cumsum(random.normal(0.02, 0.01, (400, 3)), axis=0)
    path = truth + np.cumsum(random.normal(0.0, 0.001, (400, 3)), axis=0)
    elsewhere = _moved(truth), _moved(path)
    assert absolute_error(truth, path) == pytest.approx(absolute_error(*elsewhere))
    here, pieces = relative_error(truth, path)
    assert pieces > 5
    assert here == pytest.approx(relative_error(*elsewhere)[0])


def test_both_errors_are_those_of_the_library_evo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))  # where it keeps settings
    metrics: Any = pytest.importorskip("evo.core.metrics")
    trajectory: Any = pytest.importorskip("evo.core.trajectory")
    random = np.random.default_rng(5)
    truth = np.cumsum(random.normal((0.02, 0.005, 0.004), 0.01, (600, 3)), axis=0)
    path = truth + np.cumsum(random.normal(0.0, 0.001, (600, 3)), axis=0)
    path[0] = truth[0]  # origins aligned

    def of_evo(poses: NDArray[np.float64]) -> Any:
        placed = np.tile(np.eye(4), (len(poses), 1, 1))
        cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        placed[:, 0, 0], placed[:, 0, 1], placed[:, 1, 0], placed[:, 1, 1] = (
            *(cosine, -sine),
            *(sine, cosine),
        )
        placed[:, :2, 3] = poses[:, :2]
        return trajectory.PosePath3D(poses_se3=list(placed))

    pair = of_evo(truth), of_evo(path)
    absolute = metrics.APE(metrics.PoseRelation.translation_part)
    relative = metrics.RPE(
        metrics.PoseRelation.translation_part,
        delta=1.0,
        delta_unit=metrics.Unit.meters,
        pairs_from_reference=True,
    )
    for one in (absolute, relative):
        one.process_data(pair)
    rmse = metrics.StatisticsType.rmse
    assert absolute_error(truth, path) == pytest.approx(absolute.get_statistic(rmse), rel=1e-9)
    ours, pieces = relative_error(truth, path)
    assert pieces == len(relative.delta_ids) > 5
    assert ours == pytest.approx(relative.get_statistic(rmse), rel=1e-9)


def _moved(path: NDArray[np.float64]) -> NDArray[np.float64]:
    c, s = math.cos(1.1), math.sin(1.1)
    return np.column_stack((path[:, :2] @ np.array([[c, s], [-s, c]]) + (3, -7), path[:, 2] + 1.1))


def test_the_path_of_the_odometry_begins_where_the_vehicle_is() -> None:
    history = drive(AWAY)
    path = odometry_path(history)
    assert path[0] == pytest.approx(history.pose[0])
    assert path[-1] == pytest.approx(history.pose[-1])
