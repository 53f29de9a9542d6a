"""The standard experiment over processes: results and written files."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from made_histories import first_difference
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader

from omni_core.configuration import from_mapping
from omni_ros.messages import diagnostics, to_nanoseconds
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.loop import run_closed_loop
from omni_runs.recorded_run import read_run

if TYPE_CHECKING:
    from conftest import FinishedRun, RunExperiment

VARIANTS = ("unassisted", "assisted")
SHORT = ("maneuver.speed=5", "maneuver.brake_time=0.2")
"""Overrides for a third fewer steps; the numbers of the pages are those of the whole experiment."""


@pytest.fixture(scope="module")
def straight_line(run_experiment: RunExperiment) -> FinishedRun:
    """The standard experiment from a lower speed, without and with the assistant."""
    variants = [f"--variant={variant}" for variant in VARIANTS]
    return run_experiment("straight_line", *variants, *(f"--set={value}" for value in SHORT))


def test_unassisted_swerves(straight_line: FinishedRun) -> None:
    assert straight_line.value("orientation_change.unassisted") > 15.0


@pytest.mark.parametrize("quantity", ["orientation_change", "lateral_deviation"])
def test_assisted_keeps_its_line(straight_line: FinishedRun, quantity: str) -> None:
    limit = {"orientation_change": 2.0, "lateral_deviation": 0.1}[quantity]
    assert straight_line.value(f"{quantity}.assisted") < limit


@pytest.fixture(scope="module")
def weighting_zero(run_experiment: RunExperiment) -> FinishedRun:
    """The assisted run with another weighting, and the sideslip angle of a virtual front wheel."""
    wheel = {"sensor": "front", "x": 0.6, "y": 0.0}
    sets = [f"--set=odometry.sideslip.nose.{key}={value}" for key, value in wheel.items()]
    return run_experiment("small_stop", "--set=brake_assist.weighting=zero", *sets)


def test_weighting_zero_keeps_its_line_too(weighting_zero: FinishedRun) -> None:
    assert weighting_zero.value("orientation_change.assisted") < 4.0
    assert weighting_zero.value("lateral_deviation.assisted") < 0.3


def test_sideslip_is_published_with_every_twist(weighting_zero: FinishedRun) -> None:
    with AnyReader([weighting_zero.folder / "assisted"]) as reader:
        angles: dict[int, Any] = {
            stamp: reader.deserialize(data, connection.msgtype)
            for connection, stamp, data in reader.messages()
            if connection.topic == "/odometry/sideslip"
        }
        assert len(angles) == reader.topics["/odometry/twist"].msgcount
    assert all(list(message.name) == ["nose"] for message in angles.values())
    # Straight on before it brakes; the first line has none to be compared with.
    before = [message.position[0] for stamp, message in angles.items() if stamp < 300_000_000]
    assert math.isnan(before[0])
    assert max(abs(math.degrees(angle)) for angle in before[1:]) < 1.0


def test_assisted_errors_are_smaller_by_a_factor_of_five_on_cameras(
    straight_line: FinishedRun,
) -> None:
    """Section 3.6.1: errors relative to the sliding manifold, Figures 31 and 32."""
    largest = {}
    for variant in VARIANTS:
        error = read_run(straight_line.folder / variant).error
        largest[variant] = float(abs(error).max())
    assert largest["assisted"] < 0.2 * largest["unassisted"]


def test_optical_feedback_follows_the_truth(straight_line: FinishedRun) -> None:
    # The mean over the last 10 ms lags by 5 ms: 0.03 m/s while braking with 6 m/s^2.
    assert straight_line.value("twist_rmse.assisted") < 0.1
    assert straight_line.value("yaw_rate_rmse.assisted") < 0.05


@pytest.mark.parametrize("variant", VARIANTS)
def test_one_process_gives_the_same_bits(
    straight_line: FinishedRun, library: ExperimentLibrary, variant: str
) -> None:
    in_one_process = run_closed_loop(library.load("straight_line", variant, SHORT))
    over_topics = read_run(straight_line.folder / variant)
    assert first_difference(over_topics, in_one_process) is None
    assert over_topics.assist_state == in_one_process.assist_state


def test_noisy_velocity_sensor_gives_the_same_bits_too(
    run_experiment: RunExperiment, library: ExperimentLibrary
) -> None:
    """The dissertation's feedback, Eqs. (60) and (61); the odometry runs without being used."""
    overrides = (
        "feedback=velocity_sensor",
        "velocity_sensor.linear_noise=0.15",
        "brake_assist.maximum_speed_deviation=1",
        "brake_assist.speed_noise=3",
    )
    words = [word for override in overrides for word in ("--set", override)]
    run = run_experiment("small_stop", *words)
    assert run.value("orientation_change.assisted") < 5.0
    assert run.value("fail_safe_share.assisted") == 0.0
    in_one_process = run_closed_loop(library.load("small_stop", "assisted", overrides))
    assert first_difference(read_run(run.folder / "assisted"), in_one_process) is None


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_topic_is_recorded_without_loss(straight_line: FinishedRun, variant: str) -> None:
    folder = straight_line.folder / variant
    configuration = from_mapping(
        ExperimentConfiguration, yaml.safe_load((folder / "configuration.yaml").read_text())
    )
    with AnyReader([folder]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        images: list[Any] = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages(
                [c for c in reader.connections if c.topic == "/line_scan/left/lines"]
            )
        ]
    steps = counts["/clock"]
    history = read_run(folder)
    assert steps == len(history.stamp_ns)
    each_step = ["/wheel_states", "/brake/pedal", "/brake/enable", "/brake_assist/error"]
    each_step += ["/driver/command", "/odometry/twist", "/velocity_sensor/twist", "/imu"]
    each_step += ["/ground_truth/odom", "/tf"]
    each_step += [f"/line_scan/{sensor}/lines" for sensor in configuration.sensors]
    assert {topic: counts[topic] for topic in each_step} == dict.fromkeys(each_step, steps)
    assert counts["/markers"] == counts["/wheel_forces"] == math.ceil(steps / 5)
    assert counts["/diagnostics"] > 0
    assert counts["/line_scan/left/camera_info"] == counts["/tf_static"] == 1
    # 2500 lines a second and not one missing: line 0, then 25 in every step.
    assert [image.height for image in images] == [1] + [25] * (steps - 1)
    assert all(image.width == 1024 for image in images)


def test_the_diagnostics_of_a_node_are_recorded_bit_for_bit(straight_line: FinishedRun) -> None:
    """Padding of CDR is zero, so that recordings of two runs can be compared byte by byte."""
    with AnyReader([straight_line.folder / "assisted"]) as reader:
        connections = [c for c in reader.connections if c.topic == "/diagnostics"]
        recorded = [bytes(data) for _, _, data in reader.messages(connections)]
    assert recorded
    for data in recorded:
        message = deserialize_message(data, DiagnosticArray)
        (status,) = message.status
        values = {pair.key: pair.value for pair in status.values}
        stamp_ns = to_nanoseconds(message.header.stamp)
        assert data == diagnostics(stamp_ns, status.name, status.level[0], status.message, values)


@pytest.mark.parametrize("variant", VARIANTS)
def test_configuration_versions_and_summary_are_next_to_the_bag(
    straight_line: FinishedRun, library: ExperimentLibrary, variant: str
) -> None:
    folder = straight_line.folder / variant
    saved = yaml.safe_load((folder / "configuration.yaml").read_text())
    assert from_mapping(ExperimentConfiguration, saved) == library.load(
        "straight_line", variant, SHORT
    )
    versions = yaml.safe_load((folder / "versions.yaml").read_text())
    assert {"python", "numpy", "omni_sim"} <= set(versions)
    summary = json.loads((folder / "summary.json").read_text())
    name = f"stopping_distance.{variant}"
    assert summary["metrics"][name] == straight_line.metrics[name]


def test_figures_are_drawn(straight_line: FinishedRun) -> None:
    for name in ("top_view.png", "time_series.png"):
        assert (straight_line.folder / name).read_bytes().startswith(b"\x89PNG")


def test_results_have_the_agreed_shape(straight_line: FinishedRun) -> None:
    quantities = {
        "stopping_distance": "m",
        "path_length": "m",
        "orientation_change": "deg",
        "lateral_deviation": "m",
        "stopping_time": "s",
        "peak_yaw_rate": "rad/s",
        "brake_switchings": "1",
        "fail_safe_share": "1",
        "twist_rmse": "m/s",
        "yaw_rate_rmse": "rad/s",
        "real_time_factor": "1",
    }
    for variant in VARIANTS:
        for quantity, unit in quantities.items():
            metric = straight_line.metrics[f"{quantity}.{variant}"]
            assert metric["unit"] == unit
            assert math.isfinite(metric["value"])
