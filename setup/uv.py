"""uv, the program that makes the environment and installs the packages of lock files."""

import ast
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

from setup.steps import Steps
from setup.workspace import Workspace, base_environment

_SECTIONS = ("global", "install", ":env:")  # of pip's settings; a later one replaces the earlier
_SETTINGS = {  # variable of uv for each setting of pip
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "trusted-host": "UV_INSECURE_HOST",
    "cert": "SSL_CERT_FILE",
    "client-cert": "SSL_CLIENT_CERT",
    "keyring-provider": "UV_KEYRING_PROVIDER",
    "proxy": "ALL_PROXY",
    "timeout": "UV_HTTP_TIMEOUT",
    "default-timeout": "UV_HTTP_TIMEOUT",
    "retries": "UV_HTTP_RETRIES",
}
_TRUE = ("1", "true", "True", "yes", "on")
# Every package but empy is published as a wheel. empy is built with the locked setuptools.
_WHEELS = ("--only-binary", ":all:", "--no-binary", "empy", "--no-build-isolation")


class Uv:
    """The program uv with the user's settings of pip."""

    def __init__(self, workspace: Workspace, steps: Steps, python: str) -> None:
        """Find uv on the PATH, or install the locked one with pip.

        Args:
            workspace: workspace whose environment uv changes.
            steps: runs uv and pip.
            python: Python whose pip is used while the environment has none.

        Raises:
            SetupError: There is no pip, or it cannot install uv.
        """
        self._workspace = workspace
        self._steps = steps
        self._environment = base_environment(os.environ, workspace)
        self._environment.pop("PYTHONPATH", None)
        pip = self._find_pip(python)
        self._program = self._find(pip)
        listing = [*map(str, pip), "config", "list"]
        # pip writes warnings about its cache to stderr.
        listed = subprocess.check_output(
            listing, env=self._environment, text=True, stderr=subprocess.DEVNULL
        )
        settings = pip_settings(listed)
        self._no_index = ["--no-index"] if settings.get("no-index") in _TRUE else []
        for name, value in uv_variables(settings).items():
            self._environment.setdefault(name, value)
        # All indexes are searched as by pip, because a hash identifies every file.
        self._environment.setdefault("UV_INDEX_STRATEGY", "unsafe-best-match")
        home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
        if not _may_write(home):
            self._environment.setdefault("UV_CACHE_DIR", str(workspace.cache / "packages"))

    def make_environment(self, python: str) -> None:
        """Make the empty environment of the workspace in its folder, which exists."""
        command = [self._program, "venv", "--allow-existing", "--python", python]
        command += [str(self._workspace.venv)]
        self._steps.check(command, self._environment, "making the environment")

    def install(self, lock: Path) -> None:
        """Install the packages of a lock file, and check every file against its hash."""
        command = [self._program, "pip", "install", "--python", self._workspace.python, "--no-deps"]
        command += ["--require-hashes", *_WHEELS, *self._no_index, "-r", lock]
        self._steps.check(command, self._environment, "installing the packages", _progress())

    def _find_pip(self, python: str) -> list[object]:
        """Return the command of pip: of the environment, of `python`, or one made for uv."""
        for place in (str(self._workspace.python), python):
            probe = [place, "-c", "import pip"]
            if os.path.exists(place) and not subprocess.call(
                probe, env=self._environment, stderr=subprocess.DEVNULL
            ):
                return [place, "-m", "pip"]
        folder = self._workspace.cache / "pip"
        venv = [python, "-m", "venv", "--clear", folder]
        self._steps.check(venv, self._environment, "making an environment for pip")
        return [folder / "bin" / "python", "-m", "pip"]

    def _find(self, pip: list[object]) -> str:
        """Return the path of a uv of the locked series of versions; install it if necessary."""
        lock = self._workspace.requirements / "installer.lock"
        series = " ".join(re.findall(r"(uv)==(\d+\.\d+\.)", lock.read_text())[0])
        own = self._workspace.cache / "uv"
        for folders in (self._environment["PATH"], str(own / "bin")):
            uv = shutil.which("uv", path=folders)
            if uv and subprocess.check_output([uv, "--version"], text=True).startswith(series):
                return uv
        shutil.rmtree(own, ignore_errors=True)
        command = [*pip, "--disable-pip-version-check", "--no-input", "install", "--target", own]
        command += ["--no-deps", "--require-hashes", "--only-binary", ":all:", "--no-compile"]
        command += ["--progress-bar", "off", "-r", lock]
        self._steps.check(command, self._environment, "fetching uv, which installs the packages")
        return str(own / "bin" / "uv")


def pip_settings(listing: str) -> dict[str, str]:
    """Return the settings of ``pip install``.

    Args:
        listing: output of ``pip config list``, with lines such as ``global.timeout='60'``.
    """
    entries = re.findall(r"(?m)^(\S+?)\.([\w-]+)=(.*)$", listing)
    return {
        name: str(ast.literal_eval(value))
        for section in _SECTIONS
        for place, name, value in entries
        if place == section
    }


def uv_variables(settings: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables that give uv the settings of pip."""
    variables = {}
    for name, variable in _SETTINGS.items():
        # Lists are separated by white space in pip, by commas or spaces in uv.
        values = settings.get(name, "").split()
        if values:
            variables[variable] = ("," if name == "find-links" else " ").join(values)
    return variables


def _progress() -> Callable[[str], str | None]:
    """Return a function that returns what uv waits for after each line of its output."""
    waiting: list[str] = []

    def note(line: str) -> str | None:
        found = re.match(r" *(Downloading|Downloaded|Building|Built) ([\w.-]+)", line)
        if found and found.group(1).endswith("ing"):
            waiting.append(found.group(2))
        elif found and found.group(2) in waiting:
            waiting.remove(found.group(2))
        if line.startswith("Prepared"):
            return "unpacking the packages"
        return "waiting for " + ", ".join(waiting[:4]) if waiting else None

    return note


def _may_write(folder: Path) -> bool:
    """Return whether this user may write into a folder, or make it."""
    nearest = next(place for place in (folder, *folder.parents) if place.exists())
    return folder.is_absolute() and os.access(nearest, os.W_OK)
