"""Package dependencies have one direction and no cycles, and cores do not import ROS."""

from __future__ import annotations

import ast
import importlib
import re
import typing
from collections import Counter
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from omni_process import WORKSPACE

from omni_core.configuration import Configuration, declared_parameters, without_none

MOST_MODULES = 15  # side by side in a folder, apart from what makes a node of a package
PLUG_INS = {"omni_studies/studies"}  # a file each, found by its name
LONGEST_FILE, LONGEST_FUNCTION = 450, 59  # lines
MOST_NAMES = 6  # imported from one module; a file that needs more of them imports the module
# Packages and folders whose modules may use ROS and the clock, in addition to the nodes.
OF_ROS = ("omni_ros.", "omni_recording.", "omni_bringup.", "omni_core.commands.",
          "omni_runs.graph.", "omni_runs.replay.", "omni_runs.run.", "omni_tools.drive.",
          "omni_tools.node_check.", "omni_tools.commissioning.command",
          "omni_tools.load_estimate.command")  # fmt: skip


def modules() -> dict[str, Path]:
    """Return all installed modules by their dotted names."""
    found = {}
    for package in (WORKSPACE / "src").glob("*/package.xml"):
        folder = package.parent
        for path in sorted((folder / folder.name).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imported(path: Path) -> set[str]:
    """Return the names that a module imports: modules, and names that may be modules."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


@pytest.fixture(scope="module")
def imports() -> dict[str, set[str]]:
    """Return the imports of each module."""
    return {name: imported(path) for name, path in MODULES.items()}


def arrows_of_the_map() -> dict[str, set[str]]:
    """Return the dependencies of each package according to CONTRIBUTING.md."""
    text = (WORKSPACE / "CONTRIBUTING.md").read_text(encoding="utf-8")
    block = re.search(r"## Packages\n.*?```\n(.*?)```", text, re.DOTALL)
    assert block is not None
    lines = (line.split("->") for line in block[1].splitlines())
    return {name.strip(): set(used[0].split()) if used else set() for name, *used in lines}


def test_the_paths_through_the_code_name_existing_files_and_functions() -> None:
    text = (WORKSPACE / "CONTRIBUTING.md").read_text(encoding="utf-8")
    block = re.search(r"\nThese functions convert .*?\n\n(1\. .*?)\n\n\|", text, re.DOTALL)
    assert block is not None
    names = re.findall(r"`([\w./]+)`", block[1])
    files = [name for name in names if name.endswith(".py")]
    code = {
        name: "".join(p.read_text() for p in MODULES.values() if str(p).endswith(f"/{name}"))
        for name in files
    }
    assert all(code.values())
    functions = [name.rpartition(".")[2] for name in names if name not in files]
    assert [name for name in functions if f"def {name}(" not in "".join(code.values())] == []


def knows_ros(name: str) -> bool:
    package, _, module = name.partition(".")
    return package == "omni_ros" or module.endswith("_node") or name.endswith(".messages")


def test_imports_are_the_arrows_of_the_map(imports: dict[str, set[str]]) -> None:
    drawn = arrows_of_the_map()
    assert drawn.keys() == {name.split(".")[0] for name in MODULES}
    used: dict[str, set[str]] = {name: set() for name in drawn}
    for name, names in imports.items():
        package = name.split(".")[0]
        others = {other.split(".")[0] for other in names} & drawn.keys() - {package}
        used[package] |= others
        if "omni_ros" in others and not f"{name}.".startswith(OF_ROS):
            assert knows_ros(name), f"{name}: only a node may need what the nodes share of ROS"
    assert used == drawn
    assert_no_circle(used)


def test_no_package_needs_the_studies_and_no_feature_the_command_of_another(
    imports: dict[str, set[str]],
) -> None:
    for name, names in imports.items():
        own = name.rpartition(".")[0]
        package = name.split(".")[0]
        if package != "omni_studies":
            assert not {other for other in names if other.startswith("omni_studies")}, name
        commands = {other for other in names & MODULES.keys() if other.endswith(".command")}
        if package in ("omni_tools", "omni_studies"):
            assert {other.rpartition(".")[0] for other in commands} <= {own}, name


def test_nothing_is_imported_in_a_circle_and_no_folder_is_crowded(
    imports: dict[str, set[str]],
) -> None:
    assert_no_circle({name: names & MODULES.keys() - {name} for name, names in imports.items()})
    crowds = Counter(
        path.parent.relative_to(WORKSPACE / "src").as_posix().partition("/")[2]
        for path in MODULES.values()
        if path.name not in ("__init__.py", "messages.py") and not path.stem.endswith("_node")
    )
    assert {folder for folder, n in crowds.items() if n > MOST_MODULES} <= PLUG_INS


def test_files_functions_and_lists_of_imported_names_are_short() -> None:
    long = []
    for name, path in MODULES.items():
        text = path.read_text(encoding="utf-8")
        long += [name] if len(text.splitlines()) > LONGEST_FILE else []
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                long += [f"{name}.{node.name}"] if lines > LONGEST_FUNCTION else []
            elif isinstance(node, ast.ImportFrom) and len(node.names) > MOST_NAMES:
                long.append(f"{name}: import the module {node.module}, not its names")
    assert not long


def test_tests_are_in_the_folder_of_what_they_test() -> None:
    for test in (WORKSPACE / "src").glob("*/test/**/test_*.py"):
        package, _, *folders = test.parent.relative_to(WORKSPACE / "src").parts
        assert (WORKSPACE / "src" / package / package).joinpath(*folders).is_dir(), test


def test_folders_inside_a_package_do_not_run_in_circles(imports: dict[str, set[str]]) -> None:
    uses: dict[str, set[str]] = {unit(name): set() for name in MODULES}
    for name, names in imports.items():
        uses[unit(name)] |= {unit(other) for other in names & MODULES.keys()} - {unit(name)}
    assert_no_circle(uses)


def unit(name: str) -> str:
    """Return the folder of a module, or the module itself if it is next to the folders."""
    path = MODULES[name].relative_to(WORKSPACE / "src")
    return ".".join(path.parts[1:-1]) if len(path.parts) > 3 else name


def test_the_quality_of_service_of_each_publisher_can_be_overridden() -> None:
    """Parameters override what `omni_ros.qos.advertise` declares."""
    for name, path in MODULES.items():
        # `node_check` stands for the nodes of a user, `omni_ros` declares the publishers.
        if name.endswith("_node") and "node_check" not in name:
            assert ".create_publisher(" not in path.read_text(encoding="utf-8"), name


def test_every_number_of_a_configuration_has_bounds() -> None:
    """With bounds, no permitted value overflows; seeds are limited to 64 bits."""
    for name in MODULES:
        importlib.import_module(name)
    unbounded = {
        f"{cls.__module__}.{cls.__name__}.{name}"
        for cls in subclasses(Configuration)
        for name, kind, info in declared_parameters(cls)
        if {int, float} & {*typing.get_args(without_none(kind)), without_none(kind)}
        if info.maximum is None or (info.minimum is None and info.above is None)
        if name != "seed" and cls.__module__.startswith(tuple(arrows_of_the_map()))
    }
    # These options are checked by the bounds of `omni_tools.vehicles.estimates.Measured`.
    of_new_vehicle = "omni_tools.vehicles.command.Options."
    assert {name for name in unbounded if not name.startswith(of_new_vehicle)} == set()


def subclasses(cls: type[Configuration]) -> Iterator[type[Configuration]]:
    """Yield all classes derived from a configuration."""
    for derived in cls.__subclasses__():
        yield from (derived, *subclasses(derived))


def assert_no_circle(graph: Mapping[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(f"a circle: {' <- '.join(error.args[1])}") from None


def test_cores_know_no_ros_and_no_clock(imports: dict[str, set[str]]) -> None:
    for name in MODULES:
        if knows_ros(name):
            continue
        roots = {other.split(".")[0] for other in imports[name]}
        assert not {root for root in roots if root == "rclpy" or root.endswith("_msgs")}, name
        # Measuring what a simulation costs takes a clock, and so does waiting for a compilation.
        if not name.startswith(OF_ROS) and not name.endswith((".cost", ".compilation.cache")):
            assert not {"time", "datetime", "logging"} & roots, name


def test_nodes_of_a_vehicle_subscribe_with_a_quality_of_service_that_can_be_overridden() -> None:
    root = Path(__file__).parents[1] / "src"
    own = {"recorder_node.py", "enables_node.py", "exchange_node.py"}  # any topic
    nodes = [path for path in root.glob("*/*/**/*_node.py") if path.name not in own]
    assert len(nodes) > 5
    assert [path.name for path in nodes if "create_subscription(" in path.read_text()] == []
