"""Each package declares its imports, by keys of rosdep or of rosdep.yaml."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from omni_process import WORKSPACE

from omni_core.compilation import NUMBA_SERIES
from setup import release

# Keys of rosdep for what is no ROS package of the same name.
KEYS = {
    "PIL": "python3-pil",
    "dask": "python3-distributed",  # which is made for it and brings it
    "distributed": "python3-distributed",
    "hypothesis": "python3-hypothesis",
    "llvmlite": "python3-llvmlite",
    "lz4": "python3-lz4",
    "matplotlib": "python3-matplotlib",
    "mcap": "python3-mcap",
    "mujoco": "python3-mujoco",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "pyarrow": "python3-pyarrow",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "rocket_fft": "python3-rocket-fft",
    "rosbags": "python3-rosbags",
    "ruamel": "python3-ruamel.yaml",
    "scipy": "python3-scipy",
    "websockets": "python3-websockets",
    "yaml": "python3-yaml",
    "zstandard": "python3-zstandard",
}
# Packages that are used only if they are installed.
OPTIONAL = {"tf2_msgs"}
OF_ROSDEP = {
    "python3-hypothesis",
    "python3-matplotlib",
    "python3-numpy",
    "python3-pil",
    "python3-pytest",
    "python3-rich",
    "python3-ruamel.yaml",
    "python3-scipy",
    "python3-websockets",
    "python3-yaml",
}
PACKAGES = sorted(path.parent for path in (WORKSPACE / "src").glob("*/package.xml"))


def imports(files: Iterable[Path]) -> Iterator[str]:
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                yield node.module.partition(".")[0]


def declared(package: Path, kind: str) -> list[str]:
    root = ElementTree.parse(package / "package.xml").getroot()
    return [str(entry.text) for entry in root.iter(kind)]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_every_import_is_declared_once(package: Path) -> None:
    files = [*(package / package.name).rglob("*.py"), *package.glob("launch/*.py")]
    used = set(imports(files)) - set(sys.stdlib_module_names) - {package.name} - OPTIONAL
    needed = {KEYS.get(name, name) for name in used}
    entries = declared(package, "exec_depend")
    assert len(entries) == len(set(entries))
    assert needed <= set(entries), f"not declared: {sorted(needed - set(entries))}"
    assert {key for key in entries if key.startswith("python3-")} <= needed, "declared in vain"
    of_tests = {KEYS[name] for name in imports((package / "test").rglob("*.py")) if name in KEYS}
    assert sorted(declared(package, "test_depend")) == sorted(of_tests - set(entries))


def names_of_messages(tree: ast.Module) -> dict[str, str]:
    """Return the packages of the message types that a module imports, by type name."""
    imported = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    return {
        alias.name: str(node.module).partition(".")[0]
        for node in imported
        if (node.module or "").endswith("_msgs.msg")
        for alias in node.names
    }


def messages_through_omni_ros(package: Path) -> set[str]:
    """Return the message packages that a package uses through `omni_ros`."""
    shared = WORKSPACE / "src/omni_ros"
    needed: set[str] = set()
    for file in (package / package.name).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or not node.module:
                continue
            module = shared / (node.module.replace(".", "/") + ".py")
            if not node.module.startswith("omni_ros.") or not module.is_file():
                continue
            tree = ast.parse(module.read_text(encoding="utf-8"))
            types = names_of_messages(tree)
            taken = {alias.name for alias in node.names}
            for part in tree.body:
                if getattr(part, "name", None) in taken:
                    used = {name.id for name in ast.walk(part) if isinstance(name, ast.Name)}
                    needed |= {types[name] for name in used & types.keys()}
    return needed


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_messages_sent_through_shared_code_are_declared(package: Path) -> None:
    missing = messages_through_omni_ros(package) - set(declared(package, "exec_depend"))
    assert not missing, f"not declared: {sorted(missing)}"


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_every_python_package_has_a_key(package: Path) -> None:
    rules = yaml.safe_load((WORKSPACE / "rosdep.yaml").read_text(encoding="utf-8"))
    for key in (*declared(package, "exec_depend"), *declared(package, "test_depend")):
        if key.startswith("python3-") and key not in OF_ROSDEP:
            assert rules[key]["ubuntu"]["pip"]["packages"], key
            assert rules[key]["debian"] == rules[key]["ubuntu"]


def test_all_packages_carry_one_version_and_a_license() -> None:
    roots = [ElementTree.parse(package / "package.xml").getroot() for package in PACKAGES]
    assert {root.findtext("version") for root in roots} == {release.version()}
    assert release.outdated() == {}
    for root in roots:
        assert root.findtext("license") == "Apache-2.0"
        assert root.find("maintainer") is not None
        assert root.findtext("export/build_type") == "ament_python"


def test_colcon_test_runs_the_tests_of_the_packages(tmp_path: Path) -> None:
    # By this entry colcon selects pytest; otherwise it looks for unittest's tests.
    shared = (WORKSPACE / "src/omni_core/ament_package.py").read_text()
    assert 'extras_require={"test": ["pytest"]}' in shared
    places = ["--base-paths", "src", "--build-base", str(tmp_path / "build")]
    places += ["--install-base", str(tmp_path / "install")]
    colcon = [str(Path(sys.executable).parent / "colcon"), "--log-base", str(tmp_path / "log")]
    one = ["--packages-select", "omni_core"]
    few = ["--pytest-args", "-k", "kinematics", "-p", "no:cacheprovider"]
    for command in (["build", *places, *one], ["test", *places, *one, *few]):
        subprocess.run([*colcon, *command], cwd=WORKSPACE, check=True, capture_output=True)
    results = ElementTree.parse(tmp_path / "build/omni_core/pytest.xml").getroot()
    suite = results if results.tag == "testsuite" else results[0]
    assert int(suite.get("tests", 0)) > 5
    assert suite.get("failures") == suite.get("errors") == "0"


def test_every_installation_gets_the_series_of_numba_that_the_code_needs() -> None:
    needed = re.escape(NUMBA_SERIES)
    for file, pattern in (
        ("src/omni_core/setup.py", rf'"numba=={needed}\.\*"'),
        ("src/omni_core/package.xml", rf'version_gte="{needed}" version_lt=".*">python3-numba'),
        ("requirements/shared.in", rf"(?m)^numba=={needed}\.\* "),
        ("requirements/wheels.lock", rf"(?m)^numba=={needed}\.\d+ "),
        ("requirements/sourced-ros.lock", rf"(?m)^numba=={needed}\.\d+ "),
    ):
        assert re.search(pattern, (WORKSPACE / file).read_text(encoding="utf-8")), file
