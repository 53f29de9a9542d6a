"""Invalid input is rejected by name before anything starts; Ctrl-C leaves no process running."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import resource
import signal
import subprocess
from pathlib import Path

import pytest
from omni_process import (
    RUN_TIMEOUT,
    WORKSPACE,
    disturbed,
    node_processes,
    omni_command,
    omni_environment,
    omni_here,
    processes_of,
    recorded_bytes,
    run_process,
    wait_until,
)
from rosbags.highlevel import AnyReader

from omni_bringup.cli import main

# The run brakes so late that it does not end before a busy machine disturbs it.
LATE = ("--set", "maneuver.brake_time=20")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "vehicle.load.mas=400"], "vehicle.load.mas: is not a known key; did you mean"),
        (["--set", "vehicle.load.mass=heavy"], "vehicle.load.mass: 'heavy' is a text"),
        (["--set", "vehicle.load.mass=-1"], "vehicle.load.mass: -1 kg is out of range"),
        (["--set", "vehicle.load.mass=.nan"], "vehicle.load.mass: nan kg is not a finite"),
        (["--set", "vehicle.load.mass"], "must have the form key=value"),
        (["--set", "vehicle=bicycle"], "vehicle: 'bicycle' is not known"),
        (["--set", "ground=ice", "--variant", "assisted"], "ground: 'ice' is not known"),
        (["--set", "brake_assist.k=4"], "brake_assist.k: 4"),
        (["--set", "simulation.control_period=0.0123"], "simulation.control_period"),
        (["--set", "sensors.front.heading_deg=0.0"], "odometry.sensors"),
        (["--set", "simulation.render_lines=false"], "must be true for optical feedback"),
        (["--set", "vehicle=[1, 2]"], "vehicle: [1, 2] is a list"),
        (["--set", "odometry=null"], "odometry: is nothing"),
        (["--set", "seed=99999999999999999999"], "seed: the whole number has more than 64 bits"),
        (["--set", 'vehicle.load.mass="400"'], "vehicle.load.mass: '400' is a text"),
        (["--set", "maneuver.speed=5 km/h"], "must be a number in m/s, without its unit"),
        (["--set", "vehicle.load={x: 0,5}"], "a number must have a decimal point, not a comma"),
        (
            ["--variant", "assisted", "--variant", "assisted"],
            "--variant: 'assisted' is given twice",
        ),
        (["--variant", "half_assisted"], "'half_assisted' is not a variant"),
        (["strait_line"], "did you mean 'straight_line'"),
        (["--out", "/proc/omni"], "--out: cannot make /proc/omni"),
        (
            ["--set", "vehicle.load.mass=400,500", "--out", "/proc/omni"],
            "--out: cannot make /proc/omni",
        ),
    ],
)
def test_bad_input_is_refused_by_name(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("OMNI_WORKSPACE", str(WORKSPACE))
    out = tmp_path / "out"
    chosen = [] if "--out" in arguments else ["--out", str(out)]
    with pytest.raises(SystemExit) as ended:
        main(["run", *arguments, *chosen])
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert not printed.out
    assert not out.exists()


@pytest.mark.parametrize(
    "words", [["list"], ["list", "--json"], ["completion"], ["run", "--help"], ["--version"]]
)
def test_an_output_that_cannot_be_written_is_a_failure_in_one_line(words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        finished = subprocess.run(
            omni_command(words), stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            env=omni_environment(), timeout=RUN_TIMEOUT,
        )  # fmt: skip
    problem = f"cannot write the output: {os.strerror(errno.ENOSPC)}"
    program = "omni" if words == ["--version"] else f"omni {words[0]}"
    assert (finished.returncode, finished.stderr) == (1, f"{program}: {problem}\n")


def test_a_refusal_that_cannot_be_written_is_one_line() -> None:
    words = ["run", "nosuch", "--json"]
    with Path("/dev/full").open("w") as full:
        finished = subprocess.run(
            omni_command(words), stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            env=omni_environment(), timeout=RUN_TIMEOUT,
        )  # fmt: skip
    assert finished.returncode == 2
    assert re.fullmatch("omni run: experiment: 'nosuch' is not known.*\n", finished.stderr)


def test_settings_of_a_notebook_or_of_no_terminal_change_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    monkeypatch.setenv("COLUMNS", "0")
    sample = WORKSPACE / "bags" / "small_stop" / "assisted"
    finished = omni_here(["compare", str(sample)])
    assert "stopping distance" in finished.stdout
    words = ["show", "wood", "--out", str(tmp_path / "wood.png")]
    finished = subprocess.run(
        omni_command(words), capture_output=True, text=True, check=False, env=omni_environment(),
        timeout=RUN_TIMEOUT,
    )  # fmt: skip
    assert finished.returncode == 0, finished.stderr


@pytest.mark.parametrize(
    ("mass", "words"),
    [
        ("30000", "rollers.stiffness: .* check them and their units"),
        ("0,5", "--mass: '0,5' is a text, must be a number in kg, without its unit"),
    ],
)
def test_a_vehicle_of_wrong_numbers_is_refused_and_leaves_no_files(
    mass: str, words: str, tmp_path: Path
) -> None:
    size = ("--length", "0.58", "--width", "0.38", "--wheel-radius", "0.05")
    finished = omni_here(["new-vehicle", "x", *size, "--mass", mass, "--out", str(tmp_path)])
    assert finished.returncode == 2
    assert re.search(words, finished.stderr)
    assert not list(tmp_path.iterdir())


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    finished = omni_here(["run", "--out", str(tmp_path)])
    assert finished.returncode == 2
    assert "not an empty folder" in finished.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("moment", "number", "code"),
    [
        ("first node", signal.SIGINT, 130),
        ("all nodes", signal.SIGTERM, 143),
        ("recording", signal.SIGINT, 130),
    ],
)
def test_interrupt_ends_every_process(
    moment: str, number: signal.Signals, code: int, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    with run_process(folder, *LATE, "--variant=assisted") as process:
        if moment == "recording":
            wait_until(lambda: recorded_bytes(folder) > 2_000_000)
        else:
            # With the process that forks the nodes, and the resource tracker of multiprocessing.
            wanted = 3 if moment == "first node" else 6
            wait_until(lambda: len(node_processes(process.pid)) >= wanted)
        process.send_signal(number)
        assert process.wait(RUN_TIMEOUT) == code
        # The process that forks the nodes notices the end of the one that started it.
        wait_until(lambda: not node_processes(process.pid))
        assert "Traceback" not in (process.stderr.read() if process.stderr else "")
    if moment == "recording":
        with AnyReader([folder / "assisted"]) as reader:
            assert reader.topics["/clock"].msgcount > 10
            assert (folder / "assisted/configuration.yaml").is_file()


def test_a_vehicle_that_rolls_on_under_the_pedal_is_a_failed_run(tmp_path: Path) -> None:
    out = tmp_path / "run"
    plain = ["--set", "feedback=velocity_sensor", "--set", "simulation.render_lines=false"]
    changes = [*plain, "--set", "simulation.duration_limit=0.5"]
    result = omni_here(["run", "small_stop", *changes, "--out", str(out)])
    assert result.returncode == 1
    assert "assisted: the pedal is down and the vehicle still moves at 0.50 s" in result.stderr
    assert (out / "assisted/summary.json").is_file()  # the finished run is kept


@pytest.mark.parametrize("moment", ["before Python", "importing"])
def test_an_interrupt_before_anything_has_started(moment: str, tmp_path: Path) -> None:
    # The launcher blocks the signals when it hands over; the new process inherits that.
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    with contextlib.ExitStack() as running:
        try:
            process = running.enter_context(run_process(tmp_path / "out", *LATE))
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        if moment == "importing":
            libraries = Path(f"/proc/{process.pid}/maps")
            wait_until(lambda: "_multiarray_umath" in libraries.read_text())
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=RUN_TIMEOUT)
    assert (process.returncode, errors) == (130, "interrupted\n")
    assert not (tmp_path / "out").exists()


def test_an_interrupt_of_the_terminal_is_handled_by_the_bring_up_alone(tmp_path: Path) -> None:
    with run_process(tmp_path / "out", *LATE) as process:
        # The process that forks the nodes is still importing, in the group of the terminal.
        wait_until(
            lambda: any(
                "_multiarray_umath" in Path(f"/proc/{pid}/maps").read_text()
                for pid in node_processes(process.pid)
            )
        )
        for pid in (process.pid, *node_processes(process.pid)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGINT)
        _, errors = process.communicate(timeout=RUN_TIMEOUT)
    assert (process.returncode, errors) == (130, "interrupted\n")
    wait_until(lambda: not node_processes(process.pid))


def test_nodes_end_with_a_killed_bring_up(tmp_path: Path) -> None:
    with run_process(tmp_path / "out", *LATE) as process:
        wait_until(lambda: recorded_bytes(tmp_path / "out") > 0)
        # Those of two variants, one for their results, the process that forks them, and its
        # resource tracker.
        wait_until(lambda: len(node_processes(process.pid)) == 11)
    wait_until(lambda: not node_processes(process.pid))


def test_a_full_disk_ends_the_run_and_leaves_a_readable_bag(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with run_process(folder, *LATE, "--variant=assisted") as process:
        # Every write beyond this size fails, as on a full disk; the nodes inherit it.
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
        _, words = process.communicate(timeout=RUN_TIMEOUT)
    assert process.returncode == 1
    assert f"recorder ended (exit code 1): cannot record to {folder / 'assisted'}: " in words
    assert "Traceback" not in words
    with AnyReader([folder / "assisted"]) as reader:
        assert reader.topics["/clock"].msgcount > 10


def test_a_node_that_dies_ends_the_run_by_name(tmp_path: Path) -> None:
    folder = tmp_path / "out"

    def kill_the_assistant() -> None:
        for pid in processes_of("omni_brake_assist", os.getpid()):
            os.kill(pid, signal.SIGKILL)

    words = ["run", *LATE, "--variant=assisted", "--out", str(folder)]
    ended = disturbed(words, folder, 1_000_000, kill_the_assistant)
    assert ended is not None
    assert ended.returncode == 1
    assert "brake_assist ended (signal 9)" in ended.stderr
    nodes = ("omni_sim", "omni_recording", "omni_brake_assist", "linescan_odometry")
    assert [processes_of(package, os.getpid()) for package in nodes] == [[], [], [], []]
    with AnyReader([folder / "assisted"]) as reader:
        assert reader.topics["/clock"].msgcount > 0
