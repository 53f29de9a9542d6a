"""Values and notes of a report that are not in the recording."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY
from omni_recording.limits import LIMITS
from omni_runs.experiment import ExperimentLibrary
from omni_runs.history import RunHistory
from omni_runs.metrics import run_metrics
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.report.document import flat_ground_loads, report_document, report_page, rim_slips
from omni_tools.report.recording import (
    ReportedRun,
    read_configuration,
    read_reported_run,
    run_names,
)

MakeHistory = Callable[..., RunHistory]
WORKSPACE = Path(__file__).resolve().parents[4]
SAMPLE = WORKSPACE / "bags" / "small_stop" / "assisted"


@pytest.fixture(scope="module")
def vehicle() -> VehicleConfiguration:
    return ExperimentLibrary(WORKSPACE / "config").load("small_stop", "assisted").vehicle


def reported(history: RunHistory, **more: Any) -> ReportedRun:
    return ReportedRun(name="run", history=history, metrics=run_metrics(history), **more)


# ---------------------------------------------------------------- slips and loads


def test_perfect_rolling_slips_nowhere(
    vehicle: VehicleConfiguration, make_history: MakeHistory
) -> None:
    history = make_history(turn=1.0)
    names = history.wheel_names  # in another order than the vehicle's
    assert names != tuple(vehicle.wheels)
    kinematics = PlatformKinematics({name: vehicle.wheels[name] for name in names})
    rolling = dataclasses.replace(history, wheel_speed=kinematics.wheel_speeds(history.twist))
    slips = rim_slips(vehicle, rolling)
    moving = np.abs(rolling.wheel_speed) * 0.2 > 0.1
    assert np.max(np.abs(slips[moving])) < 1e-9
    # A rim slower by a tenth lags behind the ground by a tenth of its speed; a locked one wholly.
    slower = dataclasses.replace(rolling, wheel_speed=0.9 * rolling.wheel_speed)
    sliding = rim_slips(vehicle, slower)[moving]
    assert np.abs(sliding) == pytest.approx(0.1, rel=1e-9)
    locked = dataclasses.replace(rolling, wheel_speed=np.zeros_like(rolling.wheel_speed))
    assert np.abs(rim_slips(vehicle, locked)[moving]) == pytest.approx(1.0)


def test_at_rest_there_is_no_slip_to_speak_of(
    vehicle: VehicleConfiguration, make_history: MakeHistory
) -> None:
    history = make_history()
    still = dataclasses.replace(
        history, twist=np.zeros_like(history.twist), wheel_speed=np.zeros_like(history.enable)
    )
    assert np.all(np.isnan(rim_slips(vehicle, still)))


def test_loads_balance_weight_and_inertia(
    vehicle: VehicleConfiguration, make_history: MakeHistory
) -> None:
    history = make_history(deceleration=4.0, speed=8.0)
    loads = flat_ground_loads(vehicle, history)
    masses = vehicle.masses
    weight = masses.mass * GRAVITY
    assert np.sum(loads, axis=1) == pytest.approx(weight, rel=1e-9)
    places = np.array([(vehicle.wheels[n].x, vehicle.wheels[n].y) for n in history.wheel_names])
    moment = loads @ (places - masses.center) / weight
    # The zero-moment point is h a / g ahead of the center of gravity while it brakes.
    late = np.searchsorted(history.braking_time, 1.0)
    assert moment[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert moment[late] == pytest.approx([masses.height * 4.0 / GRAVITY, 0.0], abs=1e-6)


# ---------------------------------------------------------------- document and page


def decoded(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def test_columns_carry_the_history(make_history: MakeHistory) -> None:
    history = make_history(turn=0.5)
    run = reported(history)
    document = report_document("title", [run])
    (shown,) = document["runs"]
    assert decoded(shown["columns"]["time"][0]) == pytest.approx(history.braking_time, abs=1e-6)
    for wheel in range(4):
        error = decoded(shown["columns"]["error"][wheel])
        assert error == pytest.approx(history.error[:, wheel], rel=1e-6)
    heading = decoded(shown["columns"]["heading"][0])
    assert heading[-1] == pytest.approx(math.degrees(0.5), rel=1e-6)
    assert shown["brakeStart"] == history.brake_start
    assert {row["label"]: row["values"] for row in document["metrics"]}["stopping distance"] == [
        "10.00"
    ]


def test_test_ratios_carry_what_the_assistant_published() -> None:
    run = read_reported_run(SAMPLE, "run")
    shown = report_document("", [run])["runs"][0]["series"]["test_ratio"]
    wheels = [name.replace("_", " ") for name in run.history.wheel_names]
    assert shown["names"][:3] == ["twist", "gyro", "accelerometer"]
    assert sorted(shown["names"][3:]) == sorted(wheels)
    twist = decoded(shown["values"][0])
    assert len(twist) == len(decoded(shown["time"]))
    assert np.nanmax(twist) < 1.0  # no fault in this run


def test_values_that_no_float_holds_do_no_harm(make_history: MakeHistory) -> None:
    plain = make_history()
    history = dataclasses.replace(plain, error=np.full_like(plain.error, 1e300))
    column = report_document("", [reported(history)])["runs"][0]["columns"]["error"][0]
    assert np.all(decoded(column) == np.inf)


def test_differences_are_those_of_the_values(make_history: MakeHistory) -> None:
    history = make_history()
    runs = [reported(history, values={"a": "1", "b": "x"}), reported(history, values={"a": "2"})]
    rows = report_document("", runs)["configuration"]
    assert rows == [{"key": "a", "values": ["1", "2"]}, {"key": "b", "values": ["x", None]}]


def test_a_nominal_value_is_shown_only_if_it_is_not_the_true_one(
    make_history: MakeHistory,
) -> None:
    values = {
        "sensors.left.x": "0.1",
        "sensors.left.y": "0.2",
        "odometry.sensors.left.x": "0.1",
        "odometry.sensors.left.y": "0.3",
        "odometry.method": "joint",
    }
    rows = report_document("", [reported(make_history(), values=values)])["configuration"]
    del values["odometry.sensors.left.x"]
    assert [row["key"] for row in rows] == list(values)


def test_the_page_is_one_file_that_asks_for_nothing(make_history: MakeHistory) -> None:
    title = "</script> & <b>{{STYLE}}"
    page = report_page(title, [reported(make_history())])
    assert not re.search(r"\b(?:https?|ftp|wss?):(?!//www\.w3\.org/2000/svg\")", page)
    assert "default-src 'none'" in page
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page)
    assert json.loads(data)["title"] == title
    with pytest.raises(ValueError, match="at least one run"):
        report_page("none", [])


# ---------------------------------------------------------------- reading


def test_names_are_as_short_as_they_can_be() -> None:
    assert run_names([Path("a/assisted"), Path("a/unassisted")]) == ["assisted", "unassisted"]
    assert run_names([Path("a/x/run"), Path("b/x/run")]) == ["a/x/run", "b/x/run"]
    with pytest.raises(ValueError, match="twice"):
        run_names([Path("a"), Path("a/../a")])


def aliases(levels: int) -> str:
    """Return a few lines of YAML that expand to 8 ** levels values."""
    lines = ["k0: &k0 {a: 1, b: 2, c: 3, d: 4, e: 5, f: 6, g: 7, h: 8}"]
    for level in range(1, levels):
        inner = ", ".join(f"{letter}: *k{level - 1}" for letter in "abcdefgh")
        lines.append(f"k{level}: &k{level} {{{inner}}}")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "there is no configuration.yaml"),
        ("vehicle: [", "is not valid YAML"),
        ("- 1", "does not name any value"),
        ("#" * (LIMITS.text + 1), "is larger than"),
        (aliases(20), "values, with those that aliases repeat"),
        ("a: &a {b: *a}", "a value contains itself"),
        ("a: &a [*a]", "a value contains itself"),
        ("\x00", "is not valid YAML"),
    ],
    ids=["none", "broken", "list", "large", "aliases", "endless", "endless list", "binary"],
)
def test_a_recording_without_a_usable_configuration(
    tmp_path: Path, text: str | None, reason: str, make_history: MakeHistory
) -> None:
    file = tmp_path / "configuration.yaml"
    if text is not None:
        file.write_text(text)
    history = make_history()
    configuration, values, problem = read_configuration(file, history.wheel_names)
    assert configuration is None
    assert reason in problem
    assert len(values) <= 4000
    assert all(len(key) <= 200 and len(value) <= 200 for key, value in values.items())
    page = report_page("odd", [reported(history, values=values, notes=(problem,))])
    assert len(page) < 2_000_000


def test_a_configuration_must_be_that_of_the_vehicle() -> None:
    names = ("front_left", "front_right", "rear_left", "rear_right")
    configuration, values, problem = read_configuration(SAMPLE / "configuration.yaml", names)
    assert configuration is not None
    assert problem == ""
    assert values["vehicle.load.mass"] == "250.0"
    assert values["ground.patches"] == "(none)"
    assert values["brake_assist.enabled"] == "true"
    configuration, _, problem = read_configuration(SAMPLE / "configuration.yaml", names[:3])
    assert configuration is None
    assert "other wheels" in problem
