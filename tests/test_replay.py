"""Replays over the graph, and recovery of a killed recorder's recording."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

from omni_process import (
    RUN_TIMEOUT,
    WORKSPACE,
    node_processes,
    omni,
    omni_here,
    processes_of,
    recorded_bytes,
    run_process,
    wait_until,
)
from rosbags.highlevel import AnyReader

from omni_recording.actions.compare import compare_topics
from omni_runs.recorded_run import read_run

SAMPLE = WORKSPACE / "bags/small_stop/assisted"
NODES = ["--nodes", "linescan_odometry", "brake_assist"]
RESULTS = ("/odometry/twist", "/brake/enable", "/brake_assist/error")


def test_the_real_nodes_give_what_was_recorded(tmp_path: Path) -> None:
    for attempt in range(5):
        folder = tmp_path / f"graph{attempt}"
        finished = omni(["replay", str(SAMPLE), *NODES, "--check", "--json", "--out", str(folder)])
        document = json.loads(finished.stdout)
        if document["timeouts"] == 0:
            break  # otherwise, a busy machine stalled the nodes, and the player did not wait
    assert finished.returncode == 0, finished.stderr
    metrics = document["metrics"]
    steps = len(read_run(SAMPLE).stamp_ns)
    assert {metrics[f"replayed.{topic}"]["value"] for topic in RESULTS} == {steps}
    with AnyReader([folder]) as reader:
        assert reader.topics["/clock"].msgcount >= steps
        last = max(stamp for _, stamp, _ in reader.messages())
    assert last == read_run(SAMPLE).stamp_ns[-1]
    # On one machine one process gives the same bits.
    offline = tmp_path / "offline"
    words = ["replay", str(SAMPLE), *NODES, "--offline", "--out", str(offline)]
    assert omni_here(words).returncode == 0
    for one in compare_topics(folder, offline, RESULTS).values():
        assert one.identical == one.first == one.second == steps


def test_the_rate_is_that_of_the_recording_on_request(tmp_path: Path) -> None:
    changed = ["--set", "odometry.sensors.front.x=0.61"]
    arguments = ["replay", str(SAMPLE), "--rate", "2", "--check", *changed]
    start = time.monotonic()
    finished = omni_here([*arguments, "--out", str(tmp_path / "out")])
    # Only a lower bound of the duration is tested: the recorded time divided by the rate.
    assert time.monotonic() - start > 2.33 / 2.0
    assert finished.returncode == 1
    assert "not within the tolerance" in finished.stdout


def test_a_killed_recording_is_recovered_replayed_and_reported(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    bag = folder / "assisted"
    with run_process(folder, "--variant", "assisted") as process:
        wait_until(lambda: recorded_bytes(folder) > 4_000_000)
        (recorder,) = processes_of("omni_recording", process.pid)
        os.kill(recorder, signal.SIGKILL)
        _, words = process.communicate(timeout=RUN_TIMEOUT)
    assert process.returncode == 1
    assert "recorder ended (signal 9)" in words
    assert f"what was recorded is in {folder}" in words
    assert ".mcap is incomplete" in words
    wait_until(lambda: not node_processes(process.pid))
    recovered = omni_here(["bag", "recover", str(bag), "--json"])
    assert recovered.returncode == 0, recovered.stderr
    metrics = json.loads(recovered.stdout)["metrics"]
    assert metrics["messages./clock"]["value"] > 30
    saved = f"{bag}_recovered"
    assert omni_here(["bag", "check", saved]).returncode == 0
    assert len(read_run(saved).stamp_ns) == metrics["messages./ground_truth/odom"]["value"]
    replayed = omni_here(["replay", saved, "--out", str(tmp_path / "again"), "--json"])
    assert replayed.returncode == 0, replayed.stderr
    metrics = json.loads(replayed.stdout)["metrics"]
    twists = {
        name: metrics[f"{name}./odometry/twist"]["value"]
        for name in ("recorded", "identical", "unpaired", "largest_difference")
    }
    # Messages of different topics reach the recorder in any order. At the cut, the lines of some
    # last twists, or the twists of some last lines, may therefore be missing.
    assert twists["recorded"] > 30
    assert twists["recorded"] - twists["identical"] <= twists["unpaired"] < 10
    assert twists["largest_difference"] == 0.0
    page = tmp_path / "report.html"
    reported = omni_here(["report", saved, "--out", str(page)])
    assert reported.returncode == 0, reported.stderr
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
