"""Set-up of a workspace: missing requirements, builds, interruptions, lock files."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import IO

import pytest
from launcher_workspace import PACKAGE, SETUP, Workspace, assert_one_sentence
from omni_process import WORKSPACE, wait_until

from setup import failures
from setup import workspace as places


def _wait_for(stream: IO[str] | None, word: str) -> str:
    """Read lines until one contains `word`, and return it; the end of the stream is a failure."""
    assert stream is not None
    for line in stream:
        if word in line:
            return line
    raise AssertionError(f"nothing said '{word}'")


@pytest.fixture
def bare(tmp_path: Path) -> Workspace:
    """A fresh clone; the space in its name is deliberate."""
    return Workspace(tmp_path / "a clone")


@pytest.fixture
def workspace(bare: Workspace) -> Workspace:
    """A clone with packages installed and nothing built."""
    bare.borrow_environment()
    return bare


# ---------------------------------------------------------------- what a machine lacks


def test_missing_venv_module_is_named(tmp_path: Path) -> None:
    python = tmp_path / "python3.12"
    python.write_text("#!/bin/sh\nexit 1\n")
    python.chmod(0o755)
    with pytest.raises(failures.SetupError, match=r"apt install python3\.12-venv"):
        failures.check_venv_module(str(python))
    failures.check_venv_module(sys.executable)


@pytest.mark.parametrize(
    ("machine", "part"),
    [
        (("Linux", "aarch64", "glibc 2.36", 64), "aarch64"),
        (("Linux", "x86_64", "glibc 2.27", 64), "glibc 2.27"),
        (("Linux", "x86_64", "", 64), "another C library"),
        (("Linux", "x86_64", "glibc 2.36", 32), "32-bit"),
        (("Darwin", "x86_64", "", 64), "Darwin"),
    ],
)
def test_unsupported_machine_is_named(machine: tuple[str, str, str, int], part: str) -> None:
    with pytest.raises(failures.SetupError, match=part):
        failures.check_platform(*machine)


def test_supported_machines_pass() -> None:
    failures.check_platform("Linux", "x86_64", "glibc 2.28", 64)
    failures.check_platform("Linux", "x86_64", "glibc 3.0", 64)


def test_a_full_disk_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    free = shutil.disk_usage(tmp_path).free
    with pytest.raises(failures.SetupError, match="make room"):
        failures.check_space(tmp_path, 2 * free + 1e12)


@pytest.mark.parametrize(
    ("output", "part"),
    [
        ("OSError: [Errno 28] No space left on device", "disk is full"),
        ("THESE PACKAGES DO NOT MATCH THE HASHES", "not the locked one"),
        (
            "WARNING: Retrying after connection broken: Temporary failure in name resolution\n"
            "ERROR: No matching distribution found for numpy==2.4.6",
            "no connection",
        ),
        ("ERROR: No matching distribution found for numpy==2.4.6", "no wheel of numpy==2.4.6"),
        ("Segmentation fault", "see /log"),
    ],
)
def test_failed_installation_is_explained(output: str, part: str) -> None:
    sentence = failures.explain_install(output, Path("/log"))
    assert part in sentence
    assert "/log" in sentence


def test_no_network_at_first_start(bare: Workspace) -> None:
    offline = {
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_INDEX_URL": "http://127.0.0.1:9/simple",
        "PIP_EXTRA_INDEX_URL": "",
        "PIP_FIND_LINKS": "",
        "PIP_RETRIES": "0",
    }
    result = bare.start("run", environ=offline)
    assert_one_sentence(result, "no connection", str(bare.log))
    assert "127.0.0.1" in bare.log.read_text()
    # The half-made environment is not taken for a finished one.
    assert not places.environment_ready(places.Workspace(bare.root, None))


def test_a_folder_that_cannot_be_written(bare: Workspace) -> None:
    (bare.root / ".cache").write_text("in the way")
    assert_one_sentence(bare.start("run"), str(bare.root / ".cache"))


def test_read_only_folder_is_explained(tmp_path: Path) -> None:
    sentence = failures.explain_file_error(OSError(30, "Read-only file system", "/x"), tmp_path)
    assert "/x is not writable" in sentence


def test_an_environment_of_the_users_own_is_left_alone(bare: Workspace) -> None:
    precious = bare.root / ".venv" / "precious"
    precious.parent.mkdir()
    precious.write_text("mine")
    assert_one_sentence(bare.start("run"), "move it away")
    assert precious.read_text() == "mine"


def test_a_demanded_but_missing_ros_is_refused(bare: Workspace) -> None:
    environ = {"ROS_DISTRO": "", "OMNI_ROS": "sourced"}
    assert_one_sentence(bare.start("run", environ=environ), "setup.bash")
    assert_one_sentence(bare.start("run", environ={"OMNI_ROS": "x"}), "OMNI_ROS")


def test_help_needs_no_set_up(bare: Workspace) -> None:
    result = bare.start("--help")
    assert result.returncode == 0
    assert "./omni run" in result.stdout
    assert not (bare.root / ".venv").exists()


# ---------------------------------------------------------------- building


def test_an_edit_of_a_module_needs_no_build(workspace: Workspace) -> None:
    assert workspace.start("run").returncode == 0
    built = workspace.log.stat().st_mtime_ns
    module = workspace.package / "omni_bringup" / "extra.py"
    look = ("exec", "python", "-c", "from omni_bringup import extra; print(extra.VALUE)")
    for value in ("1", "22"):  # bytecode counts as current while size and second of its source are
        module.write_text(f"VALUE = {value}\n")
        result = workspace.start(*look)
        assert (result.stdout, result.stderr) == (f"{value}\n", "")
    module.unlink()
    assert "ImportError" in workspace.start(*look).stderr
    assert workspace.log.stat().st_mtime_ns == built


def test_what_colcon_installs_is_built_again_when_it_changes(workspace: Workspace) -> None:
    assert workspace.start("run").returncode == 0
    installed = workspace.prefix / "lib" / "omni_bringup" / "another"
    assert not installed.exists()

    setup = workspace.package / "setup.py"
    setup.write_text(SETUP.replace("cli:main", 'cli:main", "another = omni_bringup.cli:main'))
    assert "building" in workspace.start("run").stderr
    assert installed.exists()

    # Same size, same modification time.
    status = setup.stat()
    setup.write_text(setup.read_text().replace("another", "renamed"))
    os.utime(setup, ns=(status.st_atime_ns, status.st_mtime_ns))
    workspace.start("run")
    assert not installed.exists()
    assert installed.with_name("renamed").exists()

    (workspace.package / "test").mkdir()
    (workspace.package / "test" / "test_x.py").write_text("")
    (workspace.package / "README.md").write_text("# A page\n")
    assert workspace.start("run").stderr == ""


def test_failing_build_names_the_package(workspace: Workspace) -> None:
    (workspace.package / "setup.py").write_text(SETUP + "\nraise SystemExit('no')\n")
    assert_one_sentence(workspace.start("run"), "omni_bringup", str(workspace.log))
    (workspace.package / "setup.py").write_text(SETUP)
    assert workspace.start("run").returncode == 0


def test_invalid_manifest_is_refused(workspace: Workspace) -> None:
    (workspace.package / "package.xml").write_text(PACKAGE.replace("<license>", "<licens>"))
    assert_one_sentence(workspace.start("run"), "package.xml")


def test_interrupted_and_killed_builds_are_made_up_for(workspace: Workspace) -> None:
    with workspace.background("run") as process:
        _wait_for(process.stderr, "building")
        process.send_signal(signal.SIGINT)
        _wait_for(process.stderr, "interrupted")
        assert process.wait(60) == 130
    with workspace.background("run") as process:
        _wait_for(process.stderr, "building")
        process.kill()
        process.wait(60)
    result = workspace.start("run")
    assert result.returncode == 0
    assert (workspace.prefix / "lib" / "omni_bringup" / "omni").exists()


def test_a_killed_set_up_leaves_no_process_at_work(tmp_path: Path) -> None:
    (tmp_path / ".cache").mkdir()
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from pathlib import Path\n"
        "from setup.steps import Steps\n"
        "from setup.workspace import Workspace\n"
        "steps = Steps(Workspace(Path(sys.argv[2]), None), None)\n"
        "child = 'import os, time; print(os.getpid(), flush=True); time.sleep(600)'\n"
        "steps.run([sys.executable, '-c', child], {}, print)\n"
    )
    command = [sys.executable, "-u", "-c", code, str(WORKSPACE), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        child = Path(f"/proc/{int(process.stdout.readline())}/stat")
        assert child.exists()
        process.kill()
        process.wait(60)
        # Its new parent process may not have collected its exit code: then it is a zombie.
        wait_until(lambda: not child.exists() or child.read_text().split()[2] == "Z")


def test_a_start_waits_for_another_that_sets_up(workspace: Workspace) -> None:
    with contextlib.ExitStack() as other:
        other.enter_context(workspace.locked(fcntl.LOCK_EX))
        with workspace.background("run") as process:
            _wait_for(process.stderr, "waiting")
            assert not (workspace.root / "install").exists()
            other.close()
            _wait_for(process.stderr, "ready")
            assert process.wait(60) == 0


def test_a_rebuild_waits_for_running_commands(workspace: Workspace) -> None:
    assert workspace.start("run").returncode == 0
    stamp = (workspace.root / "install" / "omni.json").stat().st_mtime_ns
    workspace.edit()
    with contextlib.ExitStack() as running:
        running.enter_context(workspace.locked(fcntl.LOCK_SH))
        with workspace.background("run") as process:
            _wait_for(process.stderr, "waiting")
            assert (workspace.root / "install" / "omni.json").stat().st_mtime_ns == stamp
            # A start from within the running command must not wait for it.
            within = workspace.start("run", environ={"OMNI_RUNNING": str(workspace.root)})
            assert (within.returncode, within.stderr) == (0, "")
            running.close()
            _wait_for(process.stderr, "ready")
            assert process.wait(60) == 0


# ---------------------------------------------------------------- locks


@pytest.mark.parametrize("name", ["wheels", "sourced-ros"])
def test_locks_are_exact_and_complete(name: str) -> None:
    lock = (WORKSPACE / "requirements" / f"{name}.lock").read_text()
    entries = re.findall(r"(?m)^(\S+)==\S+.*\\\n((?:    --hash=sha256:[0-9a-f]{64}.*\n)+)", lock)
    assert len(entries) == len(re.findall(r"(?m)^\S", lock))  # every line belongs to an entry
    locked = {entry[0] for entry in entries}
    for source in (f"{name}.in", "shared.in"):
        text = (WORKSPACE / "requirements" / source).read_text()
        wanted = re.findall(r"(?m)^([A-Za-z][\w-]*)", text)
        assert {word.lower() for word in wanted} <= locked
    assert "://" not in lock
