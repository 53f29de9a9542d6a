"""Processes are found through the ament index, and none of them outlives its group."""

from __future__ import annotations

import dataclasses
import functools
import glob
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from omni_runs.graph import run_variant
from omni_runs.graph.process_group import (
    NodeProcess,
    ProcessError,
    ProcessGroup,
    RunningProcess,
    describe_end,
    find_executable,
    wait_for,
)


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An ament prefix with one package, `toys`, whose executables are Python programs."""
    marker = tmp_path / "share/ament_index/resource_index/packages/toys"
    marker.parent.mkdir(parents=True)
    marker.touch()
    (tmp_path / "lib/toys").mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere{os.pathsep}{tmp_path}")
    return tmp_path


def add_program(prefix: Path, name: str, body: str) -> NodeProcess:
    path = prefix / "lib/toys" / name
    # Python reads the first lines as a string. The kernel accepts no path with spaces there.
    path.write_text(f"#!/bin/sh\n'''exec' '{sys.executable}' \"$0\" \"$@\"\n' '''\n{body}\n")
    path.chmod(0o755)
    return NodeProcess(name, "toys", name)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def running(pid: int) -> bool:
    """Return whether a process runs and is not a zombie."""
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)


def test_executables_are_found_as_ros2_run_finds_them(prefix: Path) -> None:
    add_program(prefix, "sleeper", "")
    assert find_executable("toys", "sleeper") == prefix / "lib/toys/sleeper"


@pytest.mark.parametrize(("package", "executable"), [("toys", "nothing"), ("games", "sleeper")])
def test_what_is_not_there_is_named(prefix: Path, package: str, executable: str) -> None:
    add_program(prefix, "sleeper", "")
    with pytest.raises(ProcessError, match=f"'{package}'.*'{executable}'.*2 prefixes"):
        find_executable(package, executable)


def test_stubborn_processes_are_killed_and_gone(prefix: Path) -> None:
    body = (
        "import signal, time\n"
        "from omni_ros.environment import report\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "report({})\n"
        "time.sleep(60)"
    )
    with ProcessGroup(os.environ, stop_timeout=0.2) as group:
        processes = [group.start(add_program(prefix, f"mule{i}", body)) for i in range(2)]
        deadline = time.monotonic() + 20.0
        for process in processes:
            while not process.new_reports() and time.monotonic() < deadline:
                wait_for(process, 0.02)
    assert [process.returncode for process in processes] == [-signal.SIGKILL] * 2
    assert not any(alive(process.pid) for process in processes)


def test_processes_end_when_the_block_is_left_by_an_error(prefix: Path) -> None:
    started = []
    with pytest.raises(KeyboardInterrupt), ProcessGroup(os.environ) as group:  # noqa: PT012
        started.append(group.start(add_program(prefix, "sleeper", "import time; time.sleep(60)")))
        raise KeyboardInterrupt
    assert started[0].returncode == -signal.SIGTERM


def test_last_started_ends_first(prefix: Path, tmp_path: Path) -> None:
    order = tmp_path / "order"
    order.touch()
    body = (
        "import signal, sys, time\n"
        "from omni_ros.environment import report\n"
        "def end(*_):\n"
        f"    open({str(order)!r}, 'a').write(sys.argv[0][-1])\n"
        "    sys.exit()\n"
        "signal.signal(signal.SIGTERM, end)\n"
        "report({})\n"
        "time.sleep(60)"
    )
    with ProcessGroup(os.environ) as group:
        for name in ("node1", "node2", "node3"):
            process = group.start(add_program(prefix, name, body))
            deadline = time.monotonic() + 20.0
            while not process.new_reports() and time.monotonic() < deadline:
                wait_for(process, 0.02)
    assert order.read_text() == "321"


ASKED = (
    "import pathlib, signal, sys, time\n"
    "from omni_ros.environment import report\n"
    "asked = []\n"
    "signal.signal(signal.SIGTERM, lambda *_: asked.append(1))\n"
    "report({})\n"
)


def start_and_wait(group: ProcessGroup, prefix: Path, name: str, body: str) -> RunningProcess:
    process = group.start(add_program(prefix, name, body))
    deadline = time.monotonic() + 20.0
    while not process.new_reports() and time.monotonic() < deadline:
        wait_for(process, 0.02)
    return process


def test_after_a_failure_all_senders_wait_at_the_same_time(prefix: Path, tmp_path: Path) -> None:
    # Each of two nodes ends after both were signaled; the listener after both have ended.
    def sender(own: str, other: str) -> str:
        return (
            ASKED + "while not asked: time.sleep(0.01)\n"
            f"pathlib.Path({str(tmp_path / own)!r}).touch()\n"
            f"while not pathlib.Path({str(tmp_path / other)!r}).exists(): time.sleep(0.01)\n"
        )

    listener = ASKED + "while not asked: time.sleep(0.01)\nsys.exit(len(asked) - 1)"
    with ProcessGroup(os.environ) as group:
        start_and_wait(group, prefix, "listener", listener)
        start_and_wait(group, prefix, "left", sender("left-asked", "right-asked"))
        start_and_wait(group, prefix, "right", sender("right-asked", "left-asked"))
        wait_for(group.start(add_program(prefix, "failing", "1 / 0")), 20.0)
    assert [process.returncode for process in group.running] == [0, 0, 0, 1]


def test_no_node_waits_long_for_a_subscriber_that_died(prefix: Path) -> None:
    patient = ASKED + "while len(asked) < 2: time.sleep(0.01)"
    with ProcessGroup(os.environ) as group:
        wait_for(group.start(add_program(prefix, "listener", "1 / 0")), 20.0)
        start_and_wait(group, prefix, "patient", patient)
    assert [process.returncode for process in group.running] == [1, 0]


def test_a_process_that_dies_on_its_way_out_has_failed(prefix: Path) -> None:
    dies = ASKED + "import os\nwhile not asked: time.sleep(0.01)\nos.kill(os.getpid(), 9)"
    with ProcessGroup(os.environ) as group:
        start_and_wait(group, prefix, "calm", ASKED + "while not asked: time.sleep(0.01)")
        start_and_wait(group, prefix, "doomed", dies)
    with pytest.raises(ProcessError, match=r"doomed ended \(signal 9\)"):
        group.raise_if_failed()


def test_a_halted_process_is_asked_like_any_other(prefix: Path) -> None:
    with ProcessGroup(os.environ) as group:
        process = start_and_wait(group, prefix, "calm", ASKED + "while not asked: time.sleep(0.01)")
        process.signal(signal.SIGSTOP)
    assert process.returncode == 0


def test_it_is_remembered_that_a_process_was_halted(prefix: Path) -> None:
    with ProcessGroup(os.environ) as group:
        process = start_and_wait(group, prefix, "calm", ASKED + "while not asked: time.sleep(0.01)")
        before = process.was_halted
        process.signal(signal.SIGSTOP)
        wait_until(process.note_halt)
        process.signal(signal.SIGCONT)
        wait_until(lambda: not process.note_halt())
        assert (before, process.was_halted) == (False, True)
    assert process.was_halted


def test_it_is_remembered_that_a_process_was_halted_on_its_way_out(prefix: Path) -> None:
    wakes = "until grep -q T.*stopped /proc/$0/status; do sleep 0.01; done; sleep 1; kill -CONT $0"
    leaves = (
        "import os, subprocess\n"
        "while not asked: time.sleep(0.01)\n"
        f"subprocess.Popen(['sh', '-c', {wakes!r}, str(os.getpid())])\n"
        "os.kill(os.getpid(), signal.SIGSTOP)"
    )
    with ProcessGroup(os.environ) as group:
        process = start_and_wait(group, prefix, "calm", ASKED + leaves)
        assert not process.was_halted
    assert process.returncode == 0
    assert process.was_halted


def test_a_halted_process_does_not_outlive_the_one_that_started_it(prefix: Path) -> None:
    body = "from omni_ros.process import _end_with_parent\n_end_with_parent()\n"
    add_program(prefix, "node", body + ASKED + "while not asked: time.sleep(0.01)")
    starter = (
        "import os, time\n"
        "from omni_runs.graph.process_group import NodeProcess, ProcessGroup\n"
        "node = ProcessGroup(os.environ).start(NodeProcess('node', 'toys', 'node'))\n"
        "while not node.new_reports() and node.returncode is None: time.sleep(0.01)\n"
        "print(node.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", starter], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        assert parent.stdout is not None
        node = int(parent.stdout.readline())
        os.kill(node, signal.SIGSTOP)
        threads = f"/proc/{node}/task/*/status"
        wait_until(lambda: all("T (stopped)" in Path(f).read_text() for f in glob.glob(threads)))
    finally:
        parent.kill()
        parent.communicate()
    wait_until(lambda: not running(node))


def test_an_end_is_described_with_the_last_words(prefix: Path) -> None:
    body = "import sys\nprint('first', file=sys.stderr)\nsys.exit('the lens is covered')"
    with ProcessGroup(os.environ) as group:
        process = group.start(add_program(prefix, "eye", body))
        assert wait_for(process, 20.0) == 1
        assert describe_end(process) == "eye ended (exit code 1): the lens is covered"
        with pytest.raises(ProcessError, match="the lens is covered"):
            group.raise_if_ended()
        group.raise_if_ended(besides=process)


def test_reports_come_complete_and_apart_from_standard_output(prefix: Path) -> None:
    body = (
        "import os\n"
        "from omni_ros.environment import report\n"
        "print('\\x1b[31;1m[RTPS Error] no such profile\\x1b[0m', flush=True)\n"
        "report({'share': 0.5})\n"
        "report({'share': 1.0})\n"
        "os.write(int(os.environ['OMNI_REPORT_FD']), b'{\"sha')\n"
    )
    with ProcessGroup(os.environ) as group:
        process = group.start(add_program(prefix, "teller", body))
        wait_for(process, 20.0)
        assert process.new_reports() == [{"share": 0.5}, {"share": 1.0}]
        assert process.new_reports() == []
        assert process.error_output() == "[RTPS Error] no such profile"


def test_an_interruption_while_the_group_ends_is_not_lost(prefix: Path) -> None:
    # The node signals the process that ends it, and ends a moment later.
    body = """
import os, signal, sys, time
def leave(*_):
    os.kill(int(sys.argv[1]), signal.SIGINT)
    raise SystemExit
signal.signal(signal.SIGTERM, leave)
print("up", flush=True)
while True:
    signal.pause()
"""
    program = add_program(prefix, "avenger", body)
    node = dataclasses.replace(program, arguments=(str(os.getpid()),))

    def one_run() -> None:
        with ProcessGroup(dict(os.environ)) as group:
            started.append(group.start(node))
            while not started[0].error_output():
                assert wait_for(started[0], 0.02) is None

    started: list[RunningProcess] = []
    # Other tests may have left files; without files to remove, the command ends at once.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            one_run()
    finally:
        signal.signal(signal.SIGINT, before)
    assert started[0].returncode == 0


def test_a_node_that_is_halted_while_the_graph_starts_is_named(
    prefix: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_once = functools.partialmethod(RunningProcess.raise_if_halted, longest=0.0)
    with ProcessGroup(dict(os.environ)) as group:
        odometry, simulator = (
            group.start(add_program(prefix, name, "import time; time.sleep(100)"))
            for name in ("odometry", "simulator")
        )
        steps = group.follow(simulator, lambda _: None)
        next(steps)
        monkeypatch.setattr(RunningProcess, "raise_if_halted", at_once)
        next(steps)  # all processes run
        odometry.signal(signal.SIGSTOP)
        wait_until(odometry.note_halt)
        with pytest.raises(ProcessError, match="odometry was halted by a signal"):
            next(steps)


def test_the_latest_words_of_the_nodes_are_shown_until_the_first_step(
    prefix: Path, tmp_path: Path
) -> None:
    shown: list[Any] = []
    text = (
        "import pathlib, sys, time\nfor file in sys.argv[1:]:\n"
        "    while not pathlib.Path(file).exists(): time.sleep(0.01)\n"
        "    print('compiled', pathlib.Path(file).name, file=sys.stderr, flush=True)\n"
        "time.sleep(100)"
    )
    words = {"odometry": ("10", "30"), "assistant": ("20",), "simulator": ()}
    with ProcessGroup(dict(os.environ)) as group:
        odometry, assistant, simulator = (
            group.start(
                dataclasses.replace(
                    add_program(prefix, name, text), arguments=[str(tmp_path / w) for w in files]
                )
            )
            for name, files in words.items()
        )
        steps = group.follow(simulator, shown.append)
        next(steps)
        for process, word in ((odometry, "10"), (assistant, "20"), (odometry, "30")):
            (tmp_path / word).touch()
            while word not in process.error_output():
                time.sleep(0.01)
            next(steps)
    assert shown == ["odometry: compiled 10", "assistant: compiled 20", "odometry: compiled 30"]


def test_a_finished_run_keeps_its_results_if_the_next_one_cannot_start() -> None:
    def finishes() -> Any:
        yield
        return lambda: "results"

    def cannot_start() -> Any:
        yield find_executable("no_package", "no_program")

    results = run_variant.finish_runs([finishes(), cannot_start()])
    assert next(results) == "results"  # type: ignore[comparison-overlap]
    with pytest.raises(ProcessError, match="no_package"):
        next(results)
