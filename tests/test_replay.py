"""Replays of recorded runs, and recovery of a killed recorder's recording."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

from omni_process import disturbed, omni, omni_here, processes_of

from omni_runs.recorded_run import read_run

NODES = ["--nodes", "linescan_odometry", "brake_assist"]
RESULTS = ("/odometry/twist", "/brake/enable", "/brake_assist/error")


def test_a_replay_gives_what_the_nodes_gave(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    words = ["run", "small_stop", "--variant", "assisted", "--out", str(folder)]
    finished = omni_here(words)
    assert finished.returncode == 0, finished.stderr
    bag = folder / "assisted"
    finished = omni(["replay", str(bag), *NODES, "--json", "--out", str(tmp_path / "replayed")])
    metrics = json.loads(finished.stdout)["metrics"]
    steps = len(read_run(bag).stamp_ns)
    for topic in RESULTS:
        for name in ("recorded", "replayed", "identical"):
            assert metrics[f"{name}.{topic}"]["value"] == steps


def test_a_killed_recording_is_recovered_replayed_and_reported(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    bag = folder / "assisted"

    def kill_the_recorder() -> None:
        (recorder,) = processes_of("omni_recording", os.getpid())
        os.kill(recorder, signal.SIGKILL)

    run = ["run", "--variant", "assisted", "--out", str(folder)]
    ended = disturbed(run, folder, 4_000_000, kill_the_recorder)
    assert ended is not None
    assert ended.returncode == 1
    assert "recorder ended (signal 9)" in ended.stderr
    assert f"what was recorded is in {folder}" in ended.stderr
    assert ".mcap is incomplete" in ended.stderr
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
