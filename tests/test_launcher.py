"""The launcher: set-up, its failures, and what it hands over to.

Most tests start `./omni` for real, in a small workspace whose environment borrows the packages of
the Python that runs the tests, so that nothing is downloaded.
"""

from __future__ import annotations

import ast
import contextlib
import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

import pytest
from omni_process import wait_until

from setup import failures
from setup import workspace as places

ROOT = Path(__file__).resolve().parent.parent
LAUNCHER = ROOT / "omni"


SETUP = """
from setuptools import setup
setup(
    name="omni_bringup", version="0.1.0", packages=["omni_bringup"], zip_safe=False,
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/omni_bringup"]),
        ("share/omni_bringup", ["package.xml"]),
    ],
    entry_points={"console_scripts": ["omni = omni_bringup.cli:main"]},
)
"""
PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>omni_bringup</name><version>0.1.0</version><description>A stand-in</description>
  <maintainer email="a@example.org">A</maintainer><license>Apache-2.0</license>
  <export><build_type>ament_python</build_type></export>
</package>
"""
CLI = """
import json, os, sys

def main():
    print(json.dumps({"words": sys.argv[1:], "cwd": os.getcwd(), "env": dict(os.environ)}))
    return 7 if "fail" in sys.argv else 0
"""


class Workspace:
    """A copy of the launcher with one package and a ready environment."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.package = root / "src" / "omni_bringup"
        module = self.package / "omni_bringup"
        module.mkdir(parents=True)
        shutil.copy(LAUNCHER, root / "omni")
        shutil.copytree(ROOT / "setup", root / "setup")
        shutil.copytree(ROOT / "requirements", root / "requirements")
        (module / "__init__.py").write_text("")
        (module / "cli.py").write_text(CLI)
        (self.package / "setup.py").write_text(SETUP)
        (self.package / "package.xml").write_text(PACKAGE)
        (self.package / "setup.cfg").write_text(
            "[install]\ninstall_scripts=$base/lib/omni_bringup\n"
        )
        (self.package / "resource").mkdir()
        (self.package / "resource" / "omni_bringup").write_text("")

    @property
    def log(self) -> Path:
        return self.root / ".cache" / "setup.log"

    @property
    def prefix(self) -> Path:
        return self.root / "install" / "omni_bringup"

    @property
    def libraries(self) -> list[Path]:
        version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
        return [self.package, self.prefix / "lib" / version / "site-packages"]

    def borrow_environment(self) -> None:
        venv = self.root / ".venv"
        (venv / "bin").mkdir(parents=True)
        (venv / "made-by-omni").touch()
        shutil.copy(Path(sys.prefix) / "pyvenv.cfg", venv)
        (venv / "bin" / "python").symlink_to(os.path.realpath(sys.executable))
        shutil.copy(Path(sys.prefix) / "bin" / "colcon", venv / "bin")
        # All clones import the same files of the libraries, and share their bytecode.
        own = sysconfig.get_path("purelib")
        site = venv / Path(own).relative_to(sys.prefix)
        site.mkdir(parents=True)
        (site / "borrowed.pth").write_text(f"import site; site.addsitedir({own!r})\n")
        bytecode = self.root.parents[1] / "bytecode"
        bytecode.mkdir(exist_ok=True)
        (self.root / ".cache").mkdir()
        (self.root / ".cache" / "bytecode").symlink_to(bytecode)
        workspace = places.Workspace(self.root, None)
        libraries = [str(venv / "lib")]
        places.write_stamp(
            venv, places.environment_identity(workspace), libraries=libraries, made=1
        )

    def command(self, *words: str, by: Path | None = None) -> list[str]:
        return [sys.executable, str(by or self.root / "omni"), *words]

    def start(
        self,
        *words: str,
        by: Path | None = None,
        cwd: Path | None = None,
        environ: Mapping[str, str] | None = None,
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            self.command(*words, by=by),
            cwd=cwd or self.root,
            env={**os.environ, "OMNI_ROS": "wheels", "LD_LIBRARY_PATH": "", **(environ or {})},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )

    @contextlib.contextmanager
    def background(self, *words: str) -> Iterator[subprocess.Popen[str]]:
        process = subprocess.Popen(
            self.command(*words),
            cwd=self.root,
            env={**os.environ, "OMNI_ROS": "wheels"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            yield process
        finally:
            process.kill()
            process.communicate()

    @contextlib.contextmanager
    def locked(self, mode: int) -> Iterator[None]:
        (self.root / ".cache").mkdir(exist_ok=True)
        with open(self.root / ".cache" / "lock", "w") as file:
            fcntl.flock(file, mode)
            yield

    def edit(self) -> None:
        with open(self.package / "setup.py", "a") as file:
            file.write("\n")


def _wait_for(stream: IO[str] | None, word: str) -> str:
    """Read lines until one has `word`; return it. The end of the stream is a failure."""
    assert stream is not None
    for line in stream:
        if word in line:
            return line
    raise AssertionError(f"nothing said '{word}'")


def _assert_one_sentence(result: subprocess.CompletedProcess[str], *parts: str) -> None:
    assert result.returncode == 1
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    last = result.stderr.splitlines()[-1]
    assert last.startswith("omni: ")
    assert last.endswith(".")
    for part in parts:
        assert part in last


@pytest.fixture
def bare(tmp_path: Path) -> Workspace:
    """A fresh clone; the space in its name is deliberate."""
    return Workspace(tmp_path / "a clone")


@pytest.fixture
def workspace(bare: Workspace) -> Workspace:
    """A clone with packages installed and nothing built."""
    bare.borrow_environment()
    return bare


@pytest.fixture(scope="module")
def built_once(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A finished workspace for tests that change nothing in it."""
    workspace = Workspace(tmp_path_factory.mktemp("module") / "a clone")
    workspace.borrow_environment()
    assert workspace.start("run").returncode == 0
    return workspace


# ---------------------------------------------------------------- Python


@pytest.mark.parametrize("path", ["omni", "setup/__init__.py", "setup/pythons.py"])
def test_what_an_old_python_reads_parses_there(path: str) -> None:
    tree = ast.parse((ROOT / path).read_text(), feature_version=(3, 5))
    # The parser accepts f-strings whatever the version.
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
    _assert_one_sentence(result, word, "3.10 to 3.14", "start again")


def test_an_old_python_gives_way_to_a_supported_one(tmp_path: Path) -> None:
    broken, good = tmp_path / "python3.12", tmp_path / "python3.11"
    broken.write_text("#!/bin/sh\nexit 127\n")  # a version manager's shim for nothing
    good.write_text('#!/bin/sh\n[ "$1" = -c ] && exit 0\necho "started $2"\n')
    for script in (broken, good):
        script.chmod(0o755)
    result = _start_as_python((3, 8), tmp_path)
    assert (result.returncode, result.stdout) == (0, "started run\n")


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
    _assert_one_sentence(result, "no connection", str(bare.log))
    assert "127.0.0.1" in bare.log.read_text()
    # The half-made environment is not taken for a finished one.
    assert not places.environment_ready(places.Workspace(bare.root, None))


def test_a_folder_that_cannot_be_written(bare: Workspace) -> None:
    (bare.root / ".cache").write_text("in the way")
    _assert_one_sentence(bare.start("run"), str(bare.root / ".cache"))


def test_read_only_folder_is_explained(tmp_path: Path) -> None:
    sentence = failures.explain_file_error(OSError(30, "Read-only file system", "/x"), tmp_path)
    assert "/x cannot be written" in sentence


def test_an_environment_of_the_users_own_is_left_alone(bare: Workspace) -> None:
    precious = bare.root / ".venv" / "precious"
    precious.parent.mkdir()
    precious.write_text("mine")
    _assert_one_sentence(bare.start("run"), "move it away")
    assert precious.read_text() == "mine"


# ---------------------------------------------------------------- starting


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


def test_a_plain_colcon_build_goes_beside_the_launcher_s(built_once: Workspace) -> None:
    environ = json.loads(built_once.start("run").stdout)["env"]
    colcon = [str(built_once.root / ".venv" / "bin" / "python")]
    colcon += [str(built_once.root / ".venv" / "bin" / "colcon"), "--log-base", "log", "build"]
    result = subprocess.run(
        colcon, cwd=built_once.root, env=environ, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert built_once.start("run").stderr == ""  # nothing is built again
    assert (built_once.prefix / "share" / "omni_bringup" / "package.xml").is_file()


def test_the_environment_handed_over(built_once: Workspace) -> None:
    foreign = {
        "ROS_DISTRO": "humble",
        "AMENT_PREFIX_PATH": "/opt/ros/humble",
        "PYTHONPATH": "/opt/ros/humble/lib/python3.10/site-packages:/home/me/laws:/x/dist-packages",
        "LD_LIBRARY_PATH": "/opt/ros/humble/lib:/opt/mine",
        "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    environ = json.loads(built_once.start("run", environ=foreign).stdout)["env"]
    root = built_once.root
    assert environ["AMENT_PREFIX_PATH"] == f"{root}/install/omni_bringup:{root}/.venv"
    libraries = ":".join(map(str, built_once.libraries))
    assert environ["PYTHONPATH"] == f"{libraries}:/home/me/laws"
    assert environ["LD_LIBRARY_PATH"] == f"{root}/.venv/lib:/opt/mine"
    assert environ["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert environ["VIRTUAL_ENV"] == f"{root}/.venv"
    assert environ["PATH"].startswith(f"{root}/.venv/bin:")
    assert environ["NUMBA_CACHE_DIR"] == f"{root}/.cache/numba"
    assert environ["PYTHONPYCACHEPREFIX"] == f"{root}/.cache/bytecode"
    assert not {"ROS_DISTRO", "PYTHONDONTWRITEBYTECODE"} & set(environ)


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
    assert workspace.start("run").stderr == ""


def test_failing_build_names_the_package(workspace: Workspace) -> None:
    (workspace.package / "setup.py").write_text(SETUP + "\nraise SystemExit('no')\n")
    _assert_one_sentence(workspace.start("run"), "omni_bringup", str(workspace.log))
    (workspace.package / "setup.py").write_text(SETUP)
    assert workspace.start("run").returncode == 0


def test_invalid_manifest_is_refused(workspace: Workspace) -> None:
    (workspace.package / "package.xml").write_text(PACKAGE.replace("<license>", "<licens>"))
    _assert_one_sentence(workspace.start("run"), "package.xml")


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
    command = [sys.executable, "-u", "-c", code, str(ROOT), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        child = Path(f"/proc/{int(process.stdout.readline())}/stat")
        assert child.exists()
        process.kill()
        process.wait(60)
        # Whoever inherits it may not have asked for its end yet: then it is a zombie.
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


def test_a_demanded_but_missing_ros_is_refused(bare: Workspace) -> None:
    environ = {"ROS_DISTRO": "", "OMNI_ROS": "sourced"}
    _assert_one_sentence(bare.start("run", environ=environ), "setup.bash")
    _assert_one_sentence(bare.start("run", environ={"OMNI_ROS": "x"}), "OMNI_ROS")


# ---------------------------------------------------------------- locks


@pytest.mark.parametrize("name", ["wheels", "sourced-ros"])
def test_locks_are_exact_and_complete(name: str) -> None:
    lock = (ROOT / "requirements" / f"{name}.lock").read_text()
    entries = re.findall(r"(?m)^(\S+)==\S+.*\\\n((?:    --hash=sha256:[0-9a-f]{64}.*\n)+)", lock)
    assert len(entries) == len(re.findall(r"(?m)^\S", lock))  # every line belongs to an entry
    locked = {entry[0] for entry in entries}
    for source in (f"{name}.in", "shared.in"):
        text = (ROOT / "requirements" / source).read_text()
        wanted = re.findall(r"(?m)^([A-Za-z][\w-]*)", text)
        assert {word.lower() for word in wanted} <= locked
    assert "://" not in lock
