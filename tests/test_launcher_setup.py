"""Set-up of a workspace: missing requirements, builds, interruptions, lock files."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import signal
from pathlib import Path
from typing import IO

import pytest
from launcher_workspace import PACKAGE, SETUP, Workspace, assert_one_sentence
from omni_process import WORKSPACE

from setup import failures
from setup import workspace as places
from setup.uv import pip_settings, uv_variables


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


@pytest.mark.parametrize(
    ("output", "part"),
    [
        ("cause: failed to write to `/a`: No space left on device (os error 28)", "disk is full"),
        ("OSError: [Errno 28] No space left on device", "disk is full"),
        ("cause: Hash mismatch for `six==1.17.0`", "not the locked one"),
        ("THESE PACKAGES DO NOT MATCH THE HASHES", "not the locked one"),
        ("not created successfully because ensurepip is not available", "-venv'"),
        ("No module named venv", "-venv'"),
        ("error: Failed to initialize cache at `/x/uv`", "UV_CACHE_DIR"),
        ("cause: invalid peer certificate: UnknownIssuer", "PIP_CERT"),
        ("cause: tunnel error: failed to create underlying connection", "HTTPS_PROXY"),
        ("WARNING: Retrying after ProxyError('Cannot connect to proxy.')", "HTTPS_PROXY"),
        ("error: Failed to fetch: `/six`\n  cause: dns error", "no connection"),
        (
            "WARNING: Retrying after connection broken: Temporary failure in name resolution\n"
            "ERROR: No matching distribution found for numpy==2.4.6",
            "no connection",
        ),
        ("ERROR: No matching distribution found for numpy==2.4.6", "no wheel of numpy==2.4.6"),
        ("Because numpy==2.4.6 has no wheels with a matching platform tag", "no wheel of numpy=="),
        ("Because there is no version of numpy==2.4.6 and you require", "no wheel of numpy=="),
        ("Segmentation fault", "installing failed: see /log"),
    ],
)
def test_failed_installation_is_explained(output: str, part: str) -> None:
    sentence = failures.explain_install(output, Path("/log"), "installing")
    assert part in sentence
    assert "/log" in sentence


_NOTHING = {"PIP_CONFIG_FILE": os.devnull, "PIP_EXTRA_INDEX_URL": "", "PIP_FIND_LINKS": ""}


@pytest.mark.parametrize(
    ("network", "part"),
    [
        ({"PIP_INDEX_URL": "http://127.0.0.1:9/simple"}, "no connection"),
        ({"PIP_PROXY": "http://127.0.0.1:9"}, "proxy"),
        ({"PIP_NO_INDEX": "1"}, "no connection"),
    ],
)
def test_no_network_at_first_start(bare: Workspace, network: dict[str, str], part: str) -> None:
    offline = {**_NOTHING, "PIP_RETRIES": "1", "XDG_CACHE_HOME": str(bare.root / "empty")}
    result = bare.start("run", environ={**offline, **network})
    assert_one_sentence(result, part, str(bare.log))
    # The half-made environment is not taken for a finished one.
    assert not any(places.ready(places.Workspace(bare.root, None)))


def test_uv_meets_the_same_network_as_pip(bare: Workspace, tmp_path: Path) -> None:
    bare.borrow_uv()
    unreachable = {"PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_RETRIES": "0", **_NOTHING}
    cache = {"XDG_CACHE_HOME": str(tmp_path / "empty")}
    result = bare.start("run", environ={**unreachable, **cache})
    assert_one_sentence(result, "no connection", str(bare.log))
    assert "127.0.0.1" in bare.log.read_text()

    (tmp_path / "in the way").write_text("")
    unwritable = {"UV_CACHE_DIR": str(tmp_path / "in the way")}
    result = bare.start("run", environ={**unreachable, **unwritable})
    assert_one_sentence(result, "UV_CACHE_DIR")


def test_uv_uses_the_settings_of_pip() -> None:
    listing = (
        ":env:.find-links='/a /b'\n"
        ":env:.extra-index-url=''\n"
        "global.extra-index-url='http://127.0.0.1:1/simple'\n"
        "global.index-url='http://127.0.0.1:2/simple'\n"
        "global.timeout='15'\n"
        "install.timeout='60'\n"
        "download.timeout='99'\n"
        'global.cert="/it\'s/here.pem"\n'
        "global.trusted-host='one\\ntwo'\n"
    )
    assert uv_variables(pip_settings(listing)) == {
        "UV_DEFAULT_INDEX": "http://127.0.0.1:2/simple",
        "UV_FIND_LINKS": "/a,/b",
        "UV_INSECURE_HOST": "one two",
        "SSL_CERT_FILE": "/it's/here.pem",
        "UV_HTTP_TIMEOUT": "60",
    }


def test_groups_of_packages_are_installed_once(workspace: Workspace) -> None:
    assert (
        workspace.start("install", "development").stderr.splitlines()[-1].startswith("omni: ready")
    )
    again = workspace.start("install", "development")
    assert (again.returncode, again.stderr) == (0, "")
    assert_one_sentence(workspace.start("install", "wheel"), "'wheel'", "development", "mujoco")


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


def test_what_a_package_installs_is_built_again_when_it_changes(workspace: Workspace) -> None:
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
    assert_one_sentence(workspace.start("run"), "omni_bringup", str(workspace.log))
    assert "package.xml" in workspace.log.read_text()


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


def test_a_start_waits_for_another_that_sets_up(workspace: Workspace) -> None:
    with contextlib.ExitStack() as other:
        other.enter_context(workspace.locked(fcntl.LOCK_EX))
        with workspace.background("run") as process:
            _wait_for(process.stderr, "waiting")
            assert not workspace.prefix.exists()
            other.close()
            _wait_for(process.stderr, "ready")
            assert process.wait(60) == 0


def test_a_rebuild_waits_for_running_commands(workspace: Workspace) -> None:
    assert workspace.start("run").returncode == 0
    stamp = (workspace.prefix / places.STAMP).stat().st_mtime_ns
    workspace.edit()
    with contextlib.ExitStack() as running:
        running.enter_context(workspace.locked(fcntl.LOCK_SH))
        with workspace.background("run") as process:
            _wait_for(process.stderr, "waiting")
            assert (workspace.prefix / places.STAMP).stat().st_mtime_ns == stamp
            # A start from within the running command must not wait for it.
            within = workspace.start("run", environ={"OMNI_RUNNING": str(workspace.root)})
            assert (within.returncode, within.stderr) == (0, "")
            running.close()
            _wait_for(process.stderr, "ready")
            assert process.wait(60) == 0


# ---------------------------------------------------------------- locks


INPUTS = {
    "wheels": ["wheels", "shared"],
    "sourced-ros": ["sourced-ros", "shared"],
    "development": ["development", "campaign", "parquet", "xacro"],
    "campaign": ["campaign"],
    "parquet": ["parquet"],
    "xacro": ["xacro"],
    "installer": ["installer"],
}


def _locked(name: str) -> dict[str, set[str]]:
    """Return the versions of each package of a lock file, and check its form."""
    lock = (WORKSPACE / "requirements" / f"{name}.lock").read_text()
    hashes = r"((?:    --hash=sha256:[0-9a-f]{64}.*\n)+)"
    entries = re.findall(r"(?m)^(\S+)==(\S+).*\\\n" + hashes, lock)
    assert len(entries) == len(re.findall(r"(?m)^\S", lock))  # every line belongs to an entry
    assert "://" not in lock
    locked: dict[str, set[str]] = {}
    for package, version, _ in entries:
        locked.setdefault(package, set()).add(version)
    return locked


@pytest.mark.parametrize("name", INPUTS)
def test_locks_are_exact_and_complete(name: str) -> None:
    locked = _locked(name)
    for source in INPUTS[name]:
        text = (WORKSPACE / "requirements" / f"{source}.in").read_text()
        wanted = re.findall(r"(?m)^([A-Za-z][\w-]*)", text)
        assert {word.lower() for word in wanted} <= set(locked)


@pytest.mark.parametrize("name", ["development", "campaign", "parquet", "xacro"])
def test_a_group_changes_no_package_of_a_run(name: str) -> None:
    group = _locked(name)
    for other in ("wheels", "sourced-ros", "development"):
        locked = _locked(other)
        for package in set(group) & set(locked):
            assert group[package] == locked[package], package
