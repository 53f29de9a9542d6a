"""A camera without a view of the ground is reported within 20 ms and not used."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.odometry import LineBatch, LineScanOdometry, TwistEstimate
from omni_core.sensors import LineSensor
from omni_core.signals import Lines
from omni_tools.line_trials.rig import Rig, ground, poses_at
from omni_tools.placement.mounting_area import tangential

RATE = 2500.0
BATCH = 25  # lines, 10 ms
GOOD_BATCHES = 3
PROTOTYPE = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=512, length=0.05, width=0.02)
GENERATOR = np.random.default_rng(3)

Fault = Callable[[Lines], Lines]


def cover(lines: Lines) -> Lines:
    """A lid: dark lines with the noise of the camera."""
    return np.clip(GENERATOR.normal(12.0, 1.0, lines.shape), 0, 255).astype(np.uint8)


def mud(lines: Lines) -> Lines:
    """A covered lens with a visible texture."""
    pattern = np.random.default_rng(8).normal(80.0, 20.0, lines.shape[1])
    return np.clip(pattern + GENERATOR.normal(0.0, 1.0, lines.shape), 0, 255).astype(np.uint8)


def dark(lines: Lines) -> Lines:
    return np.zeros_like(lines)


def saturated(lines: Lines) -> Lines:
    return np.full_like(lines, 255)


def frozen(lines: Lines) -> Lines:
    still = lines.copy()
    still[:] = lines[0]
    return still


def measure(odometry: LineScanOdometry, lines: Mapping[str, Lines]) -> list[TwistEstimate]:
    """Return the estimate after each batch, except after the single first line."""
    estimates = []
    for end in range(1, len(next(iter(lines.values()))) + 1, BATCH):
        stamp_ns = round(1e9 * (end - 1) / RATE)
        batches = {
            n: LineBatch(stamp_ns, own[max(0, end - BATCH) : end]) for n, own in lines.items()
        }
        estimates.append(odometry.update(batches))
    return estimates[1:]


def drive(
    fault: Fault | None,
    onset: int,
    velocity: tuple[float, float, float],
    cameras: int = 3,
    kind: str = "cork",
    heading: float = 0.4,
) -> tuple[list[TwistEstimate], NDArray[np.float64]]:
    """Return the estimate after each batch, and the true twist [m/s, m/s, rad/s], shape (3,).

    The first camera fails at line `onset`.
    """
    sensors = tangential(0.6, PROTOTYPE, cameras)
    array = Rig(sensors, ground(kind), 1.0, seed=2).array
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    twist = np.array(velocity)
    total = BATCH * (GOOD_BATCHES + 3) + 1
    poses = poses_at(np.arange(total) / RATE, np.array([0.03, 0.05, heading]), twist)
    lines = array.render(dict.fromkeys(sensors, poses))
    broken = next(iter(sensors))
    if fault is not None:
        lines[broken][onset:] = fault(lines[broken][onset:])
    return measure(odometry, lines), twist


# The axis of the camera that fails points to the left: across, along and both, and turning.
@pytest.mark.parametrize(
    "velocity",
    [
        (10.0, 0.0, 0.0), (0.0, 10.0, 0.0), (3.0, 3.0, 0.0), (1.0, 1.0, 0.5), (-2.0, 0.0, 1.0),
        (0.0, 0.0, 2.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("late", [0, 12])
@pytest.mark.parametrize("fault", [cover, mud, dark, saturated, frozen])
def test_a_fault_is_reported_within_20_ms(
    fault: Fault, late: int, velocity: tuple[float, float, float]
) -> None:
    estimates, twist = drive(fault, BATCH * GOOD_BATCHES + 1 + late, velocity)
    for estimate in estimates[:GOOD_BATCHES]:
        assert estimate.measured
        assert np.abs(estimate.twist - twist).max() < 0.1
    # The batch in which the fault begins may have enough valid lines; it is then correct. Only mud
    # that covers half a batch may give an error, until the next batch.
    first = estimates[GOOD_BATCHES]
    if first.measured:
        assert late > 0
        assert fault is mud or np.abs(first.twist - twist).max() < 0.1
    for estimate in estimates[GOOD_BATCHES + 1 :]:
        assert not estimate.measured
        assert not estimate.readings["camera_0"].measured
        assert "camera_0: " in estimate.reason
    if fault is mud:
        # The motion of this camera stops implausibly fast, or it is zero while the others move.
        reasons = ("covered: its view does not change", "not plausible")
        assert any(words in estimates[-1].reason for words in reasons)


@pytest.mark.parametrize("fault", [cover, mud, dark, frozen])
def test_five_cameras_go_on_without_the_one_that_failed(fault: Fault) -> None:
    estimates, twist = drive(fault, BATCH * GOOD_BATCHES + 1, (5.0, 1.0, 0.5), cameras=5)
    for estimate in estimates:
        assert estimate.measured
        assert np.abs(estimate.twist - twist).max() < 0.1
    assert [name for name, r in estimates[-1].readings.items() if not r.measured] == ["camera_0"]


@pytest.mark.parametrize(
    ("kind", "velocity"),
    [
        ("cork", (0.0, 0.0, 0.0)),
        ("cork", (0.001, 0.0, 0.0)),
        ("cork", (0.0, 6.0, 0.0)),
        ("walking_tile", (0.6, 0.0, 0.0)),
        ("walking_tile", (1.0, 0.0, 0.0)),
        ("walking_tile", (2.0, 0.0, 0.0)),
        ("asphalt", (20.0, 0.0, 0.0)),  # in 10 ms a whole period of the ground
    ],
)
def test_a_view_that_hardly_changes_is_no_fault(
    kind: str, velocity: tuple[float, float, float]
) -> None:
    for heading in (0.0, 0.4, 1.57):
        estimates, _ = drive(None, 0, velocity, kind=kind, heading=heading)
        assert not [e.reason for e in estimates if "covered" in e.reason]


def test_a_stop_and_a_start_are_no_fault() -> None:
    sensors = tangential(0.6, PROTOTYPE)
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    array = Rig(sensors, ground("cork"), 1.0, seed=2).array
    elapsed = np.arange(BATCH * 30 + 1) / RATE
    # 10 m/s^2 from 1 m/s to rest, a rest of 0.1 s, and as hard a start.
    speed = np.clip(1.0 - 10.0 * elapsed, 0.0, None) + np.clip(10.0 * (elapsed - 0.2), 0.0, None)
    poses = np.zeros((len(elapsed), 3))
    poses[:, 0] = np.concatenate(([0.0], np.cumsum(speed[1:]) / RATE))
    lines = array.render(dict.fromkeys(sensors, poses))
    assert not [e.reason for e in measure(odometry, lines) if not e.measured]


@pytest.mark.parametrize("broken", ["camera_0", "camera_2"])
def test_one_wrong_camera_does_not_cover_the_good_ones(broken: str) -> None:
    sensors = tangential(0.6, PROTOTYPE, 5)
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    array = Rig(sensors, ground("cork"), 1.0, seed=2).array
    poses = np.zeros((4 * BATCH + 1, 3))
    passing = poses_at(np.arange(len(poses)) / RATE, np.zeros(3), np.array([2.0, 1.0, 0.0]))
    lines = array.render(dict.fromkeys(sensors, poses) | {broken: passing})
    estimate = measure(odometry, lines)[-1]
    assert np.abs(estimate.twist).max() < 0.01
    assert [name for name, r in estimate.readings.items() if not r.measured] == [broken]
    assert "contradicts" in estimate.reason


def test_a_cover_that_is_taken_away_is_forgotten() -> None:
    sensors = tangential(0.6, PROTOTYPE)
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    array = Rig(sensors, ground("cork"), 1.0, seed=2).array
    twist = np.array([0.0, 4.0, 0.0])  # along the axis of the one that is covered
    poses = poses_at(np.arange(14 * BATCH + 1) / RATE, np.zeros(3), twist)
    lines = array.render(dict.fromkeys(sensors, poses))
    covered = slice(3 * BATCH + 1, 6 * BATCH + 1)
    lines["camera_0"][covered] = mud(lines["camera_0"][covered])
    estimates = measure(odometry, lines)
    assert all(np.abs(e.twist - twist).max() < 0.1 for e in estimates if e.measured)
    # The camera is used again after its view has changed for 50 ms.
    assert [e.measured for e in estimates] == [True] * 3 + [False] * 8 + [True] * 3


def test_lines_that_are_none_are_reported_at_once() -> None:
    sensors = tangential(0.6, PROTOTYPE)
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors))
    rig = Rig(sensors, ground("cork"), 1.0, seed=2)
    start, twist = np.zeros(3), np.array([3.0, 0.0, 0.0])
    first, second, third = (
        rig.expose(start, twist, dict.fromkeys(sensors, np.arange(begin, begin + BATCH)))
        for begin in (0, BATCH, 2 * BATCH)
    )
    odometry.update(first)  # a single batch may not separate ground and fixed pattern
    assert odometry.update(second).measured
    third["camera_1"] = LineBatch.unusable(third["camera_1"].stamp_ns, "holds NaN")
    estimate = odometry.update(third)
    assert not estimate.measured
    assert estimate.reason == "camera_1: holds NaN"
