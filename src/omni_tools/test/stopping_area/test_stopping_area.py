"""Stopping areas: geometry, coverage, and selection by Nav2's rule."""

from __future__ import annotations

import cmath
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from omni_bringup.cli import main
from omni_core.configuration import ConfigurationError
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.metrics import Metric
from omni_tools.stopping_area.area import (
    DIRECTIONS,
    SECTORS,
    StopCampaign,
    Sweep,
    areas,
    calibration_stops,
    corners,
    footprint,
    inside,
    make_cells,
    support,
    supports_of,
)
from omni_tools.stopping_area.collision_monitor import monitor_parameters, stop_campaign
from omni_tools.stopping_area.figure import areas_figure
from omni_tools.stopping_area.options import AreaOptions

CONFIG = Path(__file__).resolve().parents[4] / "config"
STOP = [
    *("feedback=velocity_sensor", "simulation.render_lines=false"),
    *("maneuver.speed=2", "maneuver.brake_time=0.4", "maneuver.direction_deg=30"),
    *("maneuver.yaw_rate_deg=40", "maneuver.heading_deg=70", "brake_assist.enabled=false"),
]


def _experiment(*changes: str) -> ExperimentConfiguration:
    return ExperimentLibrary(CONFIG).load("straight_line", "assisted", [*STOP, *changes])


def _is_inside(points: NDArray[np.float64], polygon: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (P, 2) are in a polygon (C, 2), by the crossing rule of Nav2."""
    odd = np.zeros(len(points), bool)
    x, y = points.T
    for (x_1, y_1), (x_2, y_2) in zip(polygon, np.roll(polygon, 1, axis=0), strict=True):
        crosses = (y_1 > y) != (y_2 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            odd ^= crosses & (x < (x_2 - x_1) * (y - y_1) / (y_2 - y_1) + x_1)
    return odd


def _swept(configuration: ExperimentConfiguration, start: float) -> NDArray[np.float64]:
    """Return the corners of the footprint at all stamps, in the frame at the alarm [m], (P, 2)."""
    run = run_fast_loop(configuration)
    chassis = footprint(configuration.vehicle)
    pose = run.pose[round(start * 100) :]
    points = []
    for x, y, yaw in pose:
        in_odom = [
            complex(x, y) + complex(*point) * complex(math.cos(yaw), math.sin(yaw))
            for point in chassis
        ]
        origin, turn = complex(*pose[0, :2]), complex(math.cos(pose[0, 2]), -math.sin(pose[0, 2]))
        points += [(point - origin) * turn for point in in_odom]
    return np.array([(point.real, point.imag) for point in points])


def test_an_area_touches_what_is_swept_and_holds_all_of_it() -> None:
    configuration = _experiment()
    limits = support(run_fast_loop(configuration), footprint(configuration.vehicle), 0.2)
    swept = _swept(configuration, 0.2)
    angles = np.arange(DIRECTIONS) * 2 * math.pi / DIRECTIONS
    expected = np.max(swept @ np.array([np.cos(angles), np.sin(angles)]), axis=0)
    assert limits == pytest.approx(expected, abs=1e-9)
    assert np.all(_is_inside(swept, corners(limits + 1e-6)))
    assert not np.all(_is_inside(swept, corners(limits - 1e-3)))


def test_the_place_and_heading_of_a_stop_do_not_matter() -> None:
    here, there = (
        support(run_fast_loop(configuration), footprint(configuration.vehicle), 0.2)
        for configuration in (
            _experiment(),
            _experiment("maneuver.x=7", "maneuver.y=-3", "maneuver.heading_deg=-160"),
        )
    )
    assert here == pytest.approx(there, abs=1e-6)


@pytest.mark.parametrize("width", [0.0, 0.3])
def test_the_footprint_contains_the_wheels_beside_the_chassis(width: float) -> None:
    vehicle = _experiment("vehicle.chassis_width=0.5").vehicle
    wheels = {
        name: dataclasses.replace(wheel, width=width) for name, wheel in vehicle.wheels.items()
    }
    outer = footprint(dataclasses.replace(vehicle, wheels=wheels))[:, 1].max()
    wheel = wheels["front_left"]
    assert outer == pytest.approx(wheel.y + 0.5 * (width or 0.4 * 2.0 * wheel.radius))


def test_the_footprint_has_the_offset_of_the_chassis() -> None:
    vehicle = _experiment("vehicle.chassis_x=-0.5", "vehicle.chassis_y=0.25").vehicle
    corners = footprint(vehicle)[:4]
    size = np.array([vehicle.chassis_length, vehicle.chassis_width])
    np.testing.assert_allclose(corners.max(axis=0), [-0.5, 0.25] + size / 2)
    np.testing.assert_allclose(corners.min(axis=0), [-0.5, 0.25] - size / 2)


def _parameters(
    bands: int, axes: tuple[float, float] | None = None
) -> tuple[str, list[dict[str, Any]]]:
    """Return the text of the monitor's file, and its polygons in their order."""
    options = AreaOptions(bands=bands)
    if axes:
        options = dataclasses.replace(options, speed_x=axes[0], speed_y=axes[1])
    cells = stop_campaign(options, ExperimentLibrary(CONFIG)).cells
    metrics = {"outside_share.all": Metric(0.0, "1"), "held_out_stops.all": Metric(0.0, "1")}
    limits = np.full((len(cells), DIRECTIONS), 2.0)
    text = monitor_parameters(options, cells, limits, metrics)
    monitor = yaml.safe_load(text)["collision_monitor"]["ros__parameters"]["VelocityPolygonStop"]
    return text, [{"name": name, **monitor[name]} for name in monitor["velocity_polygons"]]


def _selected(polygons: list[dict[str, Any]], v: complex, yaw_rate: float, newer: bool) -> str:
    """Return the name of the polygon that Nav2 selects; newer versions compare the magnitude."""
    speed, angle = (abs(v) if newer else v.real), math.atan2(v.imag, v.real)
    for polygon in polygons:
        if (
            polygon["theta_min"] <= yaw_rate <= polygon["theta_max"]
            and polygon["linear_min"] <= speed <= polygon["linear_max"]
            and _between(angle, polygon["direction_start_angle"], polygon["direction_end_angle"])
        ):
            return str(polygon["name"])
    return ""


def test_the_default_polygons_are_those_of_the_motion_with_every_version_of_nav2() -> None:
    text, polygons = _parameters(AreaOptions().bands)
    assert "every version of nav2_collision_monitor" in text
    random = np.random.default_rng(4)
    for speed, angle, turn in random.uniform((0, -math.pi, -0.5), (2, math.pi, 0.5), (2000, 3)):
        older, newer = (
            _selected(polygons, cmath.rect(speed, angle), turn, rule) for rule in (False, True)
        )
        assert older == newer != ""


@pytest.mark.parametrize("limits", [(1.5, 1.5), (2.0, 0.5), (0.4, 1.0)])
@pytest.mark.parametrize("bands", [1, 3])
def test_separate_limits_of_both_axes_have_a_polygon_for_every_velocity(
    limits: tuple[float, float], bands: int
) -> None:
    text, polygons = _parameters(bands, limits)
    assert f"{limits[0]:g} m/s for v_x, {limits[1]:g} m/s for v_y" in text
    random = np.random.default_rng(6)
    corner = complex(*limits) * (1.0 - 1e-4)  # the file is rounded
    velocities = [corner, corner.conjugate(), -corner, -corner.conjugate()]
    velocities += [complex(*(random.uniform(-1.0, 1.0, 2) * limits)) for _ in range(1000)]
    for v in velocities:
        assert _selected(polygons, v, 0.3, newer=True)
        if bands == 1:
            assert _selected(polygons, v, 0.3, newer=False) == _selected(polygons, v, 0.3, True)


def test_stops_keep_the_separate_limits_and_reach_them() -> None:
    options = AreaOptions(speed_x=1.2, speed_y=0.5)
    campaign = stop_campaign(options, ExperimentLibrary(CONFIG))
    maneuvers = [campaign.configuration(number).maneuver for number in range(600)]
    v = np.array([cmath.rect(m.speed, math.radians(m.direction_deg)) for m in maneuvers])
    assert np.max(np.abs(v.real)) == pytest.approx(1.2)
    assert np.max(np.abs(v.imag)) == pytest.approx(0.5)
    assert np.max(np.abs(v)) == pytest.approx(1.3, abs=0.01)


def test_a_single_limit_of_an_axis_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="--speed-x: needs --speed-y"):
        AreaOptions(speed_x=1.0)


def test_a_vehicle_on_conventional_wheels_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match=r"^wheels\..*conventional, but nav2-polygons "):
        stop_campaign(AreaOptions(vehicle="swerve_robot"), ExperimentLibrary(CONFIG))


def test_several_bands_name_the_versions_that_select_the_wrong_polygon() -> None:
    text, polygons = _parameters(2)
    assert "Only for nav2_collision_monitor of Jazzy from 1.3.12" in text
    assert _selected(polygons, 2j, 0.0, True) == "left_2"
    assert _selected(polygons, 2j, 0.0, False) == "left_1"


def test_the_corners_of_a_rectangle_are_its_corners() -> None:
    angles = np.arange(DIRECTIONS) * 2 * math.pi / DIRECTIONS
    box = np.abs(2.0 * np.cos(angles)) + np.abs(1.0 * np.sin(angles))
    found = {(round(float(x), 9), round(float(y), 9)) for x, y in corners(box)}
    assert found == {(2.0, 1.0), (-2.0, 1.0), (-2.0, -1.0), (2.0, -1.0)}


@pytest.mark.parametrize(
    ("coverage", "confidence", "stops"), [(0.99, 0.95, 299), (0.95, 0.95, 59), (0.9, 0.9, 22)]
)
def test_the_stops_that_a_promise_takes_are_those_of_wilks(
    coverage: float, confidence: float, stops: int
) -> None:
    assert calibration_stops(coverage, confidence) == stops


def test_every_motion_has_an_area() -> None:
    cells = make_cells(2.0, 3, 0.5, 3)
    random = np.random.default_rng(3)
    for speed, angle, turn in random.uniform((0, -math.pi, -0.5), (2, math.pi, 0.5), (500, 3)):
        assert (
            sum(
                cell.speed[0] <= speed <= cell.speed[1]
                and cell.yaw_rate[0] <= turn <= cell.yaw_rate[1]
                and (angle - cell.direction[0]) % math.tau <= math.pi / 4
                for cell in cells
            )
            == 1
        )
    assert len({cell.name for cell in cells}) == len(cells) == 3 * 8 * 3


@pytest.mark.parametrize("turns", [1, 2, 3, 5])
def test_the_areas_of_every_direction_are_drawn(turns: int) -> None:
    cells, vehicle = make_cells(2.0, 1, 0.5, turns), _experiment().vehicle
    figure = areas_figure(cells, np.full((len(cells), DIRECTIONS), 2.0), vehicle, "stops")
    chassis_and_nose, areas_of_straight_motion = 2, 1 if turns % 2 else 2
    drawn = [len(axes.patches) for axes in figure.axes]
    assert drawn == [chassis_and_nose + areas_of_straight_motion] * len(SECTORS)


def test_growth_is_that_of_the_stop_that_needs_most() -> None:
    campaign = StopCampaign(_experiment(), make_cells(1.0, 1, 0.1, 1), (1.0, 1.0), 0.0, 62, 1)
    sweeps = []
    for number in range(campaign.fitted):
        support_of = [1.0] * DIRECTIONS
        support_of[3] += 0.5 if number >= 61 * 8 and number % 8 == 2 else 0.0
        sweeps.append(Sweep(number, " ".join(map(str, support_of))))
    limits = areas(campaign, sweeps)
    assert limits[2] == pytest.approx(1.5)
    assert limits[[0, 1, 3, 4, 5, 6, 7]] == pytest.approx(1.0)
    farther = Sweep(campaign.fitted + 2, " ".join(["1.0"] * 15 + ["1.6"]))
    nearer = Sweep(campaign.fitted + 2, " ".join(["1.0"] * 15 + ["1.4"]))
    assert inside(campaign, limits, [farther, nearer]).tolist() == [False, True]


def test_the_margin_contains_the_motion_after_the_end_of_a_stop() -> None:
    library = ExperimentLibrary(CONFIG)
    shorter = stop_campaign(AreaOptions(), library)
    longer = stop_campaign(AreaOptions(overrides=("simulation.settling_time=0.5",)), library)
    ends, later = (
        supports_of([campaign.stop(number) for number in range(8)])
        for campaign in (shorter, longer)
    )
    assert np.all(later >= ends)
    assert np.all(later <= ends + 0.001)


def test_a_vehicle_that_does_not_stop_is_refused() -> None:
    ice = _experiment("simulation.duration_limit=1")
    campaign = StopCampaign(ice, make_cells(5.0, 1, 0.1, 1), (0.05, 0.05), 0.0, 62, 1)
    fast = next(n for n in range(40) if campaign.configuration(n).maneuver.speed > 3.0)
    with pytest.raises(ConfigurationError, match=r"not come to rest after 1 s.*friction of 0\.05"):
        campaign.stop(fast)


def test_stops_of_others_stay_within_the_polygons_of_the_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "own/vehicle.yaml"
    own.parent.mkdir()
    own.write_text((CONFIG / "vehicles/three_wheel_robot.yaml").read_text(encoding="utf-8"))
    words = ["nav2-polygons", "--vehicle", str(own), "--speed", "1.5", "--bands", "1"]
    words += ["--turns", "1", "--coverage", "0.9", "--confidence", "0.9"]
    words += ["--held-out", "96", "--workers", "1"]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--json", "--out", str(tmp_path)])
    assert ended.value.code == 0
    metrics = yaml.safe_load(capfd.readouterr().out)["metrics"]
    assert metrics["outside_share.all"]["value"] <= 0.1
    assert metrics["held_out_stops.all"]["value"] == 96
    text = (tmp_path / "collision_monitor.yaml").read_text()
    assert "# Stopping areas of own," in text
    parameters = yaml.safe_load(text)
    polygon = parameters["collision_monitor"]["ros__parameters"]["VelocityPolygonStop"]
    assert polygon["type"] == "velocity_polygon"
    assert polygon["holonomic"] is True
    assert len(polygon["velocity_polygons"]) == 8
    # A user's own stops, by the letter of Nav2's rule for those that count v_x and those that do
    # not, and by its test for points.
    random = np.random.default_rng(5)
    outside = 0
    stops = 40
    for _ in range(stops):
        speed, angle, turn = random.uniform((0.0, -math.pi, -0.5), (1.5, math.pi, 0.5))
        areas_of = [
            polygon[name]
            for name in polygon["velocity_polygons"]
            if polygon[name]["theta_min"] <= turn <= polygon[name]["theta_max"]
            and polygon[name]["linear_min"] <= speed <= polygon[name]["linear_max"]
            and polygon[name]["linear_min"] <= speed * math.cos(angle)
            and _between(
                angle, polygon[name]["direction_start_angle"], polygon[name]["direction_end_angle"]
            )
        ]
        assert areas_of, "the motion has no polygon"
        stop = _experiment(
            *("vehicle=three_wheel_robot", f"maneuver.speed={speed}", "brake_assist.enabled=true"),
            f"maneuver.direction_deg={math.degrees(angle)}",
            f"maneuver.yaw_rate_deg={math.degrees(turn)}",
            f"ground.friction={random.uniform(0.6, 1.0)}",
        )
        points = np.array(yaml.safe_load(areas_of[0]["points"]))
        outside += not np.all(_is_inside(_swept(stop, 0.2), points))
    assert outside <= 4


def _between(angle: float, start: float, end: float) -> bool:
    return start <= angle <= end if start <= end else angle >= start or angle <= end
