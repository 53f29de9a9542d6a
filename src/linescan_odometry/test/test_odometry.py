"""Odometry from line batches to twist: chain of lines, filter, faults."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.configuration import METHODS, OdometryConfiguration
from linescan_odometry.measurements import UNMEASURED_VARIANCE
from linescan_odometry.odometry import LineScanOdometry, TwistEstimate
from linescan_odometry.sensor import SensorOdometry
from omni_core.configuration import ConfigurationError
from omni_core.sensors import LineSensor, sensor_matrix
from omni_core.signals import LineBatch, LineBatchError

Expose = Callable[..., Any]

RATE = 2500.0
PERIOD_NS = 1e9 / RATE


def placement(pixels: int = 256) -> dict[str, LineSensor]:
    """Three tangential sensors on a circle, with a pixel pitch of 1/20 mm."""
    return {
        name: LineSensor(
            x=0.6 * math.cos(angle),
            y=0.6 * math.sin(angle),
            heading_deg=math.degrees(angle) + 90.0,
            pixels=pixels,
            length=5e-5 * pixels,
            line_rate=RATE,
        )
        for name, angle in (("front", 0.0), ("left", 2.0944), ("right", -2.0944))
    }


def configuration(pixels: int = 256, **changes: Any) -> OdometryConfiguration:
    return OdometryConfiguration(sensors=placement(pixels), **changes)


def batch(lines: Any, newest: int) -> LineBatch:
    """Make a batch whose newest line is line number `newest` since the start."""
    return LineBatch(round(newest * PERIOD_NS), lines)


def one_sensor(pixels: int = 256, **changes: Any) -> SensorOdometry:
    # These motions jump; `test_plausibility` tests the limit of the acceleration.
    settings = configuration(pixels, **{"maximum_acceleration": 0.0, **changes})
    return SensorOdometry(settings.sensors["front"], settings)


def drive(expose: Expose, twist: Any, lines: int = 26, **changes: Any) -> TwistEstimate:
    """Expose lines at constant twist, update with the first line and then with the rest."""
    # The lines do not change across the axis, as over endless stripes.
    settings = configuration(cover_detection=False, **changes)
    odometry = LineScanOdometry(settings)
    speeds = sensor_matrix(settings.sensors) @ np.asarray(twist)
    record = {}
    for i, (name, speed) in enumerate(zip(settings.sensors, speeds, strict=True)):
        positions = np.arange(lines) * speed / RATE / 5e-5
        record[name] = expose(positions, 256, noise=2.0, seed=1 + i, noise_seed=20 + i)
    first = odometry.update({name: batch(every[:1], 0) for name, every in record.items()})
    assert not first.measured  # there is no line to compare with
    return odometry.update({name: batch(every[1:], lines - 1) for name, every in record.items()})


@pytest.mark.parametrize(
    "twist",
    [(10.0, 0.0, 0.0), (0.0, -10.0, 0.0), (5.0, 5.0, 1.0), (0.0, 0.0, 2.0), (0.02, 0.0, 0.01)],
)
def test_twist_is_recovered_within_its_covariance(twist: Any, expose: Expose) -> None:
    estimate = drive(expose, twist)
    assert estimate.measured
    assert estimate.stamp_ns == round(25 * PERIOD_NS)
    error = estimate.twist - np.array(twist)
    assert error @ np.linalg.inv(estimate.covariance) @ error < 16.3  # 99.9 % of chi^2, 3 dof
    assert abs(error).max() < 2e-3
    assert all(reading.reason == "" for reading in estimate.readings.values())


@pytest.mark.parametrize("lines", [3, 6, 11, 12])
def test_few_lines_in_a_batch_are_enough(lines: int, expose: Expose) -> None:
    estimate = drive(expose, (5.0, 5.0, 1.0), lines + 1)
    assert estimate.measured, [reading.reason for reading in estimate.readings.values()]
    assert estimate.twist == pytest.approx((5.0, 5.0, 1.0), abs=5e-3)


def test_positive_motion_moves_features_to_smaller_indices(expose: Expose) -> None:
    lines = expose([0.0, 7.0], 256)
    assert np.abs(lines[1, :-7].astype(int) - lines[0, 7:]).mean() < 3.0  # the ground's side
    reading = one_sensor().update(batch(lines, 1))
    assert reading.velocity == pytest.approx(7.0 * 5e-5 * RATE, abs=2e-3)


@pytest.mark.parametrize("cuts", [[], [1], [7, 8, 30], [13, 26, 39, 52], list(range(1, 60))])
def test_any_split_into_batches_gives_the_same_displacements(
    cuts: list[int], expose: Expose, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = expose(np.cumsum(np.linspace(-40.0, 60.0, 60)), 256, noise=2.0)
    expected = one_sensor(method="pairs")._method._matcher.match(lines)  # type: ignore[union-attr]
    sensor = one_sensor(method="pairs")
    matcher = sensor._method._matcher  # type: ignore[union-attr]
    seen = []
    measure = matcher.match

    def record(chained: Any) -> Any:
        pairs = measure(chained)
        seen.append(pairs)
        return pairs

    monkeypatch.setattr(matcher, "match", record)
    edges = [0, *cuts, 60]
    for first, last in itertools.pairwise(edges):
        sensor.update(batch(lines[first:last], last - 1))
    for field in dataclasses.fields(expected):
        chained = np.concatenate([getattr(pairs, field.name) for pairs in seen])
        assert np.array_equal(chained, getattr(expected, field.name))


@pytest.mark.parametrize(("late", "joined"), [(0.0, 1), (0.4, 1), (-0.4, 1), (0.6, 0), (-0.6, 0)])
def test_a_gap_breaks_the_chain(late: float, joined: int, expose: Expose) -> None:
    lines = expose([0.0, 35.0, 70.0], 256)
    sensor = one_sensor()
    sensor.update(batch(lines[:2], 1))
    reading = sensor.update(LineBatch(round((2 + late) * PERIOD_NS), lines[2:]))
    assert reading.measured == bool(joined)
    if joined:
        assert reading.velocity == pytest.approx(35.0 * 5e-5 * RATE, abs=5e-3)
    else:
        assert "only one line" in reading.reason


def test_a_gap_between_batches_is_no_motion(expose: Expose) -> None:
    lines = expose([0.0, 5.0, 105.0, 110.0], 256)
    sensor = one_sensor()
    sensor.update(batch(lines[:2], 1))
    assert sensor.update(batch(lines[2:], 21)).velocity == pytest.approx(5 * 0.125, abs=5e-3)


def test_a_wrong_number_of_pixels_breaks_the_chain_and_says_so(expose: Expose) -> None:
    lines = expose([0.0, 5.0, 10.0, 15.0], 256)
    sensor = one_sensor()
    sensor.update(batch(lines[:1], 0))
    reading = sensor.update(batch(lines[1:2, :255], 1))
    assert (reading.measured, reading.variance) == (False, UNMEASURED_VARIANCE)
    assert reading.reason == "lines have 255 px, but 256 px are configured"
    assert "only one line" in sensor.update(batch(lines[2:3], 2)).reason
    assert sensor.update(batch(lines[3:], 3)).measured


def test_a_change_of_bit_depth_breaks_the_chain(expose: Expose) -> None:
    lines = expose([0.0, 5.0, 10.0], 256)
    sensor = one_sensor()
    sensor.update(batch(lines[:2], 1))
    assert "only one line" in sensor.update(batch(lines[2:].astype(np.uint16), 2)).reason


@pytest.mark.parametrize("level", [0, 255])
@pytest.mark.parametrize("count", [2, 26])
def test_dark_and_saturated_lines_are_not_measured(level: int, count: int) -> None:
    reading = one_sensor().update(batch(np.full((count, 256), level, np.uint8), count - 1))
    assert not reading.measured
    assert f"gray level {level}" in reading.reason
    assert (reading.velocity, reading.variance) == (0.0, UNMEASURED_VARIANCE)


def test_a_frozen_camera_is_not_at_rest(expose: Expose) -> None:
    still = np.repeat(expose([0.0], 256), 26, axis=0)
    assert "frozen" in one_sensor().update(batch(still, 25)).reason
    live = expose(np.zeros(26), 256, noise=1.0)
    reading = one_sensor().update(batch(live, 25))
    assert reading.measured
    assert abs(reading.velocity) < 5.0 * math.sqrt(reading.variance) < 1e-3


def test_noise_alone_is_not_measured() -> None:
    lines = np.random.default_rng(12).integers(0, 256, (26, 256)).astype(np.uint8)
    for method in METHODS:
        reading = one_sensor(method=method).update(batch(lines, 25))
        assert not reading.measured
        assert reading.reason


def test_point_errors_do_not_reach_the_velocity(expose: Expose) -> None:
    lines = expose(20.3 * np.arange(31), 256, noise=2.0)
    clean = one_sensor(method="pairs").update(batch(lines, 30))
    dirty = lines.copy()
    for i in (4, 15, 22):  # each makes the pairs before and after it invalid
        dirty[i] = expose([3000.0 + 200.0 * i], 256)[0]
    reading = one_sensor(method="pairs", minimum_correlation=0.0).update(batch(dirty, 30))
    assert reading.measured
    assert reading.inlier_share == pytest.approx(24 / 30)
    assert reading.velocity == pytest.approx(clean.velocity, abs=2e-3)


@pytest.mark.parametrize("grain", [2.0, 8.0])
@pytest.mark.parametrize("displacement", [130.0, -132.0, 140.0])
def test_motion_beyond_the_limit_is_not_measured(
    displacement: float, grain: float, expose: Expose
) -> None:
    # On coarse ground the correlation is high at the limit, but has no peak there.
    lines = expose(displacement * np.arange(12), 256, noise=2.0, grain=grain)
    reading = one_sensor(method="pairs", minimum_correlation=0.1).update(batch(lines, 11))
    assert not reading.measured
    assert reading.reason


@pytest.mark.parametrize("displacement", [-128.0, -127.6, 127.3, 128.0])
def test_motion_up_to_the_limit_is_measured(displacement: float, expose: Expose) -> None:
    lines = expose(displacement * np.arange(12), 256, noise=2.0)
    reading = one_sensor(method="pairs").update(batch(lines, 11))
    assert reading.inlier_share == 1.0
    assert reading.velocity == pytest.approx(displacement * 0.125, abs=2e-3)


@pytest.mark.parametrize("displacement", [0.03, 0.1, 0.3])
def test_creeping_is_free_of_the_pull_toward_whole_pixels(
    displacement: float, expose: Expose
) -> None:
    sensor = one_sensor()
    velocity = [
        sensor.update(
            batch(
                expose(start + displacement * np.arange(26), 256, grain=0.7, noise_seed=int(start)),
                1000 * i,
            )
        ).velocity
        for i, start in enumerate(range(0, 6000, 300))
    ]
    assert abs(np.mean(velocity) / 0.125 - displacement) < max(0.001, 0.015 * displacement)


def test_creeping_survives_a_wrong_line_at_the_end(expose: Expose) -> None:
    positions = 0.2 * np.arange(26)
    positions[-1] += 30.0  # matches the first line perfectly, 30 px off
    reading = one_sensor(method="pairs").update(batch(expose(positions, 256), 25))
    assert reading.inlier_share == pytest.approx(24 / 25)
    assert reading.velocity == pytest.approx(0.2 * 0.125, abs=1e-3)


@pytest.mark.parametrize(("method", "least"), [("pairs", 0.3), ("joint", 0.0)])
def test_sideways_motion_has_a_consistent_variance(method: str, least: float) -> None:
    """In motion across the axis, 20 % of the width is new ground in every line."""
    generator = np.random.default_rng(13)
    score = []
    for trial in range(40):
        grains = generator.standard_normal((150, 256 + 80))  # 2 strips of ground a line
        ground = gaussian_filter1d(gaussian_filter1d(grains, 2.0, axis=1), 1.0, axis=0)
        integral = np.cumsum(np.vstack((np.zeros(336), ground)), axis=0)
        rows = [integral[2 * i + 10] - integral[2 * i] for i in range(26)]
        lines = np.stack([row[3 * i : 3 * i + 256] for i, row in enumerate(rows)])
        lines = 128 + 30 * lines / lines.std() + generator.standard_normal(lines.shape)
        sensor = one_sensor(method=method)
        reading = sensor.update(batch(np.rint(lines).clip(0, 255).astype(np.uint8), 1000 * trial))
        assert reading.measured
        score.append((reading.velocity - 3 * 0.125) ** 2 / reading.variance)
    # White noise about the claimed variance would give 1 +/- 0.22. The likelihood of a batch states
    # too large a variance if few places of the ground are seen.
    assert least < np.mean(score) < 1.7


def test_missing_sensors_leave_the_twist_unmeasured(expose: Expose) -> None:
    odometry = LineScanOdometry(configuration())
    lines = expose(5.0 * np.arange(26), 256)
    whole = {name: batch(lines, 25) for name in placement()}
    assert odometry.update(whole).measured
    del whole["left"]
    estimate = odometry.update(whole)
    assert not estimate.measured
    assert not estimate.twist.any()
    assert np.array_equal(estimate.covariance, UNMEASURED_VARIANCE * np.eye(3))
    assert estimate.reason == "left: no lines arrived"
    assert list(estimate.readings) == ["front", "left", "right"]
    assert odometry.update({}).stamp_ns == round(25 * PERIOD_NS)


def test_stale_lines_are_not_mixed_with_fresh_ones(expose: Expose) -> None:
    lines = expose(5.0 * np.arange(26), 256)
    batches = {name: batch(lines, 100) for name in placement()}
    batches["right"] = batch(lines, 75)
    estimate = LineScanOdometry(configuration()).update(batches)
    assert not estimate.measured
    assert estimate.stamp_ns == round(100 * PERIOD_NS)
    assert estimate.reason == "right: stale: 10 ms older than the newest line"


def test_updates_repeat_to_the_last_bit(expose: Expose) -> None:
    first, second = (drive(expose, (3.0, -4.0, 1.0)) for _ in range(2))
    assert first.twist.tobytes() == second.twist.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_cameras_that_are_matched_as_they_come_give_the_same_twist(expose: Expose) -> None:
    settings = configuration(cover_detection=False)
    at_once, early = LineScanOdometry(settings), LineScanOdometry(settings)
    lines = expose(np.arange(76) * 7.3, 256, noise=2.0)
    for newest in (25, 50, 75):
        batches = {name: batch(lines[newest - 24 : newest + 1], newest) for name in placement()}
        for name in ("right", "front"):  # the third is not announced
            early.match(name, batches[name])
        expected, estimate = at_once.update(batches), early.update(batches)
        assert estimate.measured
        np.testing.assert_array_equal(estimate.twist, expected.twist)
        assert estimate.readings == expected.readings


def test_batches_that_wait_for_others_in_vain_are_forgotten(expose: Expose) -> None:
    odometry = LineScanOdometry(configuration())
    lines = expose(np.arange(26) * 7.3, 256, noise=2.0)
    batches = [batch(lines, newest) for newest in range(25, 2500, 25)]
    for each in batches:
        odometry.match("front", each)
    waiting = [taken.stamp_ns for taken, _ in odometry._early]
    assert waiting[-1] == batches[-1].stamp_ns
    assert waiting[-1] - waiting[0] <= 500_000_000  # of almost a second


def test_warming_up_leaves_no_trace(expose: Expose) -> None:
    lines = expose(5.0 * np.arange(26), 256)
    batches = {name: batch(lines[1:], 25) for name in placement()}
    cold, warm = LineScanOdometry(configuration()), LineScanOdometry(configuration())
    warm.warm_up()
    assert cold.update(batches).twist.tobytes() == warm.update(batches).twist.tobytes()
    assert warm.update({}).stamp_ns == cold.update({}).stamp_ns


@pytest.mark.parametrize(
    "lines",
    [np.zeros(5, np.uint8), np.zeros((2, 5)), np.zeros((2, 5), np.int16), np.zeros((1, 2, 3))],
)
def test_what_is_no_batch_of_lines_is_refused(lines: Any) -> None:
    with pytest.raises(LineBatchError, match="uint8 or uint16"):
        LineBatch(0, lines)


def test_an_empty_batch_and_an_unknown_sensor(expose: Expose) -> None:
    odometry = LineScanOdometry(configuration())
    empty = batch(np.empty((0, 256), np.uint8), 0)
    assert "no line" in odometry.update({"front": empty}).readings["front"].reason
    with pytest.raises(LineBatchError, match="'back' is not one of the sensors front, left"):
        odometry.update({"back": batch(expose([0.0], 256), 1)})


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"sensors": {"only": LineSensor(x=0.0, y=0.0, heading_deg=0.0)}}, "sensors"),
        ({"sensors": placement(40)}, "sensors.front.pixels"),
        ({"maximum_skew": 1e-4}, "maximum_skew"),
        ({"metric": "hamming"}, "metric"),
    ],
)
def test_unusable_configurations_are_refused_by_name(changes: dict[str, Any], key: str) -> None:
    settings: dict[str, Any] = {"sensors": placement()} | changes
    with pytest.raises(ConfigurationError) as caught:
        OdometryConfiguration(**settings)
    assert caught.value.key == key


def test_a_coarse_camera_at_rest_is_always_measured(expose: Expose) -> None:
    camera = one_sensor(128)
    for number in range(120):
        lines = expose(np.zeros(25), 128, noise=2.0, grain=4.0, noise_seed=number)
        reading = camera.update(batch(lines, 25 * number))
        assert reading.measured, f"batch {number}: {reading.reason}"
        assert abs(reading.velocity) < 5.0 * math.sqrt(reading.variance)
