"""A small workspace in which tests start the launcher.

Its environment uses the packages of the Python that runs the tests, so that nothing is
downloaded.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from pathlib import Path

from omni_process import WORKSPACE, running

from setup import workspace as places

SETUP = """
from setuptools import setup
from xml.etree import ElementTree

ElementTree.parse("package.xml")
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
        shutil.copy(WORKSPACE / "omni", root / "omni")
        shutil.copytree(WORKSPACE / "setup", root / "setup")
        shutil.copytree(WORKSPACE / "requirements", root / "requirements")
        (root / "pyproject.toml").write_text("[tool.pytest.ini_options]\n")
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
        return self.root / ".cache" / "install"

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
        # All clones import the same files of the libraries, and share their bytecode.
        own = sysconfig.get_path("purelib")
        site = venv / Path(own).relative_to(sys.prefix)
        site.mkdir(parents=True)
        (site / "borrowed.pth").write_text(f"import site; site.addsitedir({own!r})\n")
        bytecode = self.root.parents[1] / "bytecode"
        bytecode.mkdir(exist_ok=True)
        (self.root / ".cache").mkdir()
        (self.root / ".cache" / "bytecode").symlink_to(bytecode)
        shutil.copy(self.root / "requirements" / "development.lock", venv)
        places.write_stamp(venv, places.environment_state(places.Workspace(self.root, None)))

    def borrow_uv(self) -> None:
        (self.root / ".cache").mkdir()
        (self.root / ".cache" / "uv").symlink_to(WORKSPACE / ".cache" / "uv")

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

    def background(self, *words: str) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
        return running(
            self.command(*words),
            cwd=self.root,
            env={**os.environ, "OMNI_ROS": "wheels"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
        )

    @contextlib.contextmanager
    def locked(self, mode: int) -> Iterator[None]:
        (self.root / ".cache").mkdir(exist_ok=True)
        with open(self.root / ".cache" / "lock", "w") as file:
            fcntl.flock(file, mode)
            yield

    def edit(self) -> None:
        with open(self.package / "setup.py", "a") as file:
            file.write("\n")


def assert_one_sentence(result: subprocess.CompletedProcess[str], *parts: str) -> None:
    assert result.returncode == 1
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    last = result.stderr.splitlines()[-1]
    assert last.startswith("omni: ")
    assert last.endswith(".")
    for part in parts:
        assert part in last
