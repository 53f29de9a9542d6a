"""The launcher starts a command with the Python and the environment of its workspace."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from launcher_workspace import Workspace, assert_one_sentence
from omni_process import WORKSPACE

from setup import workspace as places

LAUNCHER = WORKSPACE / "omni"


@pytest.fixture(scope="module")
def built_once(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A complete workspace for tests that do not change it."""
    workspace = Workspace(tmp_path_factory.mktemp("module") / "a clone")
    workspace.borrow_environment()
    assert workspace.start("run").returncode == 0
    return workspace


# ---------------------------------------------------------------- Python


@pytest.mark.parametrize("path", ["omni", "setup/__init__.py", "setup/pythons.py"])
def test_what_an_old_python_reads_parses_there(path: str) -> None:
    tree = ast.parse((WORKSPACE / path).read_text(), feature_version=(3, 5))
    # The parser accepts f-strings in every version.
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]


def _start_as_python(version: tuple[int, int], path: Path) -> subprocess.CompletedProcess[str]:
    program = (
        f"import runpy, sys; sys.version_info = ({version[0]}, {version[1]}, 1, 'final', 0); "
        f"sys.argv = ['omni', 'run']; runpy.run_path({str(LAUNCHER)!r}, run_name='__main__')"
    )
    return subprocess.run(
        [sys.executable, "-I", "-c", program],
        env={**os.environ, "PATH": str(path), "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(("version", "word"), [((3, 9), "too old"), ((3, 99), "too new")])
def test_an_unsupported_python_is_refused(
    version: tuple[int, int], word: str, tmp_path: Path
) -> None:
    result = _start_as_python(version, tmp_path)
    assert_one_sentence(result, word, "3.10 to 3.14", "start again")


def test_an_old_python_gives_way_to_a_supported_one(tmp_path: Path) -> None:
    broken, good = tmp_path / "python3.12", tmp_path / "python3.11"
    broken.write_text("#!/bin/sh\nexit 127\n")  # a version manager's shim for nothing
    good.write_text('#!/bin/sh\n[ "$1" = -c ] && exit 0\necho "started $2"\n')
    for script in (broken, good):
        script.chmod(0o755)
    result = _start_as_python((3, 8), tmp_path)
    assert (result.returncode, result.stdout) == (0, "started run\n")


# ---------------------------------------------------------------- starting


def test_a_closed_standard_output_receives_nothing(built_once: Workspace) -> None:
    lock = built_once.root / ".cache" / "lock"
    closed = ["sh", "-c", 'exec "$@" >&-', "sh", *built_once.command("run")]
    finished = subprocess.run(
        closed,
        cwd=built_once.root,
        env={**os.environ, "OMNI_ROS": "wheels", "LD_LIBRARY_PATH": ""},
        stderr=subprocess.PIPE,
        check=False,
    )
    assert (finished.returncode, finished.stderr) == (0, b"")
    assert lock.read_bytes() == b""


def test_output_arguments_and_exit_code_are_the_commands_own(built_once: Workspace) -> None:
    result = built_once.start("run", "fail", "--set", "a=b c")
    assert result.returncode == 7
    assert json.loads(result.stdout)["words"] == ["run", "fail", "--set", "a=b c"]


def test_second_start_sets_nothing_up(built_once: Workspace) -> None:
    before = built_once.log.stat().st_mtime_ns
    unusable = {"PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_NO_INDEX": "1"}
    result = built_once.start("run", environ=unusable)
    assert (result.returncode, result.stderr) == (0, "")
    assert built_once.log.stat().st_mtime_ns == before


def test_starts_through_a_link_from_elsewhere(built_once: Workspace, tmp_path: Path) -> None:
    link = tmp_path / "linked omni"
    link.symlink_to(built_once.root / "omni")
    result = built_once.start("run", by=link, cwd=tmp_path)
    report = json.loads(result.stdout)
    assert report["cwd"] == str(tmp_path)
    assert report["env"]["OMNI_WORKSPACE"] == str(built_once.root)


def test_installed_executables_run_despite_the_space(built_once: Workspace) -> None:
    executable = built_once.prefix / "lib" / "omni_bringup" / "omni"
    environ = json.loads(built_once.start("run").stdout)["env"]
    result = subprocess.run(
        [executable, "direct"], env=environ, capture_output=True, text=True, check=True
    )
    assert json.loads(result.stdout)["words"] == ["direct"]


def test_a_colcon_build_disturbs_nothing(built_once: Workspace) -> None:
    environ = json.loads(built_once.start("run").stdout)["env"]
    colcon = [sys.executable, str(Path(sys.executable).with_name("colcon"))]
    colcon += ["--log-base", "log", "build"]
    result = subprocess.run(
        colcon, cwd=built_once.root, env=environ, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert built_once.start("run").stderr == ""  # nothing is built again
    share = built_once.root / "install" / "omni_bringup" / "share" / "omni_bringup"
    assert (share / "package.xml").is_file()


def test_the_environment_handed_over(built_once: Workspace) -> None:
    foreign = {
        "ROS_DISTRO": "humble",
        "AMENT_PREFIX_PATH": "/opt/ros/humble",
        "PYTHONPATH": "/opt/ros/humble/lib/python3.10/site-packages:/home/me/laws:/x/dist-packages",
        "LD_LIBRARY_PATH": "/opt/ros/humble/lib:/opt/mine",
        "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONOPTIMIZE": "2",
    }
    environ = json.loads(built_once.start("run", environ=foreign).stdout)["env"]
    root = built_once.root
    assert environ["AMENT_PREFIX_PATH"] == f"{root}/.cache/install:{root}/.venv"
    libraries = ":".join(map(str, built_once.libraries))
    assert environ["PYTHONPATH"] == f"{libraries}:/home/me/laws"
    assert environ["LD_LIBRARY_PATH"] == f"{root}/.venv/lib:/opt/mine"
    assert environ["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert environ["VIRTUAL_ENV"] == f"{root}/.venv"
    assert environ["PATH"].startswith(f"{root}/.venv/bin:")
    assert environ["NUMBA_CACHE_DIR"] == f"{root}/.cache/numba"
    assert environ["PYTHONPYCACHEPREFIX"] == f"{root}/.cache/bytecode"
    assert not {"ROS_DISTRO", "PYTHONDONTWRITEBYTECODE", "PYTHONOPTIMIZE"} & set(environ)


def test_starts_within_starts_do_not_pile_up_paths(built_once: Workspace) -> None:
    mine = {"PYTHONPATH": "/home/me/laws"}
    once = json.loads(built_once.start("run", environ=mine).stdout)["env"]
    inner = [sys.executable, str(built_once.root / "omni"), "run"]
    twice = json.loads(built_once.start("exec", *inner, environ=mine).stdout)["env"]
    for name in ("PATH", "AMENT_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH"):
        assert twice[name] == once[name]


def test_exec_runs_programs_in_the_environment(built_once: Workspace) -> None:
    result = built_once.start("exec", "python", "-c", "import omni_bringup as o; print(o.__file__)")
    assert result.stdout.strip() == str(built_once.package / "omni_bringup" / "__init__.py")
    missing = built_once.start("exec", "no-such-program")
    assert missing.returncode == 127
    assert "no-such-program" in missing.stderr


def test_test_runs_pytest_on_paths_of_the_caller(built_once: Workspace, tmp_path: Path) -> None:
    (tmp_path / "test_here.py").write_text("def test_here():\n    import omni_bringup.cli\n")
    result = built_once.start("test", "-q", "test_here.py::test_here", cwd=tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "1 passed" in result.stdout


# ---------------------------------------------------------------- sourced ROS


def test_a_sourced_jazzy_is_used(tmp_path: Path) -> None:
    prefix = tmp_path / "opt" / "jazzy"
    (prefix / "lib" / "python3.12" / "site-packages" / "rclpy").mkdir(parents=True)
    root = tmp_path / "clone"
    own = f"{root}/install:{root}/.venv"
    sourced = {"ROS_DISTRO": "jazzy", "AMENT_PREFIX_PATH": f"{own}:/overlay:{prefix}"}
    ros = places.find_sourced_ros(sourced, root)
    assert ros == places.SourcedRos(("/overlay", str(prefix)), (3, 12))
    assert places.find_sourced_ros({**sourced, "OMNI_ROS": "wheels"}, root) is None
    assert places.find_sourced_ros({**sourced, "ROS_DISTRO": "humble"}, root) is None

    workspace = places.Workspace(root, ros)
    assert workspace.venv.name == ".venv-sourced"
    environ = {**sourced, "PYTHONPATH": f"{root}/install/lib/p:{prefix}/lib/p", "PATH": "/bin"}
    kept = places.base_environment(environ, workspace)
    assert kept["PYTHONPATH"] == f"{prefix}/lib/p"
    assert kept["AMENT_PREFIX_PATH"] == f"/overlay:{prefix}"
    assert kept["ROS_DISTRO"] == "jazzy"
