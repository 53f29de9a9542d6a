"""The search reaches known optima, stays on the chassis, and is reproducible."""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path

import numpy as np
import pytest

from omni_core.quantities import BoolArray, FloatArray
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures.scene import Scene, overlap
from omni_tools.line_trials.rig import View
from omni_tools.placement.error import (
    ConditionNumber,
    MeanError,
    MotionMix,
    after_failure,
    evaluate,
    gyration,
    poses_of,
    singularity,
)
from omni_tools.placement.mounting_area import MountingArea, common_placements, named
from omni_tools.placement.search import NoRoomError, search
from omni_tools.placement.sensor_error import SensorError

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[4] / "config")
VIEW = View()
TEXTURE = SensorError(2.5e-7, 2.6e-4)
MIX = MotionMix.of(10.0, 1.0, (1, 1, 1, 1))
FAST = 10  # placements in each generation, per free coordinate


@functools.cache
def chassis(vehicle: str) -> tuple[MountingArea, MeanError]:
    read = LIBRARY.vehicle(vehicle)
    scene = Scene(read.chassis_length, read.chassis_width, read.wheels)
    radius = gyration(read.chassis_length, read.chassis_width)
    return MountingArea(scene, VIEW, 0.02, 0.02), MeanError(VIEW, TEXTURE, MIX, radius)


@dataclasses.dataclass(frozen=True, eq=False)
class Disc(MountingArea):
    """A round chassis of 0.6 m without wheels, within which the centers of cameras must be."""

    def on_chassis(self, poses: FloatArray) -> BoolArray:
        inside: BoolArray = np.hypot(poses[..., 0], poses[..., 1]) <= 0.6 + 1e-9
        return inside

    def wheel_in_the_way(
        self, poses: FloatArray
    ) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        return np.full(poses.shape[:-1], -1, np.int64)


@pytest.mark.parametrize("count", [3, 4])
def test_on_a_free_disc_equal_sensors_reach_the_bound(count: int) -> None:
    """Levers are at most R and axes are unit vectors, so E^2 >= s^2 (4/N + g^2/(N R^2))."""
    wheels = LIBRARY.vehicle("mecanum_forklift").wheels
    area = Disc(Scene(1.2, 1.2, wheels), VIEW, 0.02, 0.0)
    criterion = MeanError(VIEW, SensorError(1e-6, 0.0), MotionMix.of(1e-6, 0.0, (1, 0, 0, 0)), 0.4)
    found = search(criterion, area, count, population=FAST)
    bound = 1e-3 * math.sqrt(4.0 / count + 0.4**2 / (count * 0.6**2))
    assert bound * (1.0 - 1e-9) <= found.value <= 1.003 * bound


@pytest.mark.parametrize("vehicle", ["mecanum_forklift", "three_wheel_robot"])
def test_the_best_placement_beats_known_ones_and_can_be_mounted(vehicle: str) -> None:
    area, criterion = chassis(vehicle)
    found = search(criterion, area, 3, population=FAST)
    assert area.problem(named(found.poses, VIEW), found.poses) == ""
    best = evaluate("best", named(found.poses, VIEW), criterion, area)
    assert best.singular == ""
    assert best.mean_error == pytest.approx(found.value, rel=1e-9)
    default = evaluate("default", LIBRARY.sensors("three_generic"), criterion, area)
    tangential = criterion.mean_error(common_placements(area, 3)["tangential"])
    assert best.mean_error < 0.85 * default.mean_error
    assert best.mean_error < tangential
    # Positions for drilling: whole millimeters and degrees, with nearly no loss.
    assert found.poses[:, :2] * 1e3 == pytest.approx(np.round(found.poses[:, :2] * 1e3), abs=1e-6)
    assert found.rounding < 0.002
    # Left and right, or front and rear, are symmetric.
    assert found.symmetry != ""
    x, y, _ = found.poses.T
    assert np.isclose(x.sum(), 0.0) or np.isclose(y.sum(), 0.0)


def test_the_smallest_condition_number_is_not_the_smallest_error() -> None:
    area, criterion = chassis("six_wheel_mecanum")
    condition = ConditionNumber()
    best = search(criterion, area, 3, population=FAST).poses
    round_one = search(condition, area, 3, population=FAST).poses
    numbers = [float(condition.value(condition.information(p).sum(0))) for p in (best, round_one)]
    assert numbers[1] == pytest.approx(1.0, abs=0.01)
    assert numbers[0] > 1.8
    assert criterion.mean_error(round_one) > 1.1 * criterion.mean_error(best)


def test_redundancy_is_bought_with_little_error() -> None:
    area, criterion = chassis("mecanum_forklift")
    plain = search(criterion, area, 4, population=FAST).poses
    spare = search(criterion, area, 4, population=FAST, redundant=True)
    worst = max(after_failure(criterion, spare.poses))
    assert spare.value == pytest.approx(worst)
    assert worst < 0.97 * max(after_failure(criterion, plain))
    assert criterion.mean_error(spare.poses) < 1.05 * criterion.mean_error(plain)
    sensors = named(spare.poses, VIEW)
    for missing in sensors:
        assert singularity({name: s for name, s in sensors.items() if name != missing}) == ""


def test_singular_and_unmountable_placements_are_named() -> None:
    area, criterion = chassis("table_2_mecanum")
    classics = {
        name: evaluate(name, named(poses, VIEW, rounded=False), criterion, area)
        for name, poses in common_placements(area, 3).items()
    }
    assert classics["tangential"].singular == ""
    assert "pass through one point" in classics["radial"].singular
    assert "parallel" in classics["parallel"].singular
    assert classics["radial"].mean_error == classics["parallel"].mean_error == math.inf
    default = evaluate("default", LIBRARY.sensors("three_generic"), criterion, area)
    assert default.mounting == "left extends beyond the edge"
    at_wheel = named(np.array([(0.7, 0.36, 0.0), (0.0, 0.3, 0.0), (-0.5, 0.0, 1.57)]), VIEW)
    problem = area.problem(at_wheel, poses_of(at_wheel))
    assert problem == "front_left is too close to wheel front_left"


def test_the_same_seed_gives_the_same_placement() -> None:
    area, criterion = chassis("mecanum_forklift")
    first, second = (search(criterion, area, 3, population=FAST, seed=9).poses for _ in range(2))
    assert np.array_equal(first, second)


def test_no_room_is_said() -> None:
    area, criterion = chassis("mecanum_forklift")
    with pytest.raises(NoRoomError, match="no room for 3 sensors"):
        search(criterion, dataclasses.replace(area, clearance=0.5), 3, population=FAST)


def test_rectangles_overlap_as_their_outlines_do() -> None:
    area, _ = chassis("mecanum_forklift")
    close = dataclasses.replace(area, clearance=0.0)
    poses = np.random.default_rng(4).uniform((-0.1, -0.1, -3.0), (0.1, 0.1, 3.0), (300, 3))
    fixed = poses[0]
    outline = close.outline(fixed, housing=True)
    expected = [not overlap(close.outline(pose, housing=True), outline) for pose in poses]
    assert close.apart(poses, fixed).tolist() == expected
    assert 20 < sum(expected) < 280


def test_no_camera_is_in_the_way_of_a_steered_wheel() -> None:
    area, _ = chassis("steered_forklift")
    close = dataclasses.replace(area, housing=0.0, clearance=0.0)
    poses = np.random.default_rng(7).uniform((-0.8, 0.3, -3.0), (-0.4, 0.6, 3.0), (400, 3))
    mount, free = area.scene.wheels["rear_left"], close.wheel_in_the_way(poses) < 0
    swept = np.zeros(len(poses), np.bool_)
    for angle in np.arange(-mount.steering_limit_deg, mount.steering_limit_deg + 1.0):
        turned = dataclasses.replace(mount, heading_deg=mount.heading_deg + angle)
        wheel = dataclasses.replace(area.scene, wheels={"": turned}).wheel_outlines[0]
        outlines = [close.outline(pose, housing=False) for pose in poses]
        swept |= [overlap(outline, wheel) for outline in outlines]
    # A corner of the wheel passes between two tested angles by less than a millimeter.
    assert np.mean(free == ~swept) > 0.99
    straight = dataclasses.replace(mount, steering_limit_deg=0.0)
    scene = dataclasses.replace(area.scene, wheels={"rear_left": straight})
    fixed = dataclasses.replace(close, scene=scene).wheel_in_the_way(poses) < 0
    assert np.sum(fixed) > np.sum(free) > 20
