"""Oblique texture is distinguished from periodic ground and from a vehicle that rocks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.keyframe import Keyframe
from linescan_odometry.measurements import Decay, SensorReading
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.textures import common_ground
from linescan_odometry.unsuitable_views import UnsuitableViews
from omni_core.sensors import LineSensor, velocity_row
from omni_core.signals import LineBatch

PIXELS, BATCH, RATE = 256, 25, 2500.0
CAMERA = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=PIXELS)
LINE_PITCH = 0.0005  # m across from one row of the ground to the next
ROWS = int(CAMERA.width / LINE_PITCH)
SHIFT = 1  # px per line; at zero, a fixed pattern would have the same correlation


def three(camera: LineSensor) -> dict[str, LineSensor]:
    """Return a camera and two others that complete the twist."""
    other = dataclasses.replace(camera, y=0.5)
    return {"eye": camera, "other": other, "front": dataclasses.replace(other, heading_deg=90.0)}


Ground = Callable[[NDArray[np.int64]], NDArray[np.float64]]


def random_rows(count: int) -> Ground:
    """Rows of an ordinary ground: mean gray levels over the camera's width at each position."""
    generator = np.random.default_rng(4)
    rows = gaussian_filter1d(generator.normal(0.0, 1.0, (count, PIXELS)), 2.0, axis=1)
    seen = uniform_filter1d(rows, ROWS, axis=0, mode="wrap")
    ground: NDArray[np.float64] = 128.0 + 20.0 * seen / seen.std()
    return lambda row: ground[row % count]


def stripes(row: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rows of a ground with stripes along the motion: all rows are equal."""
    line = gaussian_filter1d(np.random.default_rng(5).normal(0.0, 60.0, PIXELS), 2.0)
    ground: NDArray[np.float64] = np.tile(128.0 + line, (len(row), 1))
    return ground


def readings_over(ground: Ground, way: NDArray[np.float64]) -> Iterator[SensorReading]:
    """Yield the reading of each batch along a path across the axis [m], one position per line."""
    keyframe, views = Keyframe(PIXELS), UnsuitableViews({"eye": CAMERA})
    noise = np.random.default_rng(6)
    seen = ground(np.rint(way / LINE_PITCH).astype(np.int64))
    seen = np.array([np.roll(line, -SHIFT * k) for k, line in enumerate(seen)])
    lines = np.rint(seen + noise.normal(0.0, 1.0, seen.shape)).clip(0, 255).astype(np.uint8)
    for end in range(BATCH, len(way), BATCH):
        stamp_ns = round(1e9 * end / RATE)
        decays = keyframe.compare(stamp_ns, 1e9 / RATE, lines[end - BATCH : end + 1], SHIFT)
        readings = {"eye": SensorReading(0.0, 1e-6, 1.0, 1.0, True, decays=decays)}
        twist = np.array([0.0, (way[end] - way[end - BATCH]) * RATE / BATCH, 0.0])
        readings |= views.sloping(stamp_ns, readings, twist)
        yield views.unsuitable(stamp_ns, readings, twist).get("eye", readings["eye"])


def steady(speed: float, batches: int = 12) -> NDArray[np.float64]:
    return np.linspace(0.0, speed * batches * BATCH / RATE, batches * BATCH + 1)


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_stripes_that_never_leave_the_view_are_oblique(speed: float) -> None:
    """Their slope is at most that which the view blurs over a few pixels."""
    *_, reading = readings_over(stripes, steady(speed))
    assert reading.measured
    assert reading.oblique
    slopes = np.array([2.0, 20.0]) * CAMERA.pixel_pitch / CAMERA.width
    assert (slopes[0] * speed) ** 2 < reading.variance < (slopes[1] * speed) ** 2


def test_stripes_determine_no_velocity_in_fast_motion_across() -> None:
    *_, reading = readings_over(stripes, steady(20.0))
    assert not reading.measured
    assert reading.reason.startswith("oblique texture: ")


@pytest.mark.parametrize(("blur", "measured"), [(5.0, True), (30.0, False), (200.0, False)])
def test_the_finest_details_limit_the_slope_of_an_oblique_texture(
    blur: float, measured: bool
) -> None:
    """The view of 102.4 px blurs stripes with a slope of 0.3 over 30 px."""
    views, twist = UnsuitableViews({"eye": CAMERA}), np.array([0.0, 5.0, 0.0])
    decay = Decay(0.0032, 0.0, 1.0, 1.0, 1e-6, True, blur)
    stripes = SensorReading(0.0, 1e-6, 1.0, 1.0, True, decays=(decay,))
    reading = views.sloping(10**9, {"eye": stripes}, twist)["eye"]
    assert reading.measured == measured
    if measured:
        slope = blur * CAMERA.pixel_pitch / CAMERA.width
        assert reading.variance == pytest.approx(1e-6 + (slope * 5.0) ** 2, rel=1e-2)
        assert not views.sloping(10**9, {"eye": reading}, twist)  # it counts once


@pytest.mark.parametrize("repeat", [0.2, 0.1, 0.0625])
@pytest.mark.parametrize("speed", [2.5, 5.0, 10.0, 20.0])
def test_a_ground_that_comes_again_is_not_oblique(speed: float, repeat: float) -> None:
    # Every batch, or every few batches, the periodic ground repeats.
    ground = random_rows(round(repeat / LINE_PITCH))
    assert all(reading.measured for reading in readings_over(ground, steady(speed)))


@pytest.mark.parametrize(("elapsed_ns", "covered"), [(81_000_000, True), (82_000_000, False)])
@pytest.mark.parametrize("twist", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.8, -0.6, 0.0)])
def test_a_view_is_covered_if_it_stops_faster_than_with_15_m_s2(
    elapsed_ns: int, covered: bool, twist: tuple[float, float, float]
) -> None:
    views = UnsuitableViews({"eye": CAMERA})
    for stamp_ns in (10**9 - 10**7, 10**9):
        views.unsuitable(stamp_ns, {}, np.array(twist))
    reading = SensorReading(0.0, 1e-6, 1.0, 1.0, True)
    # The view is static since 20 ms, and the last twist is a mean over the 10 ms before it.
    static = dataclasses.replace(reading, static_time=0.02)
    assert bool(views.stopped(10**9 + elapsed_ns, {"eye": static})) == covered
    # Because of noise, a constant view is not recognized in every batch.
    assert bool(views.stopped(10**9 + elapsed_ns + 50_000_000, {"eye": reading})) == covered
    assert not views.stopped(10**9 + elapsed_ns + 51_000_000, {"eye": reading})


@pytest.mark.parametrize(("left", "covered"), [(0.95, True), (0.76, False)])
def test_a_view_that_seems_constant_is_not_covered_if_its_texture_leaves_it(
    left: float, covered: bool
) -> None:
    """The lines of faint ground still match the oldest of the batch when a quarter is new."""
    views = UnsuitableViews({"eye": CAMERA})
    for stamp_ns in (10**9 - 10**7, 10**9):
        views.unsuitable(stamp_ns, {}, np.array([0.05, 0.3, 0.0]))
    decay = Decay(0.0052, 0.0012, left, left, 0.06**2, False)
    reading = SensorReading(0.0, 1e-3, 1.0, 1.0, True, static_time=0.01, decays=(decay,))
    assert bool(views.stopped(10**9 + 10**7, {"eye": reading})) == covered


def drive(
    views: UnsuitableViews,
    stamp_ns: int,
    readings: dict[str, SensorReading],
    twist: NDArray[np.float64],
) -> None:
    """Process readings in the order of the odometry; none of them may be rejected."""
    assert not views.stopped(stamp_ns, readings)
    slopes = {name: dataclasses.replace(r, variance=1.0) for name, r in readings.items()}
    known = {name: slopes[name] if r.slope else r for name, r in readings.items()}
    assert not views.unsuitable(stamp_ns, known, twist)


def test_an_uncertain_velocity_does_not_hide_the_certain_one_before() -> None:
    views, twist = UnsuitableViews(three(CAMERA)), np.array([0.5, 0.1, 0.0])
    moving = SensorReading(0.5, 1e-6, 1.0, 1.0, True)
    front = dataclasses.replace(moving, velocity=0.1)
    # The cover begins within the third batch.
    for batch, variance in enumerate((1e-6, 1e-6, 0.2**2)):
        eye = dataclasses.replace(moving, variance=variance)
        seen = {"eye": eye, "other": moving, "front": front}
        drive(views, 10**9 + 10**7 * batch, seen, twist)
    rest = SensorReading(0.0, 1e-8, 1.0, 1.0, True, static_time=0.0096)
    later = {"eye": rest, "other": moving, "front": front}
    assert set(views.stopped(10**9 + 3 * 10**7, later)) == {"eye"}


@pytest.mark.parametrize(
    ("after", "covered"),
    [
        ((0.3, 0.1, 0.0), True),  # the vehicle moves on
        ((0.32, 0.11, 0.02), True),  # it accelerates a little
        ((0.15, 0.1, 0.3), False),  # it turns about the camera
        ((0.0, 0.05, 0.0), False),  # it brakes
    ],
)
@pytest.mark.parametrize("gap", [1, 12])
def test_a_camera_that_stops_while_the_others_move_on_is_covered(
    after: tuple[float, float, float], covered: bool, gap: int
) -> None:
    """A cover that slides over the window leaves no velocity between motion and rest."""
    cameras = three(dataclasses.replace(CAMERA, y=-0.5))
    cameras = {**cameras, "front": dataclasses.replace(cameras["front"], x=0.6)}
    rows = {n: velocity_row(s.x, s.y, s.heading) for n, s in cameras.items()}

    def seen(twist: tuple[float, float, float]) -> dict[str, SensorReading]:
        return {
            n: SensorReading(float(np.dot(row, twist)), 4e-6, 1.0, 1.0, True)
            for n, row in rows.items()
        }

    views, before = UnsuitableViews(cameras), (0.3, 0.1, 0.0)
    for stamp_ns in (10**9 - 10**7, 10**9):
        drive(views, stamp_ns, seen(before), np.array(before))
    rest = SensorReading(0.0, 1e-6, 1.0, 1.0, True, static_time=0.0096)
    found = views.stopped(10**9 + (gap + 4) * 10**7, {**seen(after), "eye": rest})
    assert set(found) == ({"eye"} if covered else set())


def test_a_camera_that_is_seen_to_slow_down_is_not_covered() -> None:
    """The others see no motion across their axes, which may end while the vehicle drives on."""
    views, moving = UnsuitableViews(three(CAMERA)), SensorReading(0.3, 4e-6, 1.0, 1.0, True)
    sideways = ((0.03, 4e-6), (0.03, 4e-6), (0.01, 0.01**2), (0.0, 0.01**2))
    for batch, (speed, variance) in enumerate(sideways):
        front = SensorReading(speed, variance, 1.0, 1.0, True)
        seen = {"eye": moving, "other": moving, "front": front}
        drive(views, 10**9 + 10**7 * batch, seen, np.array([0.3, speed, 0.0]))
    rest = SensorReading(0.0, 1e-8, 1.0, 1.0, True, static_time=0.0096)
    for batch in range(4, 16):
        seen = {"eye": moving, "other": moving, "front": rest}
        assert not views.stopped(10**9 + 10**7 * batch, seen)


def test_a_single_twist_confirms_no_texture() -> None:
    views, twist = UnsuitableViews(three(CAMERA)), np.array([1.0, 1.0, 0.0])
    width = CAMERA.width  # half of the ordinary texture leaves the view
    left = Decay(0.5 * width, 1e-4, 0.5, 0.5, 1e-4, True)
    ordinary = SensorReading(1.0, 1e-6, 1.0, 1.0, True, decays=(left,))
    unknown = dataclasses.replace(ordinary, decays=())
    readings = {"eye": ordinary, "other": unknown, "front": ordinary}
    assert not views.unsuitable(10**9, readings, twist)
    blind = dataclasses.replace(SensorReading.unmeasured("ambiguous"), unmatched=True)
    found = views.unconfirmed(10**9 + 10**7, {**readings, "front": blind})
    assert {n for n, r in found.items() if not r.measured} == {"eye", "other"}
    assert not views.unsuitable(10**9 + 2 * 10**7, readings, twist)
    assert not views.unconfirmed(10**9 + 3 * 10**7, {**readings, "front": blind})


@pytest.mark.parametrize("decays", [(), (Decay(0.001, 1e-4, 0.0, 0.0, 1e-4, False),)])
def test_a_constant_view_of_a_camera_that_moves_across_is_uncertain(
    decays: tuple[Decay, ...],
) -> None:
    views = UnsuitableViews({"eye": CAMERA})
    rest = SensorReading(0.0, 1e-8, 1.0, 1.0, True, static_time=0.01, slope=0.3, decays=decays)
    across = views.sloping(10**9, {"eye": rest}, np.array([0.0, 0.1, 0.0]))["eye"]
    assert across.variance == pytest.approx(0.03**2, rel=1e-3)
    still = views.sloping(10**9, {"eye": rest}, np.zeros(3))["eye"]
    assert still.measured
    assert still.variance == pytest.approx(1e-8)


@pytest.mark.parametrize(("static_time", "covered"), [(0.02, False), (0.03, True)])
def test_a_static_view_is_covered_after_half_a_width_across(
    static_time: float, covered: bool
) -> None:
    views, twist = UnsuitableViews({"eye": CAMERA}), np.array([0.0, 0.4, 0.0])
    for batch in range(10):
        views.unsuitable(10**9 + 10**7 * batch, {}, twist)
    reading = SensorReading(0.0, 1e-6, 1.0, 1.0, True, static_time=static_time)
    assert bool(views.unsuitable(10**9 + 10**8, {"eye": reading}, twist)) == covered


def test_an_uncertain_motion_before_rest_is_no_cover() -> None:
    views = UnsuitableViews({"eye": CAMERA})
    uncertain = SensorReading(0.3, 0.2**2, 1.0, 1.0, True)
    drive(views, 10**9, {"eye": uncertain}, np.array([0.3, 0.0, 0.0]))
    static = SensorReading(0.0, 1e-6, 1.0, 1.0, True, static_time=0.01)
    assert not views.stopped(10**9 + 10**7, {"eye": static})


@pytest.mark.parametrize(("turn", "longest"), [(0.0, 0.1), (0.02, 0.04)])
def test_a_view_that_changes_slowly_is_not_static(turn: float, longest: float) -> None:
    generator = np.random.default_rng(7)
    one, other = gaussian_filter1d(generator.normal(0.0, 60.0, (2, PIXELS)), 2.0, axis=1)
    odometry = SensorOdometry(CAMERA, OdometryConfiguration(sensors=three(CAMERA)))
    static = 0.0
    for batch in range(11):
        angle = turn * (batch + np.arange(BATCH) / BATCH)[:, None]
        lines = 128.0 + np.cos(angle) * one + np.sin(angle) * other
        lines = np.rint(lines + generator.normal(0.0, 1.0, lines.shape)).clip(0, 255)
        stamp_ns = round(1e9 * (1.0 + batch * BATCH / RATE))
        reading = odometry.update(LineBatch(stamp_ns, lines.astype(np.uint8)))
        static = max(static, reading.static_time)
    assert 0.02 < static <= longest + BATCH / RATE


def test_the_path_across_the_axis_is_the_integral_of_the_velocity() -> None:
    views = UnsuitableViews({"eye": CAMERA})
    decay = Decay(0.04, 0.0, 1.0, 1.0, 1e-6, True)
    oblique = SensorReading(0.0, 1e-6, 1.0, 1.0, True, decays=(decay,))
    for stamp_ns, speed in ((10, 7.0), (20, 0.5), (30, 0.7), (40, 0.9)):
        views.unsuitable(stamp_ns * 10**6, {}, np.array((3.0, speed, 0.0)))
    found = views.sloping(50 * 10**6, {"eye": oblique}, np.array((3.0, 1.1, 0.0)))
    assert found["eye"].reason.endswith("after 32 mm across the axis")


@pytest.mark.parametrize(
    ("kept", "deviation", "share"),
    [
        (0.2, 0.001, 0.0),
        (0.39, 0.001, 0.0564),
        (0.25, 0.04, 0.0064),
        (0.6, 0.1, 0.26),
        (0.85, 0.1, 0.66),
        (0.2, np.inf, 1.0),
    ],
)
def test_a_slope_counts_unless_the_texture_is_ordinary(
    kept: float, deviation: float, share: float
) -> None:
    """In 3.2 ms at 5 m/s, ordinary texture keeps 1 - 16 mm / 20 mm = 0.2, and loses 0.8.

    With 0.6, half of the texture moves on, which counts as 0.5^2 plus its variance (0.1 / 0.8)^2.
    """
    views, twist = UnsuitableViews({"eye": CAMERA}), np.array([0.0, 5.0, 0.0])
    decay = Decay(0.0032, 0.0, kept, kept, deviation**2, True)
    faint = SensorReading(0.0, 1e-6, 1.0, 1.0, True, slope=0.05, decays=(decay,))
    reading = views.sloping(10**9, {"eye": faint}, twist)["eye"]
    assert reading.measured
    assert reading.slope == 0.0
    expected = 1e-6 + share * (0.05 * 5.0) ** 2
    assert reading.variance == pytest.approx(expected, rel=3e-2, abs=1e-6)


@pytest.mark.parametrize("path", [0.0, 0.4, 1.0, 1.7])
@pytest.mark.parametrize("blur", [0.0, 0.01, 0.6, 2.5])
def test_the_common_ground_is_the_mean_over_all_pairs_of_lines(path: float, blur: float) -> None:
    lines = blur * np.linspace(0.0, 1.0, 2001)
    apart = path + np.subtract.outer(lines, lines)
    expected = np.maximum(1.0 - np.abs(apart), 0.0).mean()
    assert common_ground(path, blur) == pytest.approx(expected, abs=1e-3)


def test_a_recording_that_is_played_again_has_a_new_path() -> None:
    views, twist = UnsuitableViews({"eye": CAMERA}), np.array([0.0, 1.0, 0.0])
    ordinary = Decay(0.01, 0.0, 0.5, 0.5, 1e-6, True)  # 10 mm of 20 mm across
    reading = SensorReading(0.0, 1e-6, 1.0, 1.0, True, decays=(ordinary,))
    for first_ns in (100 * 10**9, 10**9):
        for stamp_ns in range(first_ns, first_ns + 10**8, 10**7):
            assert not views.stopped(stamp_ns, {"eye": reading})
            assert not views.unsuitable(stamp_ns, {"eye": reading}, twist)


def test_rocking_to_and_fro_is_no_path_across() -> None:
    # A vehicle that has stopped rocks on its tires: 6 mm to either side, 24 mm a period.
    way = 0.006 * np.sin(2.0 * np.pi * 2.5 * np.arange(40 * BATCH + 1) / RATE)
    ground = random_rows(400)
    assert all(reading.measured for reading in readings_over(ground, way))


def test_a_camera_over_an_oblique_texture_leaves_the_others_unconfirmed() -> None:
    *_, rejected = readings_over(stripes, steady(20.0))
    assert not rejected.measured
    other = SensorReading(1.0, 1e-6, 1.0, 1.0, True)
    views = UnsuitableViews({"eye": CAMERA, "other": CAMERA})
    result = views.unconfirmed(0, {"eye": rejected, "other": other})
    assert list(result) == ["other"]
    assert "no match for eye" in result["other"].reason
    # A camera without texture gives no information about the ground.
    assert not views.unconfirmed(0, {"eye": SensorReading.unmeasured("dark"), "other": other})
    faint = dataclasses.replace(other, slope=0.3)
    dark = SensorReading.unmeasured("dark")
    assert set(views.unconfirmed(0, {"eye": dark, "other": faint})) == {"other"}
    assert not UnsuitableViews({}).unconfirmed(0, {"other": faint})
    later = {"eye": rejected, "other": other}
    views.unsuitable(10**9 - 10_000_000, {}, np.zeros(3))
    assert set(views.unconfirmed(10**9, later)) == {"other"}  # a single twist may be accidental
    views.unsuitable(10**9, {}, np.zeros(3))
    assert not views.unconfirmed(10**9 + 10_000_000, later)
    assert set(views.unconfirmed(10**9 + 60_000_000, later)) == {"other"}


def test_a_covered_camera_leaves_the_others_measured() -> None:
    views = UnsuitableViews({"eye": CAMERA, "other": CAMERA})
    for stamp_ns in (10**9 - 10**7, 10**9):
        views.unsuitable(stamp_ns, {}, np.array((1.0, 0.0, 0.0)))
    moving = SensorReading(1.0, 1e-6, 1.0, 1.0, True)
    static = dataclasses.replace(moving, velocity=0.0, static_time=0.0096)
    for stamp_ns in (10**9 + 10**7, 10**9 + 2 * 10**7):
        readings = {"eye": static, "other": moving}
        readings |= views.stopped(stamp_ns, readings)
        assert readings["eye"].reason.startswith("covered: ")
    assert not views.unconfirmed(10**9 + 10**8, readings)
