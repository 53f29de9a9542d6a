"""Make the workspace ready and run the command in it."""

import errno
import fcntl
import os
import shutil
import signal
import time
from collections.abc import Sequence
from pathlib import Path

from setup import workspace as places
from setup.build import build
from setup.environment import install_group, make_environment
from setup.failures import SetupError, explain_file_error
from setup.pythons import say
from setup.steps import Steps


def main(words: Sequence[str], door: str, usage: str) -> int:
    """Run a command; if the set-up fails, print one sentence and return exit code 1.

    Args:
        words: the command and its arguments.
        door: path of the program `omni`, which is in the folder of the workspace.
        usage: help text of the program.
    """
    root = Path(door).parent
    for stream in range(3):
        # A closed standard stream would be replaced by the next file that is opened: by the lock.
        try:
            os.fstat(stream)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # nohup ignores signals
            signal.signal(number, end)
    try:
        if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return start(words, root, usage)
    except SetupError as problem:
        say(str(problem))
    except OSError as error:
        say(explain_file_error(error, root))
    except KeyboardInterrupt:
        say("interrupted; the next start continues from here.")
        return 130
    return 1


def start(words: Sequence[str], root: Path, usage: str) -> int:
    """Make the workspace ready, and replace this process by the command."""
    asks_help = not words or words[0] in ("-h", "--help", "help")
    workspace = places.Workspace(root, places.find_sourced_ros(os.environ, root))
    if asks_help:
        print(usage.rstrip())
        if not all(places.ready(workspace)):
            return 0
        print(flush=True)
        words = ["--help"]
    lock = None
    # If a running command starts `omni`, the build of that command is used, even if files have been
    # edited since.
    within = os.environ.get("OMNI_RUNNING") == str(root)
    if not within:
        lock = open_lock(workspace)
        make_ready(workspace, lock)
    groups = {"test": ["development"], "install": words[1:]}.get(words[0], [])
    for group in groups:
        install_group(workspace, lock, group)
    if words[0] == "install":
        return 0
    environment = places.final_environment(workspace)
    if within or words[0] != "exec":
        environment["OMNI_RUNNING"] = str(root)
    return hand_over(workspace, environment, words, lock)


def make_ready(workspace: places.Workspace, lock: int | None) -> None:
    """Bring environment and build up to date, and hold the shared lock afterward.

    A command keeps the shared lock while it runs, so that no other start rebuilds the packages
    during an experiment.
    """
    while True:
        take_lock(lock, fcntl.LOCK_SH)
        if all(places.ready(workspace)):
            return
        take_lock(lock, fcntl.LOCK_EX)
        environment_ready, build_ready = places.ready(workspace)
        if build_ready:
            continue
        begun = time.monotonic()
        steps = Steps(workspace, lock)
        if not environment_ready:
            make_environment(workspace, steps)
        build(workspace, steps)
        say(f"ready after {time.monotonic() - begun:.0f} s")
        take_lock(lock, fcntl.LOCK_SH)
        return


def open_lock(workspace: places.Workspace) -> int | None:
    """Return the descriptor of the workspace's lock file."""
    path = workspace.cache / "lock"
    try:
        workspace.cache.mkdir(exist_ok=True)
        return os.open(str(path), os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        if path.exists():  # the folder may have become read-only after a set-up
            return os.open(str(path), os.O_RDONLY)
        raise


def take_lock(lock: int | None, mode: int) -> None:
    """Take the lock in a mode of `fcntl.flock`; print a message before waiting for it.

    Do nothing if `lock` is None, or if the file system does not support locks.
    """
    if lock is None:
        return
    try:
        fcntl.flock(lock, mode | fcntl.LOCK_NB)
    except BlockingIOError:
        say("waiting for another start in this folder to finish")
        fcntl.flock(lock, mode)
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.EINVAL, errno.EBADF):
            raise  # on a file system without locks, set-up runs without one


def hand_over(
    workspace: places.Workspace, environment: dict[str, str], words: Sequence[str], lock: int | None
) -> int:
    """Replace this process by the command; return only if the command is not found."""
    python = str(workspace.python)
    if words[0] == "exec":
        command = list(words[1:]) or [python]
        program = shutil.which(command[0], path=environment["PATH"])
        if not program:
            say(
                f"there is no program '{command[0]}' in the environment or on the PATH; "
                "'./omni install development' installs those for tests, lint, types and colcon."
            )
            return 127
    else:
        program = python
        if lock is not None:
            os.set_inheritable(lock, True)
        if words[0] == "test":
            # Only required plugins are loaded, as those of a sourced ROS fail with some pytests.
            environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
            command = [python, "-m", "pytest", "-p", "_hypothesis_pytestplugin", "-p", "xdist"]
            command += ["-c", str(workspace.root / "pyproject.toml"), *words[1:]]
            # Without named files, all tests run on all cores, file by file, because the tests of a
            # file share its recorded runs. There are two more workers than cores, as workers often
            # wait for other processes, but not in the fast tests.
            if not any(os.path.exists(word.split("::")[0]) for word in words[1:]):
                os.chdir(workspace.root)
                if not {"-n", "-k", "--pdb"} & set(words):
                    workers = str(len(os.sched_getaffinity(0)) + (0 if "fast" in words else 2))
                    command += ["-n", workers, "--dist", "loadfile", "--no-loadscope-reorder"]
        else:
            cli = workspace.install / "lib" / "omni_bringup" / "omni"
            command = [python, str(cli), *list(words)]
            # Signals are blocked until the command line can handle them; they are not lost.
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGTERM])
    os.execve(program, command, environment)
